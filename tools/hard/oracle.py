"""Visibility of the hidden cause: errors of multi-step predictions of the heading without and with the true cause.

Two models of yaw are fitted to the logged heading, each with its own inertia and drag. The horizons are 0.5 to 8 time
constants, with a restart every 0.5 time constants. The plain model has the torque of the bench curve only. The other
model adds the true cause. A cause in the drives is the difference of the simulated rotor torques with and without the
cause. A cause in the water is computed by the simulator's function, with the true speeds and the true state of the
water at each restart. Neither model includes waves, gusts and the coupling with sway. Blocks of eight time constants
alternate between two folds, and each fold is predicted with the parameters of the other fold.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tools.hard import layout as at
from tools.hard.campaign import Campaign, Run
from tools.hard.layout import Floats, Ints, compiled, no_cause
from tools.hard.motion import cross_flow, deviation
from tools.hard.water import moment

HORIZONS = (0.5, 1.0, 2.0, 4.0, 8.0)  # time constants
STEPS = 12  # of the oracle's grid, in a time constant
RESTARTS = 300  # in a campaign, at most
ALWAYS = ("thruster_lag", "sideslip_moment", "speed_dependent_damping", "wave_torque")
# Fits whose parameters are the best that yaw alone can have. They know the cause, and the waves, which are chance; the
# second knows how late the rotors are besides, as a model does that names a lateness.
BEST = {"told_fit": ("wave_torque",), "late_fit": ("wave_torque", "thruster_lag")}
SHOWS = 0.05  # from here on what is always there counts as a cause too


@dataclass(frozen=True)
class Stretch:
    """A run on the oracle's grid, for one model."""

    heading: Floats  # as logged
    start: Floats  # psi, r and the water's two states at each instant
    torque: Floats
    surge: Floats
    sway: Floats
    cause: Floats


@compiled
def turn(
    psi: float, r: float, water: Floats, torque: float, u: float, v: float, cause: Floats, theta: Floats, step: float,
    room: Floats,
) -> tuple[float, float]:  # fmt: skip
    """One step of yaw alone, Runge-Kutta; ``water`` is carried along in place, ``room`` is for what passes by."""
    k, inner, out = room[:4], room[4, :2], room[4, 2:]
    for stage in range(4):
        share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
        before = k[max(stage - 1, 0)]
        psi_now = psi + share * step * before[0]
        r_now = r + share * step * before[1]
        inner[0] = water[0] + share * step * before[2]
        inner[1] = water[1] + share * step * before[3]
        total = torque + moment(r_now, psi_now, u, v, inner, cause, theta[1], theta[2], out)
        k[stage, 0] = r_now
        k[stage, 1] = total / theta[0]
        k[stage, 2] = out[0]
        k[stage, 3] = out[1]
    sixth = step / 6.0
    water[0] += sixth * (k[0, 2] + 2.0 * k[1, 2] + 2.0 * k[2, 2] + k[3, 2])
    water[1] += sixth * (k[0, 3] + 2.0 * k[1, 3] + 2.0 * k[2, 3] + k[3, 3])
    psi += sixth * (k[0, 0] + 2.0 * k[1, 0] + 2.0 * k[2, 0] + k[3, 0])
    return psi, r + sixth * (k[0, 1] + 2.0 * k[1, 1] + 2.0 * k[2, 1] + k[3, 1])


@compiled
def predict(
    heading: Floats, start: Floats, torque: Floats, u: Floats, v: Floats, cause: Floats, theta: Floats, step: float,
    restarts: Ints, horizons: Ints, errors: Floats,
) -> None:  # fmt: skip
    """Heading errors at each horizon from each restart."""
    room = np.zeros((5, 4))
    water = np.zeros(2)
    for row in range(restarts.size):
        begin = restarts[row]
        psi, r = start[begin, 0], start[begin, 1]
        water[0], water[1] = start[begin, 2], start[begin, 3]
        reached = 0
        for ahead in range(horizons[-1]):
            here = begin + ahead
            psi, r = turn(psi, r, water, torque[here], u[here], v[here], cause, theta, step, room)
            if ahead + 1 == horizons[reached]:
                errors[row, reached] = heading[here + 1] - psi
                reached += 1


@compiled
def free_run(start: Floats, torque: Floats, u: Floats, v: Floats, cause: Floats, theta: Floats, step: float) -> Floats:
    """Rate of a whole run from its first instant."""
    room = np.zeros((5, 4))
    water = start[0, 2:4].copy()
    psi, r = start[0, 0], start[0, 1]
    rate = np.zeros(torque.size)
    for k in range(torque.size):
        rate[k] = r
        psi, r = turn(psi, r, water, torque[k], u[k], v[k], cause, theta, step, room)
    return rate


def sway_moment(sway: Floats, rate: Floats, step: float, hull: Floats) -> Floats:
    """Moment that sway adds to that of cross flow in turning alone, and that of its acceleration."""
    return np.asarray(added_cross_flow(sway, rate, hull) - hull[at.M23] * np.gradient(sway, step))


@compiled
def added_cross_flow(sway: Floats, rate: Floats, hull: Floats) -> Floats:
    """Moment of cross flow at each sway and rate, less that of turning alone."""
    moments = np.empty(sway.size)
    for k in range(sway.size):
        _, both = cross_flow(sway[k], rate[k], hull)
        _, turning = cross_flow(0.0, rate[k], hull)
        moments[k] = both - turning
    return moments


class Judge:
    """A campaign on the oracle's grid."""

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        tau = campaign.vehicle.time_constant
        self.every = [max(1, round(tau / STEPS / run.step)) for run in campaign.runs]
        self.steps = [run.step * every for run, every in zip(campaign.runs, self.every, strict=True)]
        self.horizons = [
            np.array([max(1, round(h * tau / step)) for h in HORIZONS], dtype=np.int64) for step in self.steps
        ]
        spaces = [max(1, round(0.5 * tau / step)) for step in self.steps]
        lengths = [run.record.shape[0] // every for run, every in zip(campaign.runs, self.every, strict=True)]
        total = sum(max(0, n - h[-1] - 3) // s for n, h, s in zip(lengths, self.horizons, spaces, strict=True))
        thin = max(1, -(-total // RESTARTS))
        self.restarts: list[Ints] = [
            np.arange(2, max(2, n - h[-1] - 1), s * thin, dtype=np.int64)
            for n, h, s in zip(lengths, self.horizons, spaces, strict=True)
        ]
        self.folds = np.concatenate(
            [(r * step / (8.0 * tau)).astype(int) % 2 for r, step in zip(self.restarts, self.steps, strict=True)]
        )
        hull = campaign.vehicle.hull()
        self.truth = np.array([campaign.vehicle.total_inertia, hull[at.DQ], hull[at.DL]])

    def stretches(self, with_cause: bool, always: Collection[str] = ()) -> list[Stretch]:
        """Runs as inputs of one model; ``always`` adds effects that act in every campaign."""
        return [
            self._stretch(run, every, with_cause, always)
            for run, every in zip(self.campaign.runs, self.every, strict=True)
        ]

    def _stretch(self, run: Run, every: int, with_cause: bool, always: Collection[str]) -> Stretch:
        record = run.record
        count = record.shape[0] // every
        means = record[: count * every].reshape(count, every, -1).mean(axis=1)
        grid = run.step * every * np.arange(count)
        psi = record[: count * every : every, at.R_PSI].copy()
        offset = np.array([deviation(float(x), run.cause) for x in psi])
        rounding = np.radians(self.campaign.instruments.heading_step)
        heading = np.interp(grid, run.log.time, np.round(run.log.heading / rounding) * rounding)
        cause = run.cause.copy() if with_cause else no_cause()
        torque = means[:, at.R_BENCH].copy()
        if "thruster_lag" in always:
            torque = means[:, at.R_TORQUE_PLAIN].copy()
        if with_cause:
            torque += means[:, at.R_TORQUE] - means[:, at.R_TORQUE_PLAIN]
            swell = run.series[: 2 * count * every : 2 * every, at.SWELL_MOMENT]
            torque += cause[at.SWELL] * swell
            heading = heading - offset
        else:
            psi = psi + offset
        hull = self.campaign.vehicle.hull()
        if "sideslip_moment" in always:
            cause[at.MUNK] += hull[at.M22] - hull[at.M11] + hull[at.N_UV]
            torque += sway_moment(means[:, at.R_SWAY], means[:, at.R_RATE], run.step * every, hull)
        if "wave_torque" in always:
            torque += means[:, at.R_WAVES]
        if "speed_dependent_damping" in always:
            cause[at.SPEED_LINEAR] += hull[at.N_UR]
            torque -= hull[at.M23] * means[:, at.R_SURGE] * means[:, at.R_RATE]
        width = max(1, STEPS // 8)  # the rate at a restart is a slope of the heading, as nobody would have it better
        rate = np.gradient(psi, run.step * every)
        rate[width:-width] = (psi[2 * width :] - psi[: -2 * width]) / (2 * width * run.step * every)
        water = record[: count * every : every, [at.R_WATER_0, at.R_WATER_1]] * float(with_cause)
        return Stretch(
            heading, np.column_stack([psi, rate, water]), torque, means[:, at.R_SURGE].copy(),
            means[:, at.R_SWAY].copy(), cause,
        )  # fmt: skip

    def errors(self, stretches: list[Stretch], theta: Floats) -> Floats:
        """A row a restart, a column a horizon."""
        parts = []
        for one, step, restarts, horizons in zip(stretches, self.steps, self.restarts, self.horizons, strict=True):
            errors = np.zeros((restarts.size, len(HORIZONS)))
            predict(one.heading, one.start, one.torque, one.surge, one.sway, one.cause, theta, step, restarts, horizons,
                    errors)  # fmt: skip
            parts.append(errors)
        return np.nan_to_num(np.concatenate(parts), nan=1e3).clip(-1e3, 1e3)

    def fit(self, stretches: list[Stretch], rows: NDArray[np.bool_], begin: Floats | None = None) -> Floats:
        """Inertia and drags that make the sum over horizons of the logarithm of the mean square error least."""
        lowest = np.log(self.truth) - 7.0
        highest = np.log(self.truth) + 4.0
        # A drag that has gone to nothing has no slope left in its logarithm: begin where it has.
        theta = np.log(self.truth if begin is None else np.maximum(begin, 0.1 * self.truth))
        errors = self.errors(stretches, np.exp(theta))[rows]
        cost = _cost(errors)
        damping = 1e-3
        for _ in range(15):
            weights = 1.0 / np.sqrt(np.mean(errors**2, axis=0) * errors.shape[0])
            slopes = [
                ((self.errors(stretches, np.exp(theta + 1e-4 * np.eye(3)[j]))[rows] - errors) * weights / 1e-4).ravel()
                for j in range(3)
            ]
            jacobian = np.stack(slopes, axis=1)
            residual = (errors * weights).ravel()
            normal = jacobian.T @ jacobian
            improved = False
            for _ in range(6):
                matrix = normal + damping * np.diag(np.diag(normal) + 1e-9)
                step = -np.linalg.solve(matrix, jacobian.T @ residual)
                trial = np.clip(theta + np.clip(step, -1.0, 1.0), lowest, highest)
                tried = self.errors(stretches, np.exp(trial))[rows]
                if _cost(tried) < cost:
                    improved = True
                    break
                damping *= 10.0
            if not improved:
                break
            gained = cost - _cost(tried)
            theta, errors, cost = trial, tried, _cost(tried)
            damping = max(damping / 10.0, 1e-6)
            if gained < 1e-4:
                break
        return np.asarray(np.exp(theta))

    def held_out(self, stretches: list[Stretch], begin: Floats) -> Floats:
        """RMS heading error by horizon, each fold with the parameters of the other, rad."""
        squares = np.zeros(len(HORIZONS))
        for fold in (0, 1):
            theta = self.fit(stretches, self.folds != fold, begin)
            squares += np.sum(self.errors(stretches, theta)[self.folds == fold] ** 2, axis=0)
        return np.sqrt(squares / self.folds.size)

    def misfit(self, begin: Floats, always: tuple[str, ...]) -> float:
        """Mean logarithm of the heading error over horizons, where the cause and what is ``always`` there are known."""
        known = self.stretches(self.campaign.cause is not None, always=always)
        best = self.fit(known, np.full(self.folds.size, True), begin)
        return 0.5 * _cost(self.errors(known, best)) / len(HORIZONS)

    def rate_r2(self, stretches: list[Stretch], theta: Floats) -> float:
        """R^2 of the yaw rate over all runs, each simulated freely from its start."""
        left = total = 0.0
        for run, one, every, step in zip(self.campaign.runs, stretches, self.every, self.steps, strict=True):
            true = run.record[::every, at.R_RATE][: one.torque.size]
            rate = free_run(one.start, one.torque, one.surge, one.sway, one.cause, theta, step)
            left += float(np.sum(np.nan_to_num(true - rate, nan=1e3) ** 2))
            total += float(np.sum((true - true.mean()) ** 2))
        return 1.0 - left / total


def _cost(errors: Floats) -> float:
    return float(np.sum(np.log(np.mean(errors**2, axis=0) + 1e-20)))


def look(campaign: Campaign) -> dict[str, Any]:
    """What can be seen of a campaign's cause by one who knows it; see the head of this file."""
    judge = Judge(campaign)
    everything = np.full(judge.folds.size, True)
    plain = judge.stretches(with_cause=False)
    theta = judge.fit(plain, everything)
    without = judge.held_out(plain, theta)
    facts: dict[str, Any] = {
        "plain_r2": judge.rate_r2(plain, theta),
        "plain_fit": dict(zip(("inertia", "quadratic_drag", "linear_drag"), theta.tolist(), strict=True)),
        "heading_error_deg": np.degrees(without).tolist(),
        "visible": 0.0,
    }
    told = plain
    if campaign.cause:
        told = judge.stretches(with_cause=True)
        theta = judge.fit(told, everything)
        ratios = judge.held_out(told, theta) / without
        facts["ratios"] = ratios.tolist()
        facts["visible"] = 1.0 - float(np.exp(np.mean(np.log(ratios))))
        facts["told_r2"] = judge.rate_r2(told, theta)
    for name, known in BEST.items():
        best = judge.fit(judge.stretches(campaign.cause is not None, known), everything, theta)
        facts[name] = dict(zip(("inertia", "quadratic_drag", "linear_drag"), best.tolist(), strict=True))
    facts["always_there"] = {}
    nothing, everything_there = judge.misfit(theta, ()), judge.misfit(theta, ALWAYS)
    for effect in ALWAYS:
        others = tuple(other for other in ALWAYS if other != effect)
        # The effect alone and in addition to all others, because two effects may compensate each other.
        shares = (nothing - judge.misfit(theta, (effect,)), judge.misfit(theta, others) - everything_there)
        facts["always_there"][effect] = 1.0 - float(np.exp(-max(shares)))
    facts["also_true"] = [effect for effect, share in facts["always_there"].items() if share >= SHOWS]
    return facts
