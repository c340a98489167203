"""Grammar of formulas: products of functions of signals, each with a coefficient whose unit makes it a torque."""

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import SPEEDS
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
_HOUR = 3600.0  # s
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
# Time constants of a first-order memory, in time constants of the vehicle.
MEMORIES = (0.5, 2.0)
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


@dataclass(frozen=True)
class Product:
    """A product of one or two factors, perhaps after a first-order memory; without factors it is 1.

    The memory of the thruster torque is less the torque: with a coefficient of 1 the torque lags.
    """

    factors: tuple[Factor, ...]
    memory: float = 0.0  #: Time constant in s of the memory; 0 for none.

    @property
    def lags(self) -> bool:
        """Whether the product is a memory of the thruster torque less the torque itself."""
        return self.memory > 0.0 and [(one.signal, one.shape) for one in self.factors] == [
            ("thruster_torque", "linear")
        ]

    @property
    def signals(self) -> tuple[str, ...]:
        """The signals in it."""
        return tuple(dict.fromkeys(factor.signal for factor in self.factors))

    @property
    def logged(self) -> tuple[Factor, ...]:
        """Factors of logged signals, which are no part of the simulated motion."""
        return tuple(factor for factor in self.factors if factor.signal not in STATES)

    @property
    def symbols(self) -> int:
        """Length of its code."""
        return sum(SHAPES[factor.shape].symbols for factor in self.factors) + 2 * (self.memory > 0.0)

    @property
    def text(self) -> str:
        """The product in a formula; ``memory(…)`` is the output of a first-order low-pass filter."""
        return self.text_with("")

    def text_with(self, constant: str) -> str:
        """The product in a formula, with the time constant of its memory as a text."""
        text = "*".join(factor.code(factor.signal) for factor in self.factors) or "1"
        if not self.memory:
            return text
        text, whole = f"memory({text}{constant})", text
        return f"({text} - {whole})" if self.lags else text

    def with_memory(self, constant: float) -> Self:
        """The product after a memory with another time constant in s."""
        return replace(self, memory=constant)

    def unit_of_coefficient(self, units: Mapping[str, str]) -> str:
        """Unit of the coefficient that makes the product a torque in N m."""
        powers: dict[str, float] = defaultdict(float, {"N m": -1.0})
        for factor in self.factors:
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
        found = np.ones(len(time))
        for factor in self.factors:
            found = found * factor.values(series[factor.signal])
        found = np.nan_to_num(found)
        if not self.memory:
            return found
        return remembered(time, found, self.memory) - found * self.lags


@compiled
def remembered(time: FloatArray, values: FloatArray, constant: float) -> FloatArray:
    """(n,) output of a first-order low-pass filter that begins at zero; ``values`` are held."""
    found, state = np.zeros(len(time)), 0.0
    for k in range(1, len(time)):
        decay = math.exp((time[k - 1] - time[k]) / constant)
        state = decay * state + (1.0 - decay) * values[k - 1]
        found[k] = state
    return found


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
        return (trial.campaign_time + time) / _HOUR
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
        # Longer products are rare in nature, and would be half of all.
        pairs += [
            Product((one, other))
            for one, other in product(*each)
            if SHAPES[one.shape].symbols + SHAPES[other.shape].symbols <= _LONGEST_PAIR
        ]
        if second.startswith(THRUST) and first.startswith(THRUST):
            pairs += map(Product, product(*(factors(name, _OF_THRUST) for name in (first, second))))
    slow = [
        Product((one,), memory=share * time_constant)
        for name in signals
        if name not in {"angle", "heading", HOURS} and not name.startswith(THRUST)
        for one in factors(name, ("linear", "quadratic"))
        for share in MEMORIES
    ]
    return [*alone, *pairs, *slow]
