# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Speed against error of what this workspace computes. See docs/benchmarks.md."""
