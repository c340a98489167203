"""What an effect is: an equation, its parameters, what it looks like, and how to tell it from its rivals.

An effect acts at one of five places on the way from command to measured heading:

    command -> [on_command] -> bench curve -> [on_thrust] -> sum -> [on_torque] -> motion [term] -> [on_heading]

The first three are functions of the logged commands alone and are worked out once for a set of parameters. ``term`` is
compiled into the equation of motion; ``on_heading`` says how far the measured heading is off. A ``wave`` is a torque of
its own that the filter carries along.

Nature does not know our equations: one cause may have several forms. They share the id and are told apart by ``form``;
a cause is named, whichever form fits best.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field

import numba
import numpy as np

from rovid.campaign.trial import Trial
from rovid.campaign.vehicle import ThrustCurve, Vehicle
from rovid.ground.arrays import FloatArray
from rovid.ground.caches import keeps_compiled

# Compiled for the machine at first use; the result is kept on disk. Several may run at once.
compiled = numba.njit(cache=keeps_compiled(), error_model="numpy", nogil=True)

# Room for each term of the equation of motion: parameters and states of its own.
TERM_PARAMETERS = 4
TERM_STATES = 2

# What terms read of ``base`` by name, see `rovid.model.kernels.simulate_effects`. From `BESIDE` on stands what they are
# told of each interval: the thrusters' race, and the speeds of `SPEEDS`.
STIFFNESS, TRIM, WATER, RACE, SURGE, SWAY = 5, 6, 7, 8, 9, 10
BESIDE, BASE_SIZE = RACE, SWAY + 1
# Channels of the log that say how fast the vehicle goes ahead and to starboard, m/s.
SPEEDS = ("surge_velocity", "sway_velocity")

# rad/s; where forms that depend on the rate agree with the plain one, or have the time constant that they are given.
REFERENCE_RATE = 0.3
# Of the bench's largest thrust; the same for thrust. Trials seldom use much more in yaw, and away from the thrust in
# use a change of shape would be one of scale, which inertia and drag would have to follow.
_REFERENCE_SHARE = 0.1
# A parameter whose slopes are taken over more than this share of it makes stairs of the likelihood.
_SMOOTH = 1e-3
# A null so large stands for infinity.
_ENDLESS = 1e5

Values = Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class EffectParameter:
    """One parameter of an effect.

    Attributes
    ----------
    null
        Value at which the effect is not there.
    low, high
        Physical bounds, in ``unit``, or in units of the scale.
    starts
        Where to begin a fit, in units of the scale.
    scale
        What one unit of the search is: ``one``, ``command`` (a hundredth of the largest command in use), or what is in
        use of ``torque``, ``rate``, ``race``, ``surge`` or ``sway`` speed and of ``root``, that of a thrust, the
        heaviest ``load`` as a share of full thrust, the hours of the ``longest`` log or of the ``day`` from the first
        log's beginning to the last one's end; or one of them over others, as ``torque/surge/rate``.
    step
        Share of its size over which slopes are taken. A threshold between samples makes stairs of the likelihood: over
        less than a step of them it has no slope, or far too much.
    """

    name: str
    unit: str
    null: float
    low: float
    high: float
    starts: tuple[float, ...]
    scale: str = "one"
    step: float = 1e-4

    @property
    def stairs(self) -> bool:
        """Whether the likelihood has steps along it in place of slopes."""
        return self.step > _SMOOTH

    @property
    def endless(self) -> bool:
        """Whether the effect is gone only at infinity, for which ``null`` stands."""
        return abs(self.null) > _ENDLESS


@dataclass(frozen=True, kw_only=True, eq=False)
class Actuation:
    """One trial on the way from command to torque.

    Attributes
    ----------
    time
        (n,) s.
    neutral
        (k,) command of no thrust of each actuator.
    arms
        (k,) yaw arm of each actuator.
    full_thrust
        (k,) N; largest thrust of each actuator's bench curve, or largest torque or force of a campaign that logs it.
    names
        (k,) of the thrusters.
    ahead
        (k,) share of each thrust that drives the vehicle ahead; 0 where that is not known.
    ends
        (k, 2) the least and the largest command of the bench curve.
    dead_zone
        (k, 2) commands between which the bench curve gives no thrust; both ``neutral`` where there is no such zone.
    extras
        Further channels of the log, (n,), held.
    reference
        The median of each further channel over the whole campaign.
    trial
        Its name.
    whole
        Name of the trial that it is a part of; its own where it is none.
    since
        s from the beginning of the campaign's first trial to that of this one.
    parts
        How many each interval between two of the log's instants is cut into.
    """

    time: FloatArray
    neutral: FloatArray
    arms: FloatArray
    full_thrust: FloatArray
    names: tuple[str, ...]
    ahead: FloatArray
    ends: FloatArray
    dead_zone: FloatArray
    extras: Mapping[str, FloatArray]
    reference: Mapping[str, float] = field(default_factory=dict)
    trial: str = ""
    whole: str = ""
    since: float = 0.0
    parts: int = 1

    @property
    def reference_thrust(self) -> FloatArray:
        """(k,) N; a tenth of the full thrust, at which forms of the thrust curve agree with the bench."""
        return _REFERENCE_SHARE * self.full_thrust

    def speed(self, name: str) -> FloatArray:
        """(n,) m/s, the mean until the next instant of one of `SPEEDS`; that of the campaign where it is not logged."""
        logged = self.extras.get(name)
        if logged is None or not np.isfinite(logged).any():
            return np.full(len(self.time), self.reference.get(name, 0.0))
        known = bridged(logged)
        return np.asarray(0.5 * (known + np.append(known[1:], known[-1])))

    def beyond(self, command: FloatArray) -> FloatArray:
        """(n, k) how far each command is beyond the bench's dead zone, with its sign; 0 inside."""
        low, high = self.dead_zone.T
        return np.asarray(np.maximum(command - high, 0.0) + np.minimum(command - low, 0.0))

    def from_beyond(self, excess: FloatArray) -> FloatArray:
        """(n, k) commands that are so far beyond the dead zone; neutral where that is 0."""
        low, high = self.dead_zone.T
        return np.where(excess > 0.0, high + excess, np.where(excess < 0.0, low + excess, self.neutral))


OnSeries = Callable[[Actuation, FloatArray, Values], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class Effect:
    """One physical cause.

    Attributes
    ----------
    id
        Its name for users and programs.
    equation, fingerprint, experiment
        For people: what it does, what it looks like in the residuals, and the run that reveals it.
    rivals
        Ids of the effects it is confused with.
    on_command
        (n, k) commands -> commands.
    on_thrust
        (n, k) thrusts in N -> thrusts.
    on_torque
        (n,) torque in N m -> torque, each value the mean until the next instant.
    scatter
        (n,) torque in N m, before ``on_torque`` -> variance of its impulse until the next instant in N^2 m^2 s^2, where
        the equation leaves open when the torque acts.
    on_speed
        (n, k) thrusts in N -> (n,) what ``base[SURGE]`` is, each value the mean until the next instant, of a form that
        makes do without a logged speed.
    term
        Compiled; torque in N m from (rate, angle since the start, push, base, p, x, dx, j), with ``base`` the inertia,
        quadratic and linear drag, the first position, the fastest state, and what the names above stand for:
        `STIFFNESS` and `TRIM` of the restoring torque, the rate `WATER` of the water about the hull, the thrusters'
        `RACE`, the speeds `SURGE` and `SWAY` in m/s. Row ``j`` of ``p`` holds the effect's parameters in their order,
        of ``x`` its states, and of ``dx`` their rates of change, to be filled in.
    fastest
        (parameters) -> the fastest rate of the term's states in 1/s, for the step of the integration.
    added_inertia
        (parameters) -> what the term adds to the inertia in slow motion, in kg m^2.
    carried
        Whether the term's states ring on after what set them off, so that a filter has to know how well it knows them.
        They are linear in the rate and each other, the first the integral of the second; one of a model's effects may
        be of this kind.
    on_heading
        (n,) true headings in rad -> deviation of the measured heading in rad.
    wave
        Whether it is a torque at random phase: the parameters are amplitude, frequency and damping.
    races
        Whether its term asks for the thrusters' race, ``base[RACE]``.
    remembers
        Whether its term has states of its own.
    moves_water
        Whether its term sets ``base[WATER]``: all drag is of the rate less that of the water.
    quick
        Whether it acts in less than the interval between two samples.
    form
        Which of the effect's forms this is; empty for the plain one.
    needs
        Channels of the log without which this form cannot be.
    each_thruster
        Whether it acts on one thruster, whose name is the form.
    canonical
        (parameters) -> the same, in the range in which people expect them.
    axes
        Names of the axes along which there is such a thing; empty for all.
    anchored
        Whether it leaves thrust as it was taken at one thrust, command or voltage that is a mere choice. An effect
        that says where thrust is gone (astern, of one thruster, with load, with time) leaves the rest as it was.
    """

    id: str
    title: str
    parameters: tuple[EffectParameter, ...]
    equation: str
    fingerprint: str
    experiment: str
    form: str = ""
    rivals: tuple[str, ...] = ()
    on_command: OnSeries | None = None
    on_thrust: OnSeries | None = None
    on_torque: OnSeries | None = None
    scatter: OnSeries | None = None
    on_speed: OnSeries | None = None
    term: Callable[..., float] | None = None
    fastest: Callable[[Values], float] | None = None
    added_inertia: Callable[[Values], float] | None = None
    carried: bool = False
    on_heading: Callable[[FloatArray, Values], FloatArray] | None = None
    wave: bool = False
    races: bool = False
    remembers: bool = False
    moves_water: bool = False
    quick: bool = False
    needs: tuple[str, ...] = ()
    each_thruster: bool = False
    canonical: Callable[[FloatArray], FloatArray] | None = None
    axes: tuple[str, ...] = ()
    anchored: bool = False

    @property
    def key(self) -> str:
        """Id and form, as in ``thruster_lag:rotor``."""
        return f"{self.id}:{self.form}" if self.form else self.id

    @property
    def actuates(self) -> bool:
        """Whether it acts between command and torque."""
        return bool(self.on_command or self.on_thrust or self.on_torque or self.on_speed)

    @property
    def starts(self) -> list[FloatArray]:
        """Where to begin the search for the parameters, in units of their scale."""
        count = max(len(parameter.starts) for parameter in self.parameters)
        return [
            np.array([p.starts[min(number, len(p.starts) - 1)] for p in self.parameters], dtype=float)
            for number in range(count)
        ]

    def values(self, numbers: FloatArray) -> dict[str, float]:
        """Parameters by name."""
        return {parameter.name: float(value) for parameter, value in zip(self.parameters, numbers, strict=True)}


@dataclass(frozen=True)
class Scales:
    """What one unit of each parameter's search is, in SI; see ``EffectParameter.scale``."""

    command: float
    torque: float
    rate: float
    race: float
    root: float = 1.0
    surge: float = 1.0
    sway: float = 1.0
    load: float = 1.0
    longest: float = 1.0
    day: float = 1.0

    def of(self, parameter: EffectParameter) -> float:
        """Size of one unit of ``parameter``."""
        sizes = {"one": 1.0, **asdict(self), "command": 0.01 * self.command}
        first, *others = parameter.scale.split("/")
        return float(sizes[first] / math.prod(sizes[name] for name in others))


def finer(held: FloatArray, parts: int) -> FloatArray:
    """(m, ...) of (n, ...) values that are held, with each interval between two instants cut into ``parts``."""
    return np.repeat(held, parts, axis=0)[: (len(held) - 1) * parts + 1]


def bridged(values: FloatArray) -> FloatArray:
    """(n,) ``values`` with straight lines through their gaps; zeros where none is known."""
    known = np.flatnonzero(np.isfinite(values))
    if known.size == len(values):
        return values
    return np.interp(np.arange(len(values)), known, values[known]) if known.size else np.zeros(len(values))


def _instants(time: FloatArray, parts: int) -> FloatArray:
    steps = np.arange((len(time) - 1) * parts + 1) / parts
    return np.asarray(np.interp(steps, np.arange(len(time)), time))


def actuation(vehicle: Vehicle, trial: Trial, parts: int = 1) -> Actuation:
    """What the effects between command and torque need to know of ``vehicle`` and ``trial``.

    ``parts`` is how many each interval between two instants is cut into.
    """
    curves = [thruster.curve for thruster in vehicle.thrusters]
    return Actuation(
        time=trial.time if parts == 1 else _instants(trial.time, parts),
        names=tuple(thruster.name for thruster in vehicle.thrusters),
        ahead=vehicle.ahead,
        ends=np.array([(-t.most, t.most) if t.curve is None else t.curve.command[[0, -1]] for t in vehicle.thrusters]),
        dead_zone=np.array([(0.0, 0.0) if c is None else _dead_zone(c) for c in curves]),
        extras={name: finer(values, parts) for name, values in trial.extras.items()},
        reference=trial.reference,
        trial=trial.name,
        whole=trial.whole or trial.name,
        since=trial.since,
        parts=parts,
        neutral=neutral_commands(vehicle),
        arms=np.array([thruster.arm for thruster in vehicle.thrusters]),
        full_thrust=np.array([thruster.full_thrust for thruster in vehicle.thrusters]),
    )


def race(thrust: FloatArray, arms: FloatArray) -> FloatArray:
    """(n,) N^0.5 m^2; sum over the thrusters of the root of their (n, k) thrust in N times their arm squared."""
    return np.asarray(np.sqrt(np.abs(thrust)) @ arms**2)


def neutral_commands(vehicle: Vehicle) -> FloatArray:
    """(k,) the command of no thrust: the middle of the bench curve's zeros, or where it crosses zero."""
    return np.array([0.0 if t.curve is None else sum(_dead_zone(t.curve)) / 2.0 for t in vehicle.thrusters])


def _dead_zone(curve: ThrustCurve) -> tuple[float, float]:
    zeros = curve.command[curve.thrust == 0.0]
    if zeros.size:
        return float(zeros[0]), float(zeros[-1])
    rising = np.argsort(curve.thrust, kind="stable")
    crossing = float(np.interp(0.0, curve.thrust[rising], curve.command[rising]))
    return crossing, crossing
