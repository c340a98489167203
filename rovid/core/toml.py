"""TOML that a person or another program wrote: read within limits, its numbers of a size that something has."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rovid.core.errors import ConfigError, display_text
from rovid.core.paths import require_regular

# No quantity of a vehicle is larger, in whatever unit, and no size of one smaller: squares and quotients stay finite.
LARGEST, SMALLEST = 1e18, 1e-12
# Bytes; thirty thousand logs with their hashes.
_SIZE = 4_000_000
# Tables within tables. The parser takes time and memory by the square of a key's parts.
_DEPTH = 32
_DEEP_KEY = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){{{_DEPTH}}}""")
_INTEGER = 1 << 63  # what TOML promises to hold


def read_toml(path: Path, mend: str = "") -> dict[str, Any]:
    """The document in ``path``; no integer in it is larger than 64 bits.

    Parameters
    ----------
    mend
        What to do about a file that is none.

    Raises
    ------
    ConfigError
        It cannot be read, is too large, or is not TOML.
    """
    require_regular(path)
    try:
        with path.open("rb") as file:
            content = file.read(_SIZE + 1)
    except OSError as error:
        raise ConfigError(f"cannot be read ({error.strerror}).", where=path) from error
    if len(content) > _SIZE:
        raise ConfigError(f"is larger than {_SIZE / 1e6:g} MB; a short text was expected.", where=path, mend=mend)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError("is not UTF-8 text.", where=path, mend=mend or "Save it as UTF-8.") from error
    too_deep = ConfigError(f"is nested deeper than {_DEPTH} levels.", where=path, mend=mend)
    if _DEEP_KEY.search(text):
        raise too_deep
    try:
        document = tomllib.loads(text)
    except RecursionError as error:
        raise too_deep from error
    except ValueError as error:  # of a number with thousands of digits too
        raise ConfigError(f"is not valid TOML: {str(error).partition(';')[0]}.", where=path, mend=mend) from error
    for place, value in _everything(document):
        if len(place) > _DEPTH:
            raise too_deep
        if isinstance(value, int) and abs(value) >= _INTEGER:
            raise ConfigError("is an integer beyond 64 bits.", where=f"{path}: {_words(place)}", mend=mend)
    return document


def _everything(document: dict[str, Any]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Each value and the keys that lead to it, the document itself first."""
    # A list of what is to be looked at, in place of a function that calls itself: depth is what is to be found out.
    waiting: list[tuple[tuple[str, ...], Any]] = [((), document)]
    while waiting:
        place, value = waiting.pop()
        yield place, value
        if isinstance(value, dict):
            waiting += [((*place, key), inside) for key, inside in value.items()]
        elif isinstance(value, list):
            waiting += [((*place, str(number)), inside) for number, inside in enumerate(value, 1)]


def _words(place: tuple[str, ...]) -> str:
    return ".".join(display_text(part, 60) for part in place)


def expected_number(value: object, *, positive: bool = False, largest: float = LARGEST) -> str:
    """What was expected in place of ``value``; nothing where it is a number of a size that something has."""
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        return "a number"
    if positive and not value > 0.0:
        return "a positive number"
    if not abs(value) <= largest or (positive and value < SMALLEST):
        return f"a number between {SMALLEST:g} and {largest:g}" if positive else f"a number up to {largest:g} in size"
    return ""
