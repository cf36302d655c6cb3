# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Run the examples and update their pages: ./tactile run python docs/examples.py.

A line ``# %%`` starts a part of an example, which has comments in Markdown and then code. The page
shows the text, the code, its output and its figures. A notebook with the same parts as cells is
written next to the page.
"""

from __future__ import annotations

from contextlib import redirect_stdout
import io
import json
import os
from pathlib import Path
import re
from typing import Any

import matplotlib as mpl

FOLDER = Path(__file__).with_name('examples')
IMAGES = Path(__file__).with_name('images')


def read_parts(script: Path) -> list[tuple[str, str]]:
    """Return prose (Markdown) and code of each part of an example."""
    _, *parts = re.split(r'^# %%\n', script.read_text('utf-8'), flags=re.MULTILINE)
    prose = [re.match(r'(#.*\n)*', part)[0] for part in parts]
    return [
        (re.sub(r'^# ?', '', text, flags=re.MULTILINE).strip(), part[len(text) :].strip())
        for text, part in zip(prose, parts, strict=True)
    ]


def build_notebook(script: Path) -> str:
    """Return an example as a notebook (nbformat 4.5) without outputs."""
    cells: list[dict[str, Any]] = []
    for prose, code in read_parts(script):
        for kind, text in (('markdown', prose), ('code', code)):
            if not text:
                continue
            cell: dict[str, Any] = {'cell_type': kind, 'id': f'cell-{len(cells)}', 'metadata': {}}
            cell['source'] = text.splitlines(keepends=True)
            if kind == 'code':
                cell |= {'execution_count': None, 'outputs': []}
            cells.append(cell)
    kernel = {'display_name': 'Python 3', 'language': 'python', 'name': 'python3'}
    notebook = {'cells': cells, 'metadata': {'kernelspec': kernel}}
    return json.dumps({**notebook, 'nbformat': 4, 'nbformat_minor': 5}, indent=1) + '\n'


def build_page(script: Path, images: Path) -> str:
    """Run an example, write its figures, and return its page.

    Parameters
    ----------
    script : Path
    images : Path
        Folder for the figures.
    """
    mpl.use('Agg')
    from matplotlib import pyplot as plt

    scope = {'__name__': script.stem}
    page = []
    for prose, code in read_parts(script):
        page.append(prose)
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
    source = (
        f'Made by `docs/examples.py` from [{script.name}]({script.name}); also a '
        f'[notebook]({script.stem}.ipynb). SIMULATED numbers.'
    )
    return '\n\n'.join([text for text in page if text] + [source]) + '\n'


def main() -> None:
    # Without public recordings, the pages show only SIMULATED numbers.
    os.environ.pop('TACTILE_DATA', None)
    for script in sorted(FOLDER.glob('*.py')):
        script.with_suffix('.ipynb').write_text(build_notebook(script), 'utf-8')
        script.with_suffix('.md').write_text(build_page(script, IMAGES), 'utf-8')


if __name__ == '__main__':
    main()
