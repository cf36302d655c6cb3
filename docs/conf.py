# Copyright 2026 Tendon Tactile maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the documentation site, which `./tactile docs` builds with Sphinx.

The source folder is the root of the repository, so links between pages, README and CONTRIBUTING
work both on the site and in the repository.
"""

import importlib
from pathlib import Path
import re

ROOT = Path(__file__).resolve().parent.parent

project = 'Tendon Tactile'
author = 'Tendon Tactile maintainers'
copyright = f'2026, {author}'
manifest = (ROOT / 'src' / 'tactile_bringup' / 'package.xml').read_text()
release = version = re.search(r'<version>(.*?)</version>', manifest).group(1)

root_doc = 'docs/index'
folders = ('decisions', 'examples', 'tutorials')
include_patterns = ['*.md', 'docs/*.md', 'docs/*.rst', *(f'docs/{name}/*.md' for name in folders)]
exclude_patterns = ['.*', '**/.*', 'src', 'build', 'install', 'log']
extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.napoleon',
]

# Pages link to headings with the anchors of GitHub.
myst_heading_anchors = 4
myst_enable_extensions = ['deflist']

autodoc_default_options = {'members': True, 'show-inheritance': True}
autodoc_member_order = 'bysource'
autodoc_typehints = 'signature'
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False

html_theme = 'sphinx_rtd_theme'
html_title = f'{project} {release}'
html_show_sourcelink = False
html_copy_source = False


# Packages import their modules on first use, but autodoc only finds imported names.
for package in (
    'linear_guide_driver',
    'tactile_analysis',
    'tactile_bags',
    'tactile_classifier',
    'tactile_features',
    'tactile_sim',
    'tendon_sensor_driver',
):
    module = importlib.import_module(package)
    for part in module.__all__:
        setattr(module, part, getattr(module, part))


def add_contents(app, name, source):
    """Add hidden tables of contents to the index page, with the links of its lists."""
    if name != root_doc:
        return
    tables = re.findall(r'^## (.+)\n\n((?:- .*\n)+)', source[0], re.MULTILINE)
    for caption, rows in tables:
        pages = [
            page.rsplit('.', 1)[0]
            for page in re.findall(r'\]\(([^):]+)\)', rows)
            if '#' not in page
        ]
        if 'architecture' in pages:
            pages.insert(pages.index('architecture') + 1, 'decisions/*')
        source[0] += '\n'.join(
            [
                '',
                '```{toctree}',
                ':hidden:',
                ':glob:',
                f':caption: {caption.capitalize()}',
                '',
                *pages,
                '```',
                '',
            ]
        )


def skip_requests(app, what, name, obj, skip, options):
    """Omit methods such as ``set_fit_request``, which scikit-learn generates."""
    return True if re.fullmatch(r'set_\w+_request', name) else None


def setup(app):
    app.connect('autodoc-skip-member', skip_requests)
    app.connect('source-read', add_contents)
