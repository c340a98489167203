"""The trials as the page's viewer draws them: true samples, thinned where they are too many, with all extremes kept.

A row holds all signals of one instant. Level after level of a long trial has a quarter of the rows of the one before,
so that the whole of it is drawn as quickly as a part.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rovid.core.array_types import FloatArray
from rovid.effects import Effect
from rovid.model.simulation import HORIZONS, TrialSimulation
from rovid.present.page.nested_simulations import NestedSimulation, effects_of, simulation_errors, worst_first
from rovid.present.page.report_data import ReportData
from rovid.present.plots.canvas import min_max_indices
from rovid.present.tables.diagnosis import effect_name
from rovid.signals.rates import resample
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import Axis

# Numbers of all trials together. In text they take 5.4 bytes each, which leaves more than half of 8 MB to the pictures.
VALUES = 600_000
# Two for each pixel of a wide screen; what has more rows gets a coarser level.
COARSEST = 4_000
_STEP = 4

# Columns of a table, time being the first; then two for each stage, its rate and what its position is off by.
_TORQUE, _MEASURED, _POSITION = 1, 2, 3
_FIRST_STAGE, _EACH_STAGE = 4, 2


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialLevels:
    """The levels of one trial, the finest first, each of (columns, rows) in float32; and how many rows there were."""

    name: str
    samples: int
    levels: tuple[NDArray[np.float32], ...]


def viewer_document(evidence: ReportData) -> dict[str, Any]:
    """What the viewer's script reads."""
    axis, stages = evidence.axis, _sides(evidence)
    order = worst_first(stages[0])
    sides = [[side[number] for number in order] for side in stages]
    trials = [_trial(each) for each in trial_levels(sides)]
    for trial, items in zip(trials, zip(*sides, strict=True), strict=True):
        trial["missed"] = [_missed(axis, [item]) for item in items]
    causes = effects_of(evidence.nested)
    return {
        "panels": _panels(axis, evidence.vehicle.assumptions),
        "measures": list(_measures(evidence)),
        "causes": [effect_name(effect, axis) for effect in causes],
        # Which causes each stage has.
        "stages": [_switched(stage, causes) for stage in evidence.nested] or [[]],
        "missed": [_missed(axis, side) for side in stages],
        "trials": trials,
    }


def _sides(evidence: ReportData) -> list[tuple[TrialSimulation, ...]]:
    """All trials once for each stage; by the parameter file's model where there are no stages."""
    return [stage.simulations for stage in evidence.nested] or [evidence.simulations]


def _switched(stage: NestedSimulation, causes: Sequence[Effect]) -> list[bool]:
    keys = {effect.key for effect in stage.model.effects}
    return [effect.key in keys for effect in causes]


def _measures(evidence: ReportData) -> Iterator[dict[str, Any]]:
    """What the numbers of `_missed` are: words, unit, and what a perfect model's would be, None where unknown."""
    axis, diagnosis = evidence.axis, evidence.diagnosis
    shown, _ = axis.display_unit
    floors = diagnosis.position_floors if diagnosis else {}
    for horizon in HORIZONS:
        floor = _known(axis.to_display(floors.get(horizon)))
        yield {"title": f"{axis.position_words} error after {horizon:.0f}\u00a0s", "unit": shown, "floor": floor}
    floor = _known(diagnosis.noise_floor if diagnosis else None)
    yield {"title": f"{axis.rate_words} error", "unit": axis.rate_unit, "floor": floor}


def _missed(axis: Axis, simulations: Sequence[TrialSimulation]) -> list[float | None]:
    off = simulation_errors(simulations)
    return [*(_known(axis.to_display(off.position[horizon])) for horizon in HORIZONS), _known(off.rate)]


def _known(value: float | None) -> float | None:
    """``value`` to four digits, as JSON has it: no number that is not one."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.4g}")


def _trial(each: TrialLevels) -> dict[str, Any]:
    """What the page is given of one trial's signals."""
    levels = [{"rows": level.shape[1], "data": _text(level)} for level in each.levels]
    return {"name": each.name, "samples": each.samples, "levels": levels}


def trial_levels(stages: Sequence[Sequence[TrialSimulation]], *, values: int | None = None) -> list[TrialLevels]:
    """Every trial within a budget of ``values`` numbers, ``VALUES`` if not given; short trials keep all rows.

    Each of ``stages`` has all trials in the same order.
    """
    tables = [_table(items) for items in zip(*stages, strict=True)]
    if not tables:
        return []
    if values is None:
        values = VALUES
    # The coarser levels of a trial take a third of its finest at most.
    rows = values * (_STEP - 1) // (_STEP * len(tables[0]))
    granted = fair_shares([table.shape[1] for table in tables], rows)
    series = []
    for item, table, count in zip(stages[0], tables, granted, strict=True):
        levels = tuple(_levels(table, count))
        series.append(TrialLevels(name=item.run.trial.name, samples=table.shape[1], levels=levels))
    return series


def fair_shares(wanted: Sequence[int], budget: int) -> list[int]:
    """What each gets of ``budget``: no more than it wants, and no less than another that wants more."""
    granted, left = [0] * len(wanted), budget
    smallest_first = sorted(range(len(wanted)), key=wanted.__getitem__)
    for rank, index in enumerate(smallest_first):
        # What those before it did not want is shared among the rest.
        granted[index] = min(wanted[index], left // (len(wanted) - rank))
        left -= granted[index]
    return granted


def decimate_table(table: FloatArray, count: int) -> FloatArray:
    """At most ``count`` rows of (columns, rows) with the lowest and highest of each stretch of every drawn signal.

    First and last row stay, and a stretch without values keeps one, so that a gap stays a gap.
    """
    total, size = table.shape[1], 1
    rows = np.arange(total)
    while len(rows) > count and size < total:
        size = max(size + 1, size * len(rows) // count)
        picked = [min_max_indices(values, size) for values in (*table[1:], *_errors(table))]
        rows = np.unique(np.concatenate([*picked, [0, total - 1]]))
    return table[:, rows]


def _errors(table: FloatArray) -> list[FloatArray]:
    """What the viewer works out itself."""
    return [rate - table[_MEASURED] for rate in table[_FIRST_STAGE::_EACH_STAGE]]


def _levels(table: FloatArray, count: int) -> list[NDArray[np.float32]]:
    """(rows, samples) tables, each coarser than the one before, the finest first."""
    levels = [decimate_table(table, count)]
    while levels[-1].shape[1] > COARSEST:
        levels.append(decimate_table(levels[-1], levels[-1].shape[1] // _STEP))
    return [level.astype("<f4") for level in levels]


def _table(stages: Sequence[TrialSimulation]) -> FloatArray:
    """All signals of one trial at its own instants, which are those of the commands too."""
    item = stages[0]
    trial = item.run.trial
    position = trial.axis.display_unit[1] * resample(trial, trial.position - trial.first_position, trial.time)
    rows = [trial.time, item.run.torque, _at_instants(item, item.measured), position]
    for side in stages:
        rows += [_at_instants(side, side.simulated), _position_error(side)]
    return np.stack(rows)


def _at_instants(item: TrialSimulation, rate: FloatArray) -> FloatArray:
    """(n,) ``rate`` at the trial's own instants; NaN where the filter has no answer."""
    return np.interp(item.run.trial.time, item.run.rates.time, rate, left=np.nan, right=np.nan)


def _position_error(item: TrialSimulation) -> FloatArray:
    """(n,) deg or m that the simulation is off at the trial's own instants."""
    trial = item.run.trial
    return trial.axis.display_unit[1] * resample(trial, item.position - trial.position, trial.time)


def _panels(axis: Axis, guess: Assumptions) -> list[dict[str, Any]]:
    """Each panel from the top: its words, its height in pixels, and its lines."""
    shown, _ = axis.display_unit
    rate, off = _FIRST_STAGE, _FIRST_STAGE + 1
    panels = [
        _panel(axis.rate_words, axis.rate_unit, 190, [_measured(_MEASURED), *_simulated(rate)]),
        _panel(f"{axis.rate_words} error", axis.rate_unit, 90, _simulated(rate, less=_MEASURED)),
        _panel(
            f"{axis.position_words} from the start", shown, 120, [_measured(_POSITION), *_simulated(off, _POSITION)]
        ),
        _panel(f"{axis.position_words} error", shown, 90, _simulated(off)),
        _panel(axis.force_name, axis.force_unit, 70, [_line("applied", _TORQUE)]),
    ]
    for panel in panels:
        if guess.is_placeholder(panel["unit"]):
            panel["title"] += f", by guessed {guess.quantities}"
    return panels


def _panel(title: str, unit: str, height: int, lines: list[dict[str, Any]]) -> dict[str, Any]:
    return {"title": title, "unit": unit, "height": height, "lines": lines}


def _measured(column: int) -> dict[str, Any]:
    return _line("measured", column)


def _simulated(column: int, plus: int | None = None, less: int | None = None) -> list[dict[str, Any]]:
    """Without what was found, and with what is switched on."""
    return [{**_line(look, column, plus, less), "staged": _EACH_STAGE} for look in ("without", "simulated")]


def _line(look: str, column: int, plus: int | None = None, less: int | None = None) -> dict[str, Any]:
    """A column, and what is added to it or taken off; ``staged`` where each stage has its own, so many further on."""
    return {"look": look, "column": column, "plus": plus, "less": less, "staged": 0}


def _text(level: NDArray[np.float32]) -> str:
    """The table's bytes as base64, a row after another."""
    return base64.b64encode(np.ascontiguousarray(level).tobytes()).decode("ascii")
