# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

from pathlib import Path
import sys

# Modules that several tests share are in the folder of the tests and not part of the package.
sys.path.insert(0, str(Path(__file__).parent))
