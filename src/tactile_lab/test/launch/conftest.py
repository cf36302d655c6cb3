# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path
import sys

# What the launch tests share lies beside them and is no part of the package.
sys.path.insert(0, str(Path(__file__).parent))
