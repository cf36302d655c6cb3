# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Options and help of the `tactile` command.

Ubuntu 24.04 has Typer 0.9, which refuses ``X | None`` and does not look into annotations that
are strings. So modules with options have ``Optional[X]``, and no ``from __future__ import
annotations``.
"""
