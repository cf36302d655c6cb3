# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0
import sys
from pathlib import Path

# What the launch tests share lies beside them and is no part of the package.
sys.path.insert(0, str(Path(__file__).parent))
