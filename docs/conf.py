"""Sphinx configuration: ``make docs``, or ``sphinx-build -W -b html docs build/docs``.

The pages are also read offline, for example from a USB stick aboard. They load nothing from the
network, and formulas are drawn at build time.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT))

import rovid  # noqa: E402 - needs the path above

project = "rovid"
author = "the rovid developers"
project_copyright = author
version = release = rovid.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "docs.extensions.formulas",
    "docs.extensions.generated",
    "docs.extensions.docstrings",
    "docs.extensions.search",
    "docs.extensions.accessible",
]
source_suffix = {".md": "markdown"}
default_role = "literal"
nitpicky = False

myst_enable_extensions = ["deflist", "dollarmath"]
myst_heading_anchors = 3
html_math_renderer = "drawn"

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 88
add_module_names = False
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_attr_annotations = False
napoleon_use_rtype = False

html_theme = "furo"
html_title = f"rovid {release}"
html_static_path = ["_static"]
templates_path = ["_templates"]
html_css_files = ["rovid.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_show_copyright = False
