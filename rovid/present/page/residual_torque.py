"""The torque that the model leaves over, and what shape it has."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.model.model import Model
from rovid.model.ode import evaluate_along
from rovid.signals.preprocessing import PreparedRuns, Run, prepare
from rovid.signals.rates import fast_fft_length, finite_segments, power_spectral_density
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

_SEGMENT = 1024
_SHORTEST = 64
_BINS = 16


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualTorque:
    """One run's torques, or forces, all (m,), in N m (N) and behind the same filter; NaN where they are not known.

    Attributes
    ----------
    drive
        The thrusters', after every effect between command and torque.
    beside
        Theirs, as in `rovid.model.torque_input.Drive`.
    left
        T - I rdot - DQ |r| r - DL r, and what weight and buoyancy do off it. Effects in the equation of motion are
        still in it.
    noise
        What the sensor's noise alone would leave over, as a standard deviation.
    """

    run: Run
    thruster_torque: FloatArray
    beside: FloatArray
    residual: FloatArray
    noise_sd: float


def residual_torques(runs: Sequence[Run], model: Model, vehicle: Vehicle) -> list[ResidualTorque]:
    """What inertia, drag, weight and buoyancy leave over of the torque in each run."""
    return [_residual(run, model, vehicle) for run in runs]


def _residual(run: Run, model: Model, vehicle: Vehicle) -> ResidualTorque:
    held = model.torque_input(vehicle, run.trial).mapped(lambda series: run.rates.filter_held(run.trial, series))
    drive = held.torque if model.effects else run.filtered_torque
    noise = model.inertia * run.rates.acceleration_noise
    item = ResidualTorque(
        run=run, thruster_torque=drive, beside=held.effect_inputs, residual=_left(run, model, drive), noise_sd=noise
    )
    return replace(item, residual=item.residual + _terms_torque(item, _base(model)))


def _left(run: Run, model: Model, drive: FloatArray) -> FloatArray:
    """(n,) N m of ``drive`` that neither inertia nor drag take."""
    return np.asarray(drive - model.inertia * run.rates.acceleration - model.drag(run.rates.rate))


def _base(model: Model) -> Model:
    """``model`` without effects; what weight and buoyancy do is a term of it."""
    return replace(model, effects=(), effect_values=())


def unexplained_torques(runs: PreparedRuns, model: Model, vehicle: Vehicle) -> list[ResidualTorque]:
    """As ``residuals_of``, with every effect taken out: those in the equation of motion and the heading's deviation.

    A wave stays in: its phase is not a parameter.
    """
    items = []
    for item in residual_torques(_as_turned(runs, model, vehicle), model, vehicle):
        with_all = item.residual + _terms_torque(item, model)
        # What weight and buoyancy do is taken out already.
        left = with_all - _terms_torque(item, _base(model))
        items.append(replace(item, residual=left))
    return items


def _as_turned(runs: PreparedRuns, model: Model, vehicle: Vehicle) -> Sequence[Run]:
    """The runs with the headings that ``model`` takes for the true ones, behind the same filter."""
    if not model.heading_sensor.deviates:
        return runs.items
    turned = tuple(_turned(run.trial, model) for run in runs.items)
    return prepare(Campaign(trials=turned, sources=()), vehicle, cutoff=runs.cutoff).items


def _turned(trial: Trial, model: Model) -> Trial:
    """``trial`` with the heading that ``model`` takes for the true one."""
    heading, _ = model.heading_sensor.to_true(trial.position)
    return replace(trial, position=heading)


def _terms_torque(item: ResidualTorque, model: Model) -> FloatArray:
    """(m,) torque in N m of the terms in the equation of motion, along the measured rate and angle."""
    trial, rates = item.run.trial, item.run.rates
    turned = rates.position - model.equation_for(trial).start
    return evaluate_along(
        model.equation_for(trial), rates.kernel.period, (rates.rate, turned, item.thruster_torque), item.beside
    )[0]


def all_residuals(items: Sequence[ResidualTorque]) -> FloatArray:
    """What is left of the torque in all runs, one after another."""
    return np.concatenate([item.residual for item in items])


def all_thruster_torques(items: Sequence[ResidualTorque]) -> FloatArray:
    """The thrusters' torques in all runs, one after another."""
    return np.concatenate([item.thruster_torque for item in items])


def all_rates(items: Sequence[ResidualTorque]) -> FloatArray:
    """The rates in all runs, one after another."""
    return np.concatenate([item.run.rates.rate for item in items])


def rms_sizes(items: Sequence[ResidualTorque]) -> tuple[float, float, float]:
    """Root mean squares in N m: of what is left, of the torque, and of what the sensor's noise makes of itself."""
    left = all_residuals(items)
    known = np.isfinite(left)
    drive, noise = all_thruster_torques(items)[known], _all_noises(items)[known]
    return _rms(left[known]), _rms(drive), _rms(noise)


def _all_noises(items: Sequence[ResidualTorque]) -> FloatArray:
    """(N,) standard deviation in N m of the noise in what is left."""
    return np.concatenate([np.full(len(item.residual), item.noise_sd) for item in items])


def _rms(values: FloatArray) -> float:
    """Root mean square; NaN of nothing."""
    if not values.size:
        return math.nan
    return float(np.sqrt(np.mean(values**2)))


def binned_means(driver: FloatArray, left: FloatArray, bins: int = _BINS) -> tuple[FloatArray, FloatArray]:
    """Mean of ``driver`` and of ``left`` in stretches of the driver's range that hold enough samples."""
    known = np.isfinite(driver) & np.isfinite(left)
    x, y = driver[known], left[known]
    if x.size < bins or np.ptp(x) == 0.0:
        return np.empty(0), np.empty(0)
    edges = np.linspace(x.min(), x.max(), bins + 1)
    # The largest value stands on the last edge, and belongs to the bin below it.
    where = np.clip(np.digitize(x, edges) - 1, 0, bins - 1)
    return _means(where, x, bins), _means(where, y, bins)


def _means(where: IntArray, values: FloatArray, bins: int) -> FloatArray:
    """Mean of the ``values`` in each bin; NaN where these are too few to say anything."""
    count = np.bincount(where, minlength=bins)
    enough = count >= max(10, values.size // 2000)
    total = np.bincount(where, weights=values, minlength=bins)
    # An empty bin is not divided by zero: it is not enough in any case.
    mean = total / np.maximum(count, 1)
    return np.where(enough, mean, np.nan)


def spectrum(items: Sequence[ResidualTorque], cutoff: float) -> tuple[FloatArray, FloatArray]:
    """Frequency in Hz up to the cut-off and density in (N m)^2/Hz, averaged over all stretches by their length."""
    frequency = np.linspace(0.0, cutoff, 256)[1:]
    total, weight = np.zeros(len(frequency)), 0.0
    for period, part in _stretches(items):
        own = power_spectral_density(part, _SEGMENT, period, about_mean=True)
        total += np.interp(frequency, np.fft.rfftfreq(_SEGMENT, period), own) * len(part) * period
        weight += len(part) * period
    if not weight:
        return frequency, np.full(len(frequency), np.nan)
    return frequency, total / weight


def autocorrelation(items: Sequence[ResidualTorque], longest: float) -> tuple[FloatArray, FloatArray]:
    """Lag in s up to ``longest``, and the correlation of what is left with itself that much later."""
    lags = np.linspace(0.0, longest, 200)
    total = np.zeros(len(lags))
    for period, part in _stretches(items):
        # With as many zeros behind it none comes round again.
        size = fast_fft_length(2 * len(part))
        products = np.fft.irfft(np.abs(np.fft.rfft(part, size)) ** 2, size)[: len(part)]
        own = period * np.arange(len(part))
        total += np.interp(lags, own, products, right=0.0) * period
    if not total[0] > 0.0:
        return lags, np.full(len(lags), np.nan)
    return lags, total / total[0]


def _stretches(items: Sequence[ResidualTorque]) -> Iterator[tuple[float, FloatArray]]:
    """Sampling period in s and values of every unbroken stretch long enough to speak of a spectrum."""
    for item in items:
        for start, stop in finite_segments(item.residual):
            if stop - start >= _SHORTEST:
                yield item.run.rates.kernel.period, item.residual[start:stop]
