"""Data of the page's viewer.

Every trial is reduced to tables of float32 in base64, at several levels of detail, so that any part of it is drawn
quickly. Lowest and highest values of each stretch are kept.
"""

import base64
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rovid.core.array_types import FloatArray
from rovid.model.simulation import HORIZONS, TrialSimulation, simulation_errors
from rovid.present import sentences
from rovid.present.number_format import rounded_errors
from rovid.present.plots.canvas import min_max_indices
from rovid.present.report_data import ReportData, effects_of, worst_first
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import Axis
from rovid.trial.rates import resample

# Numbers of all trials together. In text each takes 5.4 bytes, which leaves 0.8 of 3 MB to the pictures.
VALUES = 400_000
# Rows of the coarsest level, two for each pixel of a wide screen, and ratio of the rows of successive levels.
COARSEST, _STEP = 4_000, 4
# Columns of a table after time; then rate and position error of each simulation.
_TORQUE, _MEASURED, _POSITION, _FIRST_SIMULATION, _COLUMNS_EACH = 1, 2, 3, 4, 2


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialLevels:
    """Tables of one trial, (columns, rows) in float32, the finest first; ``samples`` is the number of samples."""

    name: str
    samples: int
    levels: tuple[NDArray[np.float32], ...]


def viewer_document(report: ReportData) -> dict[str, Any]:
    """The data that the viewer's script reads."""
    axis = report.axis
    simulations = [nested.simulations for nested in report.nested] or [report.simulations]
    order = worst_first(simulations[0])
    sides = [[side[number] for number in order] for side in simulations]
    trials = []
    for trial, items in zip(trial_levels(sides), zip(*sides, strict=True), strict=True):
        missed = [_errors_document(axis, [item]) for item in items]
        # The table's bytes, column after column, in base64.
        tables = [base64.b64encode(level.tobytes()).decode() for level in trial.levels]
        levels = [{"rows": level.shape[1], "data": data} for level, data in zip(trial.levels, tables, strict=True)]
        trials.append({"name": trial.name, "samples": trial.samples, "levels": levels, "missed": missed})
    every = [_errors_document(axis, side) for side in simulations]
    measures = []
    for measure, numbers in zip(_measures(report), zip(*every, strict=True), strict=True):
        texts = rounded_errors((measure["floor"], *numbers))  # as on the first screen
        measures.append(measure | {"decimals": max(len(text.partition(".")[2]) for text in texts)})
    causes = effects_of(report.nested)
    keys = [{effect.key for effect in nested.model.effects} for nested in report.nested]
    return {
        "panels": _panels(axis, report.vehicle.assumptions, is_driven=any(item.run.torque.any() for item in sides[0])),
        "measures": measures,
        "causes": [sentences.effect_title(effect, axis) for effect in causes],
        # Which causes each simulation has.
        "stages": [[effect.key in present for effect in causes] for present in keys] or [[]],
        "missed": every,
        "trials": trials,
    }


def _measures(report: ReportData) -> Iterator[dict[str, Any]]:
    """Title, unit and noise floor of each number of `_errors_document`."""
    axis, floors, floor = report.axis, dict[float, float](), None
    if report.diagnosis:
        floors, floor = dict(report.diagnosis.position_floors), report.diagnosis.noise_floor
    for horizon in HORIZONS:
        title = f"{axis.position_words} error after {horizon:.0f}\u00a0s"
        yield {"title": title, "unit": axis.display_unit[0], "floor": _rounded(axis.to_display(floors.get(horizon)))}
    yield {"title": f"{axis.rate_words} error", "unit": axis.rate_unit, "floor": _rounded(floor)}


def _errors_document(axis: Axis, simulations: Sequence[TrialSimulation]) -> list[float | None]:
    errors = simulation_errors(simulations)
    positions = [axis.to_display(errors.position[horizon]) for horizon in HORIZONS]
    return list(map(_rounded, (*positions, errors.rate)))


def _rounded(value: float | None) -> float | None:
    """``value`` to four significant digits; None where it is not finite, as JSON requires."""
    if value is None or not math.isfinite(value):
        return None
    return float(f"{value:.4g}")


def trial_levels(stages: Sequence[Sequence[TrialSimulation]], *, values: int | None = None) -> list[TrialLevels]:
    """Every trial within a budget of ``values`` numbers, ``VALUES`` if None; short trials keep all rows.

    Each of ``stages`` has all trials in the same order.
    """
    tables = list(map(_table, zip(*stages, strict=True)))
    if not tables:
        return []
    budget = VALUES if values is None else values
    # The coarser levels of a trial take at most a third of the finest.
    rows = budget * (_STEP - 1) // (_STEP * len(tables[0]))
    granted = fair_shares([table.shape[1] for table in tables], rows)
    trials = []
    for item, table, count in zip(stages[0], tables, granted, strict=True):
        levels = [decimate_table(table, count)]
        while levels[-1].shape[1] > COARSEST:
            levels.append(decimate_table(levels[-1], levels[-1].shape[1] // _STEP))
        kept = tuple(level.astype("<f4") for level in levels)
        trials.append(TrialLevels(name=item.run.trial.name, samples=table.shape[1], levels=kept))
    return trials


def fair_shares(wanted: Sequence[int], budget: int) -> list[int]:
    """Shares of ``budget``: at most what each wants, and at least as much as any other that is not satisfied."""
    granted, left = [0] * len(wanted), budget
    smallest_first = sorted(range(len(wanted)), key=wanted.__getitem__)
    for rank, index in enumerate(smallest_first):
        granted[index] = min(wanted[index], left // (len(wanted) - rank))
        left -= granted[index]
    return granted


def decimate_table(table: FloatArray, count: int) -> FloatArray:
    """At most ``count`` rows of (columns, rows) with the lowest and highest of each stretch of every drawn signal.

    First and last row stay. A stretch without values keeps one row, so gaps remain visible.
    """
    total, size = table.shape[1], 1
    # The viewer itself subtracts the measured rate from each simulated one.
    errors = [rate - table[_MEASURED] for rate in table[_FIRST_SIMULATION::_COLUMNS_EACH]]
    rows = np.arange(total)
    while len(rows) > count and size < total:
        size = max(size + 1, size * len(rows) // count)
        picked = [min_max_indices(values, size) for values in (*table[1:], *errors)]
        rows = np.unique(np.concatenate([*picked, [0, total - 1]]))
    return table[:, rows]


def _table(stages: Sequence[TrialSimulation]) -> FloatArray:
    """All signals of one trial at the instants of its commands."""
    first = stages[0]
    trial, factor = first.run.trial, first.run.trial.axis.display_unit[1]

    def at_instants(item: TrialSimulation, rate: FloatArray) -> FloatArray:
        return np.interp(trial.time, item.run.rates.time, rate, left=np.nan, right=np.nan)

    position = factor * resample(trial, trial.position - trial.first_position, trial.time)
    rows = [trial.time, first.run.torque, at_instants(first, first.measured), position]
    for item in stages:
        rows.append(at_instants(item, item.simulated))
        rows.append(factor * resample(trial, item.position - trial.position, trial.time))
    return np.stack(rows)


def _panels(axis: Axis, guess: Assumptions, *, is_driven: bool) -> list[dict[str, Any]]:
    """Each panel from the top: its title, its height in pixels, and its lines; that of the torque if there is one."""
    unit, _ = axis.display_unit
    rate, error = _FIRST_SIMULATION, _FIRST_SIMULATION + 1
    measured_rate, measured_position = _line("measured", _MEASURED), _line("measured", _POSITION)
    text = f"{axis.position_words} from the start"
    panels = [
        (axis.rate_words, axis.rate_unit, 190, [measured_rate, *_simulated_lines(rate)]),
        (f"{axis.rate_words} error", axis.rate_unit, 90, _simulated_lines(rate, less=_MEASURED)),
        (text, unit, 120, [measured_position, *_simulated_lines(error, plus=_POSITION)]),
        (f"{axis.position_words} error", unit, 90, _simulated_lines(error)),
        (axis.force_name, axis.force_unit, 70, [_line("applied", _TORQUE)]),
    ][: 4 + is_driven]
    documents = []
    for title, panel_unit, height, lines in panels:
        guessed = f", by guessed {guess.quantities}" * guess.is_placeholder(panel_unit)
        documents.append({"title": title + guessed, "unit": panel_unit, "height": height, "lines": lines})
    return documents


def _simulated_lines(column: int, plus: int | None = None, less: int | None = None) -> list[dict[str, Any]]:
    """Lines without the causes, and with those that are switched on."""
    return [_line(look, column, plus, less, _COLUMNS_EACH) for look in ("without", "simulated")]


def _line(look: str, column: int, plus: int | None = None, less: int | None = None, staged: int = 0) -> dict[str, Any]:
    """A column, and the columns that are added and subtracted; ``staged`` is the distance between simulations."""
    return {"look": look, "column": column, "plus": plus, "less": less, "staged": staged}
