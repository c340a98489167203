"""Products of functions of signals, some behind an operator: what a formula is the sum of."""

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import played, root_played, root_slewed, slewed
from rovid.effects.actuator_inputs import SPEEDS
from rovid.jit.decorators import compiled

# Name of the signal -> its code in a compiled term.
STATES = {
    "rate": "at.rate",
    "angle": "at.angle",
    "heading": "(at.start + at.angle)",
    "thruster_torque": "at.thruster_torque",
    SPEEDS[0]: "at.surge",
    SPEEDS[1]: "at.sway",
}
# Signals of the campaign's clock and of single thrusters -> their code in a plug-in.
HOURS, THRUST = "campaign_hours", "thrust:"


class Shape(NamedTuple):
    """A function of one signal."""

    text: str  #: Python code: x is the signal, m the prefix of the functions of a module, s the scale near zero.
    power: float  #: Power of the signal's unit.
    symbols: int  #: Length of its code.
    function: Callable[[FloatArray, float], FloatArray]  #: (values, scale near zero) -> values.


SHAPES = {
    "linear": Shape("{x}", 1, 1, lambda x, _: x),
    "quadratic": Shape("{x}*abs({x})", 2, 2, lambda x, _: x * np.abs(x)),
    "cubic": Shape("{x}*{x}*{x}", 3, 3, lambda x, _: x**3),
    "size": Shape("abs({x})", 1, 2, lambda x, _: np.abs(x)),
    "square": Shape("{x}*{x}", 2, 2, lambda x, _: x * x),
    "root": Shape("{x}/{m}sqrt(abs({x}) + {s})", 0.5, 2, lambda x, s: x / np.sqrt(np.abs(x) + s)),
    "root_size": Shape("{m}sqrt(abs({x}) + {s})", 0.5, 2, lambda x, s: np.sqrt(np.abs(x) + s)),
    "sign": Shape("{m}tanh({x}/{s})", 0, 2, lambda x, s: np.tanh(x / s)),
    "sine": Shape("{m}sin({x})", 0, 2, lambda x, _: np.sin(x)),
    "cosine": Shape("{m}cos({x})", 0, 2, lambda x, _: np.cos(x)),
    "sine_2": Shape("{m}sin(2.0*{x})", 0, 3, lambda x, _: np.sin(2.0 * x)),
    "cosine_2": Shape("{m}cos(2.0*{x})", 0, 3, lambda x, _: np.cos(2.0 * x)),
}


@dataclass(frozen=True)
class Factor:
    """A function of one signal."""

    signal: str
    shape: str
    scale: float  #: Value of the signal, less its centre, at which a smooth sign reaches 76 %, and a root begins.
    centre: float = 0.0  #: Value that is subtracted from the signal.

    def code(self, signal: str, module: str = "") -> str:
        """Python code, with functions of a ``module`` such as ``math.``."""
        x = f"({signal} - {self.centre!r})".replace("- -", "+ ") if self.centre else signal
        return SHAPES[self.shape].text.format(x=x, m=module, s=repr(self.scale))

    def values(self, signal: FloatArray) -> FloatArray:
        """(n,) values of the factor for those of the signal."""
        return SHAPES[self.shape].function(signal - self.centre, self.scale)


@compiled
def remembered(time: FloatArray, values: FloatArray, constant: float) -> FloatArray:
    """(n,) output of a first-order low-pass filter that begins at zero; ``values`` are held."""
    found, state = np.zeros(len(time)), 0.0
    for k in range(1, len(time)):
        decay = math.exp((time[k - 1] - time[k]) / constant)
        state = decay * state + (1.0 - decay) * values[k - 1]
        found[k] = state
    return found


@compiled
def oscillated(time: FloatArray, values: FloatArray, frequency: float, damping: float) -> FloatArray:
    """(n,) output x of x''/ω² + 2ζx'/ω + x = values, which are held; it begins at rest, and ζ is 1 at most."""
    found, x, speed = np.zeros(len(time)), 0.0, 0.0
    # Critical damping is the limit of slow ringing.
    ringing = frequency * math.sqrt(max(1.0 - damping * damping, 1e-6))
    for k in range(1, len(time)):
        step = time[k] - time[k - 1]
        decay, angle = math.exp(-damping * frequency * step), ringing * step
        off = x - values[k - 1]
        slope = (speed + damping * frequency * off) / ringing
        x = values[k - 1] + decay * (off * math.cos(angle) + slope * math.sin(angle))
        turned = decay * (slope * math.cos(angle) - off * math.sin(angle)) * ringing
        speed = turned - damping * frequency * (x - values[k - 1])
        found[k] = x
    return found


class Operator(NamedTuple):
    """A function of the past of a signal, with constants."""

    constants: Mapping[str, str]  #: Name of each constant, to which the number of its product is added -> unit.
    function: Callable[..., FloatArray]  #: (instants, held values, *constants) -> values.
    #: Code of the derivatives of its states x0 and x1, of which the first is the output; u is the value, c0 and c1 are
    #: the constants. Without states it acts on the series of a trial.
    derivatives: tuple[str, ...] = ()
    fastest: str = "1e-9"  #: Code of the fastest rate of change of the states in 1/s; here no faster than the motion.
    of_swept: bool = False  #: Whether the swept angle takes the place of the time: a wake is left behind by distance.


OPERATORS = {
    "memory": Operator({"tau": "s"}, remembered, ("({u} - {x0}) / {c0}",), "1.0 / {c0}"),
    "swept_memory": Operator({"swept": "rad"}, remembered, ("abs(at.rate) * ({u} - {x0}) / {c0}",), of_swept=True),
    "oscillation": Operator(
        {"frequency": "rad/s", "damping": "1"},
        oscillated,
        ("{x1}", "{c0} * {c0} * ({u} - {x0}) - 2.0 * {c1} * {c0} * {x1}"),
        "{c0}",
    ),
    "limit": Operator({"rate": "N m/s"}, slewed),
    "play": Operator({"width": "N m"}, played),
    # A thrust often goes with the square of the command, or of a propeller's speed.
    "root_limit": Operator({"rate": "(N m)^0.5/s"}, root_slewed),
    "root_play": Operator({"width": "(N m)^0.5"}, root_played),
}


@dataclass(frozen=True)
class Product:
    """A product of factors, perhaps of the past of some of these; without factors it is 1.

    An operator on the thruster torque alone is less the torque: with a coefficient of 1 the torque lags, is limited in
    its rate, or has a play.
    """

    factors: tuple[Factor, ...]
    operator: str = ""  #: Name of the operator on the ``factors``; "" for none.
    constants: tuple[float, ...] = ()  #: Constants of the operator.
    outside: tuple[Factor, ...] = ()  #: Further factors, outside of the operator.

    @property
    def is_change(self) -> bool:
        """Whether the product is an operator's output for the thruster torque, less the torque itself."""
        torque = [("thruster_torque", "linear")]
        return bool(self.operator) and not self.outside and [(one.signal, one.shape) for one in self.factors] == torque

    @property
    def states(self) -> int:
        """Number of states that an operator adds to the motion."""
        return len(OPERATORS[self.operator].derivatives) if self.operator else 0

    @property
    def of_series(self) -> bool:
        """Whether an operator acts on the series of a trial, not on the simulated motion."""
        return bool(self.operator) and not self.states

    @property
    def signals(self) -> tuple[str, ...]:
        """The signals in it."""
        return tuple(dict.fromkeys(factor.signal for factor in (*self.outside, *self.factors)))

    @property
    def logged(self) -> tuple[Factor, ...]:
        """Factors of logged signals, which are no part of the simulated motion."""
        return tuple(factor for factor in (*self.outside, *self.factors) if factor.signal not in STATES)

    @property
    def symbols(self) -> int:
        """Length of its code."""
        return sum(SHAPES[one.shape].symbols for one in (*self.outside, *self.factors)) + 2 * bool(self.operator)

    @property
    def text(self) -> str:
        """The product in a formula; ``memory(…)`` is the output of a first-order low-pass filter."""
        return self.text_with(())

    def text_with(self, constants: Sequence[str]) -> str:
        """The product in a formula, with the constants of its operator as texts."""
        inside, *beside = ("*".join(one.code(one.signal) for one in some) for some in (self.factors, self.outside))
        if not self.operator:
            return inside or "1"
        past = f"{self.operator}({', '.join((inside, *constants))})"
        return f"({past} - {inside})" if self.is_change else "*".join((*filter(None, beside), past))

    def units_of_constants(self, number: int) -> dict[str, str]:
        """Name of each constant of the operator -> unit, for the product with this ``number`` in a formula, from 1."""
        constants = OPERATORS[self.operator].constants if self.operator else {}
        return {f"{name}{number}": unit for name, unit in constants.items()}

    def unit_of_coefficient(self, units: Mapping[str, str]) -> str:
        """Unit of the coefficient that makes the product a torque in N m."""
        powers: dict[str, float] = defaultdict(float, {"N m": -1.0})
        for factor in (*self.outside, *self.factors):
            above, _, below = units[factor.signal].partition("/")
            powers[above] += SHAPES[factor.shape].power
            if below:
                powers[below] -= SHAPES[factor.shape].power
        over = [_power(unit, -count) for unit, count in powers.items() if count < 0]
        under = [_power(unit, count) for unit, count in powers.items() if count > 0]
        text = " ".join(over) or "1"
        if not under:
            return text
        below = " ".join(under)
        return f"{text}/({below})" if " " in below else f"{text}/{below}"

    def values(self, series: Mapping[str, FloatArray], time: FloatArray) -> FloatArray:
        """(n,) values at (n,) instants in s of one trial; 0 where a signal is missing."""
        inside, beside = (
            math.prod((one.values(series[one.signal]) for one in some), start=np.ones(len(time)))
            for some in (self.factors, self.outside)
        )
        inside = np.asarray(np.nan_to_num(inside))
        if not self.operator:
            return inside
        operator, clock = OPERATORS[self.operator], time
        if operator.of_swept:
            clock = np.concatenate(([0.0], np.cumsum(np.abs(series["rate"][:-1]) * np.diff(time))))
        past = operator.function(clock, inside, *self.constants)
        return np.asarray(np.nan_to_num(beside * past) - inside * self.is_change)


def _power(unit: str, count: float) -> str:
    return unit if count == 1 else f"({unit})^{count:g}" if " " in unit else f"{unit}^{count:g}"
