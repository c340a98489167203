"""Which parameters go together, as a shaded table."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations

from rovid.model.parameter_names import base_names
from rovid.present.number_text import NOTHING, format_number, parameter_title
from rovid.store.parameter_file import Parameters
from rovid.trial.axis import Axis

# From here on a shade darker; at the last one parameter can hardly be told from the other.
_SHADES = (0.5, 0.8, 0.95)
_CAPTION = "Correlation of parameters"

Correlation = Callable[[str, str], float]


@dataclass(frozen=True, kw_only=True)
class CorrelationTable:
    """A captioned square table: each cell with its shade, 0 for none."""

    caption: str
    names: tuple[str, ...]
    cells: tuple[tuple[tuple[str, int], ...], ...]

    @property
    def rows(self) -> list[tuple[str, tuple[tuple[str, int], ...]]]:
        """Row by row, with its name."""
        return list(zip(self.names, self.cells, strict=True))


def correlation_table(stored: Parameters) -> CorrelationTable | None:
    """Of a parameter file; None where no two of its parameters were found together."""
    base = base_names(stored.axis)
    # The base model's first; a dict for a set that keeps the order.
    names = [name for name in dict.fromkeys((*base, *stored.entries)) if name in stored.entries]

    def correlation(first: str, second: str) -> float:
        known = stored.covariance
        covariance = known.get((first, second), known.get((second, first), 0.0))
        errors = math.sqrt(known.get((first, first), 0.0) * known.get((second, second), 0.0))
        # A file has no other word than zero for what was not found together.
        if errors <= 0.0 or covariance == 0.0:
            return math.nan
        return covariance / errors

    if not any(math.isfinite(correlation(a, b)) for a, b in combinations(names, 2)):
        return None
    return _matrix(names, correlation, stored.axis)


def _matrix(names: Sequence[str], correlation: Correlation, axis: Axis) -> CorrelationTable:
    rows = []
    for first in names:
        cells = [_cell(correlation, first, second) for second in names]
        rows.append(tuple(cells))
    titles = [axis.reword(parameter_title(name)) for name in names]
    return CorrelationTable(caption=_CAPTION, names=tuple(titles), cells=tuple(rows))


def _cell(correlation: Correlation, first: str, second: str) -> tuple[str, int]:
    """The correlation as text, and its shade."""
    if first == second:
        return "1", 0
    value = correlation(first, second)
    if not math.isfinite(value):
        return NOTHING, 0
    shade = sum(abs(value) >= least for least in _SHADES)
    return format_number(value, "+.2f").replace("-", "−"), shade
