"""Adapt docstrings for Sphinx: plain bars in formulas, several attributes on one line.

Signatures use the short type names of the sources.
"""

from __future__ import annotations

import re

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

_LITERAL = re.compile(r"(``.*?``|`.*?`)")
_SEVERAL = re.compile(r"\w+(?:, \w+)+")
# Placeholder for the blank between two names while Sphinx parses: Sphinx interprets the word before a blank as a type.
_BLANK = "\ue000"


# Evaluated annotation -> short name in the sources.
_ARRAY = r"~?(?:numpy\.)?ndarray\[tuple\[~?(?:typing\.)?Any, \.\.\.\], ~?(?:numpy\.)?dtype\[~?(?:numpy\.)?"
_SHORT = {
    re.compile(_ARRAY + r"float64\]\]"): "FloatArray",
    re.compile(_ARRAY + r"(\w+)\]\]"): r"NDArray[\1]",
    re.compile(r"\S*_Buffer \| .*?_NestedSequence\[complex \| bytes \| str\]"): "ArrayLike",
    re.compile(r"\S*Axis\(name='yaw'.*?rights=False\)"): "YAW",
    re.compile(r"<factory>"): "...",
}


def plain_bars(line: str) -> str:
    """``line`` with escaped bars outside code, because Sphinx reads |r| as a substitution."""
    parts = _LITERAL.split(line)
    return "".join(part if number % 2 else part.replace("|", r"\|") for number, part in enumerate(parts))


def _prepare(_app: Sphinx, _what: str, _name: str, _obj: object, _options: object, lines: list[str]) -> None:
    lines[:] = [line.replace(", ", f",{_BLANK}") if _SEVERAL.fullmatch(line) else plain_bars(line) for line in lines]


def _shorten(
    _app: Sphinx, _what: str, _name: str, _obj: object, _options: object, signature: str | None, returned: str | None
) -> tuple[str | None, str | None]:
    for pattern, short in _SHORT.items():
        signature = None if signature is None else pattern.sub(short, signature)
        returned = None if returned is None else pattern.sub(short, returned)
    return signature, returned


def _restore(_app: Sphinx, doctree: nodes.document) -> None:
    for text in list(doctree.findall(nodes.Text)):
        if _BLANK in text:
            text.parent.replace(text, nodes.Text(text.replace(_BLANK, " ")))


def setup(app: Sphinx) -> ExtensionMetadata:
    """Connect the handlers, with the docstring handler first."""
    app.connect("autodoc-process-docstring", _prepare, priority=1)
    app.connect("autodoc-process-signature", _shorten)
    app.connect("doctree-read", _restore)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
