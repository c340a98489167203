"""Results as text: JSON, and numbers rounded to their uncertainty."""

from __future__ import annotations

import json
import math
from typing import Any

from rovid.core.escaping import encodable, json_lines


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
        return [_finite(item) for item in value]
    if isinstance(value, str):
        return encodable(value)
    if value is None or isinstance(value, int):
        return value
    number = float(value)
    if not math.isfinite(number):
        return None
    return number


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
    exponent = int(f"{error:.1e}".partition("e")[2])
    return rounded(value, 1 - exponent)


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
