"""Grammar of formulas: products of functions of signals, with a coefficient whose unit makes the product a torque."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects.actuator_inputs import SPEEDS
from rovid.jit.decorators import compiled
from rovid.signals.preprocessing import Run, shared_channels

# Name of the signal -> its code in a compiled term.
STATES = {
    "rate": "at.rate",
    "angle": "at.angle",
    "heading": "(at.start + at.angle)",
    "thruster_torque": "at.thruster_torque",
    SPEEDS[0]: "at.surge",
    SPEEDS[1]: "at.sway",
}
_UNITS = {
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
TILTS = ("roll", "pitch")
# Rate, speed or angle at which a smooth sign reaches 76 %, as a share of the signal's RMS.
_SIGN_SHARE = 0.1
# Time constants of a first-order memory, in time constants of the vehicle.
MEMORIES = (0.5, 2.0)
# Symbols of the longest product of two factors.
_LONGEST_PAIR = 3
# Length of the code of one more symbol in nats.
_SYMBOL = math.log(2.0)


class Shape(NamedTuple):
    """A function of one signal."""

    text: str  #: Python code: x is the signal, m the prefix of the functions of a module, s the scale of a sign.
    power: int  #: Power of the signal's unit.
    symbols: int  #: Length of its code.
    function: Callable[[FloatArray, float], FloatArray]  #: (values, scale of a sign) -> values.


SHAPES = {
    "linear": Shape("{x}", 1, 1, lambda x, _: x),
    "quadratic": Shape("{x}*abs({x})", 2, 2, lambda x, _: x * np.abs(x)),
    "cubic": Shape("{x}*{x}*{x}", 3, 3, lambda x, _: x**3),
    "size": Shape("abs({x})", 1, 2, lambda x, _: np.abs(x)),
    "square": Shape("{x}*{x}", 2, 2, lambda x, _: x * x),
    "sign": Shape("{m}tanh({x}/{s})", 0, 2, lambda x, s: np.tanh(x / s)),
    "sine": Shape("{m}sin({x})", 0, 2, lambda x, _: np.sin(x)),
    "cosine": Shape("{m}cos({x})", 0, 2, lambda x, _: np.cos(x)),
    "sine_2": Shape("{m}sin(2.0*{x})", 0, 3, lambda x, _: np.sin(2.0 * x)),
    "cosine_2": Shape("{m}cos(2.0*{x})", 0, 3, lambda x, _: np.cos(2.0 * x)),
}
_OF_ANGLE = ("sine", "cosine", "sine_2", "cosine_2")
_ALONE = ("linear", "quadratic", "cubic", "size", "square", "sign")
_IN_PRODUCT = ("linear", "quadratic", "size", "square", "sign")


@dataclass(frozen=True)
class Factor:
    """A function of one signal."""

    signal: str
    shape: str
    scale: float  #: Value of the signal, less its centre, at which a smooth sign reaches 76 %.
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
    """A product of one or two factors, perhaps after a first-order memory; without factors it is 1."""

    factors: tuple[Factor, ...]
    memory: float = 0.0  #: Time constant in s of the memory; 0 for none.

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
        text = "*".join(factor.code(factor.signal) for factor in self.factors) or "1"
        return f"memory({text})" if self.memory else text

    def with_memory(self, constant: float) -> Product:
        """The product after a memory with another time constant in s."""
        return replace(self, memory=constant)

    def unit_of_coefficient(self, units: Mapping[str, str]) -> str:
        """Unit of the coefficient that makes the product a torque in N m."""
        powers = Counter({"N m": -1})
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
        return remembered(time, found, self.memory)


@compiled
def remembered(time: FloatArray, values: FloatArray, constant: float) -> FloatArray:
    """(n,) output of a first-order low-pass filter that begins at zero; ``values`` are held."""
    found, state = np.zeros(len(time)), 0.0
    for k in range(1, len(time)):
        decay = math.exp((time[k - 1] - time[k]) / constant)
        state = decay * state + (1.0 - decay) * values[k - 1]
        found[k] = state
    return found


def _power(unit: str, count: int) -> str:
    return unit if count == 1 else f"({unit})^{count}" if " " in unit else f"{unit}^{count}"


@dataclass(frozen=True, eq=False)
class Grammar:
    """All products for some logs, with their series."""

    products: tuple[Product, ...]
    series: Mapping[str, Mapping[str, FloatArray]]  #: Trial name -> signal -> (n,) values.
    times: Mapping[str, FloatArray]  #: Trial name -> (n,) instants in s.
    units: Mapping[str, str]  #: Signal -> unit.

    @classmethod
    def of(cls, runs: Sequence[Run], parts: Sequence[Run], time_constant: float) -> Grammar:
        """All products of the signals that every one of the ``runs`` holds; ``parts`` are further pieces of them."""
        names = _signals(runs)
        every = (*runs, *parts)
        series = {run.trial.name: {name: _values(run, name) for name in names} for run in every}
        factors = {
            name: _plain_factor(name, np.concatenate([series[r.trial.name][name] for r in runs])) for name in names
        }
        units = {name: _UNITS.get(name, f"[{name}]") for name in names}
        times = {run.trial.name: run.trial.time for run in every}
        return cls(tuple(_products(factors, time_constant)), series, times, units)

    def values(self, product: Product) -> dict[str, FloatArray]:
        """Trial name -> (n,) values of a product."""
        return {name: product.values(series, self.times[name]) for name, series in self.series.items()}

    def price(self, product: Product) -> float:
        """Length in nats of the code that chooses the product: the number of symbols, then one among as long ones."""
        same = sum(other.symbols == product.symbols for other in self.products)
        return _SYMBOL * product.symbols + math.log(max(same, 1))


def _signals(runs: Sequence[Run]) -> list[str]:
    """State signals, then logged ones that vary and are known to every run."""
    names = ["rate", "angle"] + ["heading"] * runs[0].trial.axis.angular
    if runs[0].trial.has_actuators:
        names.append("thruster_torque")
    found = []
    for name in sorted(shared_channels(runs)):
        every = np.concatenate([_values(run, name) for run in runs])
        spread, mean = float(np.nanstd(every)), float(np.abs(np.nanmean(every)))
        if np.isfinite(every).mean() > 0.5 and spread > 1e-6 * (mean + 1e-300):
            found.append(name)
    return [*names, *found]


def _values(run: Run, name: str) -> FloatArray:
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
    return np.asarray(trial.channels[name], dtype=float)


def _plain_factor(name: str, values: FloatArray) -> Factor:
    """The signal itself as a factor; less its mean where it varies little about that, as a supply voltage."""
    mean, spread = float(np.nanmean(values)), float(np.nanstd(values))
    centre = float(f"{mean:.3g}") if name not in STATES and abs(mean) > spread else 0.0
    size = float(np.sqrt(np.nanmean((values - centre) ** 2)))
    return Factor(name, "linear", float(f"{_SIGN_SHARE * size:.1e}"), centre)


def _products(signals: Mapping[str, Factor], time_constant: float) -> list[Product]:
    """Every product: alone, in pairs, and with a memory."""
    base = {("rate", "linear"), ("rate", "quadratic"), ("thruster_torque", "linear")}  # the plain model has them

    def factors(name: str, shapes: Sequence[str]) -> list[Factor]:
        return [replace(signals[name], shape=shape) for shape in shapes]

    alone = [Product(())]
    for name in signals:
        shapes = _OF_ANGLE if name == "heading" else (*_ALONE, *_OF_ANGLE[:2]) if name == "angle" else _ALONE
        alone += [Product((one,)) for one in factors(name, shapes) if (name, one.shape) not in base]
    pairs = []
    for first, second in combinations(signals, 2):
        if {first, second} == {"angle", "heading"}:
            continue
        # A logged signal takes the place of the speed ahead in the compiled term.
        if SPEEDS[0] in {first, second} and not {first, second} <= {*STATES}:
            continue
        each = [factors(name, _OF_ANGLE[:2] if name == "heading" else _IN_PRODUCT) for name in (first, second)]
        # Longer products are rare in nature, and would be half of all.
        pairs += [
            Product((one, other))
            for one, other in product(*each)
            if SHAPES[one.shape].symbols + SHAPES[other.shape].symbols <= _LONGEST_PAIR
        ]
    slow = [
        Product((one,), memory=share * time_constant)
        for name in signals
        if name not in {"angle", "heading"}
        for one in factors(name, ("linear", "quadratic"))
        for share in MEMORIES
    ]
    return [*alone, *pairs, *slow]
