"""The heading controller as the page words it, and its tables."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rovid.control.design import Control, RunResult
from rovid.report.grids import Column, Grid, numbers, words
from rovid.report.text import NOTHING, number


def gains_grid(control: Control) -> Grid:
    """Gains and margins; the margins over the parameters' uncertainty too, where that is known."""
    rows = list(_gains(control))
    names, values, units, bounds = zip(*rows, strict=True)
    columns = [words("quantity", names), Column(title="value", cells=values), words("unit", units)]
    if control.spread is not None and control.margins.stable:
        columns.append(Column(title=f"95 % of {control.spread.draws} draws", cells=bounds))
    return Grid(caption="The controller and its margins", columns=tuple(columns))


def _gains(control: Control) -> Iterator[tuple[str, str, str, str]]:
    """Quantity, value, unit, and what 95 % of the draws from the parameters' covariance keep."""
    law, margins, spread = control.law, control.margins, control.spread
    yield "gain on heading kp", number(law.kp, ".5g"), "N m/rad", NOTHING
    yield "gain on yaw rate kd", number(law.kd, ".5g"), "N m s/rad", NOTHING
    yield "damping ratio", number(control.damping, ".3f"), "", NOTHING
    yield "bandwidth", number(control.bandwidth, ".3g"), "rad/s", NOTHING
    yield "all that delays the loop", number(control.lag, ".2g"), "s", NOTHING
    if not margins.stable:
        return
    kept = (math.nan,) * 4
    if spread is not None:
        kept = spread.gain_db, spread.phase_deg, spread.delay_s, spread.sensitivity_peak
    yield "gain margin", _bounded(margins.gain_db, ".1f"), "dB", f"≥ {_bounded(kept[0], '.1f')}"
    yield "phase margin", number(margins.phase_deg, ".0f"), "deg", f"≥ {number(kept[1], '.0f')}"
    yield "delay margin", number(margins.delay_s, ".2f"), "s", f"≥ {number(kept[2], '.2f')}"
    yield "lag margin", _bounded(margins.lag_s, ".2f"), "s", NOTHING
    yield "peak of the sensitivity", number(margins.sensitivity_peak, ".2f"), "", f"≤ {number(kept[3], '.2f')}"


def _bounded(value: float, form: str) -> str:
    return "without limit" if math.isinf(value) else number(value, form)


def runs_grid(control: Control) -> Grid:
    """Every closed-loop run, in the order of the design."""
    runs, found = control.runs, [run.measures for run in control.runs]
    columns = [words("run", [run.name for run in runs])]
    if control.model.effects:
        columns.append(words("effects", ["all" if run.effects else "none" for run in runs]))
    columns += [
        words("aid", [_aid(run) for run in runs]),
        numbers("63 % after", "s", [number(each.time_constant, ".1f") for each in found]),
        numbers("10 to 90 % in", "s", [number(each.rise_time, ".1f") for each in found]),
        numbers("settled after", "s", [number(each.settling_time, ".1f") for each in found]),
        numbers("overshoot", "deg", [number(each.overshoot_deg, ".1f") for each in found]),
        numbers("steady error", "deg", [number(each.steady_error_deg, ".2f") for each in found]),
        numbers("torque rms", "N m", [number(each.effort, ".1f") for each in found]),
        words("limit cycle", [_cycle(run) for run in runs]),
    ]
    return Grid(caption="Closed-loop runs, with 2 % of the torque in use as disturbance", columns=tuple(columns))


def _aid(run: RunResult) -> str:
    if not run.model_aid:
        return "none"
    return "drag and effects" if run.effects_known else "drag"


def _cycle(run: RunResult) -> str:
    cycle = run.measures.limit_cycle
    return "none" if cycle is None else f"±{cycle.amplitude_deg:.2f} deg, {cycle.period_s:.3g} s"
