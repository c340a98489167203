"""A trial made ready for identification: its torque, its rates, and both through one filter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import ConfigError, DataError
from rovid.signals.rates import Rates, choose_cutoff, compute_rates, highest_cutoff
from rovid.signals.segments import find_releases
from rovid.trial.axis import Axis
from rovid.trial.trial import Campaign, Remark, Trial
from rovid.trial.vehicle import Vehicle

# A logged rate this far from the position's, as a gain and as a share of the usual rate, spoils the drag.
_GYRO_GAIN = 0.03
_GYRO_OFFSET = 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One trial with everything derived from it.

    Attributes
    ----------
    torque
        (n,) N m, held, at the trial's own instants.
    rates
        Yaw rate and acceleration on a uniform grid of m instants.
    drive
        (m,) the torque through the same filter as the rates.
    """

    trial: Trial
    torque: FloatArray
    rates: Rates
    filtered_torque: FloatArray

    @property
    def valid(self) -> BoolArray:
        """(m,) where rate, acceleration and torque are all known."""
        return np.asarray(self.rates.valid & np.isfinite(self.filtered_torque))


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedRuns:
    """The runs of a campaign, the cut-off they share in Hz (``chosen`` from the data?), and what was left out."""

    items: tuple[Run, ...]
    cutoff: float
    chosen: bool
    remarks: tuple[Remark, ...]

    @property
    def axis(self) -> Axis:
        """The degree of freedom that is looked at."""
        return self.items[0].trial.axis

    @property
    def rate_only(self) -> bool:
        """Whether the rate alone was measured."""
        return self.items[0].trial.rate_only

    def noise(self) -> tuple[float, float, float]:
        """Median over the runs of the sensor's noise in what is measured, and what the low pass leaves of it.

        Standard deviations; of the position, or of the rate where that alone was measured, of rate and of acceleration.
        """
        every = [run.rates for run in self.items]
        rows = [(rates.position_noise, rates.rate_noise, rates.acceleration_noise) for rates in every]
        measured, rate, acceleration = np.median(rows, axis=0)
        return float(measured), float(rate), float(acceleration)


def prepare(campaign: Campaign, vehicle: Vehicle, *, cutoff: float | None = None) -> PreparedRuns:
    """Derive torque and rates of every trial, with the cut-off chosen from the data unless it is given.

    Raises
    ------
    DataError
        No trial is long enough for the filter.
    ConfigError
        The cut-off is too high for the sampling rate.
    """
    trials, remarks = _free(campaign.trials)
    shared = choose_cutoff(trials) if cutoff is None else cutoff
    highest = highest_cutoff(trials)
    if shared > highest * (1.0 + 1e-6):
        raise ConfigError(
            f"is {shared:g} Hz; at this sampling rate rates can be had up to {highest:.3g} Hz.", where="--cutoff"
        )
    runs = []
    for trial in trials:
        torque = vehicle.torque(trial)
        try:
            rates = compute_rates(trial, cutoff=shared)
        except DataError as error:
            remarks.append(Remark(kind="left out", count=len(trial.time), text=str(error)))
            continue
        runs.append(Run(trial=trial, torque=torque, rates=rates, filtered_torque=rates.filter_held(trial, torque)))
    if not runs:
        raise DataError(remarks[0].text if remarks else "there is no trial.")
    remarks += _gyro_remarks([run for run in runs if _gyro_is_off(run.rates)])
    return PreparedRuns(items=tuple(runs), cutoff=shared, chosen=cutoff is None, remarks=tuple(remarks))


def _free(trials: Sequence[Trial]) -> tuple[Sequence[Trial], list[Remark]]:
    """The trials; of those that nothing drives the stretches in which the vehicle swings after it was let go of."""
    if all(trial.has_actuators for trial in trials):
        return trials, []
    found, kept, gone = [], [], []
    for trial in trials:
        parts = find_releases(trial)
        spans = [_span(trial.time[part]) for part in parts]
        for part, span in zip(parts, spans, strict=True):
            name = trial.name if len(parts) == 1 else f"{trial.name}, {span}"
            found.append(trial.part(part, name))
        if spans:
            kept.append(f"{trial.name} ({', '.join(spans)})")
        else:
            gone.append(trial.name)
    if not found:
        axis = trials[0].axis
        raise DataError(
            f"nothing drives these logs in {axis.name}, and they hold no swings that die out.",
            mend=f"Give logs of releases, or map what drives the vehicle: [[thrusters]] with {axis.arm_key}.",
        )
    return found, list(_release_remarks(kept, gone))


def _gyro_is_off(rates: Rates) -> bool:
    known = rates.rate[np.isfinite(rates.rate)]
    typical = float(np.linalg.norm(known)) / max(len(known), 1) ** 0.5
    return abs(rates.gyro_gain - 1.0) > _GYRO_GAIN or abs(rates.gyro_offset) > _GYRO_OFFSET * typical


def _gyro_remarks(off: Sequence[Run]) -> list[Remark]:
    """Say where a logged rate is not the position's, which a bias, a unit or a sign would do."""
    if not off:
        return []
    axis = off[0].trial.axis
    gain, offset = np.median([(run.rates.gyro_gain, run.rates.gyro_offset) for run in off], axis=0)
    names = ", ".join(run.trial.name for run in off)
    text = (
        f"{names}: the logged {axis.rate_words} is {gain:.3g} times the "
        f"{axis.position_words}'s rate, with an offset of {offset:.2g} {axis.rate_unit}, and the results rest on it. "
        f"Check its unit and sign, or delete {axis.rate_signal} in rovid.toml: the {axis.position_words}'s own rate is then "
        "used."
    )
    return [Remark(kind="gyro", count=len(off), text=text)]


def _span(time: FloatArray) -> str:
    return f"{time[0]:.1f} to {time[-1]:.1f} s"


def _release_remarks(kept: Sequence[str], gone: Sequence[str]) -> Iterator[Remark]:
    """Which stretches of which trials are free swings, and the trials that hold none."""
    if kept:
        text = f"Free swings, all that is used of these logs: {'; '.join(kept)}."
        yield Remark(kind="released", count=len(kept), text=text)
    if gone:
        text = f"Left out, for they hold no swings that die out: {', '.join(gone)}."
        yield Remark(kind="left out", count=len(gone), text=text)


def shared_channels(runs: Sequence[Run]) -> set[str]:
    """Further channels that every run has, with readings in one of them at least."""
    every = [run.trial.extras for run in runs]
    shared: set[str] = set.intersection(*map(set, every))
    return {name for name in shared if any(np.isfinite(extras[name]).any() for extras in every)}
