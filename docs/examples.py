# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Run the examples and renew their pages: ./tactile run python docs/examples.py.

A line ``# %%`` begins a part of an example: first comments, which are Markdown, then code.
What the code prints stands below it, and each figure that it leaves open.
"""

from __future__ import annotations

from contextlib import redirect_stdout
import io
from pathlib import Path
import re

import matplotlib as mpl

FOLDER = Path(__file__).with_name('examples')
IMAGES = Path(__file__).with_name('images')


def build_page(script: Path, images: Path) -> str:
    """Run an example; return its page, and write its figures.

    Parameters
    ----------
    script : Path
    images : Path
        Folder for the figures.
    """
    mpl.use('Agg')
    from matplotlib import pyplot as plt

    _, *parts = re.split(r'^# %%\n', script.read_text('utf-8'), flags=re.MULTILINE)
    scope = {'__name__': script.stem}
    page = []
    for part in parts:
        prose = re.match(r'(#.*\n)*', part)[0]
        code = part[len(prose) :].strip()
        page.append(re.sub(r'^# ?', '', prose, flags=re.MULTILINE).strip())
        printed = io.StringIO()
        with redirect_stdout(printed):
            exec(compile(code, str(script), 'exec'), scope)  # noqa: S102 - our own scripts
        page += [f'```python\n{code}\n```'] if code else []
        page += [f'```\n{printed.getvalue().rstrip()}\n```'] if printed.getvalue() else []
        for number in plt.get_fignums():
            image = f'example_{script.stem}_{number}.png'
            plt.figure(number).savefig(images / image, dpi=100, metadata={'Software': None})
            page.append(f'![{script.stem}](../images/{image})')
        plt.close('all')
    source = f'Made by `docs/examples.py` from [{script.name}]({script.name}); SIMULATED numbers.'
    return '\n\n'.join([text for text in page if text] + [source]) + '\n'


def main() -> None:
    for script in sorted(FOLDER.glob('*.py')):
        script.with_suffix('.md').write_text(build_page(script, IMAGES), 'utf-8')


if __name__ == '__main__':
    main()
