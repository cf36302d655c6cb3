# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The one way that a model's graph is run: onnxruntime, one thread, limited memory."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from tactile_classifier.errors import ModelFileError

MAX_INFERENCE_BYTES = 256 * 2**20
"""Most that the models of a process take together while they answer [byte]: a graph of a
few bytes can ask for any amount."""


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

    Raises
    ------
    ModelFileError
        When the graph cannot be loaded.
    """
    import onnxruntime

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
