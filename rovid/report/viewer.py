"""The trials as the page's viewer draws them: true samples, thinned where they are too many, with all extremes kept.

A row holds all signals of one instant. Level after level of a long trial has a quarter of the rows of the one before,
so that the whole of it is drawn as quickly as a part.
"""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rovid.campaign.axis import Axis
from rovid.campaign.guesswork import Guesswork
from rovid.ground.arrays import FloatArray
from rovid.model.simulation import TrialSimulation
from rovid.motion.rates import on_grid
from rovid.report.evidence import Evidence
from rovid.report.plots.canvas import extreme_rows

# Numbers of all trials together. In text they take 5.4 bytes each, which leaves more than half of 8 MB to the pictures.
VALUES = 600_000
# Two for each pixel of a wide screen; what has more rows gets a coarser level.
COARSEST = 4_000
_STEP = 4

# Columns of a table, time being the first; of the last two there are as many as simulations.
_TORQUE, _MEASURED = 1, 2
_SIMULATED, _POSITION_ERROR = (3, 5), (4, 6)


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """The levels of one trial, the finest first, each of (columns, rows) in float32; and how many rows there were."""

    name: str
    samples: int
    levels: tuple[NDArray[np.float32], ...]


def viewer_document(evidence: Evidence) -> dict[str, Any]:
    """What the viewer's script reads."""
    sides = (evidence.before, evidence.simulations) if evidence.before else (evidence.simulations,)
    return {
        "panels": _panels(evidence.axis, evidence.vehicle.guess, found=bool(evidence.before)),
        "trials": [_trial(each) for each in series_of(*sides)],
    }


def _trial(each: Series) -> dict[str, Any]:
    """What the page is given of one trial's signals."""
    levels = [{"rows": level.shape[1], "data": _text(level)} for level in each.levels]
    return {"name": each.name, "samples": each.samples, "levels": levels}


def series_of(
    simulations: Sequence[TrialSimulation], extended: Sequence[TrialSimulation] = (), *, values: int | None = None
) -> list[Series]:
    """Every trial within a budget of ``values`` numbers, ``VALUES`` if not given; short trials keep all rows."""
    if not simulations:
        return []
    sides = [simulations, extended] if extended else [simulations]
    tables = [_table(trial) for trial in zip(*sides, strict=True)]
    if values is None:
        values = VALUES
    # The coarser levels of a trial take a third of its finest at most.
    rows = values * (_STEP - 1) // (_STEP * len(tables[0]))
    granted = shares([table.shape[1] for table in tables], rows)
    series = []
    for item, table, count in zip(simulations, tables, granted, strict=True):
        levels = tuple(_levels(table, count))
        series.append(Series(name=item.run.trial.name, samples=table.shape[1], levels=levels))
    return series


def shares(wanted: Sequence[int], budget: int) -> list[int]:
    """What each gets of ``budget``: no more than it wants, and no less than another that wants more."""
    granted, left = [0] * len(wanted), budget
    smallest_first = sorted(range(len(wanted)), key=wanted.__getitem__)
    for rank, index in enumerate(smallest_first):
        # What those before it did not want is shared among the rest.
        granted[index] = min(wanted[index], left // (len(wanted) - rank))
        left -= granted[index]
    return granted


def thinned(table: FloatArray, count: int) -> FloatArray:
    """At most ``count`` rows of (columns, rows) with the lowest and highest of each stretch of every drawn signal.

    First and last row stay, and a stretch without values keeps one, so that a gap stays a gap.
    """
    total, size = table.shape[1], 1
    rows = np.arange(total)
    while len(rows) > count and size < total:
        size = max(size + 1, size * len(rows) // count)
        picked = [extreme_rows(values, size) for values in (*table[1:], *_errors(table))]
        rows = np.unique(np.concatenate([*picked, [0, total - 1]]))
    return table[:, rows]


def _errors(table: FloatArray) -> list[FloatArray]:
    """What the viewer works out itself."""
    return [table[column] - table[_MEASURED] for column in _SIMULATED if column < len(table)]


def _levels(table: FloatArray, count: int) -> list[NDArray[np.float32]]:
    """(rows, samples) tables, each coarser than the one before, the finest first."""
    levels = [thinned(table, count)]
    while levels[-1].shape[1] > COARSEST:
        levels.append(thinned(levels[-1], levels[-1].shape[1] // _STEP))
    return [level.astype("<f4") for level in levels]


def _table(sides: tuple[TrialSimulation, ...]) -> FloatArray:
    """All signals at the trial's own instants, which are those of the commands too; of one simulation or of two."""
    item = sides[0]
    rows = [item.run.trial.time, item.run.torque, _at_instants(item, item.measured)]
    for side in sides:
        rows += [_at_instants(side, side.simulated), _position_error(side)]
    return np.stack(rows)


def _at_instants(item: TrialSimulation, rate: FloatArray) -> FloatArray:
    """(n,) ``rate`` at the trial's own instants; NaN where the filter has no answer."""
    return np.interp(item.run.trial.time, item.run.rates.time, rate, left=np.nan, right=np.nan)


def _position_error(item: TrialSimulation) -> FloatArray:
    """(n,) deg or m that the simulation is off at the trial's own instants."""
    trial = item.run.trial
    return trial.axis.shown[1] * on_grid(trial, item.position - trial.position, trial.time)


def _panels(axis: Axis, guess: Guesswork, *, found: bool) -> list[dict[str, Any]]:
    """Each panel from the top: its words, its height in pixels, and its lines as columns, one less another."""
    looks = [("simulated", "simulated")]
    if found:
        looks.append(("with what was found", "found"))
    torques = [_line("applied", "applied", _TORQUE)]
    rates = [_line("measured", "measured", _MEASURED)]
    misses, drifts = [], []
    for look, simulated, position_error in zip(looks, _SIMULATED, _POSITION_ERROR, strict=False):
        rates.append(_line(*look, simulated))
        misses.append(_line(*look, simulated, _MEASURED))
        drifts.append(_line(*look, position_error))
    by = f", by guessed {guess.words}" if guess else ""
    return [
        _panel(axis.push + by, axis.push_unit, 110, torques),
        _panel(axis.rate_words, axis.rate_unit, 240, rates),
        _panel(f"{axis.rate_words}, simulated less measured", axis.rate_unit, 130, misses),
        _panel(f"{axis.position_words}, simulated less measured", axis.shown[0], 130, drifts),
    ]


def _panel(title: str, unit: str, height: int, lines: list[dict[str, Any]]) -> dict[str, Any]:
    return {"title": title, "unit": unit, "height": height, "lines": lines}


def _line(label: str, look: str, column: int, less: int | None = None) -> dict[str, Any]:
    return {"label": label, "look": look, "column": column, "less": less}


def _text(level: NDArray[np.float32]) -> str:
    """The table's bytes as base64, a row after another."""
    return base64.b64encode(np.ascontiguousarray(level).tobytes()).decode("ascii")
