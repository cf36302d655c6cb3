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

from pathlib import Path
import sys

ROOT = Path(__file__).resolve().parent.parent
NOTICE = Path(__file__).read_text(encoding='utf-8').partition('\n\n')[0]


def main() -> int:
    missing = [
        path.relative_to(ROOT)
        for folder in ('benchmarks', 'docs', 'src', 'tools')
        for path in sorted((ROOT / folder).rglob('*.py'))
        if not path.read_text(encoding='utf-8').startswith(NOTICE)
    ]
    for path in missing:
        print(f'{path} does not begin with the notice that tools/headers.py begins with')
    return 1 if missing else 0


if __name__ == '__main__':
    sys.exit(main())
