"""Text of results and text from files: JSON, rounded numbers, escapes of each format, and the safe terminal."""

import io
import json
import math
import re
import tomllib
from collections.abc import Collection, Sequence
from csv import writer
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

from rovid.core.errors import LINE_LENGTH, display_text, escape_invisible

# Characters; MATLAB's limit for a field's name, the narrowest of all formats with identifiers.
_MAX_LENGTH = 63
# A byte that is no text, as `encodable` writes it.
_ESCAPED_BYTE = re.compile(r"\\udc([89a-f][0-9a-f])")
# Where a spreadsheet may begin a formula: at the start of a cell, and after the separators of some countries' settings.
_FORMULA_START = re.compile(r"(?:^|[;,|])\s*(?=[=+@-])")


def encodable(text: str) -> str:
    """``text`` with escapes for what UTF-8 cannot hold, such as parts of a file name in another encoding."""
    return text.encode("utf-8", "backslashreplace").decode()


def decoded(text: str) -> str:
    """``text`` as it was before `encodable`."""
    return _ESCAPED_BYTE.sub(lambda byte: chr(0xDC00 + int(byte[1], 16)), text)


def json_lines(text: str) -> str:
    """A JSON document with JSON escapes for the invisible characters in its strings."""
    return "\n".join(escape_invisible(line, lambda character: json.dumps(character)[1:-1]) for line in text.split("\n"))


def xml_attribute(text: str) -> str:
    """An XML attribute value with its quotes."""
    return f'"{escape(_xml_text(text))}"'


def xml_comment(text: str) -> str:
    """Text of an XML comment, which must not contain two hyphens in a row."""
    return re.sub("-(?=-)", "- ", escape(_xml_text(text), quote=False))


def _xml_text(text: str) -> str:
    """``text`` in characters that XML allows, without ${…} and $(…), which xacro and Stonefish would evaluate."""
    return re.sub(r"\$(?=[{(])", "$ ", escape_invisible(text))


def toml_text(text: str) -> str:
    """A quoted string for TOML and for YAML, which have the same escapes."""

    def escaped(character: str) -> str:
        code = ord(character)
        return f"\\u{code:04X}" if code < 0x10000 else f"\\U{code:08X}"

    quoted = re.sub(r'(["\\])', r"\\\1", encodable(text))
    return f'"{escape_invisible(quoted, escaped)}"'


def toml_key(text: str) -> str:
    """``text`` as a TOML key."""
    return text if text.isascii() and text.isidentifier() else toml_text(text)


def python_docstring(text: str) -> str:
    """Text for a Python string in three double quotes."""
    return escape_invisible(text).replace("\\", "\\\\").replace('"', "'")


def csv_line(cells: Sequence[str]) -> str:
    """Names as a line of CSV without its end. A name that a spreadsheet would evaluate gets an apostrophe in front."""
    line = io.StringIO()
    cells = [_FORMULA_START.sub(r"\g<0>'", escape_invisible(cell)) for cell in cells]
    writer(line, lineterminator="").writerow(cells)
    return line.getvalue()


def identifiers(names: Sequence[str], *, taken: Collection[str] = ()) -> list[str]:
    """``names`` as identifiers for XML, YAML, topics and programs, distinct from each other and from ``taken``."""
    plain = [re.sub(r"[^A-Za-z0-9_]", "_", name) for name in names]
    return _distinct([re.sub(r"^(?![A-Za-z_])", "_", name) for name in plain], taken)


def field_names(names: Sequence[str], *, taken: Collection[str] = ()) -> list[str]:
    """``names`` as column or field names, with letters of any script, distinct from each other and from ``taken``."""
    return _distinct([re.sub(r"\W+", "_", name) for name in names], taken)


def _distinct(names: Sequence[str], taken: Collection[str]) -> list[str]:
    """``names`` cut to the maximum length; a name that occurs again or is ``taken`` gets a number."""
    used = set(taken)
    # A numbered name must not be a later name either.
    reserved = used.union(names)
    last_number: dict[str, int] = {}
    result = []
    for name in names:
        start = candidate = name[:_MAX_LENGTH]
        if candidate in used:
            # All numbers up to the last one of this name are used.
            number = last_number.get(start, 1) + 1
            while (candidate := f"{start[: _MAX_LENGTH - len(str(number)) - 1]}_{number}") in reserved:
                number += 1
            last_number[start] = number
        used.add(candidate)
        reserved.add(candidate)
        result.append(candidate)
    return result


def to_json(document: Any) -> str:
    """JSON text. Numbers that are not finite become null."""
    return json_lines(json.dumps(_finite(document), indent=2, ensure_ascii=False))


def to_json_line(document: Any) -> str:
    """JSON text on one line, for a stream of documents. Numbers that are not finite become null."""
    return json_lines(json.dumps(_finite(document), ensure_ascii=False))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {encodable(str(key)): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return list(map(_finite, value))
    if isinstance(value, str):
        return encodable(value)
    if value is None or isinstance(value, int):
        return value
    number = float(value)
    return number if math.isfinite(number) else None


def plus_minus(value: float, error: float) -> str:
    """Value and standard error, both rounded to two significant digits of the error."""
    if not math.isfinite(error) or error <= 0.0:
        return significant(value, 4)
    return f"{round_to_error(value, error)} ± {round_to_error(error, error)}"


def round_to_error(value: float, error: float) -> str:
    """``value`` rounded as by `plus_minus`; to four digits if the standard error is unknown."""
    if not math.isfinite(error) or error <= 0.0:
        return significant(value, 4)
    # The exponent after rounding: 0.0996 is 0.10.
    return rounded(value, 1 - int(f"{error:.1e}".partition("e")[2]))


def significant(value: float, digits: int) -> str:
    """``value`` to so many significant digits, without exponent from a millionth to a million."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    # The exponent after rounding: 0.0996 is 0.10.
    exponent = int(f"{value:.{digits - 1}e}".partition("e")[2])
    if not -6 <= exponent < 7:
        return f"{value:.{digits}g}"
    return rounded(value, digits - 1 - exponent)


def rounded(value: float, decimals: int) -> str:
    """``value`` to so many decimals, negative ones before the point, without exponent; never minus zero."""
    return f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}"


class SafeConsole(Console):
    """A console without markup, which prints invisible characters as escapes.

    Names of files, columns and thrusters come from anywhere, and are printed by it like all other text.
    """

    def __init__(self, **options: Any) -> None:  # those of Console
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:  # those of Console
        """Text of every printed string and table cell."""
        return super().render_str(display_text(text, LINE_LENGTH), **options)

    def on_broken_pipe(self) -> None:
        """Leave the end to the command line; rich would exit with 1."""
        raise BrokenPipeError


def labelled_text(label: str, text: str = "", style: str = "bold") -> Text:
    """``text`` after a ``label`` in that style."""
    rest = f" {display_text(text, LINE_LENGTH)}" if text else ""
    return Text.assemble((display_text(label, LINE_LENGTH), style), rest)


class TextTemplates:
    """The texts in ``templates/NAME.toml`` next to the file of a ``module``, by their names; read at first use."""

    def __init__(self, module: str, name: str) -> None:
        self._path = Path(module).parent / "templates" / f"{name}.toml"

    @cached_property
    def _texts(self) -> dict[str, str]:
        return tomllib.loads(self._path.read_text(encoding="utf-8"))

    def __getitem__(self, name: str) -> str:
        return self._texts[name]
