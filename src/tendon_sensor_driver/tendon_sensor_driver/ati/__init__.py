# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force sensors of ATI: Net F/T and Digital F/T."""
