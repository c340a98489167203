"""Grammar of formulas, and the regression of the missing torque on them.

Formulas are products of functions of signals, with a coefficient whose unit makes the product a torque. The Kalman
filter turns a torque that the model lacks into innovations, which are independent with known variances. The response of
the innovations to each product is the regressor. It is the weak form of the regression: the test functions are the
responses of the filter, no measured signal is differentiated, and the covariance of the smoothed missing torque is
taken into account (de Jong 1991, equivalence of innovations and smoothed disturbances).
"""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from typing import NamedTuple, Self

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.effects import Effect, EffectParameter
from rovid.effects.actuator_inputs import SPEEDS, ActuatorInputs
from rovid.effects.base import OnTorque, Values
from rovid.estimate.fit_result import FitResult
from rovid.jit.decorators import compiled
from rovid.trial.preprocessing import Run, shared_channels

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
# Products whose responses are computed at once.
_AT_ONCE = 32
# Size of a torque in the RMS torque in use, for the difference quotient.
_SIZE = 0.01
# Least share of its information that is left to a product next to the model's parameters; with less, the linearisation
# misleads.
_LEAST_SHARE = 1e-3


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

    def with_memory(self, constant: float) -> Self:
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
    def of(cls, runs: Sequence[Run], parts: Sequence[Run], time_constant: float) -> Self:
        """All products of the signals that every one of the ``runs`` holds; ``parts`` are further pieces of them."""
        names = _signals(runs)
        every = (*runs, *parts)
        series = {run.trial.name: {name: _values(run, name) for name in names} for run in every}
        # The signal itself as a factor; less its mean where it varies little about that, as a supply voltage.
        factors = {}
        for name in names:
            values = np.concatenate([series[r.trial.name][name] for r in runs])
            mean, spread = float(np.nanmean(values)), float(np.nanstd(values))
            centre = float(f"{mean:.3g}") if name not in STATES and abs(mean) > spread else 0.0
            size = float(np.sqrt(np.nanmean((values - centre) ** 2)))
            factors[name] = Factor(name, "linear", float(f"{_SIGN_SHARE * size:.1e}"), centre)
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


@dataclass(frozen=True, eq=False)
class InnovationRegression:
    """Normal equations of p parameters of a model and q regressors, for each of b blocks of the data."""

    gradient: FloatArray  #: (b, p + q)
    own: FloatArray  #: (b, p, p) information of the parameters.
    cross: FloatArray  #: (b, p, q)
    power: FloatArray  #: (b, q) information of each regressor.
    between: FloatArray  #: (q, q) information between regressors, of all blocks.

    def gains(self, weights: FloatArray | None = None) -> FloatArray:
        """(q,) log-likelihood gain in nats of each regressor alone; ``weights`` are counts of (b,) blocks."""
        w = np.ones(len(self.own)) if weights is None else weights
        count = self.own.shape[1]
        gradient, cross, power = w @ self.gradient, np.tensordot(w, self.cross, 1), w @ self.power
        moved = np.linalg.pinv(np.tensordot(w, self.own, 1), rcond=1e-12) @ cross
        score = gradient[count:] - moved.T @ gradient[:count]
        left = power - np.sum(cross * moved, axis=0)
        known = left > _LEAST_SHARE * np.maximum(power, 1e-300)
        return np.where(known, 0.5 * score**2 / np.where(known, left, 1.0), 0.0)

    def correlation(self) -> FloatArray:
        """(q, q) correlation of the regressors next to the model's parameters; 0 for regressors without power."""
        cross = self.cross.sum(axis=0)
        left = self.between - cross.T @ np.linalg.pinv(self.own.sum(axis=0), rcond=1e-12) @ cross
        size = np.sqrt(np.maximum(np.diag(left), 0.0))
        known = np.outer(size, size) > 0.0
        return np.where(known, left / np.where(known, np.outer(size, size), 1.0), 0.0)


def product_effects(grammar: Grammar, products: Sequence[Product]) -> list[Effect]:
    """Each product as an effect with the measured motion, for regression alone."""
    return [_effect(f"product {k}", grammar.values(product)) for k, product in enumerate(products)]


def _effect(name: str, series: Mapping[str, FloatArray]) -> Effect:
    every = np.concatenate(list(series.values()))
    size = max(float(np.sqrt(np.mean(every**2))), 1e-300)
    scaled = {trial: values / size for trial, values in series.items()}

    def changed(inputs: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
        return np.asarray(torque + values["size"] * inputs.from_trials(scaled))

    parameter = EffectParameter(
        name="size", unit="N m", neutral=0.0, low=-5.0, high=5.0, initial_values=(_SIZE,), scale="torque"
    )
    return Effect(
        id=name,
        title=name,
        parameters=(parameter,),
        equation=name,
        fingerprint=name,
        experiment=name,
        acts=OnTorque(changed),
    )


def regress(fitted: FitResult, effects: Sequence[Effect]) -> InnovationRegression:
    """Normal equations of the first start of each of the ``effects`` next to a fitted model."""
    objective, count = fitted.objective, len(fitted.x)
    blocks = objective.masked(fitted.data.block_index)
    number = np.unique(blocks, return_inverse=True)[1]
    b, q = int(number.max()) + 1, len(effects)
    gradient, power = np.zeros((b, count + q)), np.zeros((b, q))
    own, cross, between = np.zeros((b, count, count)), np.zeros((b, count, q)), np.zeros((q, q))
    others = [objective.with_effects((*fitted.effects, effect)) for effect in effects]
    starts = [other.parametrization.initial_values()[0] for other in others]
    for index, chunk in enumerate(objective.chunks):
        centre = chunk.innovations(fitted.x)
        sides = []
        for first in range(0, q, _AT_ONCE):
            some = slice(first, first + _AT_ONCE)
            pairs = [
                (other.chunks[index], np.concatenate((fitted.x, start)))
                for other, start in zip(others[some], starts[some], strict=True)
            ]
            sides += chunk.evaluate_each(pairs)
        pieces = zip(chunk.jacobian(fitted.x), chunk.jacobian_between(centre, sides, np.ones(q)), strict=True)
        for mine, theirs in pieces:
            # A model may diverge with a torque of that size: such a product explains nothing.
            columns = np.nan_to_num(np.hstack((mine.matrix, theirs.matrix)), posinf=0.0, neginf=0.0)
            rows = np.tile(number[mine.rows], 2)
            between += columns[:, count:].T @ columns[:, count:]
            for block in np.unique(rows):
                at = rows == block
                part, residual = columns[at], mine.residual[at]
                gradient[block] += part.T @ residual
                own[block] += part[:, :count].T @ part[:, :count]
                cross[block] += part[:, :count].T @ part[:, count:]
                power[block] += np.sum(part[:, count:] ** 2, axis=0)
    return InnovationRegression(gradient, own, cross, power, between)


def inclusion(found: InnovationRegression, prices: FloatArray, rng: np.random.Generator, draws: int) -> FloatArray:
    """(draws,) index of the regressor with the largest gain less its price, in each draw of blocks with replacement."""
    count = len(found.own)
    chosen: list[int] = []
    for _ in range(draws):
        weights: IntArray = np.bincount(rng.integers(0, count, count), minlength=count)
        chosen.append(int(np.argmax(found.gains(weights.astype(float)) - prices)))
    return np.array(chosen)
