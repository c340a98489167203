"""What the baselines share: data on a uniform grid, the library of candidate terms, and a filter that simulates too.

A term adds to the torque, per coefficient: its command part a(t), its part b(t) times the rate, and a weighted sum of
functions of rate and heading (see `STATE`). A column of the equation error alone stands for terms with memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numba
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from benchmarks.challenge.rules import Campaign, Floats

_MOST = 8000  # instants of a campaign on the grid
_NOISE = 0.1  # of the acceleration that remains after smoothing, relative to the acceleration
# Functions of rate and heading: a smooth sign of the rate, r^3, r^2, the angle turned, cos, sin, cos 2, sin 2.
STATE = 8
_compiled = numba.njit(cache=True)


@dataclass(frozen=True, eq=False)
class Grid:
    """A run on a uniform grid: (n,) heading in rad (NaN where held out), torque in N m; (n, k) torques and thrust."""

    step: float
    time: Floats
    heading: Floats
    torques: Floats
    arms: Floats
    extra: dict[str, Floats]

    @property
    def torque(self) -> Floats:
        return np.asarray(self.torques.sum(axis=1))

    @property
    def thrust(self) -> Floats:
        return np.asarray(self.torques / self.arms)


@dataclass(frozen=True, eq=False)
class Part:
    """One coefficient of a term, over all runs: a (N,), b (N,), weights (STATE,); or an equation-error column alone."""

    a: Floats
    b: Floats
    w: Floats
    column: Floats | None = None


@dataclass(frozen=True, eq=False)
class Data:
    """A campaign on the grid. ``rate``, ``acceleration`` and ``smooth`` torque (N,) went through one filter."""

    runs: tuple[Grid, ...]
    sigma: float  # s, of the Gaussian filter
    rate: Floats
    acceleration: Floats
    turned: Floats
    heading: Floats
    used: np.ndarray = field(repr=False)

    @property
    def lengths(self) -> list[int]:
        return [run.time.size for run in self.runs]

    def smooth(self, values: Floats) -> Floats:
        """Values (N,) through the filter, run by run."""
        pieces = zip(np.split(values, np.cumsum(self.lengths)[:-1]), self.runs, strict=True)
        return np.concatenate([gaussian_filter1d(one, self.sigma / run.step) for one, run in pieces])


def grid_of(campaign: Campaign) -> tuple[Grid, ...]:
    """Runs on a grid of the median step, or a coarser one where there are too many readings."""
    total = sum(float(run.time[-1]) for run in campaign.runs)
    every = [float(np.median(np.diff(run.time[np.isfinite(run.heading)]))) for run in campaign.runs]
    step = max(float(np.median(every)), total / _MOST)
    grids = []
    arms = np.array([one["yaw_arm_m"] for one in campaign.description["thrusters"]])
    names = {one["name"] for one in campaign.description["thrusters"]}
    arms = np.where(np.abs(arms) < 1e-9, 1e-9, arms)
    for run in campaign.runs:
        time = np.arange(run.time[0], run.time[-1], step)
        known = np.isfinite(run.heading)
        heading = np.interp(time, run.time[known], run.heading[known])
        heading[time > run.time[known][-1]] = np.nan
        # Commands are held; the mean over the step keeps changes between two instants.
        edges = np.append(time, time[-1] + step)
        held = np.searchsorted(run.time, edges + 1e-9, side="right") - 1
        spans = np.diff(run.time, append=run.time[-1] + 1e-9)[:, None]
        integral = np.vstack([np.zeros(run.torques.shape[1]), np.cumsum(run.torques * spans, axis=0)])
        at = integral[held] + run.torques[held] * (np.minimum(edges, run.time[-1]) - run.time[held])[:, None]
        torques = np.diff(at, axis=0) / step
        extra = {}
        for name in run.table.columns:
            values = run.table[name].to_numpy(dtype=float)
            good = np.isfinite(values)
            if name not in {*names, "time_s", "heading_deg"} and good.sum() > 10:
                extra[name] = np.interp(time, run.time[good], values[good])
        grids.append(Grid(step, time, heading, torques, arms, extra))
    return tuple(grids)


def data_of(campaign: Campaign) -> Data:
    """The campaign on the grid, with rates from the heading by a Gaussian filter that leaves little noise."""
    runs = grid_of(campaign)
    filled = [np.where(np.isfinite(run.heading), run.heading, run.heading[np.isfinite(run.heading)][-1])
              for run in runs]  # fmt: skip
    step = runs[0].step
    noise = float(np.median([np.std(np.diff(one, 3)) for one in filled])) / np.sqrt(20.0)
    width = 3.0
    while True:
        # Differences of the smooth heading: a kernel's own derivative has a sum that is not quite zero.
        rates = [np.gradient(gaussian_filter1d(one, width), step) for one in filled]
        acceleration = [np.gradient(one, step) for one in rates]
        left = noise * np.sqrt(3.0 / (8.0 * np.sqrt(np.pi))) / (width**2.5 * step**2)
        if left < _NOISE * np.std(np.concatenate(acceleration)) or width * step > 0.02 * sum(r.time[-1] for r in runs):
            break
        width *= 1.3
    edge = int(3.0 * width)
    used = []
    for run in runs:
        inner = np.zeros(run.time.size, dtype=bool)
        last = int(np.isfinite(run.heading).sum())
        inner[edge : max(last - edge, 0)] = True
        used.append(inner)
    turned = np.concatenate([one - one[0] for one in filled])
    return Data(runs, width * step, np.concatenate(rates), np.concatenate(acceleration), turned, np.concatenate(filled),
                np.concatenate(used))  # fmt: skip


def _lagged(values: Floats, share: float) -> Floats:
    return np.asarray(values[0] + lfilter([share], [1.0, share - 1.0], values - values[0]))


def _late(values: Floats, places: int) -> Floats:
    return np.concatenate([np.full(places, values[0]), values])[: len(values)]


def _limited(values: Floats, most: float) -> Floats:
    result = values.copy()
    for k in range(1, len(values)):
        result[k] = result[k - 1] + min(max(values[k] - result[k - 1], -most), most)
    return result


def _play(values: Floats, width: float) -> Floats:
    result = values.copy()
    for k in range(1, len(values)):
        result[k] = min(max(result[k - 1], values[k] - width), values[k] + width)
    return result


Candidates = Iterator[tuple[str, list[Part], int]]


def library(data: Data) -> Candidates:
    """(cause, its parts, number of its nonlinear parameters) of each candidate; some causes have several candidates.

    Added mass with memory, the compass' deviation, waves and seiche are not in it. Their columns would hold the
    measured acceleration itself, or need a frequency.
    """
    yield from _of_motion(data)
    yield from _of_thrust(data)
    yield from _of_commands(data)
    yield from _of_speeds(data)


def _commanded(*values: Floats) -> list[Part]:
    return [Part(one, np.zeros_like(one), np.zeros(STATE)) for one in values]


def _state(data: Data, *places: int) -> list[Part]:
    zero = np.zeros_like(data.rate)
    return [Part(zero, zero, np.eye(STATE)[place]) for place in places]


def _seen(data: Data, column: Floats) -> list[Part]:
    """A term of the equation error alone; there is no free simulation of it here."""
    zero = np.zeros_like(data.rate)
    return [Part(zero, zero, np.zeros(STATE), column)]


def _each_rate(data: Data) -> list[Floats]:
    return np.split(data.rate, np.cumsum(data.lengths)[:-1])


def _of_motion(data: Data) -> Candidates:
    yield "bias_torque", _commanded(np.ones_like(data.rate)), 0
    yield "coulomb_resistance", _state(data, 0), 0
    yield "drag_curvature", _state(data, 1), 0
    yield "drag_asymmetry", _state(data, 2), 0
    yield "tether_torsion", _state(data, 3), 0
    yield "heading_dependent_torque", _state(data, 4, 5), 0
    yield "heading_dependent_torque", _state(data, 6, 7), 0
    for size in data.sigma * np.array([10.0, 30.0, 100.0]):
        # A shorter lag of the rate would hold the acceleration itself.
        share = 1.0 - np.exp(-data.runs[0].step / size)
        yield "entrained_swirl", _seen(data, np.concatenate([_lagged(one, share) for one in _each_rate(data)])), 1
    yield "oscillatory_drag", _seen(data, np.abs(data.rate) * data.rate * np.exp(-_since_reversal(data) / 0.5)), 1


def _of_thrust(data: Data) -> Candidates:
    runs, arms = data.runs, data.runs[0].arms
    torque, thrust = (np.concatenate([getattr(run, name) for run in runs]) for name in ("torque", "thrust"))
    most = np.abs(thrust).max()
    if thrust.min() < 0.0:
        yield "thrust_asymmetry", _commanded(np.minimum(thrust, 0.0) @ arms), 0
    if len(arms) > 1:
        for place in range(len(arms)):
            yield "thruster_imbalance", _commanded(thrust[:, place] * arms[place]), 0
    yield "thrust_curve_shape", _commanded((thrust * np.log(np.abs(thrust) / most + 1e-3)) @ arms), 0
    for share in (0.02, 0.1):
        yield "thruster_deadband", _commanded((np.sign(thrust) * np.exp(-np.abs(thrust) / (share * most))) @ arms), 1
    yield "supply_sag", _commanded(torque * np.abs(thrust).sum(axis=1) / most), 0
    yield "supply_sag", _commanded(torque * np.concatenate([run.time for run in runs])), 0
    if all("supply_voltage" in run.extra for run in runs):
        volts = np.concatenate([run.extra["supply_voltage"] for run in runs])
        yield "supply_sag", _commanded(torque * (volts - volts.mean())), 0
    if len(runs) > 1:
        number = np.repeat(np.arange(len(runs)), data.lengths)
        # Relative to the first run.
        yield "thrust_scale_by_trial", _commanded(*(torque * (number == k) for k in range(1, len(runs)))), 0


def _of_commands(data: Data) -> Candidates:
    runs, step, span = data.runs, data.runs[0].step, np.ptp(np.concatenate([run.torque for run in data.runs]))

    def changed(change: Callable[[Floats], Floats]) -> list[Part]:
        return _commanded(np.concatenate([change(run.torque) - run.torque for run in runs]))

    for size in step * np.unique(np.round(np.geomspace(1.0, max(9.0 * data.sigma / step, 4.0), 9))):
        share, places, most = 1.0 - np.exp(-step / size), round(size / step), span * step / (4.0 * size)
        yield "thruster_lag", changed(partial(_lagged, share=share)), 1
        yield "command_delay", changed(partial(_late, places=places)), 1
        yield "slew_limit", changed(partial(_limited, most=most)), 1
    for width in (0.03, 0.1):
        yield "command_hysteresis", changed(partial(_play, width=width * span)), 1


def _of_speeds(data: Data) -> Candidates:
    runs, arms, zero = data.runs, data.runs[0].arms, np.zeros_like(data.rate)
    thrust = np.concatenate([run.thrust for run in runs])
    yield "advance_speed_loss", [Part(zero, -np.sqrt(np.abs(thrust)) @ arms**2, np.zeros(STATE))], 0
    if not all("surge_velocity" in run.extra for run in runs):
        return
    surge = np.concatenate([run.extra["surge_velocity"] for run in runs])
    yield "speed_dependent_damping", [Part(zero, np.abs(surge), np.zeros(STATE))], 0
    yield "speed_dependent_damping", [Part(zero, surge**2, np.zeros(STATE))], 0
    yield "advance_speed_loss", _commanded(-np.sqrt(np.abs(thrust)) @ arms * surge), 0
    if all("sway_velocity" in run.extra for run in runs):
        sway = np.concatenate([run.extra["sway_velocity"] for run in runs])
        yield "sideslip_moment", _commanded(sway), 0
        yield "sideslip_moment", _commanded(surge * sway), 0


def _since_reversal(data: Data) -> Floats:
    """Angle (N,) turned since the last reversal, in rad."""
    result = np.zeros(len(data.rate))
    for k in range(1, len(result)):
        same = data.rate[k] * data.rate[k - 1] > 0.0
        result[k] = result[k - 1] + abs(data.rate[k]) * data.runs[0].step if same else 0.0
    return result


def columns(data: Data, parts: list[Part], scale: float) -> Floats:
    """Torque (N, k) of each coefficient along the measured motion; ``scale`` in rad/s is that of the smooth sign."""
    r, state = data.rate, state_of(data.rate, data.heading, data.turned, scale)
    made = [one.a + one.b * r + state @ one.w if one.column is None else one.column for one in parts]
    return np.column_stack(made)


def state_of(rate: Floats, heading: Floats, turned: Floats, scale: float) -> Floats:
    """(N, STATE) functions of rate and heading, as torques that resist where the motion is to be resisted."""
    return np.column_stack([-np.tanh(rate / scale), -(rate**3), -(rate**2), -turned, np.cos(heading), np.sin(heading),
                            np.cos(2.0 * heading), np.sin(2.0 * heading)])  # fmt: skip


@_compiled
def kalman(
    heading: Floats, torque: Floats, a: Floats, b: Floats, w: Floats, step: float, plain: Floats, noises: Floats,
    scale: float, filtering: bool,
) -> tuple[float, Floats]:  # fmt: skip
    """Negative log-likelihood of the heading of a run by a continuous-discrete extended Kalman filter, and its heading.

    States are heading, rate and a first-order Gauss-Markov torque. ``a``, ``b`` (n,) and ``w`` (STATE,) are the sums
    over all coefficients. ``plain`` is (inertia, quadratic, linear), ``noises`` the disturbance in N m, its time in s,
    and the heading's noise in rad. Without ``filtering`` it is a free simulation.
    """
    inertia, quadratic, linear = plain
    size, memory, noise = noises
    n = len(heading)
    out = np.empty(n)
    psi, r, missing = heading[0], 0.0, 0.0
    p00, p01, p02, p11, p12, p22 = noise**2, 0.0, 0.0, 1e-4 * scale**2, 0.0, size**2
    keep = np.exp(-step / memory)
    total = 0.0
    for k in range(n):
        if filtering and np.isfinite(heading[k]):
            s = p00 + noise**2
            e = heading[k] - psi
            total += 0.5 * (np.log(2.0 * np.pi * s) + e * e / s)
            g0, g1, g2 = p00 / s, p01 / s, p02 / s
            psi, r, missing = psi + g0 * e, r + g1 * e, missing + g2 * e
            p22, p12, p11 = p22 - g2 * p02, p12 - g1 * p02, p11 - g1 * p01
            p02, p01, p00 = p02 - g0 * p02, p01 - g0 * p01, p00 - g0 * p00
        out[k] = psi
        spent = max(1, int(np.ceil(step * (2.0 * quadratic * abs(r) + linear) / inertia / 0.2)))
        h = step / spent
        slope = 0.0
        for _ in range(spent):
            turned = psi - out[0]
            sign = np.tanh(r / scale)
            extra = (
                a[k] + b[k] * r - w[0] * sign - w[1] * r**3 - w[2] * r**2 - w[3] * turned + w[4] * np.cos(psi)
                + w[5] * np.sin(psi) + w[6] * np.cos(2.0 * psi) + w[7] * np.sin(2.0 * psi)
            )  # fmt: skip
            slope = (
                -2.0 * quadratic * abs(r) - linear + b[k] - w[0] * (1.0 - sign**2) / scale - 3.0 * w[1] * r**2
                - 2.0 * w[2] * r
            ) / inertia  # fmt: skip
            push = (torque[k] + missing + extra - quadratic * abs(r) * r - linear * r) / inertia
            push = min(max(push, -1e6), 1e6)
            # Exact for the linearised rate.
            z = min(max(slope * h, -50.0), 5.0)
            factor = (np.exp(z) - 1.0) / z if abs(z) > 1e-6 else 1.0
            psi += h * (r + 0.5 * h * push)
            r = min(max(r + h * push * factor, -1e3), 1e3)
        z = min(max(slope * step, -50.0), 5.0)
        # Transition [[1, f01, f02], [0, f11, f12], [0, 0, keep]] of the covariance.
        f11 = np.exp(z)
        f01 = step * 0.5 * (1.0 + f11)
        f12 = step / inertia * 0.5 * (1.0 + f11)
        f02 = 0.5 * step * f12
        missing *= keep
        c00, c01, c02 = p00 + f01 * p01 + f02 * p02, p01 + f01 * p11 + f02 * p12, p02 + f01 * p12 + f02 * p22
        c11, c12 = f11 * p11 + f12 * p12, f11 * p12 + f12 * p22
        p00, p01, p02 = c00 + f01 * c01 + f02 * c02, f11 * c01 + f12 * c02, keep * c02
        p11, p12 = f11 * c11 + f12 * c12, keep * c12
        p22 = keep**2 * p22 + size**2 * (1.0 - keep**2)
    return total, out
