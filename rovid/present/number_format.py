"""Numbers, units and names as text for terminal and page."""

import contextlib
import math
import re
from collections.abc import Sequence
from statistics import median_high

from rovid.core.errors import ConfigError
from rovid.core.formatting import significant
from rovid.trial.axis import Axis

# Blanks as wide as a digit and as a decimal point: they align a column without being seen.
_FIGURE_SPACE, _POINT_SPACE = "\u2007", "\u2008"
DASH = "–"
_PLUS_MINUS = " ± "
# Between the axis and the name of a parameter of the coupled model.
_COUPLED = re.compile(r"\b(surge|sway|yaw)\.(?=[a-z])")
# Characters of the name of a trial in a table.
NAME_LENGTH = 40

PARAMETER_TITLES = {
    "inertia": "inertia I",
    "quadratic_drag": "quadratic drag DQ",
    "linear_drag": "linear drag DL",
    "net_buoyancy": "net buoyancy B",
    "restoring_stiffness": "restoring stiffness K",
    "trim": "trim θ0",
    "inertia/quadratic_drag": "inertia over quadratic drag I/DQ",
    "inertia/linear_drag": "time constant at rest I/DL",
    "linear_drag/quadratic_drag": "linear over quadratic drag DL/DQ",
}
_UNITS = {
    "kg m^2": "kg m²",
    "N m s^2/rad^2": "N m s²/rad²",
    "N m s^3/rad^3": "N m s³/rad³",
    "(N m)^0.5 s/rad": "√(N m) s/rad",
    "N^0.5 s/m": "√N s/m",
    "N m s^2": "N m s²",
    "N s^2/m": "N s²/m",
    "N s^2/m^2": "N s²/m²",
    "N s^3/m^3": "N s³/m³",
}


def format_number(value: float | None, form: str | int = 3, unknown: str = DASH) -> str:
    """``value`` in a format, or to a number of significant digits; ``unknown`` where no finite value is known."""
    if value is None or not math.isfinite(value):
        return unknown
    return significant(value, form) if isinstance(form, int) else format(value, form)


def unit_symbol(text: str) -> str:
    """A unit with superscripts, "command units" for that of a command; empty for a dimensionless number."""
    if text == "1":
        return ""
    return _UNITS.get(text) or text.replace("^2", "²").replace("^3", "³").replace("command", "command units")


def number_with_unit(text: str, unit: str) -> str:
    """A number and its unit joined by no-break spaces; words unchanged."""
    if not _is_number(text):
        return text
    return f"{text} {unit_symbol(unit)}".strip().replace(" ", "\u00a0")


def parameter_title(name: str) -> str:
    """A parameter's name in words, with its symbol where it has one, and with the title of its effect."""
    from rovid.effects import effect_named

    if title := PARAMETER_TITLES.get(name):
        return title
    key, dot, parameter = name.rpartition(".")
    with contextlib.suppress(ConfigError):  # surge, sway and yaw are no effects
        key = effect_named(key).title if dot else ""
    return f"{key}{': ' * bool(dot)}{parameter}".replace("_", " ")


def arm_words(axis: Axis) -> tuple[str, str]:
    """Name and unit of a thruster's lever arm."""
    return (axis.arm_key.replace("_", " "), "m") if axis.angular else (f"share along {axis.name}", "")


def steady_state_words(axis: Axis) -> str:
    """Name of a steady state along ``axis``."""
    return "steady turn" if axis.angular else "steady state"


def as_sentence(text: str) -> str:
    """A message of the command line as a sentence: names in words, units with superscripts, a capital letter first."""
    text = _COUPLED.sub(r"\1 ", text).replace("R^2", "R²")
    for name in PARAMETER_TITLES:
        text = text.replace(name, name.replace("_", " "))
    for plain, symbol in _UNITS.items():
        text = text.replace(plain, symbol)
    # A file name at the beginning keeps its case.
    if text.partition(" ")[0].isalpha():
        text = text[:1].upper() + text[1:]
    return f"{text}." if text and not text.endswith((".", "!", "?")) else text


def equal_decimals(values: Sequence[float | None], digits: int = 3) -> list[str]:
    """All ``values`` with equal decimals, which show the median to ``digits`` significant digits."""
    sizes = [abs(value) for value in values if value and math.isfinite(value)]
    first_place = math.floor(math.log10(median_high(sizes))) if sizes else 0
    decimals = min(max(digits - 1 - first_place, 0), 8)
    return [format_number(value, f".{decimals}f") for value in values]


def shorten_name(name: str, length: int) -> str:
    """The end of a long name, which distinguishes logs in one folder."""
    return name if len(name) <= length else f"…{name[1 - length :]}"


def rounded_errors(values: Sequence[float | None]) -> list[str]:
    """Errors of models and their noise floor, with decimals that show the smallest to two significant digits."""
    sizes = [abs(value) for value in values if value and math.isfinite(value)]
    (least,) = equal_decimals([min(sizes, default=1.0)], 2)
    return [format_number(value, f".{_decimals(least)}f") for value in values]


def same_decimals(text: str, value: float) -> str:
    """``value`` with as many decimals as the number at the beginning of ``text``."""
    return format_number(value, f".{_decimals(text.partition(_PLUS_MINUS)[0])}f")


def align_decimal_points(texts: Sequence[str]) -> list[str]:
    """Numbers, or pairs with ± between, padded with blanks for right alignment at decimal points and signs.

    Words and dashes stay as they are.
    """
    numbers = [text.partition(_PLUS_MINUS) for text in texts if _is_number(text)]
    if not numbers:
        return list(texts)
    values, signs, errors = zip(*numbers, strict=True)
    padded = _pad_decimals(values)
    if any(errors):
        right = _pad_decimals(errors)
        width = max(map(len, right))
        # Blanks replace the sign of a value without an error.
        signs = tuple(sign or _POINT_SPACE * len(_PLUS_MINUS) for sign in signs)
        right = [text.rjust(width, _FIGURE_SPACE) for text in right]
        padded = list(map("".join, zip(padded, signs, right, strict=True)))
    aligned = iter(padded)
    return [next(aligned) if _is_number(text) else text for text in texts]


def _pad_decimals(texts: Sequence[str]) -> list[str]:
    """``texts`` with blanks in place of missing decimals and decimal points."""
    most = max(map(_decimals, texts))
    padded = []
    for text in texts:
        present = _decimals(text)
        point = _POINT_SPACE if most and not present else ""
        padded.append(text + point + _FIGURE_SPACE * (most - present))
    return padded


def _is_number(text: str) -> bool:
    return text[-1:].isdigit()


def _decimals(text: str) -> int:
    return len(text.partition(".")[2])


def sensor_words(sensor: str) -> str:
    """Name of a sensor of the coupled model in text for people."""
    return sensor.replace("_velocity", "").replace("_", " ")
