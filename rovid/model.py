"""The model: inertia, quadratic and linear drag, and its free-running simulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rovid.rates import body_angle, on_grid, uniform_grid
from rovid.trial import FloatArray, Trial

# Names, and the unit of each, as they stand in the parameter file and in JSON.
UNITS = {
    "inertia": "kg m^2",
    "quadratic_drag": "N m s^2/rad^2",
    "linear_drag": "N m s/rad",
}
_START_SECONDS = 2.0


@dataclass(frozen=True, kw_only=True)
class Model:
    """``inertia*rdot + quadratic_drag*|r|*r + linear_drag*r = torque``, psidot = r."""

    inertia: float
    quadratic_drag: float
    linear_drag: float

    def drag(self, rate: FloatArray) -> FloatArray:
        """Drag torque in N m at ``rate`` in rad/s."""
        return self.quadratic_drag * np.abs(rate) * rate + self.linear_drag * rate

    def simulate(self, trial: Trial, torque: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Simulate freely from the first sample.

        Parameters
        ----------
        torque
            (n,) N m, held, at the instants of ``trial``.

        Returns
        -------
        rate, heading
            (n,) body yaw rate in rad/s and heading in rad at the instants of ``trial``. The heading starts at
            the first one measured. Where roll and pitch are logged the body rate turns into the heading's by
            psidot = (r + thetadot sin(phi)) / (cos(phi) cos(theta)) (Fossen 2011, eq. 2.28).
        """
        from rovid.kernels import simulate

        rate, angle = simulate(
            trial.time, torque, self.inertia, self.quadratic_drag, self.linear_drag, initial_rate(trial)
        )
        if trial.roll is not None and trial.pitch is not None:
            angle = _euler_heading(trial, rate)
        first = int(np.argmax(trial.measured))
        return rate, trial.heading[first] + angle - angle[first]


def initial_rate(trial: Trial) -> float:
    """Yaw rate in rad/s at the first sample: the gyro's, or the slope of the first seconds of heading."""
    early = (trial.time <= trial.time[0] + _START_SECONDS) & trial.measured
    if trial.yaw_rate is not None and np.isfinite(trial.yaw_rate[early]).any():
        return float(np.nanmean(trial.yaw_rate[early][:5]))
    time, angle = trial.time[early] - trial.time[0], body_angle(trial)[early]
    if len(time) < 3:
        return 0.0
    return float(np.polynomial.polynomial.polyfit(time, angle - angle[0], 2 if len(time) > 5 else 1)[1])


def _euler_heading(trial: Trial, rate: FloatArray) -> FloatArray:
    assert trial.roll is not None and trial.pitch is not None  # noqa: S101, PT018 - narrowed by the caller
    grid = uniform_grid(trial)
    roll, pitch = (_tilt(trial, values, grid) for values in (trial.roll, trial.pitch))
    pitch_rate = np.gradient(pitch, trial.time)
    slope = (rate + pitch_rate * np.sin(roll)) / (np.cos(roll) * np.cos(pitch))
    steps = 0.5 * (slope[1:] + slope[:-1]) * np.diff(trial.time)
    return np.concatenate(([0.0], np.cumsum(steps)))


def _tilt(trial: Trial, values: FloatArray, grid: FloatArray) -> FloatArray:
    known = on_grid(trial, values, grid)
    finite = np.isfinite(known)
    return np.interp(trial.time, grid[finite], known[finite]) if finite.any() else np.zeros(len(trial.time))
