"""Docstrings as they are written here, for Sphinx: plain bars in formulas, several attributes on one line."""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

_LITERAL = re.compile(r"(``.*?``|`.*?`)")
_SEVERAL = re.compile(r"\w+(?:, \w+)+")
# Stands for the blank between two names until all is read: before a blank Sphinx looks for a type.
_BLANK = "\ue000"


def plain_bars(line: str) -> str:
    """``line`` with every bar outside code taken as a bar: |r| asks for no substitution."""
    parts = _LITERAL.split(line)
    return "".join(part if number % 2 else part.replace("|", r"\|") for number, part in enumerate(parts))


def _prepare(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    lines[:] = [line.replace(", ", f",{_BLANK}") if _SEVERAL.fullmatch(line) else plain_bars(line) for line in lines]


def _restore(_app: Sphinx, doctree: nodes.document) -> None:
    for text in list(doctree.findall(nodes.Text)):
        if _BLANK in text:
            text.parent.replace(text, nodes.Text(text.replace(_BLANK, " ")))


def setup(app: Sphinx) -> ExtensionMetadata:
    """Prepare before anything else looks at the docstring."""
    app.connect("autodoc-process-docstring", _prepare, priority=1)
    app.connect("doctree-read", _restore)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
