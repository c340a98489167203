"""Notations of numbers in tables: decimal signs and thousands separators."""

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray

# Between groups of three digits: the sign that is not the decimal one, an apostrophe, a space, two narrow spaces.
_SEPARATORS = "'’ \u00a0\u202f"
_GROUPED = re.compile(rf"[+-]?\d{{1,3}}(?:[.,{_SEPARATORS}]\d{{3}})+(?:[.,]\d+)?")


class Notation(NamedTuple):
    """Decimal sign and thousands separators of a table."""

    decimal: str
    thousands: str

    def numbers(self, cells: Sequence[str]) -> FloatArray | None:
        """(n,) numbers of ``cells`` without outer spaces, NaN where empty; None if one is none in this notation."""
        whole, sign = rf"(?:\d{{1,3}}(?:[{self.thousands}]\d{{3}})+|\d+)", re.escape(self.decimal)
        number = re.compile(rf"[+-]?(?:{whole}(?:{sign}\d*)?|{sign}\d+)(?:[eE][+-]?\d+)?")
        signs = str.maketrans({**dict.fromkeys(self.thousands), self.decimal: "."})
        if not all(number.fullmatch(cell) for cell in cells if cell):
            return None
        return np.array([float(cell.translate(signs)) if cell else np.nan for cell in cells])


NOTATIONS = (Notation(".", f",{_SEPARATORS}"), Notation(",", f".{_SEPARATORS}"))


def has_thousands(cell: str) -> bool:
    """Whether a cell may be a number with thousands separators."""
    return bool(_GROUPED.fullmatch(cell))


def read_grouped(columns: Sequence[Sequence[str]], time: int | None) -> list[FloatArray] | None:
    """(n,) numbers of each of ``columns`` in the one notation that fits them all; None if no notation or both fit.

    Where both fit, that one is taken in which the column ``time`` goes back less often: 999, 1.000, 1.001 is a time in
    ms with thousands separators.
    """
    read = [list(map(notation.numbers, columns)) for notation in NOTATIONS]
    fitting = [[one for one in numbers if one is not None] for numbers in read]
    fitting = [numbers for numbers in fitting if len(numbers) == len(columns)]
    if len(fitting) > 1 and time is not None:
        one, other = (_backward_steps(numbers[time]) for numbers in fitting)
        fitting = fitting[:1] if one < other else fitting[1:] if other < one else []
    return fitting[0] if len(fitting) == 1 else None


def _backward_steps(time: FloatArray) -> int:
    return int(np.count_nonzero(np.diff(time[np.isfinite(time)]) <= 0.0))
