# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""What each node is made of: lifecycle, parameters, guarded messages, goals and requests."""
