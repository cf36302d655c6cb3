# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path
import sys

# Helpers of the launch tests are in this folder, which is not part of the package.
sys.path.insert(0, str(Path(__file__).parent))
