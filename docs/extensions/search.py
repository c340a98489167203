"""Search that shows excerpts, also where the pages are opened as local files.

The search of Sphinx requests each page again for its excerpt, which browsers refuse for local files. Here the text of
every section, and of every row of a table, is written to ``_static/sections.js``, and ``_static/search.js`` ranks it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

# Page whose sections are questions that users ask, and answers.
_QUESTIONS = "questions"
# Page, anchor, title, text; as the page shows them.
Entry = tuple[str, str, str, str]


def entries(doctree: nodes.document, page: str) -> Iterator[Entry]:
    """The sections of a page, and the rows of its tables, which are titled by their first cell."""
    for section in doctree.findall(nodes.section):
        title = section.next_node(nodes.title)
        anchor = section["ids"][0]
        # A comment in Markdown is raw HTML.
        own = [child for child in section.children if not isinstance(child, nodes.section | nodes.title | nodes.raw)]
        yield page, anchor, "" if title is None else title.astext(), " ".join(map(_text, own))
        for child in own:
            for row in child.findall(nodes.row):
                cells = [_text(cell) for cell in row.children]
                if isinstance(row.parent, nodes.tbody) and len(cells) > 1:
                    yield page, anchor, cells[0], " ".join(cells[1:])


def _text(node: nodes.Node) -> str:
    """The text that a reader sees, on one line."""
    shown = node.deepcopy()
    for raw in list(shown.findall(nodes.raw)):  # Tags of HTML
        raw.parent.remove(raw)
    return " ".join(shown.astext().split())


def _write(app: Sphinx, error: Exception | None) -> None:
    if error is not None or app.builder.format != "html":
        return
    pages = [page for page in sorted(app.env.found_docs) if "nosearch" not in app.env.metadata[page]]
    titles = {page: app.env.titles[page].astext() for page in pages}
    found = [entry for page in pages for entry in entries(app.env.get_doctree(page), page)]
    document = {"pages": titles, "questions": _QUESTIONS, "entries": found}
    target = Path(app.outdir, "_static", "sections.js")
    target.write_text(f"var SECTIONS = {json.dumps(document, ensure_ascii=False)};\n", encoding="utf-8")


def setup(app: Sphinx) -> ExtensionMetadata:
    """Connect the handler to the end of the build."""
    app.connect("build-finished", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
