"""Grammar of formulas: products of functions of signals, each with a coefficient whose unit makes it a torque."""

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_dynamics import played, root_played, root_slewed, slewed
from rovid.effects.actuator_inputs import SPEEDS
from rovid.effects.base import HOUR
from rovid.jit.decorators import compiled
from rovid.trial.preprocessing import Run, shared_channels
from rovid.trial.vehicle import Vehicle

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
_UNITS = {
    HOURS: "h",
    "rate": "rad/s",
    "angle": "rad",
    "heading": "rad",
    "thruster_torque": "N m",
    "roll": "rad",
    "pitch": "rad",
    "supply_voltage": "V",
    SPEEDS[0]: "m/s",
    SPEEDS[1]: "m/s",
}
# Rate, speed or angle at which a smooth sign reaches 76 %, as a share of the signal's RMS.
_SIGN_SHARE = 0.1
# Time constants of a first-order memory, in time constants of the vehicle. Rates of a limited torque, in its RMS value
# for each time constant, and widths of a play, in the RMS value. Frequencies and the damping ratio of an oscillation,
# which is seen near its frequency alone.
_MEMORIES, _LIMITS, _PLAYS = (0.5, 2.0), (0.3, 1.0, 3.0), (0.1, 0.4)
_FREQUENCIES, _DAMPING = tuple(0.3 * 1.13**k for k in range(30)), 0.05
# Symbols of the longest product of two factors.
_LONGEST_PAIR = 3
# Length of the code of one more symbol in nats.
_SYMBOL = math.log(2.0)
_OF_ANGLE = ("sine", "cosine", "sine_2", "cosine_2")
_ALONE = ("linear", "quadratic", "cubic", "size", "square", "sign")
_IN_PRODUCT = ("linear", "quadratic", "size", "square", "sign")
# Of a thrust also its root, as a propeller's speed; of two thrusters, of which one takes in the jet of the other, the
# product of these. Shapes of a single thruster's thrust, the first two also in pairs.
_OF_THRUST = ("root", "root_size")
_OF_THRUSTER = ("linear", "size", "quadratic", "root")


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
    fastest: str = ""  #: Code of the fastest rate of change of the states in 1/s; empty: no faster than the motion.
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
            np.prod([np.ones(len(time)), *(one.values(series[one.signal]) for one in some)], axis=0)
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


@dataclass(frozen=True, eq=False)
class Grammar:
    """All products for some logs, with their series."""

    products: tuple[Product, ...]
    series: Mapping[str, Mapping[str, FloatArray]]  #: Trial name -> signal -> (n,) values.
    times: Mapping[str, FloatArray]  #: Trial name -> (n,) instants in s.
    units: Mapping[str, str]  #: Signal -> unit.

    @classmethod
    def of(cls, runs: Sequence[Run], parts: Sequence[Run], time_constant: float, vehicle: Vehicle) -> Self:
        """All products of the signals that every one of the ``runs`` holds; ``parts`` are further pieces of them."""
        names = _signals(runs, vehicle)
        every = (*runs, *parts)
        series = {run.trial.name: {name: _values(run, name, vehicle) for name in names} for run in every}
        # The signal itself as a factor; less its mean where it varies little about that, as a supply voltage.
        factors = {}
        for name in names:
            values = np.concatenate([series[r.trial.name][name] for r in runs])
            mean, spread = float(np.nanmean(values)), float(np.nanstd(values))
            has_zero = name in STATES or name.startswith(THRUST)
            centre = float(f"{mean:.3g}") if not has_zero and abs(mean) > spread else 0.0
            size = float(np.sqrt(np.nanmean((values - centre) ** 2)))
            factors[name] = Factor(name, "linear", float(f"{_SIGN_SHARE * size:.1e}"), centre)
        units = {name: "N" if name.startswith(THRUST) else _UNITS.get(name, f"[{name}]") for name in names}
        times = {run.trial.name: run.trial.time for run in every}
        return cls(tuple(_products(factors, time_constant)), series, times, units)

    def values(self, product: Product) -> dict[str, FloatArray]:
        """Trial name -> (n,) values of a product."""
        return {name: product.values(series, self.times[name]) for name, series in self.series.items()}

    def price(self, product: Product) -> float:
        """Length in nats of the code that chooses the product: the number of symbols, then one among as long ones."""
        same = sum(other.symbols == product.symbols for other in self.products)
        return _SYMBOL * product.symbols + math.log(max(same, 1))


def _signals(runs: Sequence[Run], vehicle: Vehicle) -> list[str]:
    """State signals, then logged ones that vary and are known to every run."""
    names = ["rate", "angle"] + ["heading"] * runs[0].trial.axis.angular
    if runs[0].trial.has_actuators:
        names.append("thruster_torque")
    found = []
    single = [f"{THRUST}{one.name}" for one in vehicle.thrusters if one.curve is not None]
    for name in [*single * (len(single) > 1), *[HOURS] * (len(runs) > 1), *sorted(shared_channels(runs))]:
        every = np.concatenate([_values(run, name, vehicle) for run in runs])
        spread, mean = float(np.nanstd(every)), float(np.abs(np.nanmean(every)))
        if np.isfinite(every).mean() > 0.5 and spread > 1e-6 * (mean + 1e-300):
            found.append(name)
    return [*names, *found]


def _values(run: Run, name: str, vehicle: Vehicle) -> FloatArray:
    """(n,) signal at the log instants: of the motion, the mean until the next instant."""
    time, trial = run.trial.time, run.trial
    centre = time + 0.5 * np.diff(time, append=time[-1])
    if name == "rate":
        known = np.isfinite(run.rates.rate)
        return np.interp(centre, run.rates.time[known], run.rates.rate[known]) if known.any() else np.zeros(len(time))
    if name in {"angle", "heading"}:
        known = np.isfinite(trial.position)
        position = np.interp(centre, time[known], trial.position[known])
        return position - (position[0] if name == "angle" else 0.0)
    if name == "thruster_torque":
        return np.asarray(run.torque)
    if name.startswith(THRUST):
        at = [one.name for one in vehicle.thrusters].index(name.removeprefix(THRUST))
        return vehicle.thrust(trial.commands)[:, at]
    if name == HOURS:
        return (trial.campaign_time + time) / HOUR
    return np.asarray(trial.channels[name], dtype=float)


def _products(signals: Mapping[str, Factor], time_constant: float) -> list[Product]:
    """Every product: alone, in pairs, and with a memory."""
    base = {("rate", "linear"), ("rate", "quadratic"), ("thruster_torque", "linear")}  # the plain model has them

    def factors(name: str, shapes: Sequence[str]) -> list[Factor]:
        return [replace(signals[name], shape=shape) for shape in shapes]

    def shapes_in_product(name: str) -> Sequence[str]:
        if name.startswith(THRUST):
            return _OF_THRUSTER[:2]
        return _OF_ANGLE[:2] if name == "heading" else (*_IN_PRODUCT, *_OF_THRUST[1:] * (name == "thruster_torque"))

    alone = [Product(())]
    for name in signals:
        shapes: Sequence[str] = (
            *_ALONE,
            *_OF_ANGLE[:2] * (name == "angle"),
            *_OF_THRUST[:1] * (name == "thruster_torque"),
        )
        shapes = _OF_ANGLE if name == "heading" else _OF_THRUSTER if name.startswith(THRUST) else shapes
        alone += [Product((one,)) for one in factors(name, shapes) if (name, one.shape) not in base]
    pairs = []
    for first, second in combinations(signals, 2):
        if {first, second} == {"angle", "heading"}:
            continue
        if first.startswith(THRUST) != second.startswith(THRUST) and "rate" not in {first, second}:
            continue
        # A logged signal takes the place of the speed ahead in the compiled term.
        if SPEEDS[0] in {first, second} and not {first, second} <= {*STATES}:
            continue
        each = [factors(name, shapes_in_product(name)) for name in (first, second)]
        # Longer products are rare in nature, and would be half of all. A heading acts by its sine or cosine at least.
        longest = _LONGEST_PAIR + ("heading" in {first, second})
        pairs += [
            Product((one, other))
            for one, other in product(*each)
            if SHAPES[one.shape].symbols + SHAPES[other.shape].symbols <= longest
        ]
        if second.startswith(THRUST) and first.startswith(THRUST):
            pairs += map(Product, product(*(factors(name, _OF_THRUST) for name in (first, second))))
    of_past = [name for name in signals if name not in {"angle", "heading", HOURS} and not name.startswith(THRUST)]
    memories = [("memory", (share * time_constant,)) for share in _MEMORIES]
    slow = [
        Product((one,), *memory)
        for name in of_past
        for one in factors(name, ("linear", "quadratic"))
        for memory in memories
    ]
    # The size of the past motion or load changes what acts now, as a supply that sags.
    own = [replace(signals[name], shape="linear") for name in ("rate", "thruster_torque") if name in signals]
    slow += [
        Product((replace(one, shape=shape),), *memory, (now,))
        for now, one in product(own, own)
        for shape in ("size", "square")
        for memory in memories
    ]
    # Drag relative to water that the vehicle set in motion, and to its own wake, which it leaves behind by distance.
    angle = signals["rate"].scale / _SIGN_SHARE * time_constant
    wakes = [("memory", (share * time_constant,), "size", "linear") for share in _MEMORIES]
    wakes += [("swept_memory", (share * angle,), "size", "linear") for share in _MEMORIES]
    wakes += [("swept_memory", (share * angle,), "square", "sign") for share in _MEMORIES]
    slow += [
        Product((replace(own[0], shape=past),), name, constants, (replace(own[0], shape=now),))
        for name, constants, now, past in wakes
    ]
    slow += [Product((signals["rate"],), "oscillation", (w / time_constant, _DAMPING)) for w in _FREQUENCIES]
    if torque := signals.get("thruster_torque"):
        size = torque.scale / _SIGN_SHARE
        for name, unit in (("", size), ("root_", math.sqrt(size))):
            slow += [Product((torque,), f"{name}limit", (share * unit / time_constant,)) for share in _LIMITS]
            slow += [Product((torque,), f"{name}play", (share * unit,)) for share in _PLAYS]
    return [*alone, *pairs, *slow]
