"""Docstrings write |r| and mean it; reStructuredText would look for a substitution."""

from __future__ import annotations

import re

from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

_LITERAL = re.compile(r"(``.*?``|`.*?`)")


def plain_bars(line: str) -> str:
    """``line`` with every bar outside code taken as a bar."""
    parts = _LITERAL.split(line)
    return "".join(part if number % 2 else part.replace("|", r"\|") for number, part in enumerate(parts))


def _escape(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    lines[:] = [plain_bars(line) for line in lines]


def setup(app: Sphinx) -> ExtensionMetadata:
    """Escape before anything else looks at the docstring."""
    app.connect("autodoc-process-docstring", _escape, priority=1)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
