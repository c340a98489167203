"""What drives the torque that a model without one cause misses: seen in the logs, and by the cause's equation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects import Effect
from rovid.model.model import Model
from rovid.present.page.residual_torque import all_residuals, unexplained_torques
from rovid.signals.preprocessing import PreparedRuns, Run, shared_channels
from rovid.signals.rates import resample
from rovid.trial.axis import YAW, Axis
from rovid.trial.vehicle import Vehicle

# A driver is preferred to a plainer one if it explains so much more of what the equation gives.
_BETTER = 0.02
# No driver: less than that of it follows any of them.
_FOLLOWS = 0.5
_BINS = 32


@dataclass(frozen=True, kw_only=True, eq=False)
class MissingTorque:
    """The torque, or force, that a model misses without one of its effects.

    Attributes
    ----------
    driver
        What it is shown against, with its unit.
    at
        (n,) values of that.
    measured, equation
        (n,) N m or N: what the logs ask for beside all else in the model, and what the effect's equation gives.
    line
        Mean of the driver and of what the equation gives, from the least driver to the largest; over time, where
        nothing drives it, the equation itself.
    """

    driver: str
    driver_values: FloatArray
    measured: FloatArray
    equation: FloatArray
    line: tuple[FloatArray, FloatArray]


def missing_without(effect: Effect, runs: PreparedRuns, model: Model, vehicle: Vehicle) -> MissingTorque | None:
    """What ``model`` misses without ``effect``, against that of the logs which the effect follows most.

    Over time, in the run that shows most of it, where it follows nothing. None of a wave, whose phase nobody knows.
    """
    if effect.is_wave:
        return None
    with_it, without = (unexplained_torques(runs, each, vehicle) for each in (model, _less(model, effect)))
    equation = all_residuals(with_it) - all_residuals(without)
    known = np.isfinite(equation)
    if not known.any() or not np.any(equation[known]):
        return None
    best, follows, chosen = np.empty(0), -np.inf, ""
    for name, values in _drivers(runs.items, vehicle.axis):
        share = _followed(values, equation)
        if share > follows + _BETTER:
            best, follows, chosen = values, share, name
    if follows < _FOLLOWS:
        return _over_time([item.residual for item in with_it], [item.residual for item in without], runs)
    return MissingTorque(
        driver=chosen,
        driver_values=best,
        measured=-all_residuals(without),
        equation=equation,
        line=bin_means(best, equation),
    )


def _less(model: Model, effect: Effect) -> Model:
    """``model`` without ``effect``, all else as it is."""
    effects, values = [], []
    numbers = list(model.effect_values)
    for each in model.effects:
        own, numbers = numbers[: len(each.parameters)], numbers[len(each.parameters) :]
        if each.key != effect.key:
            effects.append(each)
            values += own
    return replace(model, effects=tuple(effects), effect_values=tuple(values))


def _drivers(runs: Sequence[Run], axis: Axis) -> Iterator[tuple[str, FloatArray]]:
    """What may drive it, the plainest first, along all runs one after another."""

    def along(name: str, values: list[FloatArray]) -> tuple[str, FloatArray]:
        return name, np.concatenate(values)

    shown, factor = axis.display_unit
    yield along(f"{axis.force_name} of the thrusters, {axis.force_unit}", [run.filtered_torque for run in runs])
    yield along(f"{axis.rate_words}, {axis.rate_unit}", [run.rates.rate for run in runs])
    changes = [np.gradient(run.filtered_torque, run.rates.kernel.period) for run in runs]
    yield along(f"change of the {axis.force_name}, {axis.force_unit}/s", changes)
    yield along(f"acceleration, {axis.rate_unit}²", [run.rates.acceleration for run in runs])
    if axis is YAW:
        yield along("heading, deg", [factor * _on_grid(run, run.trial.position) % 360.0 for run in runs])
    turned = [factor * (_on_grid(run, run.trial.position) - run.trial.first_position) for run in runs]
    yield along(f"{axis.position_words} from the start, {shown}", turned)
    yield along("time in the trial, s", [run.rates.time for run in runs])
    for name in sorted(shared_channels(runs)):
        yield along(name.replace("_", " "), [_on_grid(run, run.trial.extras[name]) for run in runs])


def _on_grid(run: Run, values: FloatArray) -> FloatArray:
    return resample(run.trial, values, run.rates.time)


def _followed(driver: FloatArray, equation: FloatArray) -> float:
    """Share of the square of ``equation`` that its mean at each value of ``driver`` explains."""
    known = np.isfinite(driver) & np.isfinite(equation)
    x, y = driver[known], equation[known]
    if x.size < _BINS or np.ptp(x) == 0.0:
        return -np.inf
    where = _bin_of(x, _BINS)
    count = np.maximum(np.bincount(where), 1)
    mean = np.bincount(where, weights=y) / count
    return 1.0 - float(np.sum((y - mean[where]) ** 2) / np.sum(y**2))


def _bin_of(x: FloatArray, bins: int) -> IntArray:
    """(n,) in which bin each value stands: half of them are of one width, half hold as many values.

    So neither what happens about rest, where most values are, nor what happens far from it is smeared.
    """
    widths = np.linspace(x.min(), x.max(), bins // 2 + 1)
    counts = np.quantile(x, np.linspace(0.0, 1.0, bins // 2 + 1))
    edges = np.unique(np.concatenate([widths, counts]))[1:-1]
    return np.asarray(np.searchsorted(edges, x, side="right"))


def bin_means(
    driver: FloatArray, values: FloatArray, bins: int = _BINS, fewest: int = 3
) -> tuple[FloatArray, FloatArray]:
    """Mean of ``driver`` and of ``values`` in bins that hold enough of them, from the least driver to the largest."""
    known = np.isfinite(driver) & np.isfinite(values)
    x, y = driver[known], values[known]
    where = _bin_of(x, bins)
    count = np.bincount(where)
    enough = count >= fewest

    def mean(of: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(where, weights=of)[enough] / count[enough])

    return mean(x), mean(y)


def _over_time(with_it: Sequence[FloatArray], without: Sequence[FloatArray], runs: PreparedRuns) -> MissingTorque:
    """The run in which the equation gives most."""
    sizes = [float(np.nansum((one - other) ** 2)) for one, other in zip(with_it, without, strict=True)]
    most = int(np.argmax(sizes))
    time, equation = runs.items[most].rates.time, with_it[most] - without[most]
    return MissingTorque(
        driver=f"time in {runs.items[most].trial.name}, s",
        driver_values=time,
        measured=-without[most],
        equation=equation,
        line=(time, equation),
    )
