# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The live page and its terminal twin: what every finger feels, as it comes."""
