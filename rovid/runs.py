"""A trial made ready for identification: its torque, its rates, and both through one filter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rovid.errors import DataError
from rovid.rates import Rates, choose_cutoff, yaw_rates
from rovid.trial import Campaign, FloatArray, Remark, Trial
from rovid.vehicle import Vehicle


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
    drive: FloatArray

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(m,) where rate, acceleration and torque are all known."""
        return np.asarray(self.rates.valid & np.isfinite(self.drive))


@dataclass(frozen=True, kw_only=True, eq=False)
class Runs:
    """The runs of a campaign, the cut-off they share in Hz (``chosen`` from the data?), and what was left out."""

    items: tuple[Run, ...]
    cutoff: float
    chosen: bool
    remarks: tuple[Remark, ...]

    def noise(self) -> tuple[float, float, float]:
        """Median over the runs of the sensor's noise in heading (rad), and what the low pass leaves of it.

        Standard deviations; rate in rad/s, acceleration in rad/s^2.
        """
        rows = [(r.rates.heading_noise, r.rates.yaw_rate_noise, r.rates.acceleration_noise) for r in self.items]
        heading, rate, acceleration = np.median(rows, axis=0)
        return float(heading), float(rate), float(acceleration)


def prepare(campaign: Campaign, vehicle: Vehicle, *, cutoff: float | None = None) -> Runs:
    """Derive torque and rates of every trial, with the cut-off chosen from the data unless it is given.

    Raises
    ------
    DataError
        No trial is long enough for the filter.
    """
    shared = choose_cutoff(campaign.trials) if cutoff is None else cutoff
    runs, remarks = [], []
    for trial in campaign.trials:
        torque = vehicle.torque(trial)
        try:
            rates = yaw_rates(trial, cutoff=shared)
        except DataError as error:
            remarks.append(Remark(kind="left out", count=len(trial.time), text=str(error)))
            continue
        runs.append(Run(trial=trial, torque=torque, rates=rates, drive=rates.held(trial, torque)))
    if not runs:
        raise DataError(remarks[0].text if remarks else "there is no trial.")
    return Runs(items=tuple(runs), cutoff=shared, chosen=cutoff is None, remarks=tuple(remarks))


def stack(runs: Sequence[Run]) -> tuple[FloatArray, FloatArray, FloatArray, NDArray[np.intp]]:
    """Concatenate the valid rate, acceleration and torque of ``runs``, with the index of the run of each."""
    parts = [(run.rates.yaw_rate[run.valid], run.rates.acceleration[run.valid], run.drive[run.valid]) for run in runs]
    rate, acceleration, torque = (np.concatenate(column) for column in zip(*parts, strict=True))
    return rate, acceleration, torque, np.repeat(np.arange(len(runs)), [len(part[0]) for part in parts])
