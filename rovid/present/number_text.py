"""Numbers as the page shows them: rounded to what is known, decimal points one under another."""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import median_high

from rovid.trial.axis import Axis

# As wide as a digit and as a point: they fill a column up without showing.
_FIGURE_SPACE, _POINT_SPACE = "\u2007", "\u2008"
NOTHING = "–"
_SIGN = " ± "

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
    "N s^2/m^2": "N s²/m²",
    "N s^3/m^3": "N s³/m³",
}


def format_number(value: float | None, form: str = ".4g") -> str:
    """``value`` in that form; a dash where there is none."""
    if value is None or not math.isfinite(value):
        return NOTHING
    return format(value, form)


def format_numbers(values: Sequence[float | None], form: str) -> list[str]:
    """Each of ``values`` as by `number`."""
    return [format_number(value, form) for value in values]


def unit_symbol(text: str) -> str:
    """A unit with its powers raised; nothing for a plain number."""
    if text == "1":
        return ""
    return _UNITS.get(text, text)


def number_with_unit(text: str, plain: str) -> str:
    """A number and its unit on one line, however narrow the page; words as they are."""
    if not _is_number(text):
        return text
    return f"{text} {unit_symbol(plain)}".strip().replace(" ", "\u00a0")


def parameter_title(name: str) -> str:
    """A parameter's name in words, with its symbol where it has one."""
    return PARAMETER_TITLES.get(name, name.replace("_", " ").replace(".", ": "))


def arm_words(axis: Axis) -> tuple[str, str]:
    """What a thruster's lever is called, and its unit."""
    if axis.angular:
        return axis.arm_key.replace("_", " "), "m"
    return f"share along {axis.name}", ""


def steady_state_words(axis: Axis) -> str:
    """What a steady state is called."""
    return "steady turn" if axis.angular else "steady state"


def as_sentence(text: str) -> str:
    """A message of the command line as a sentence of the page: names in words, powers raised, a capital first."""
    for name in PARAMETER_TITLES:
        text = text.replace(name, name.replace("_", " "))
    for plain, raised in _UNITS.items():
        text = text.replace(plain, raised)
    first, _, _ = text.partition(" ")
    # A file's name keeps its case.
    if first.isalpha():
        text = text[:1].upper() + text[1:]
    if text and not text.endswith((".", "!", "?")):
        text += "."
    return text


def equal_decimals(values: Sequence[float | None], significant: int = 3) -> list[str]:
    """All ``values`` with as many decimals as show the middle one to so many significant digits."""
    place_of_first = math.floor(math.log10(_middle(values)))
    decimals = min(max(significant - 1 - place_of_first, 0), 8)
    return [format_number(value, f".{decimals}f") for value in values]


def _middle(values: Sequence[float | None]) -> float:
    """The middling size; 1 where nothing is known but zeros, which have no first digit."""
    known = [abs(value) for value in values if value is not None and math.isfinite(value)]
    sizes = [size for size in known if size > 0.0]
    if not sizes:
        return 1.0
    return median_high(sizes)


def same_decimals(text: str, value: float) -> str:
    """``value`` with the decimals of the number that ``text`` begins with."""
    first, _, _ = text.partition(_SIGN)
    return format_number(value, f".{_decimals(first)}f")


def align_decimal_points(texts: Sequence[str]) -> list[str]:
    """Right-aligned numbers, or pairs with ± between, filled up so that points and signs stand in line."""
    found = list(texts)
    # Words and dashes keep out of the way of the rest.
    at = [place for place, text in enumerate(texts) if _is_number(text)]
    for place, text in zip(at, _lined_up([texts[place] for place in at]), strict=True):
        found[place] = text
    return found


def _lined_up(texts: Sequence[str]) -> list[str]:
    """The same of numbers alone."""
    if not texts:
        return []
    parts = [text.partition(_SIGN) for text in texts]
    values, signs, errors = zip(*parts, strict=True)
    if not any(errors):
        return _filled(values)
    lines = []
    for value, sign, error in zip(_filled(values), signs, _to_the_right(_filled(errors)), strict=True):
        # Where a value stands without an error, spaces stand for the sign too.
        between = sign or _POINT_SPACE * len(_SIGN)
        lines.append(value + between + error)
    return lines


def _to_the_right(texts: Sequence[str]) -> list[str]:
    wide = max(map(len, texts))
    return [text.rjust(wide, _FIGURE_SPACE) for text in texts]


def _is_number(text: str) -> bool:
    return text[-1:].isdigit()


def _filled(texts: Sequence[str]) -> list[str]:
    places = max(map(_decimals, texts))
    return [text + _fill(places, _decimals(text)) for text in texts]


def _fill(places: int, present: int) -> str:
    """Spaces in place of the decimals, and the point, that a number lacks."""
    spaces = _FIGURE_SPACE * (places - present)
    if places and not present:
        return _POINT_SPACE + spaces
    return spaces


def _decimals(text: str) -> int:
    """How many figures stand behind the point."""
    _, _, behind_point = text.partition(".")
    return len(behind_point)
