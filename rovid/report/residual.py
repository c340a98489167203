"""The torque that the model leaves over, and what shape it has."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import signal

from rovid.campaign.trial import Campaign
from rovid.campaign.vehicle import Vehicle
from rovid.ground.arrays import FloatArray
from rovid.model.model import Model
from rovid.motion.rates import finite_stretches
from rovid.motion.runs import Run, Runs, prepare

_SEGMENT = 1024
_SHORTEST = 64
_BINS = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class Residual:
    """One run's torques, or forces, all (m,), in N m (N) and behind the same filter; NaN where they are not known.

    Attributes
    ----------
    drive
        The thrusters', after every effect between command and torque.
    beside
        Theirs, as in `rovid.model.drive.Drive`.
    left
        T - I rdot - DQ |r| r - DL r, and what weight and buoyancy do off it. Effects in the equation of motion are
        still in it.
    noise
        What the sensor's noise alone would leave over, as a standard deviation.
    """

    run: Run
    drive: FloatArray
    beside: FloatArray
    left: FloatArray
    noise: float


def residuals_of(runs: Sequence[Run], model: Model, vehicle: Vehicle) -> list[Residual]:
    """What inertia, drag, weight and buoyancy leave over of the torque in each run."""
    return [_residual(run, model, vehicle) for run in runs]


def _residual(run: Run, model: Model, vehicle: Vehicle) -> Residual:
    held = model.drive(vehicle, run.trial).mapped(lambda series: run.rates.held(run.trial, series))
    drive = held.torque if model.effects else run.drive
    item = Residual(
        run=run,
        drive=drive,
        beside=held.beside,
        left=np.asarray(drive - model.inertia * run.rates.acceleration - model.drag(run.rates.rate)),
        noise=model.inertia * run.rates.acceleration_noise,
    )
    return replace(item, left=item.left + _terms_torque(item, _base(model)))


def _base(model: Model) -> Model:
    """``model`` without effects; what weight and buoyancy do is a term of it."""
    return replace(model, effects=(), effect_values=())


def left_by_all(runs: Runs, model: Model, vehicle: Vehicle) -> list[Residual]:
    """As ``residuals_of``, with every effect taken out: those in the equation of motion and the heading's deviation.

    A wave stays in: its phase is not a parameter.
    """
    items = residuals_of(_as_turned(runs, model, vehicle), model, vehicle)
    # What weight and buoyancy do is taken out already.
    return [
        replace(item, left=item.left + _terms_torque(item, model) - _terms_torque(item, _base(model))) for item in items
    ]


def _as_turned(runs: Runs, model: Model, vehicle: Vehicle) -> Sequence[Run]:
    """The runs with the headings that ``model`` takes for the true ones, behind the same filter."""
    if not any(effect.on_heading for effect in model.effects):
        return runs.items
    trials = [run.trial for run in runs.items]
    true = [model.true_angle(trial, trial.position, np.arange(len(trial.time)))[0] for trial in trials]
    turned = tuple(replace(trial, position=heading) for trial, heading in zip(trials, true, strict=True))
    return prepare(Campaign(trials=turned, sources=()), vehicle, cutoff=runs.cutoff).items


def _terms_torque(item: Residual, model: Model) -> FloatArray:
    """(m,) torque in N m of the terms in the equation of motion, along the measured rate and angle."""
    trial, rates = item.run.trial, item.run.rates
    turned = rates.position - model.base(trial)[3]
    return model.along(trial, rates.kernel.period, (rates.rate, turned, item.drive), item.beside)[0]


def sizes(items: Sequence[Residual]) -> tuple[float, float, float]:
    """Root mean squares in N m: of what is left, of the torque, and of what the sensor's noise makes of itself."""
    left = np.concatenate([item.left for item in items])
    known = np.isfinite(left)
    drive = np.concatenate([item.drive for item in items])[known]
    noise = np.concatenate([np.full(len(item.left), item.noise) for item in items])[known]
    return _rms(left[known]), _rms(drive), _rms(noise)


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def binned(driver: FloatArray, left: FloatArray, bins: int = _BINS) -> tuple[FloatArray, FloatArray]:
    """Mean of ``driver`` and of ``left`` in stretches of the driver's range that hold enough samples."""
    known = np.isfinite(driver) & np.isfinite(left)
    x, y = driver[known], left[known]
    if x.size < bins or np.ptp(x) == 0.0:
        return np.empty(0), np.empty(0)
    edges = np.linspace(x.min(), x.max(), bins + 1)
    where = np.clip(np.digitize(x, edges) - 1, 0, bins - 1)
    count = np.bincount(where, minlength=bins)
    enough = count >= max(10, x.size // 2000)
    divide = np.maximum(count, 1)
    means = (np.bincount(where, weights=values, minlength=bins) / divide for values in (x, y))
    across, up = (np.where(enough, mean, np.nan) for mean in means)
    return across, up


def spectrum(items: Sequence[Residual], cutoff: float) -> tuple[FloatArray, FloatArray]:
    """Frequency in Hz up to the cut-off and density in (N m)^2/Hz, averaged over all stretches by their length."""
    frequency = np.linspace(0.0, cutoff, 256)[1:]
    total, weight = np.zeros(len(frequency)), 0.0
    for period, part in _stretches(items):
        own, density = signal.welch(part, fs=1.0 / period, nperseg=min(_SEGMENT, len(part)), nfft=_SEGMENT)
        total += np.interp(frequency, own, np.asarray(density)) * len(part) * period
        weight += len(part) * period
    return frequency, total / weight if weight else np.full(len(frequency), np.nan)


def autocorrelation(items: Sequence[Residual], longest: float) -> tuple[FloatArray, FloatArray]:
    """Lag in s up to ``longest``, and the correlation of what is left with itself that much later."""
    lags = np.linspace(0.0, longest, 200)
    total = np.zeros(len(lags))
    for period, part in _stretches(items):
        products = signal.correlate(part, part, mode="full", method="fft")[len(part) - 1 :]
        total += np.interp(lags, period * np.arange(len(part)), products, right=0.0) * period
    return lags, total / total[0] if total[0] > 0.0 else np.full(len(lags), np.nan)


def _stretches(items: Sequence[Residual]) -> Iterator[tuple[float, FloatArray]]:
    """Sampling period in s and values of every unbroken stretch long enough to speak of a spectrum."""
    for item in items:
        for start, stop in finite_stretches(item.left):
            if stop - start >= _SHORTEST:
                yield item.run.rates.kernel.period, item.left[start:stop]
