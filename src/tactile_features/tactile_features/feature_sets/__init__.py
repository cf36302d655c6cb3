# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sets of features, one module each, and the registry that finds them by name."""
