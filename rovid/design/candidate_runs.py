"""Runs that a crew can play: holds, stairs, sines, sweeps, random levels, coast-downs, turns and back, one thruster."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.effects.actuator_inputs import actuator_inputs
from rovid.model.model import Model
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# s of rest before each run: the filter and the vehicle begin from nothing.
LEAD_SECONDS = 4.0
_LEVELS = (0.3, 0.6, 1.0)
_SEED = 20130401  # a plan is the same whenever it is made
# Times in vehicle time constants, but no shorter than so many s for a crew and its drives.
_SHORTEST_HOLD = 8.0
_TURNS = (1.0, 6.0)
# A sweep lasts so many of its longest periods.
_SWEEP = 3.0


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateRun:
    """A run to come.

    Attributes
    ----------
    name
        One line for a crew.
    time, commands
        (n,) s and (n, k) in each actuator's unit, held from each instant to the next.
    reference
        What each further channel is taken to be meanwhile.
    """

    name: str
    time: FloatArray
    commands: FloatArray
    reference: Mapping[str, float] = field(default_factory=dict)

    @property
    def seconds(self) -> float:
        """How long it takes."""
        return float(self.time[-1])


@dataclass(frozen=True, kw_only=True)
class RunLimits:
    """What a crew allows: share of the commands in use, and at most so many s, rad/s (m/s) and turns (or m)."""

    share: float = 1.0
    seconds: float = 600.0
    rate: float = math.inf
    travel: float = math.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class RunScales:
    """What the runs are scaled by.

    Attributes
    ----------
    constant
        The vehicle's time constant in s at a middling rate.
    period
        s between the instants of a command file.
    full
        (2, k) commands of a full push down and up, each actuator in the sense of its arm.
    edge
        (2, k) where the thrust begins on either side.
    fast
        Steady rate under a full push, in rad/s or m/s.
    """

    constant: float
    period: float
    full: FloatArray
    edge: FloatArray
    fast: float

    @classmethod
    def from_trials(cls, model: Model, vehicle: Vehicle, trials: Sequence[Trial], share: float) -> RunScales:
        """From the commands that ``trials`` used, of which ``share`` is allowed.

        Raises
        ------
        DataError
            The thrusters push one way only.
        """
        commands = np.vstack([trial.commands for trial in trials])
        where = actuator_inputs(vehicle, trials[0])
        used = np.nanmin(commands, axis=0), np.nanmax(commands, axis=0)
        most = np.maximum(used[1] - where.neutral, where.neutral - used[0]) * share
        senses = np.sign(where.arms)
        full, edge = np.empty((2, len(most))), np.empty((2, len(most)))
        for row, way in enumerate((-1.0, 1.0)):
            side = (way * senses > 0.0).astype(int)
            edge[row] = where.dead_zone[np.arange(len(most)), side]
            # About a neutral that is off the middle of the curve the same way back would be beyond its end.
            full[row] = np.clip(where.neutral + way * senses * most, *where.command_range.T)
        torques = np.array([vehicle.thrust(one[None])[0] @ where.arms for one in full])
        if not torques[0] < 0.0 < torques[1]:
            raise DataError("the thrusters push one way only.", mend=f"Look at {vehicle.axis.arm_key} in rovid.toml.")
        fast = model.steady_rate(float(np.min(np.abs(torques))))
        slope = 2.0 * model.quadratic_drag * 0.5 * fast + model.linear_drag
        constant = model.inertia / max(slope, 1e-12)
        if model.stiffness > 0.0:
            constant = max(constant, 2.0 * math.pi * math.sqrt(model.inertia / model.stiffness))
        period = float(np.median([trial.sampling_interval for trial in trials]))
        return cls(constant=constant, period=period, full=full, edge=edge, fast=fast)

    def commands(self, shares: FloatArray) -> FloatArray:
        """(n, k) commands of (n,) shares of the full push, -1 to 1; neutral at 0."""
        row = (shares > 0.0).astype(int)
        edge, full = self.edge[row], self.full[row]
        reach = edge + np.abs(shares)[:, None] * (full - edge)
        return np.asarray(np.where(shares[:, None] == 0.0, self.neutral, reach))

    @property
    def neutral(self) -> FloatArray:
        """(k,) commands half way between those at which the thrusters begin to push either way."""
        return np.asarray(0.5 * (self.edge[0] + self.edge[1]))


def candidate_runs(pace: RunScales, thrusters: Sequence[str]) -> list[CandidateRun]:
    """Every run that is worth a thought, each from rest and left at rest."""
    runs = [_played(name, pieces, pace) for name, pieces in _courses(pace)]
    if len(thrusters) > 1:
        runs += [_alone(one, at, pace) for at, one in enumerate(thrusters)]
    return runs


# Seconds and share of full thrust of a held push.
_Piece = tuple[float, float]


def _courses(pace: RunScales) -> Iterator[tuple[str, list[_Piece]]]:
    tau = pace.constant
    hold = max(5.0 * tau, _SHORTEST_HOLD)
    for level in _LEVELS:
        share = f"{100 * level:.0f} % of the command"
        yield f"hold both ways at {share}, {hold:.0f} s each", [(hold, level), (hold, -level)]
        coast = max(8.0 * tau, 2.0 * _SHORTEST_HOLD)
        yield f"coast-downs from both ways at {share}", [(hold, level), (coast, 0.0), (hold, -level), (coast, 0.0)]
        for count in (3.0, 10.0, 30.0):
            period = count * tau
            cycles = max(4, math.ceil(40.0 / count))
            yield f"sine of {period:.3g} s at {share}, {cycles} periods", _sine(period, level, cycles, pace)
        for turns in _TURNS:
            # A rate that quadratic drag holds goes as the root of the push.
            seconds = turns * 2.0 * math.pi / max(pace.fast * math.sqrt(level), 1e-9)
            rest = max(8.0 * tau, 20.0)
            plural = "s" if turns > 1 else ""
            name = f"about {turns:g} turn{plural} and back at {share}, with rests"
            yield name, [(seconds, level), (rest, 0.0), (seconds, -level), (rest, 0.0)]
        for quick, word in ((0.3, "fast"), (2.0, "slow")):
            yield f"{word} random levels up to {share}", _random(quick * tau, level, 60.0 * quick**0.3 * tau)
    step = max(3.0 * tau, 4.0)
    up = [0.05, 0.1, 0.2, 0.3, 0.45, 0.3, 0.2, 0.1, 0.05]
    down = [-level for level in up]
    stairs = [(step, level) for level in (*up, 0.0, *down, 0.0)]
    yield f"slow staircase through neutral, {step:.0f} s a level", stairs
    yield "sweep from slow to fast sines", _sweep(30.0 * tau, 1.5 * tau, 0.8, pace)
    yield "left alone at rest for two minutes", [(2.0, 0.3), (120.0, 0.0)]


def _sine(period: float, level: float, cycles: int, pace: RunScales) -> list[_Piece]:
    """Whole periods of a sine that reaches the share ``level``, ``period`` in s."""
    step = max(pace.period, period / 200.0)
    time = np.arange(0.0, cycles * period, step)
    return [(step, float(level * math.sin(2.0 * math.pi * t / period))) for t in time]


def _sweep(longest: float, shortest: float, level: float, pace: RunScales) -> list[_Piece]:
    """Periods fall by a constant share from each to the next, so that each has as many cycles as another."""
    step = max(pace.period, shortest / 40.0)
    time = np.arange(0.0, _SWEEP * longest, step)
    phase = _swept(longest, shortest, time)
    return [(step, float(level * math.sin(one))) for one in phase]


def _swept(longest: float, shortest: float, time: FloatArray) -> FloatArray:
    """(n,) rad at each ``time`` of a sine whose period falls from the ``longest`` to the ``shortest``."""
    growth = math.log(longest / shortest) / (_SWEEP * longest)
    return np.asarray(2.0 * math.pi / longest * np.expm1(growth * time) / growth)


def _random(typical: float, level: float, length: float) -> list[_Piece]:
    rng = np.random.default_rng(_SEED)
    pieces: list[_Piece] = []
    while sum(seconds for seconds, _ in pieces) < length:
        pieces.append(_random_piece(rng, typical, level))
    return pieces


def _random_piece(rng: np.random.Generator, typical: float, level: float) -> _Piece:
    """A push either way, held for half to twice as long as is typical."""
    share = float(rng.uniform(0.2, 1.0) * level * rng.choice((-1.0, 1.0)))
    return float(typical * rng.uniform(0.5, 2.0)), share


def _played(name: str, pieces: Sequence[_Piece], pace: RunScales) -> CandidateRun:
    """The run that a crew plays of (seconds, share) ``pieces``."""
    time, shares = _course(pieces, pace)
    return CandidateRun(name=name, time=time, commands=pace.commands(shares))


def _course(pieces: Sequence[_Piece], pace: RunScales) -> tuple[FloatArray, FloatArray]:
    """(n,) s and the share held at each, on the clock of the logs."""
    lengths, shares = zip(*pieces, strict=True)
    ends = LEAD_SECONDS + np.cumsum(lengths)
    time = pace.period * np.arange(round(float(ends[-1]) / pace.period) + 1)
    levels = np.array([0.0, *shares], dtype=np.float64)
    # A little late, so that rounding moves no instant to the level before.
    at = np.searchsorted(np.array([LEAD_SECONDS, *ends]), time + 1e-9, side="right")
    held = levels[np.minimum(at, len(levels) - 1)]
    return np.asarray(time, dtype=np.float64), held


def _alone(name: str, at: int, pace: RunScales) -> CandidateRun:
    hold = max(5.0 * pace.constant, _SHORTEST_HOLD)
    time, shares = _course([(hold, 1.0), (hold, 0.0), (hold, -1.0), (hold, 0.0)], pace)
    commands = pace.commands(np.zeros(len(time)))
    commands[:, at] = pace.commands(shares)[:, at]
    return CandidateRun(name=f"{name} alone, both ways, {hold:.0f} s each", time=time, commands=commands)
