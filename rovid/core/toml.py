"""TOML files of people and other programs, read within limits of size, depth and magnitude."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rovid.core.errors import ConfigError, display_text
from rovid.core.paths import require_regular

# Bounds of a vehicle's quantities, in any unit. Their squares and quotients stay finite.
LARGEST, SMALLEST = 1e18, 1e-12
# Bytes; enough for thirty thousand logs with their hashes.
_MAX_SIZE = 4_000_000
# Nested tables. The parser needs time and memory by the square of the parts of a dotted key.
_MAX_DEPTH = 32
_DEEP_KEY = re.compile(rf"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){{{_MAX_DEPTH}}}""")
_INTEGER_LIMIT = 1 << 63  # TOML guarantees 64 bits


def read_toml(path: Path, mend: str = "") -> dict[str, Any]:
    """The document in ``path``, with integers of 64 bits at most.

    Parameters
    ----------
    mend
        Advice for a file that is not TOML.

    Raises
    ------
    ConfigError
        The file cannot be read, is too large, or is not TOML.
    """
    require_regular(path)
    try:
        with path.open("rb") as file:
            content = file.read(_MAX_SIZE + 1)
    except OSError as error:
        raise ConfigError(f"cannot be read ({error.strerror}).", where=path) from error
    if len(content) > _MAX_SIZE:
        raise ConfigError(f"is larger than {_MAX_SIZE / 1e6:g} MB; a short text was expected.", where=path, mend=mend)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise ConfigError("is not UTF-8 text.", where=path, mend=mend or "Save it as UTF-8.") from error
    too_deep = ConfigError(f"is nested deeper than {_MAX_DEPTH} levels.", where=path, mend=mend)
    if _DEEP_KEY.search(text):
        raise too_deep
    try:
        document = tomllib.loads(text)
    except RecursionError as error:
        raise too_deep from error
    except ValueError as error:  # also for a number with thousands of digits
        raise ConfigError(f"is not valid TOML: {str(error).partition(';')[0]}.", where=path, mend=mend) from error
    for keys, value in _all_values(document):
        if len(keys) > _MAX_DEPTH:
            raise too_deep
        if isinstance(value, int) and abs(value) >= _INTEGER_LIMIT:
            place = ".".join(display_text(key, 60) for key in keys)
            raise ConfigError("is an integer of more than 64 bits.", where=f"{path}: {place}", mend=mend)
    return document


def _all_values(document: dict[str, Any]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """The document and all values in it, each with the keys that lead to it; without recursion, as it may be deep."""
    waiting: list[tuple[tuple[str, ...], Any]] = [((), document)]
    while waiting:
        keys, value = waiting.pop()
        yield keys, value
        if isinstance(value, dict):
            waiting += [((*keys, key), inner) for key, inner in value.items()]
        elif isinstance(value, list):
            waiting += [((*keys, str(number)), inner) for number, inner in enumerate(value, 1)]


def expected_number(value: object, *, positive: bool = False, largest: float = LARGEST) -> str:
    """Description of the number that was expected in place of ``value``; empty if ``value`` is such a number."""
    if isinstance(value, bool) or not isinstance(value, int | float) or math.isnan(value):
        return "a number"
    if positive and not value > 0.0:
        return "a positive number"
    if positive and not SMALLEST <= value <= largest:
        return f"a number between {SMALLEST:g} and {largest:g}"
    if not abs(value) <= largest:
        return f"a number up to {largest:g} in size"
    return ""
