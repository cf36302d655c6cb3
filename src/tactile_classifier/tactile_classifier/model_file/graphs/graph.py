# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""An ONNX graph under construction: operators and constants, in double precision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Shape = tuple[type, Sequence[int | None]]
"""Type of a tensor, ``float`` (double) or ``int`` (int64), and its shape; None: any."""


class Graph:
    """Nodes and constants; tensors go by name.

    Parameters
    ----------
    prefix : str
        Of all names: those of a branch must not be those of the graph around it.
    """

    def __init__(self, prefix: str = '') -> None:
        self._prefix = prefix
        self._nodes: list[Any] = []
        self._constants: list[Any] = []

    def name(self, stem: str) -> str:
        """Return a name of this graph."""
        return f'{self._prefix}{stem}'

    def constant(self, value: npt.ArrayLike) -> str:
        """Add a constant; return its name."""
        from onnx import numpy_helper

        name = self.name(f'c{len(self._constants)}')
        self._constants.append(numpy_helper.from_array(np.asarray(value), name))
        return name

    def add(self, op_type: str, *inputs: str, output: str = '', **attributes: Any) -> str:
        """Add an operator; return the name of its output."""
        output = output or self.name(f't{len(self._nodes)}')
        self.add_many(op_type, inputs, [output], **attributes)
        return output

    def add_many(
        self, op_type: str, inputs: Sequence[str], outputs: Sequence[str], **attributes: Any
    ) -> None:
        """Add an operator of several outputs."""
        from onnx import helper

        self._nodes.append(helper.make_node(op_type, inputs, outputs, **attributes))

    def embed(self, model: Any, x: str) -> str:
        """Add another model with ``x`` for its one input; return its output, as doubles."""
        from onnx import TensorProto
        from onnx.compose import add_prefix_graph

        inner = add_prefix_graph(model.graph, self.name(f'e{len(self._nodes)}_'))
        self.add('Identity', x, output=inner.input[0].name)
        self._nodes.extend(inner.node)
        self._constants.extend(inner.initializer)
        return self.add('Cast', inner.output[0].name, to=TensorProto.DOUBLE)

    def to_proto(self, inputs: Mapping[str, Shape], outputs: Mapping[str, Shape]) -> Any:
        """Return the graph alone, as a model holds it or a branch is."""
        from onnx import helper, TensorProto

        types = {float: TensorProto.DOUBLE, int: TensorProto.INT64}

        def tensors(shapes: Mapping[str, Shape]) -> list[Any]:
            return [
                helper.make_tensor_value_info(name, types[kind], shape)
                for name, (kind, shape) in shapes.items()
            ]

        return helper.make_graph(
            self._nodes,
            self.name('graph'),
            tensors(inputs),
            tensors(outputs),
            initializer=self._constants,
        )
