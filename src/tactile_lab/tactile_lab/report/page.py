# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report as one HTML file that needs no other."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template

from tactile_lab.report.figures.drawing import Drawing

_TEMPLATE = Template((Path(__file__).parent / 'page.html').read_text(encoding='utf-8'))


class Page:
    """Collects the parts of a report, top to bottom. All text is escaped here."""

    def __init__(self, title: str, *, simulated: bool) -> None:
        self._title = title
        self._simulated = simulated
        self._parts: list[str] = []
        self._contents: list[str] = []
        self._end = ''

    def heading(self, text: str, *, folded: bool = False) -> None:
        """Begin a section; a folded one opens by a click on its heading or its link."""
        name = f's{len(self._contents) + 1}'
        self._contents.append(f'<li><a href="#{name}">{escape(text)}</a></li>')
        self._parts.append(self._end)
        if folded:
            # Browsers open what encloses the target of a link.
            self._parts.append(f'<details><summary>{escape(text)}</summary><div id="{name}">')
        else:
            self._parts.append(f'<h2 id="{name}">{escape(text)}</h2>')
        self._end = '</div></details>' if folded else ''

    def subheading(self, text: str) -> None:
        """Begin a part of a section."""
        self._parts.append(f'<h3>{escape(text)}</h3>')

    def paragraph(self, text: str) -> None:
        """Add a paragraph."""
        self._parts.append(f'<p>{escape(text)}</p>')

    def items(self, texts: Sequence[str]) -> None:
        """Add a list."""
        lines = ''.join(f'<li>{escape(text)}</li>' for text in texts)
        self._parts.append(f'<ul>{lines}</ul>')

    def table(
        self, caption: str, header: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1
    ) -> None:
        """Add a table.

        Parameters
        ----------
        caption : str
            Names split and scaling of what stands in it; "SIMULATED" is put before it.
        words : int
            How many columns from the left hold words; the others hold numbers.
        """
        label = 'SIMULATED. ' if self._simulated else ''
        head = ''.join(f'<th scope="col">{escape(text)}</th>' for text in header)
        body = []
        for row in rows:
            cells = [
                f'<td{"" if i < words else " class=n"}>{escape(text)}</td>'
                for i, text in enumerate(row)
            ]
            body.append(f'<tr>{"".join(cells)}</tr>')
        self._parts.append(
            f'<div class="wide"><table><caption>{escape(label + caption)}</caption>'
            f'<thead><tr>{head}</tr></thead><tbody>{"".join(body)}</tbody></table></div>'
        )

    def drawing(self, drawing: Drawing) -> None:
        """Add a figure below the sentence that says what one sees."""
        self._parts.append(
            f'<figure><figcaption>{escape(drawing.caption)}</figcaption>'
            f'<div class="wide">{drawing.svg}</div></figure>'
        )

    def to_html(self) -> str:
        """Return the whole file."""
        banner = (
            '<p class="banner">SIMULATED: every number and figure on this page comes, wholly or '
            'in part, from a simulated rig. None is a measurement of a real finger.</p>'
            if self._simulated
            else ''
        )
        return _TEMPLATE.substitute(
            title=escape(self._title),
            banner=banner,
            contents=''.join(self._contents),
            body='\n'.join([*self._parts, self._end]),
        )
