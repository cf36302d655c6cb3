# Copyright 2026 Tendon Tactile maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Check that every Python file begins with the notice of the licence, as ament_copyright asks."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
NOTICE = Path(__file__).read_text(encoding='utf-8').partition('\n\n')[0]


def main() -> int:
    names = subprocess.run(
        ['git', 'ls-files', '*.py'], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.splitlines()
    missing = [
        name
        for name in names
        if (ROOT / name).is_file()
        and not (ROOT / name).read_text(encoding='utf-8').startswith(NOTICE)
    ]
    for name in missing:
        print(f'{name} does not begin with the notice that tools/headers.py begins with')
    return 1 if missing else 0


if __name__ == '__main__':
    sys.exit(main())
