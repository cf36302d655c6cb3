# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The one way that a model's graph is run: onnxruntime, one thread, limited memory and work."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from math import prod
from typing import Any

from tactile_classifier.errors import ModelFileError

MAX_INFERENCE_BYTES = 256 * 2**20
"""Most that the models of a process take together while they answer [byte]: a graph of a
few bytes can ask for any amount."""

MAX_VALUES = 2**24
"""Most values that a graph computes for one window."""

MAX_PRODUCTS = 2**30
"""Most multiplications in its products of matrices for one window: a second on a slow computer."""


@lru_cache(maxsize=1)
def _limit_memory() -> None:
    """Give all models of this process one arena of `MAX_INFERENCE_BYTES`."""
    import onnxruntime

    kind = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR
    memory = onnxruntime.OrtMemoryInfo('Cpu', kind, 0, onnxruntime.OrtMemType.DEFAULT)
    default = -1  # of onnxruntime: how it grows, and in which steps
    limits = onnxruntime.OrtArenaCfg(MAX_INFERENCE_BYTES, default, default, default)
    onnxruntime.create_and_register_allocator(memory, limits)


def open_session(data: bytes) -> Any:
    """Return an onnxruntime session on the graph, with limited memory and one thread.

    Raises ModelFileError when the graph cannot be loaded, or asks for too much.
    """
    import onnxruntime

    _check_work(data)

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1  # one row: a thread pool costs more than it brings
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what goes wrong comes as an exception
    _limit_memory()
    options.add_session_config_entry('session.use_env_allocators', '1')
    try:
        return onnxruntime.InferenceSession(
            data,
            options,
            providers=['CPUExecutionProvider'],
            # It computes what is constant while loading, in memory that nobody limits.
            disabled_optimizers=['ConstantFolding'],
        )
    except Exception as error:
        raise ModelFileError(f'onnxruntime cannot load its graph: {error}') from error


def _check_work(data: bytes) -> None:
    """Refuse a graph that computes too much for one window, before anything is computed."""
    import onnx
    from onnx.shape_inference import infer_shapes

    model = onnx.ModelProto.FromString(data)
    del model.graph.value_info[:]  # what it claims does not count
    for value in model.graph.input:
        for dimension in value.type.tensor_type.shape.dim:
            if not dimension.HasField('dim_value'):
                dimension.dim_value = 1  # one window
    for value in model.graph.output:
        value.type.tensor_type.ClearField('shape')
    try:
        model = infer_shapes(model, check_type=True, strict_mode=True, data_prop=True)
    except Exception as error:  # several kinds, of C++
        raise ModelFileError(f'the shapes in its graph do not fit: {error}') from None
    values, products = _count_work(model.graph, {})
    if values > MAX_VALUES or products > MAX_PRODUCTS:
        raise ModelFileError(
            f'its graph computes {values:,} values with {products:,} multiplications for one '
            f'window; the limits are {MAX_VALUES:,} and {MAX_PRODUCTS:,}'
        )


def _count_work(graph: Any, outer: Mapping[str, list[int]]) -> tuple[int, int]:
    """Return how many values a graph computes, and the multiplications of its matrix products."""
    shapes = dict(outer)
    shapes |= {tensor.name: list(tensor.dims) for tensor in graph.initializer}
    for value in (*graph.input, *graph.value_info, *graph.output):
        dimensions = value.type.tensor_type.shape.dim
        if all(dimension.HasField('dim_value') for dimension in dimensions):
            shapes[value.name] = [dimension.dim_value for dimension in dimensions]
    values = products = 0
    for node in graph.node:
        for attribute in node.attribute:
            if attribute.HasField('g'):
                inner = _count_work(attribute.g, shapes)
                values, products = values + inner[0], products + inner[1]
        for name in filter(None, node.output):
            if name not in shapes:
                raise ModelFileError(f'the size of "{name}" in its graph cannot be known')
            size = prod(shapes[name])
            values += size
            if node.op_type == 'MatMul':
                products += size * prod(shapes[node.input[0]][-1:])
    return values, products
