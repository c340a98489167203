"""Candidate runs of an experiment: holds, stairs, sines and others of a list, and optimised patterns."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.effects.actuator_inputs import actuator_inputs
from rovid.model.model import Model
from rovid.trial.axis import Axis
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

# Rest before each run in s: filter and vehicle start at rest. Convention.
LEAD_SECONDS = 4.0
# Shares of the full command. Convention.
_LEVELS = (0.3, 0.6, 1.0)
# Seed of random levels and patterns: a plan is the same whenever it is made.
_SEED = 20130401
# Shortest hold in s that a crew and its drives can play; otherwise holds last some time constants. Convention.
_SHORTEST_HOLD = 8.0
# Turns of the runs there and back. Convention.
_TURNS = (1.0, 6.0)
# Length of a sweep in its longest periods. Convention.
_SWEEP = 3.0
# Beginnings of the names of the runs in the standard programme. Convention: what a crew runs first.
_STANDARD = (
    "hold both ways",
    "coast-downs from both ways at 100 %",
    "about 1 turn and back at 60 %",
    "fast random levels up to 100 %",
    "slow staircase",
)
# Duration in s and share of the full command of a constant piece.
_Piece = tuple[float, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class CandidateRun:
    """A future run."""

    name: str  # one line for a crew
    time: FloatArray  # (n,) s
    commands: FloatArray  # (n, k) in the unit of each actuator, held from each instant to the next
    reference: Mapping[str, float] = field(default_factory=dict)  # assumed value of each further channel

    @property
    def seconds(self) -> float:
        """Duration."""
        return float(self.time[-1])

    def trial(self, axis: Axis) -> Trial:
        """The run as a trial that was not run, at rest."""
        trial = Trial.from_commands(self.time, self.commands, name=self.name, reference=self.reference)
        return replace(trial, axis=axis)


@dataclass(frozen=True, kw_only=True)
class RunLimits:
    """Limits of a run: share of the commands in use, duration in s, rate in rad/s (m/s), and travel in turns (m)."""

    share: float = 1.0
    seconds: float = 600.0
    rate: float = math.inf
    travel: float = math.inf
    design: bool = False  # Whether levels and switching times of a run are optimised within the limits


@dataclass(frozen=True, kw_only=True, eq=False)
class RunScales:
    """Scales of the candidate runs."""

    constant: float  # time constant of the vehicle in s at half of the fast rate
    period: float  # interval between the instants of a command file in s
    full: FloatArray  # (2, k) full commands down and up, each actuator in the sense of its arm
    edge: FloatArray  # (2, k) commands at which the thrust begins on either side
    fast: float  # steady rate at the full command in rad/s or m/s

    @classmethod
    def from_trials(cls, model: Model, vehicle: Vehicle, trials: Sequence[Trial], share: float) -> Self:
        """Scales for the given ``share`` of the commands that ``trials`` used.

        Raises DataError if the thrusters push one way only.
        """
        commands = np.vstack([trial.commands for trial in trials])
        inputs = actuator_inputs(vehicle, trials[0])
        lowest, highest = np.nanmin(commands, axis=0), np.nanmax(commands, axis=0)
        used = np.column_stack((inputs.neutral - lowest, highest - inputs.neutral))
        senses = np.sign(inputs.arms)
        full, edge = np.empty((2, len(senses))), np.empty((2, len(senses)))
        for row, way in enumerate((-1.0, 1.0)):
            side = (np.arange(len(senses)), (way * senses > 0.0).astype(int))
            edge[row] = inputs.dead_zone[side]
            # A side that was never driven gets the reach of the other one.
            is_driven = used[side] > np.abs(edge[row] - inputs.neutral)
            reach = share * np.where(is_driven, used[side], used.max(axis=1))
            # With a neutral off the middle of the curve, an equal reach to the other side may exceed the curve.
            full[row] = np.clip(inputs.neutral + way * senses * reach, *inputs.command_range.T)
        torques = np.array([vehicle.thrust(one[None])[0] @ inputs.arms for one in full])
        if not torques[0] < 0.0 < torques[1]:
            raise DataError("the thrusters push one way only.", mend=f"Check {vehicle.axis.arm_key} in rovid.toml.")
        fast = model.steady_rate(float(np.min(np.abs(torques))))
        slope = 2.0 * model.quadratic_drag * 0.5 * fast + model.linear_drag
        constant = model.inertia / max(slope, 1e-12)
        if model.stiffness > 0.0:
            constant = max(constant, 2.0 * math.pi * math.sqrt(model.inertia / model.stiffness))
        period = float(np.median([trial.sampling_interval for trial in trials]))
        return cls(constant=constant, period=period, full=full, edge=edge, fast=fast)

    def commands(self, shares: FloatArray) -> FloatArray:
        """(n, k) commands of (n,) shares of the full command, -1 to 1; neutral at 0."""
        row = (shares > 0.0).astype(int)
        edge, full = self.edge[row], self.full[row]
        reach = edge + np.abs(shares)[:, None] * (full - edge)
        return np.asarray(np.where(shares[:, None] == 0.0, self.neutral, reach))

    @property
    def neutral(self) -> FloatArray:
        """(k,) commands in the middle of each dead zone."""
        return np.asarray(0.5 * (self.edge[0] + self.edge[1]))


def candidate_runs(scales: RunScales, thrusters: Sequence[str], longest: float = math.inf) -> list[CandidateRun]:
    """All candidate runs of at most ``longest`` s; each starts and ends at rest."""
    runs = []
    for name, pieces in _named_pieces(scales):
        # A slow vehicle has long runs: only those that are wanted are sampled.
        if LEAD_SECONDS + sum(seconds for seconds, _ in pieces) <= longest:
            time, shares = sampled_shares(pieces, scales)
            runs.append(CandidateRun(name=name, time=time, commands=scales.commands(shares)))
    if len(thrusters) > 1 and LEAD_SECONDS + 4.0 * _hold(scales) <= longest:
        runs += [_single_thruster(name, at, scales) for at, name in enumerate(thrusters)]
    return runs


def standard_programme(model: Model, vehicle: Vehicle, trials: Sequence[Trial], share: float) -> list[Trial]:
    """The runs of a day before anything is known: holds, coast-downs, a sine, turns, random levels, stairs.

    ``trials``, ``share``: trials whose commands and further channels the runs take over, see `RunScales.from_trials`.
    """
    scales, thrusters = RunScales.from_trials(model, vehicle, trials, share), [one.name for one in vehicle.thrusters]
    sine = f"sine of {10.0 * scales.constant:.3g} s at 60 %"
    wanted = (*_STANDARD, sine, *(f"{name} alone" for name in thrusters[:-1]))
    runs = [run for run in candidate_runs(scales, thrusters) if run.name.startswith(wanted)]
    return [replace(run, reference=trials[0].reference).trial(vehicle.axis) for run in runs]


def _hold(scales: RunScales) -> float:
    """Length of a hold in s."""
    return max(5.0 * scales.constant, _SHORTEST_HOLD)


def _named_pieces(scales: RunScales) -> Iterator[tuple[str, list[_Piece]]]:
    """Name and pieces of each run with all thrusters."""
    tau = scales.constant
    hold = _hold(scales)
    for level in _LEVELS:
        share = f"{100 * level:.0f} % of the command"
        yield f"hold both ways at {share}, {hold:.0f} s each", [(hold, level), (hold, -level)]
        coast = max(8.0 * tau, 2.0 * _SHORTEST_HOLD)
        yield f"coast-downs from both ways at {share}", [(hold, level), (coast, 0.0), (hold, -level), (coast, 0.0)]
        for count in (3.0, 10.0, 30.0):
            period = count * tau
            cycles = max(4, math.ceil(40.0 / count))
            yield f"sine of {period:.3g} s at {share}, {cycles} periods", _sine(period, level, cycles, scales)
        for turns in _TURNS:
            # With quadratic drag, the steady rate grows with the square root of the thrust.
            seconds = turns * 2.0 * math.pi / max(scales.fast * math.sqrt(level), 1e-9)
            rest = max(8.0 * tau, 20.0)
            plural = "s" if turns > 1 else ""
            name = f"about {turns:g} turn{plural} and back at {share}, with rests"
            yield name, [(seconds, level), (rest, 0.0), (seconds, -level), (rest, 0.0)]
        for quick, word in ((0.3, "fast"), (2.0, "slow")):
            yield f"{word} random levels up to {share}", _random_levels(quick * tau, level, 60.0 * quick**0.3 * tau)
    step = max(3.0 * tau, 4.0)
    up = [0.05, 0.1, 0.2, 0.3, 0.45, 0.3, 0.2, 0.1, 0.05]
    down = [-level for level in up]
    stairs = [(step, level) for level in (*up, 0.0, *down, 0.0)]
    yield f"slow staircase through neutral, {step:.0f} s a level", stairs
    yield "sweep from slow to fast sines", _sweep(30.0 * tau, 1.5 * tau, 0.8, scales)
    yield "left alone at rest for two minutes", [(2.0, 0.3), (120.0, 0.0)]


def _sine(period: float, level: float, cycles: int, scales: RunScales) -> list[_Piece]:
    """Whole periods of a sine with amplitude ``level``, ``period`` in s."""
    step = max(scales.period, period / 200.0)
    time = np.arange(0.0, cycles * period, step)
    return [(step, float(level * math.sin(2.0 * math.pi * t / period))) for t in time]


def _sweep(longest: float, shortest: float, level: float, scales: RunScales) -> list[_Piece]:
    """Exponential sweep from the ``longest`` to the ``shortest`` period in s: each octave has equally many cycles."""
    step = max(scales.period, shortest / 40.0)
    time = np.arange(0.0, _SWEEP * longest, step)
    growth = math.log(longest / shortest) / (_SWEEP * longest)
    phase = 2.0 * math.pi / longest * np.expm1(growth * time) / growth
    return [(step, float(level * math.sin(one))) for one in phase]


def _random_levels(typical: float, level: float, length: float) -> list[_Piece]:
    """Random commands either way, each held for half to twice the ``typical`` time in s."""
    rng = np.random.default_rng(_SEED)
    pieces: list[_Piece] = []
    while sum(seconds for seconds, _ in pieces) < length:
        share = float(rng.uniform(0.2, 1.0) * level * rng.choice((-1.0, 1.0)))
        pieces.append((float(typical * rng.uniform(0.5, 2.0)), share))
    return pieces


def sampled_shares(pieces: Sequence[_Piece], scales: RunScales) -> tuple[FloatArray, FloatArray]:
    """(n,) time in s after a lead, and (n,) share of the full command from each instant on."""
    lengths, shares = zip(*pieces, strict=True)
    ends = LEAD_SECONDS + np.cumsum(lengths)
    time = scales.period * np.arange(round(float(ends[-1]) / scales.period) + 1)
    levels = np.array([0.0, *shares], dtype=np.float64)
    # A tiny delay, because rounding must not move an instant to the previous level.
    at = np.searchsorted(np.array([LEAD_SECONDS, *ends]), time + 1e-9, side="right")
    return np.asarray(time, dtype=np.float64), levels[np.minimum(at, len(levels) - 1)]


def _single_thruster(name: str, at: int, scales: RunScales) -> CandidateRun:
    hold = _hold(scales)
    time, shares = sampled_shares([(hold, 1.0), (hold, 0.0), (hold, -1.0), (hold, 0.0)], scales)
    commands = scales.commands(np.zeros(len(time)))
    commands[:, at] = scales.commands(shares)[:, at]
    return CandidateRun(name=f"{name} alone, both ways, {hold:.0f} s each", time=time, commands=commands)


# Levels of a pattern, and the shortest and longest hold of a level in time constants of the vehicle: as in the list of
# candidate runs.
_PATTERN_LEVELS, _HOLDS = 6, (0.15, 10.0)
# Random patterns and regular ones among which the search starts, searches, and evaluations of each. About 350 in all.
_RANDOM, _REGULAR, _SEARCHES, _EVALUATIONS = 40, 6, 2, 150


def design_run(worth: Callable[[CandidateRun], float], scales: RunScales, seconds: float) -> CandidateRun:
    """The run of about ``seconds`` with the largest ``worth``, which is negative for a run beyond the limits.

    Powell's method over levels and logarithms of holds, from the best of random and of regular patterns.
    """
    from scipy import optimize  # The import takes long.

    low, high = np.log(_HOLDS)
    bounds = np.array([(-1.0, 1.0)] * _PATTERN_LEVELS + [(low, high)] * _PATTERN_LEVELS)
    rng = np.random.default_rng(_SEED)
    alternating = np.where(np.arange(_PATTERN_LEVELS) % 2, -1.0, 1.0)
    starts = [np.append(alternating, np.full(_PATTERN_LEVELS, hold)) for hold in np.linspace(low, high, _REGULAR)]
    for _ in range(_RANDOM):
        levels = rng.uniform(0.3, 1.0, _PATTERN_LEVELS) * rng.choice((-1.0, 1.0), _PATTERN_LEVELS)
        starts.append(np.append(levels, rng.uniform(low, 0.6 * high) + rng.normal(0.0, 0.5, _PATTERN_LEVELS)))
    duration = seconds - LEAD_SECONDS

    def cost(pattern: FloatArray) -> float:
        return -worth(pattern_run(pattern, scales, duration))

    def search(start: FloatArray) -> FloatArray:
        found = optimize.minimize(
            cost,
            start,
            method="Powell",
            bounds=optimize.Bounds(*bounds.T),
            options={"maxfev": _EVALUATIONS, "xtol": 0.05, "ftol": 0.01},
        )
        return np.asarray(np.clip(found.x, *bounds.T))

    ranked = sorted((np.clip(start, *bounds.T) for start in starts), key=cost)
    return pattern_run(min([ranked[0], *map(search, ranked[:_SEARCHES])], key=cost), scales, duration)


def pattern_run(pattern: FloatArray, scales: RunScales, seconds: float) -> CandidateRun:
    """The run that repeats a pattern for ``seconds``: levels, and logarithms of holds in time constants."""
    levels, holds = np.split(pattern, 2)
    holds = np.maximum(scales.constant * np.exp(holds), scales.period)
    count = math.ceil(seconds / holds.sum())
    pieces = []
    for hold, level in zip(np.tile(holds, count).tolist(), np.tile(levels, count).tolist(), strict=True):
        pieces.append((min(hold, seconds), round(level, 2)))
        seconds -= hold
        if seconds <= 0.0:
            break
    time, shares = sampled_shares(pieces, scales)
    words = ", ".join(f"{100.0 * level:.0f} % for {hold:.2g} s" for level, hold in zip(levels, holds, strict=True))
    return CandidateRun(name=f"designed: {words}, repeated", time=time, commands=scales.commands(shares))
