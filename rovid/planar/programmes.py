"""Candidate runs of the planar model: steps, sines, circles, zigzags, random levels and a square. docs/plan.md."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.estimate.candidate_runs import LEAD_SECONDS, CandidateRun
from rovid.planar.dataset import PlanarData
from rovid.planar.model import AXIS_NAMES

# Shares of the full demand; length of a run in longest time constants; that of a step in time constants and its least
# in s, which a crew and its drives can play. Conventions.
_LEVELS, _LENGTH, _HOLD, _SHORTEST_HOLD = (0.3, 0.6, 1.0), 40.0, 4.0, 4.0
# Seed of random levels: a plan is the same whenever it is made.
_SEED = 20130401
# Points of a thrust curve that is inverted, and least share of a unit demand that the thrusters can follow.
_POINTS, _LEAST_SHARE = 401, 0.1
# Duration in s and demands along surge, sway and yaw, -1 to 1.
_Piece = tuple[float, tuple[float, float, float]]


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarAllocation:
    """Commands of all k actuators for demands along surge, sway and yaw, within those of the logs."""

    data: PlanarData
    bounds: FloatArray  #: (2, k) least and largest command; the command without thrust is between them.
    neutral: FloatArray  #: (k,)
    ways: FloatArray  #: (3, t) N of each thruster at a full demand along each axis; zeros where none can follow.
    unused: tuple[str, ...]  #: Thrusters that never run in the logs: they use as much of their curves as the others.

    @classmethod
    def of(cls, data: PlanarData, share: float) -> Self:
        """For the given ``share`` of the commands in the logs."""
        vehicle, own = data.vehicle, data.actuators.thruster_columns
        commands = np.vstack([run.trial.commands for run in data.runs])
        turned = data.actuators.angle_columns
        commands[:, turned] = (commands[:, turned] + math.pi) % (2.0 * math.pi) - math.pi
        curves = [one.curve for one in vehicle.thrusters]
        neutral = np.array([0.0 if curve is None else curve.neutral for curve in curves])
        used = np.nanmin(commands, axis=0), np.nanmax(commands, axis=0)
        bounds = np.array([np.fmin(used[0], neutral), np.fmax(used[1], neutral)])
        ends = bounds.copy()
        for at, curve in enumerate(curves):
            if curve is not None:
                ends[:, at] = curve.command[[0, -1]]
        bounds = np.clip(bounds, *ends)
        idle = [at for at in own.tolist() if bounds[0, at] == bounds[1, at]]
        reach = np.ptp(bounds, axis=0)[own] / np.maximum(np.ptp(ends, axis=0)[own], 1e-300)
        bounds[:, idle] = neutral[idle] + reach.max(initial=0.0) * (ends[:, idle] - neutral[idle])
        bounds = neutral + share * (bounds - neutral)
        ways = _ways(data.actuators.matrix, np.abs(vehicle.thrust(bounds))[:, own].max(axis=0))
        names = tuple(vehicle.thrusters[at].name for at in idle)
        return cls(data=data, bounds=bounds, neutral=neutral, ways=ways, unused=names)

    @property
    def driven(self) -> BoolArray:
        """(3,) whether an actuator acts along surge, sway and yaw."""
        turned = np.ptp(self.bounds, axis=0)[self.data.actuators.angle_columns]
        return np.array([way.any() or (axis == 2 and turned.any()) for axis, way in enumerate(self.ways)], dtype=bool)

    def commands(self, demands: FloatArray) -> FloatArray:
        """(n, k) commands of (n, 3) demands."""
        found, wanted = np.tile(self.neutral, (len(demands), 1)), demands @ self.ways
        grid = np.linspace(self.bounds[0], self.bounds[1], _POINTS)
        thrust = self.data.vehicle.thrust(grid)
        for column, force in zip(self.data.actuators.thruster_columns.tolist(), wanted.T, strict=True):
            way = 1 if thrust[-1, column] >= thrust[0, column] else -1
            command = np.interp(force, np.maximum.accumulate(thrust[::way, column]), grid[::way, column])
            found[:, column] = np.where(force == 0.0, self.neutral[column], command)
        positions = {one.name: one.position or (0.0, 0.0) for one in self.data.vehicle.thrusters}
        for column in self.data.actuators.angle_columns.tolist():
            one = self.data.vehicle.thrusters[column]
            # A stern rudder turns the bow to the side of its angle, a stern thruster to the other side.
            ahead = -one.rudder.position[0] if one.rudder else positions[one.turns][0]
            turn = math.copysign(1.0, ahead) * demands[:, 2]
            found[:, column] = np.abs(turn) * np.where(turn > 0.0, self.bounds[1, column], self.bounds[0, column])
        return found + 0.0  # No -0 in the command file.


def _ways(matrix: FloatArray, thrusts: FloatArray) -> FloatArray:
    """(3, t) N of each thruster at a full demand, from the (3, t) ``matrix`` and the (t,) largest thrusts."""
    size = np.abs(matrix).max(axis=1, initial=0.0)
    scaled = matrix / np.where(size > 0.0, size, 1.0)[:, None]
    ways = np.zeros_like(matrix)
    for axis, row in enumerate(np.linalg.pinv(scaled, rcond=1e-6).T):
        used = (np.abs(row) > _LEAST_SHARE * np.abs(row).max(initial=0.0)) & (thrusts > 0.0)
        if scaled[axis] @ row > _LEAST_SHARE and used.any():
            ways[axis] = row * np.min(thrusts[used] / np.abs(row[used]))
    return ways


def planar_candidates_of(
    allocation: PlanarAllocation, axes: BoolArray, times: FloatArray, rate: float, period: float
) -> list[CandidateRun]:
    """Candidate runs along the (3,) ``axes``, each repeated for some time constants.

    (3,) ``times`` are the time constants in s, ``rate`` the usual yaw rate in rad/s, and ``period`` the interval
    between the instants of a command file in s.
    """
    runs, rest = [], (0.0, 0.0, 0.0)
    for level in _LEVELS:
        for name, pieces in _programmes(axes, times, 0.5 * math.pi / rate):
            seconds = sum(one for one, _ in pieces)
            count = max(1, int(_LENGTH * float(times[axes].max()) / seconds))
            time = period * np.arange(round((LEAD_SECONDS + count * seconds) / period) + 1, dtype=np.float64)
            starts = np.concatenate(([0.0], LEAD_SECONDS + np.cumsum([0.0, *[one for one, _ in pieces] * count])))
            levels = np.array([rest, *[one for _, one in pieces] * count, rest])
            # A tiny delay, because rounding must not move an instant to the previous level.
            at = np.searchsorted(starts, time + 1e-9, side="right") - 1
            named = f"{name}, at {100.0 * level:.0f} % of the command" + (f", {count} times" if count > 1 else "")
            runs.append(CandidateRun(name=named, time=time, commands=allocation.commands(level * levels[at])))
    return runs


def _programmes(axes: BoolArray, times: FloatArray, quarter: float) -> Iterator[tuple[str, list[_Piece]]]:
    """Name and pieces of one period of each programme; a ``quarter`` turn takes so many s."""
    hold = np.maximum(_HOLD * times, _SHORTEST_HOLD).tolist()
    for axis in np.flatnonzero(axes).tolist():
        unit, coast = np.eye(3)[axis], (0.5 * hold[axis], np.zeros(3))
        parts = [(hold[axis], unit), coast, (hold[axis], -unit), coast]
        yield f"steps of {AXIS_NAMES[axis]} both ways, {hold[axis]:.0f} s each", [_piece(*one) for one in parts]
    rng = np.random.default_rng(_SEED)
    named = " and ".join(np.array(AXIS_NAMES)[axes].tolist())
    for word, typical in (("fast", 1.0), ("slow", 4.0)):
        lengths = max(typical * float(times[axes].min()), 0.5 * _SHORTEST_HOLD) * rng.uniform(0.5, 2.0, 16)
        levels = rng.uniform(-1.0, 1.0, (16, 3)) * axes
        yield f"{word} random levels of {named}", list(map(_piece, lengths, levels))
    if axes[2]:
        for count in (3.0, 10.0):
            cycle = max(count * float(times[2]), _SHORTEST_HOLD)
            angles = 2.0 * math.pi * (np.arange(24) + 0.5) / 24.0
            yield f"sines of yaw of {cycle:.3g} s", [(cycle / 24.0, (0.0, 0.0, math.sin(one))) for one in angles]
    if axes[0] and axes[2]:
        long, swing = 2.0 * max(hold[0], hold[2]), max(2.0 * float(times[2]), _SHORTEST_HOLD)
        yield f"turning circles both ways, {long:.0f} s each", [(long, (1.0, 0.0, 0.7)), (long, (1.0, 0.0, -0.7))]
        swings = [(swing * (0.5, 1.0)[at > 0], (ahead, 0.0, (-1.0) ** at)) for ahead in (0.4, 1.0) for at in range(6)]
        yield f"zigzags at two speeds, {swing:.0f} s a swing", swings
        sides: list[_Piece] = [(hold[0], (1.0, 0.0, 0.0)), (quarter, (0.5, 0.0, 0.6))]
        yield f"square on about four headings, {hold[0]:.0f} s a side", sides * 4


def _piece(seconds: float, demand: FloatArray) -> _Piece:
    surge, sway, yaw = demand.tolist()
    return float(seconds), (surge, sway, yaw)
