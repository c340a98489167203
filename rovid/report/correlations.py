"""Which parameters go together, as a shaded table."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rovid.campaign.axis import Axis
from rovid.identify.estimate import Estimate
from rovid.model.names import base_names
from rovid.parameters.parameters import Parameters
from rovid.report.text import NOTHING, number, title

# From here on a shade darker; at the last one parameter can hardly be told from the other.
_SHADES = (0.5, 0.8, 0.95)
_CAPTION = "Correlation of parameters"

Correlation = Callable[[str, str], float]


@dataclass(frozen=True, kw_only=True)
class Matrix:
    """A captioned square table: each cell with its shade, 0 for none."""

    caption: str
    names: tuple[str, ...]
    cells: tuple[tuple[tuple[str, int], ...], ...]

    @property
    def rows(self) -> list[tuple[str, tuple[tuple[str, int], ...]]]:
        """Row by row, with its name."""
        return list(zip(self.names, self.cells, strict=True))


def of_parameters(stored: Parameters) -> Matrix | None:
    """Of a parameter file; None where no two of its parameters were found together."""
    base = base_names(stored.axis)
    names = [name for name in base if name in stored.entries]
    names += [name for name in stored.entries if name not in base]

    def correlation(first: str, second: str) -> float:
        found = stored.covariance
        covariance = found.get((first, second), found.get((second, first), 0.0))
        errors = math.sqrt(found.get((first, first), 0.0) * found.get((second, second), 0.0))
        # A file has no other word than zero for what was not found together.
        return covariance / errors if errors > 0.0 and covariance != 0.0 else math.nan

    pairs = [correlation(a, b) for k, a in enumerate(names) for b in names[:k]]
    return _matrix(names, correlation, stored.axis) if any(map(math.isfinite, pairs)) else None


def of_estimate(estimate: Estimate) -> Matrix:
    """Of what was estimated together."""
    names = [name for name in estimate.names if name not in estimate.refused]
    return _matrix(names, estimate.correlation, estimate.axis)


def _matrix(names: Sequence[str], correlation: Correlation, axis: Axis) -> Matrix:
    return Matrix(
        caption=_CAPTION,
        names=tuple(axis.words(title(name)) for name in names),
        cells=tuple(tuple(("1", 0) if a == b else _cell(correlation(a, b)) for b in names) for a in names),
    )


def _cell(value: float) -> tuple[str, int]:
    if not math.isfinite(value):
        return NOTHING, 0
    return number(value, "+.2f").replace("-", "−"), sum(abs(value) >= least for least in _SHADES)
