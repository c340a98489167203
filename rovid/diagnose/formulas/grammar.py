"""Grammar of formulas: products of functions of signals, each with a coefficient whose unit makes it a torque."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise, product
from typing import Self

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.diagnose.formulas.products import HOURS, SHAPES, STATES, THRUST, Factor, Product
from rovid.effects.actuator_inputs import SPEEDS
from rovid.effects.base import HOUR
from rovid.trial.preprocessing import Run, shared_channels
from rovid.trial.vehicle import Vehicle

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
        if product.operator:
            return {name: product.values(series, self.times[name]) for name, series in self.series.items()}
        ends = np.cumsum([0, *map(len, self.times.values())]).tolist()
        joined = product.values(self._joined, np.concatenate(list(self.times.values())))
        return {name: joined[begin:end] for name, (begin, end) in zip(self.times, pairwise(ends), strict=True)}

    @cached_property
    def _joined(self) -> dict[str, FloatArray]:
        """Signal -> (n,) values of all trials, one after the other."""
        names = next(iter(self.series.values()))
        return {name: np.concatenate([self.series[trial][name] for trial in self.times]) for name in names}

    def price(self, product: Product) -> float:
        """Length in nats of the code that chooses the product: the number of symbols, then one among as long ones."""
        return _SYMBOL * product.symbols + math.log(max(self._lengths[product.symbols], 1))

    @cached_property
    def _lengths(self) -> Counter[int]:
        """Number of products by the number of their symbols."""
        return Counter(product.symbols for product in self.products)


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
