"""Names and text from elsewhere in the files that rovid writes: one function for each format."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Collection, Sequence
from csv import writer
from html import escape

from rovid.core.errors import escape_invisible, is_visible

# MATLAB's limit of a field's name, the narrowest of those that take identifiers.
_LONGEST = 63
# Where a spreadsheet sees a formula begin: ahead of a cell, and of what some countries' settings take for one.
_FORMULA = re.compile(r"(?:^|[;,|])\s*(?=[=+@-])")


def encodable(text: str) -> str:
    """``text`` with what UTF-8 cannot hold, as of a file's name in another encoding, as an escape."""
    return text.encode("utf-8", "backslashreplace").decode()


def json_lines(text: str) -> str:
    """A JSON document with what is not visible in its strings as JSON's own escapes."""
    return "\n".join(map(_json_line, text.split("\n")))


def _json_line(line: str) -> str:
    # Most lines are, and a look at each sign takes long.
    if line.isprintable():
        return line
    return "".join(map(_json_sign, line))


def _json_sign(sign: str) -> str:
    if is_visible(sign):
        return sign
    return json.dumps(sign)[1:-1]


def xml_attribute(text: str) -> str:
    """An attribute's value with its quotes."""
    return f'"{escape(_xml_signs(text))}"'


def xml_comment(text: str) -> str:
    """Text for a comment, which may hold no two hyphens in a row."""
    return re.sub("-(?=-)", "- ", escape(_xml_signs(text), quote=False))


def _xml_signs(text: str) -> str:
    """``text`` in signs that XML can hold, and without what xacro and Stonefish would work out: ${…} and $(…)."""
    return re.sub(r"\$(?=[{(])", "$ ", escape_invisible(text))


def toml_text(text: str) -> str:
    """A string with its quotes, for TOML and for YAML, which read the same escapes."""
    return f'"{"".join(map(_toml_sign, encodable(text)))}"'


def toml_key(text: str) -> str:
    """``text`` as a key of TOML."""
    return text if text.isascii() and text.isidentifier() else toml_text(text)


def _toml_sign(sign: str) -> str:
    if sign in '"\\':
        return "\\" + sign
    if is_visible(sign):
        return sign
    return _code_of(sign)


def _code_of(sign: str) -> str:
    code = ord(sign)
    if code < 0x10000:
        return f"\\u{code:04X}"
    return f"\\U{code:08X}"


def python_docstring(text: str) -> str:
    """Text within three double quotes; a name by itself is a string literal by `repr`."""
    return escape_invisible(text).replace("\\", "\\\\").replace('"', "'")


def csv_line(cells: Sequence[str]) -> str:
    """Names as a line of CSV without its end.

    One that a spreadsheet would take for a formula gets an apostrophe in front, which spreadsheets take for text.
    """
    line = io.StringIO()
    writer(line, lineterminator="").writerow([_csv_cell(escape_invisible(cell)) for cell in cells])
    return line.getvalue()


def _csv_cell(text: str) -> str:
    return _FORMULA.sub(r"\g<0>'", text)


def identifiers(names: Sequence[str], *, taken: Collection[str] = ()) -> list[str]:
    """Each of ``names`` as XML, YAML, topics and programs take it; no two alike, and none of those ``taken``."""
    return _distinct([_identifier(name) for name in names], taken)


def _identifier(name: str) -> str:
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)
    begins_well = re.match("[A-Za-z_]", plain)
    return plain if begins_well else f"_{plain}"


def field_names(names: Sequence[str], *, taken: Collection[str] = ()) -> list[str]:
    """Each of ``names`` as a column or field, letters of any script kept; no two alike, and none of those ``taken``."""
    return _distinct([re.sub(r"\W+", "_", name) for name in names], taken)


def _distinct(names: Sequence[str], taken: Collection[str]) -> list[str]:
    """Each of ``names``, not too long; the second of a name and what is ``taken`` with a number behind."""
    gone = set(taken)
    # What is another's own name stays that one's.
    own = gone.union(names)
    last: dict[str, int] = {}
    given = []
    for name in names:
        start = one = name[:_LONGEST]
        if one in gone:
            # All numbers up to the last that its like got are gone.
            one, last[start] = _numbered(start, last.get(start, 1), own)
        gone.add(one)
        own.add(one)
        given.append(one)
    return given


def _numbered(start: str, last: int, gone: Collection[str]) -> tuple[str, int]:
    """``start`` with the first number behind ``last`` that makes it another name, and that number."""
    number = last + 1
    while (one := _ended(start, f"_{number}")) in gone:
        number += 1
    return one, number


def _ended(start: str, end: str) -> str:
    return start[: _LONGEST - len(end)] + end
