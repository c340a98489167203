"""Pages that keep the rules of axe-core, where the theme or Sphinx breaks them."""

from __future__ import annotations

import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

_MENDED = {
    # Captions of the list of pages.
    r'<p class="caption" role="heading">': '<p class="caption" role="heading" aria-level="2">',
    r'<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="All pages">',
    r'<aside class="toc-drawer([^"]*)">': r'<aside class="toc-drawer\1" aria-label="This page">',
    # The keyboard scrolls what is wider than the screen.
    r"<pre>": '<pre tabindex="0">',
    r'<div class="formulas">': '<div class="formulas" tabindex="0" role="group" aria-label="Formulas">',
    r'<th class="head"><p></p></th>': "<td></td>",
}


def _mend(app: Sphinx, error: Exception | None) -> None:
    if error is not None or app.builder.format != "html":
        return
    for page in Path(app.outdir).rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        for wrong, right in _MENDED.items():
            text = re.sub(wrong, right, text)
        page.write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> ExtensionMetadata:
    """Connect the handler to the end of the build."""
    app.connect("build-finished", _mend)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
