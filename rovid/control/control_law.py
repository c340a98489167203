"""Options, conditions and manoeuvres of the loop, and the control law: model aid and PD; source in C and Python."""

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from string import Template
from typing import NamedTuple

import numpy as np

from rovid import __version__
from rovid.core.array_types import ComplexArray, FloatArray
from rovid.core.errors import ConfigError, suggestion
from rovid.core.formatting import TextTemplates
from rovid.effects import term_effect
from rovid.effects.base import TERM_STATES, Instant, Term
from rovid.model.model import Model
from rovid.trial.assumptions import Assumptions

# Names of `rovid control --law`.
LAWS = ("model", "ardusub", "ardurover", "px4")
WAVE_PERIOD = 8.0  # s
# Without logs: rad, heading noise of the paper's instrument; rad/s, rate whose drag is the torque in use.
_HEADING_NOISE, _RATE_IN_USE = math.radians(0.01), 0.15
# Torque of current and waves relative to the torque in use.
_ENVIRONMENT = 0.1


@dataclass(frozen=True, kw_only=True)
class ControllerOptions:
    """Options of `rovid control`. Raises ConfigError if an option has an invalid value."""

    kp: float | None = None
    kd: float | None = None
    damping: float = 0.7
    bandwidth: float | None = None
    period: float = 0.1
    delay: float = 0.0
    rate_filter: float | None = None
    law: str = "model"  #: Model-aided PD, or an autopilot of `rovid.control.actuators.AUTOPILOTS`.
    steps: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        positive = {"--kp": self.kp, "--damping": self.damping, "--bandwidth": self.bandwidth, "--period": self.period}
        for name, value in positive.items():
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"is {value:g}; a number above zero was expected.", where=name)
        for name, value in {"--kd": self.kd, "--delay": self.delay, "--rate-filter": self.rate_filter}.items():
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"is {value:g}; zero or a number above it was expected.", where=name)
        if (self.kp is None) != (self.kd is None):
            raise ConfigError("needs the other gain too.", where="--kp" if self.kd is None else "--kd")
        if self.kp is not None and self.bandwidth is not None:
            raise ConfigError("contradicts --kp and --kd.", where="--bandwidth", mend="Leave one out.")
        if self.law not in LAWS:
            raise ConfigError(f"is {self.law!r}. {suggestion(self.law, LAWS)}", where="--law")
        if self.law != LAWS[0] and (self.steps or self.rate_filter is not None):
            text = "is for the model-aided law; an autopilot has its own rate."
            raise ConfigError(text, where="--step" if self.steps else "--rate-filter", mend="Leave it out.")
        self.parsed_steps()

    def parsed_steps(self) -> list[tuple[float, float]]:
        """(from, to) in deg of each of ``steps``, to the nearest turn: the controller turns the shorter way."""
        found = []
        for text in self.steps:
            first, _, last = text.partition(":")
            try:
                start, end = float(first), float(last)
                found.append((start, start + math.remainder(end - start, 360.0)))
            except ValueError as error:
                words = f"is {text!r}; two headings in deg were expected, as in 20:120."
                raise ConfigError(words, where="--step") from error
        return found


def loop_conditions(
    options: ControllerOptions, model: Model, heading_noise: float | None, torque_in_use: float | None
) -> "LoopConditions":
    """Conditions of the loop; without logs with a heading noise of 0.01 deg and the drag at 0.15 rad/s."""
    return LoopConditions(
        period=options.period,
        delay=options.delay,
        rate_filter=options.rate_filter,
        heading_noise=_HEADING_NOISE if heading_noise is None else heading_noise,
        torque_in_use=model.drag(np.array(_RATE_IN_USE)).item() if torque_in_use is None else torque_in_use,
    )


@dataclass(frozen=True, kw_only=True)
class LoopConditions:
    """Conditions of the loop, from options and logs."""

    #: ``period``, ``delay``: s, sampling period, and delay from a heading to the command that it leads to.
    period: float = 0.1
    delay: float = 0.0
    #: s, time constant of the low pass of the rate; None to choose it with the bandwidth.
    rate_filter: float | None = None
    #: ``heading_noise``, ``torque_in_use``: rad and N m.
    heading_noise: float = 0.0
    torque_in_use: float


@dataclass(frozen=True, kw_only=True)
class HeadingManoeuvre:
    """A run from rest at ``start`` to ``target``, in deg; ``current`` and ``waves`` in N m."""

    name: str
    start: float
    target: float
    current: float = 0.0
    waves: float = 0.0


def paper_runs() -> tuple[HeadingManoeuvre, ...]:
    """The three closed-loop runs of Ramesh et al. 2013."""
    return (
        HeadingManoeuvre(name="90 to 200 deg", start=90.0, target=200.0),
        HeadingManoeuvre(name="20 to 120 deg", start=20.0, target=120.0),
        HeadingManoeuvre(name="hold 120 deg, pushed to 100", start=100.0, target=120.0),
    )


def standard_manoeuvres(steps: Sequence[tuple[float, float]], torque_in_use: float) -> tuple[HeadingManoeuvre, ...]:
    """Runs of the paper, the user's ``steps`` in deg, and holds against current and against waves."""
    torque = _ENVIRONMENT * torque_in_use
    return (
        *paper_runs(),
        *(HeadingManoeuvre(name=f"{a:g} to {b % 360.0:g} deg", start=a, target=b) for a, b in steps),
        HeadingManoeuvre(name="hold 120 deg, current sets in", start=120.0, target=120.0, current=torque),
        HeadingManoeuvre(name="hold 120 deg, waves", start=120.0, target=120.0, waves=torque),
    )


# Shapes of torques at rest in the catalogue: constant, odd in the turned angle, once and twice a turn.
NO_STATIC_TERMS = (0.0,) * 7
# rad, step of the central difference of the torque at rest.
_DIFFERENCE = 1e-4
_TURNS = np.linspace(-2.0, 2.0, 97) * 2.0 * math.pi


class ControllerState(NamedTuple):
    """State of the controller: last heading in rad, filtered rate in rad/s, turned angle in rad."""

    heading: float
    rate: float
    turned: float


@dataclass(frozen=True, kw_only=True)
class ControlLaw:
    """Model-aided PD (Ramesh et al. 2013, eq. 12), sampled.

    ``T = I*wanted_acceleration + DQ*|r|*r + DL*r + hold + kp*(wanted - heading) + kd*(wanted_rate - r)``

    r is the difference of two headings over the period, behind a first-order low pass. A step of the set point has
    neither a wanted rate nor a wanted acceleration.
    """

    #: ``kp``, ``kd``: N m/rad and N m s/rad.
    kp: float
    kd: float
    #: ``period``, ``rate_filter``: sampling period and time constant of the low pass of the rate, in s.
    period: float
    rate_filter: float
    #: ``inertia``, ``quadratic_drag``, ``linear_drag``: of the model aid, in kg m^2, N m s^2/rad^2 and N m s/rad; 0
    #: without aid.
    inertia: float = 0.0
    quadratic_drag: float = 0.0
    linear_drag: float = 0.0
    #: (7,) N m, factors of 1, x, x^3, sin h, cos h, sin 2h and cos 2h that compensate the torques at rest; x is the
    #: angle turned since the start and h the heading in rad.
    static_terms: tuple[float, ...] = NO_STATIC_TERMS
    #: ``lowest``, ``highest``: limits of the actuators in N m.
    lowest: float = -math.inf
    highest: float = math.inf

    @functools.cached_property
    def blend(self) -> float:
        """Weight of a new rate in the filtered rate."""
        if self.rate_filter <= 0.0:
            return 1.0
        return -math.expm1(-self.period / self.rate_filter)

    @property
    def lag(self) -> float:
        """Lag in s at low frequency: hold and difference of headings take half a period each."""
        return self.period + self.rate_filter

    def noise(self, heading_noise: float) -> float:
        """Standard deviation in N m of the torque by the filtered rate under white ``heading_noise`` in rad."""
        return self.kd * heading_noise * self.blend / self.period * math.sqrt(2.0 / (2.0 - self.blend))

    def feedback(self, frequency: FloatArray) -> tuple[ComplexArray, float]:
        """(f,) negative wanted torque per heading, and per yaw rate, which is not measured."""
        back = np.exp(-1j * frequency * self.period)
        rate = self.blend * (1.0 - back) / self.period / (1.0 - (1.0 - self.blend) * back)
        # Slope of the compensation of torques at rest.
        change = self.static_torque(_DIFFERENCE, _DIFFERENCE) - self.static_torque(-_DIFFERENCE, -_DIFFERENCE)
        slope = change / (2.0 * _DIFFERENCE)
        return np.asarray(self.kp - slope + (self.kd - self.linear_drag) * rate), 0.0

    @staticmethod
    def initial_state(heading: float) -> ControllerState:
        """State at rest at ``heading`` in rad."""
        return ControllerState(heading, 0.0, 0.0)

    def step(
        self,
        state: ControllerState,
        heading: float,
        wanted: float,
        wanted_rate: float = 0.0,
        wanted_acceleration: float = 0.0,
    ) -> tuple[float, ControllerState]:
        """Torque in N m for one period, and the new state, from a ``heading`` in rad, wrapped or not."""
        turn = wrapped(heading - state.heading)
        rate = state.rate + self.blend * (turn / self.period - state.rate)
        turned = state.turned + turn
        torque = (
            self.inertia * wanted_acceleration
            + (self.quadratic_drag * abs(rate) + self.linear_drag) * rate
            + self.static_torque(turned, heading)
            + self.kp * wrapped(wanted - heading)
            + self.kd * (wanted_rate - rate)
        )
        return min(max(torque, self.lowest), self.highest), ControllerState(heading, rate, turned)

    def static_torque(self, turned: float, heading: float) -> float:
        """Torque in N m that compensates the torques at rest, ``turned`` rad from the start."""
        a, b, c, d, e, f, g = self.static_terms
        once = d * math.sin(heading) + e * math.cos(heading)
        twice = f * math.sin(2.0 * heading) + g * math.cos(2.0 * heading)
        return a + b * turned + c * turned * turned * turned + once + twice


def wrapped(angle: float) -> float:
    """``angle`` in rad within -pi to pi."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


def static_terms_of(model: Model) -> tuple[float, ...]:
    """(7,) factors of ``ControlLaw.static_terms`` that compensate the torques at rest of ``model``.

    They are fitted to the effects' own terms over two turns each way, which requires no knowledge of any effect.
    """
    torque = effect_torque(model)
    if torque is None:
        return NO_STATIC_TERMS
    # Two initial headings, a radian apart, distinguish functions of the angle from functions of the heading.
    rows = [(angle, angle + first) for first in (0.0, 1.0) for angle in _TURNS]
    values = np.array([torque(0.0, x, 0.0, h - x, None)[0] for x, h in rows])
    x, h = np.array(rows).T
    columns = (np.ones(len(x)), x, x**3, np.sin(h), np.cos(h), np.sin(2 * h), np.cos(2 * h))
    factors, *_ = np.linalg.lstsq(np.column_stack(columns), -values, rcond=None)
    # Rounding errors of zero are not written into the controller.
    least = 1e-9 * float(np.max(np.abs(values)))
    return tuple(float(factor) if abs(factor) > least else 0.0 for factor in factors)


TermTorque = Callable[[float, float, float, float, FloatArray | None], tuple[float, FloatArray]]


def effect_torque(model: Model) -> TermTorque | None:
    """Torque of all terms in N m and (m, 2) derivatives of their states; None for a model without terms.

    The arguments are rate, angle, thruster torque, initial heading and (m, 2) states.
    """
    terms = model.terms
    if not len(terms.kinds):
        return None
    acting = [term for kind in terms.kinds.tolist() if isinstance(term := term_effect(kind).acts, Term)]
    numbers = terms.parameters[:, 0].reshape(len(acting), -1)

    def torque(
        rate: float, angle: float, push: float, heading: float, states: FloatArray | None
    ) -> tuple[float, FloatArray]:
        own = np.zeros((len(acting), TERM_STATES)) if states is None else states
        rows = [(term, tuple(p), tuple(x)) for term, p, x in zip(acting, numbers, own, strict=True)]
        entrained = sum(term.entrained_rate(p, x) for term, p, x in rows if term.entrained_rate is not None)
        at = Instant(rate, rate - entrained, angle, heading, push, 0.0, 0.0, 0.0, model.body)
        total, change = 0.0, np.zeros_like(own)
        for (term, p, x), row in zip(rows, change, strict=True):
            given, changes = term.evaluate(at, p, x)
            row[: term.states] = changes
            total += given
        return total, change

    return torque


# ---- source code


_TEXTS = TextTemplates(__file__, "control_law")


def c_source(law: ControlLaw, guess: Assumptions) -> str:
    """C99 source of ``law`` without memory allocation, with a notice on guessed values."""
    text = "    if (torque {operator} {value!r}) torque = {value!r};\n"
    return _source(Template(_TEXTS["c"]), law, guess, ("<", ">"), text)


def python_source(law: ControlLaw, guess: Assumptions) -> str:
    """Python source of ``law`` with the standard library only, with a notice on guessed values."""
    text = "        torque = {operator}(torque, {value!r})\n"
    return _source(Template(_TEXTS["python"]), law, guess, ("max", "min"), text)


def _source(template: Template, law: ControlLaw, guess: Assumptions, operators: tuple[str, str], statement: str) -> str:
    """Source with the law's numbers, and a ``statement`` for each finite limit of the torque."""
    limits = ""
    for operator, value in zip(operators, (law.lowest, law.highest), strict=True):
        if math.isfinite(value):
            limits += statement.format(operator=operator, value=value)
    shapes = ("1.0", "x", "x * x * x", "sin(heading)", "cos(heading)", "sin(2.0 * heading)", "cos(2.0 * heading)")
    terms = [f"{value!r} * {shape}" for value, shape in zip(law.static_terms, shapes, strict=True) if value != 0.0]
    names = ("kp", "kd", "inertia", "quadratic_drag", "linear_drag", "period", "blend")
    return template.substitute(
        {name: repr(float(getattr(law, name))) for name in names},
        hold=" + ".join(terms) or "0.0",
        limits=limits,
        stamp=f" {guess.file_notice}" if guess else "",
        whole=repr(2.0 * math.pi),
        half=repr(math.pi),
        version=__version__,
    )
