# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
"""Datasets, training, evaluation, the ONNX model file and the classifier node."""
