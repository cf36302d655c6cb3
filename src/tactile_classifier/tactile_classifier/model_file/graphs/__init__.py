# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parts of a model as ONNX graphs of plain operators in double precision."""
