"""Held-out tests of planar models, and what they say of a cause in a diagnosis.

Each part of the logs is predicted by a fit to the others. Parts are whole runs if there are four or more, and otherwise
equal pieces of the runs. A fold is every fourth part. The filter always runs through whole logs: a part is held out by
leaving its readings out of the likelihood of the fit.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.diagnose.cross_validation import certain_growth
from rovid.diagnose.evidence import posterior_probability, probability_not_a_stand_in, recalibrated, size_in_errors
from rovid.diagnose.result import Finding, OtherCause
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.estimate.fisher_information import negative_log_likelihoods
from rovid.model.simulation import HORIZONS
from rovid.planar.dataset import SMOOTHED_INTERVALS, PlanarData, measured_axes, slowest_interval, smooth_run
from rovid.planar.free_runs import PlanarMotion
from rovid.planar.kernels import NOISE_SENSOR
from rovid.planar.model import AXIS_SPEEDS, INPUT_COUNT, SENSORS
from rovid.planar.optimum import Linearisation, PlanarOptimum, chord_fit
from rovid.planar.search import PlanarSearch

# Steps of a fit without a fold, from the fit to all readings.
_FOLD_STEPS = 4
_FOLDS = 4
# Least time between two restarts in s, and most restarts.
_RESTART, _MOST_WINDOWS = 15.0, 200
_WORSENED = "With {}, {}: it is not established."
_STANDS_IN = "Next to {1}, {0} may stand for the same, and is not established: with both, {2}."
_NOT_ALONE = "Without {1}, the logs do not establish {0}."


@dataclass(frozen=True, kw_only=True)
class PlanarScores:
    """Errors of a model on held-out parts of the logs, each predicted by a fit to the others."""

    log_likelihood: float  #: Of the innovations, in nats.
    #: surge_velocity, sway_velocity (m/s), yaw_rate (rad/s) -> RMS error of free-running simulations of 60 s.
    rmse: Mapping[str, float]
    heading_errors: Mapping[float, float]  #: Horizon in s -> RMS heading error in rad that far after a restart.


@dataclass(frozen=True, eq=False)
class Parts:
    """Parts of the logs, and windows of free-running simulations."""

    data: PlanarData
    optimum: PlanarOptimum  #: A model of the search. All models of the search share its grid.

    @cached_property
    def count(self) -> int:
        """Number of parts."""
        return int(self.part_of_run[-1][1])

    @property
    def least(self) -> float:
        """Least length of a part in s."""
        times, yaw_only = self.optimum.coordinates.sizes.time, self.optimum.likelihood.grid.yaw_only
        return THRESHOLDS.part_time_constants_min * float(times[2] if yaw_only else times.min())

    @cached_property
    def part_of_run(self) -> list[tuple[int, int]]:
        """First part of each run, and the part after its last one."""
        runs = self.data.runs
        if len(runs) >= THRESHOLDS.min_trials:
            return [(number, number + 1) for number in range(len(runs))]
        total, first, found = sum(run.duration for run in runs), 0, []
        usual = max(min(THRESHOLDS.parts, int(total / self.least)), THRESHOLDS.min_trials)
        for run in runs:
            last = first + max(1, round(usual * run.duration / total))
            found.append((first, last))
            first = last
        return found

    def part(self, run: IntArray, time: FloatArray) -> IntArray:
        """Part of each instant ``time`` of the runs with the numbers ``run``."""
        first, last = np.array(self.part_of_run).T
        duration = np.array([one.duration for one in self.data.runs])
        share = np.minimum(time / duration[run], 1.0 - 1e-9)
        return np.asarray(first[run] + np.floor(share * (last - first)[run]).astype(np.intp))

    @cached_property
    def of_innovations(self) -> IntArray:
        """(N,) part of each innovation; -1 of a prior, which no fold leaves out."""
        run, time, _ = self.optimum.likelihood.rows
        return np.where(run < 0, -1, self.part(run, time))

    @cached_property
    def shortest(self) -> float:
        """Length of the shortest part in s."""
        pairs = zip(self.data.runs, self.part_of_run, strict=True)
        return min(run.duration / (last - first) for run, (first, last) in pairs)

    @cached_property
    def windows(self) -> list[tuple[int, int, int, int]]:
        """Run, part, and the slice of the grid's instants of each window; windows stay within their part."""
        grid, found = self.optimum.likelihood.grid, []
        total = sum(run.duration for run in self.data.runs)
        spacing = max(_RESTART, total / _MOST_WINDOWS)
        for number in range(len(self.data.runs)):
            begin, end = int(grid.offsets[number]), int(grid.offsets[number + 1])
            time = grid.time[begin:end]
            parts = self.part(np.full(len(time), number), time)
            for part in np.unique(parts).tolist():
                own = np.flatnonzero(parts == part)
                # The filter has to settle after the start of a run.
                first = max(float(time[own[0]]), 0.1 * HORIZONS[0])
                for start in np.arange(first, float(time[own[-1]]) - HORIZONS[0], spacing).tolist():
                    here = int(np.searchsorted(time, start))
                    last = int(np.searchsorted(time, min(start + HORIZONS[1], float(time[own[-1]])), side="right"))
                    if last - here > 1:
                        found.append((number, part, begin + here, begin + last))
        return found

    @cached_property
    def measured(self) -> FloatArray:
        """(n, 4) heading, and surge, sway and yaw speeds over ground, at the grid's instants; NaN where unknown.

        A speed with a sensor stands at its readings. Others follow from smoothed headings and positions.
        """
        grid = self.optimum.likelihood.grid
        found = np.full((len(grid.time), 4), np.nan)
        axes = measured_axes(self.data.sensors)
        instant = np.repeat(np.arange(len(grid.time)), np.diff(grid.event_offsets))
        for number, run in enumerate(grid.runs):
            own = slice(int(grid.offsets[number]), int(grid.offsets[number + 1]))
            time, widths = grid.time[own], [SMOOTHED_INTERVALS * slowest_interval(run)] * 3
            if "heading" in run.sensors:
                widths[2] = SMOOTHED_INTERVALS * float(np.median(np.diff(run.readings("heading").time)))
            for axis, width in enumerate(widths):
                is_derived = axes[axis] and AXIS_SPEEDS[axis] not in run.sensors
                if is_derived and (smooth := smooth_run(run, width)) is not None:
                    found[own, 1 + axis] = np.interp(time, smooth.time, smooth.speeds[:, axis], np.nan, np.nan)
            if "heading" in run.sensors:
                heading = run.readings("heading")
                found[own, 0] = np.interp(time, heading.time, heading.values)
        for axis, name in enumerate(AXIS_SPEEDS):
            read = grid.sensors == SENSORS.index(name)
            found[instant[read], 1 + axis] = grid.values[read]
        return found


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Predictions of all parts by one model."""

    parts: Parts
    gains: FloatArray  #: (parts,) log-likelihood of each part.
    squares: FloatArray  #: (windows, 5) mean square errors of the speeds, and square heading errors at the horizons.

    @property
    def log_likelihood(self) -> float:
        """Of all parts."""
        return float(self.gains.sum())

    @cached_property
    def errors(self) -> list[float]:
        """(5,) RMS errors over all windows; NaN where unknown."""
        known = [one[np.isfinite(one)] for one in self.squares.T]
        return [math.sqrt(float(np.mean(one))) if len(one) else math.nan for one in known]

    @property
    def scores(self) -> PlanarScores:
        """The ``errors`` by name."""
        root = self.errors
        return PlanarScores(
            log_likelihood=self.log_likelihood,
            rmse={name: value for name, value in zip(AXIS_SPEEDS, root[:3], strict=True) if math.isfinite(value)},
            heading_errors={s: value for s, value in zip(HORIZONS, root[3:], strict=True) if math.isfinite(value)},
        )

    @cached_property
    def by_part(self) -> FloatArray:
        """(parts, 5) mean of ``squares`` in each part; NaN where unknown."""
        found = np.full((self.parts.count, self.squares.shape[1]), np.nan)
        owner = np.array([part for _, part, _, _ in self.parts.windows], dtype=np.intp)
        for part in range(self.parts.count):
            own = self.squares[owner == part]
            known = np.isfinite(own)
            count, total = known.sum(axis=0), np.where(known, own, 0.0).sum(axis=0)
            found[part] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
        return found


def held_out(parts: Parts, fitted: PlanarOptimum, line: Linearisation) -> HeldOut:
    """Predictions of all ``parts`` by the model ``fitted``, whose linearisation is ``line``."""
    number, gains = parts.of_innovations, np.zeros(parts.count)
    squares = np.full((len(parts.windows), 3 + len(HORIZONS)), np.nan)
    for fold in range(min(_FOLDS, parts.count)):
        left_out = np.arange(fold, parts.count, _FOLDS)
        rows = ~np.isin(number, left_out)
        own = chord_fit(fitted.likelihood, fitted.x, line.matrix.copy(), rows, steps=_FOLD_STEPS)
        innovations, states = fitted.likelihood.filtered(own.x, keep=True)
        each = -negative_log_likelihoods(innovations.error, innovations.variance)
        for part in left_out.tolist():
            gains[part] = float(each[number[: len(each)] == part].sum())
        chosen = [at for at, (_, part, _, _) in enumerate(parts.windows) if part in left_out]
        squares[chosen] = window_errors(parts, own, states, chosen)
    return HeldOut(parts, gains, squares)


def window_errors(
    parts: Parts, model: PlanarOptimum, states: FloatArray, chosen: Sequence[int], disturbed: bool = False
) -> FloatArray:
    """(windows, 5) squares as in `HeldOut`, of simulations from the filtered (n, 12) ``states``.

    With ``disturbed`` the errors are those of a perfect model: the change of the simulation by a random disturbance of
    the fitted size.
    """
    grid, planar = model.likelihood.grid, model.model
    found = np.full((len(chosen), 3 + len(HORIZONS)), np.nan)
    if not len(chosen):
        return found
    windows = [parts.windows[at] for at in chosen]
    every = np.concatenate([np.arange(begin, end) for _, _, begin, end in windows])
    offsets = np.cumsum([0, *(end - begin for _, _, begin, end in windows)])
    inputs = grid.inputs(planar)[every]
    first = states[[begin for _, _, begin, _ in windows]]
    time = grid.time[every]
    # The change of a wandering current counts as speed over ground.
    logged = parts.data.sensors
    started = PlanarMotion.of_states(time[offsets[:-1]], first, planar, logged)
    starts = started.sensors(("heading", *AXIS_SPEEDS, "north", "east"))

    def simulated(forces: FloatArray) -> FloatArray:
        motion = PlanarMotion.simulated(
            planar, offsets, time, forces, starts, grid.speed, yaw_only=grid.yaw_only, sensors=logged
        )
        return motion.sensors(("heading", *AXIS_SPEEDS))

    motion, reference = simulated(inputs), parts.measured[every]
    if disturbed:
        reference = simulated(inputs + _random_forces(model, time, offsets, inputs.shape))
    with np.errstate(invalid="ignore", over="ignore"):
        error = motion - reference
        if not disturbed:
            error[:, 0] = np.angle(np.exp(1j * error[:, 0]))
    for at in range(len(windows)):
        own = slice(int(offsets[at]), int(offsets[at + 1]))
        elapsed = time[own] - time[own][0]
        for axis in range(3):
            known = error[own, 1 + axis]
            known = known[np.isfinite(known)]
            if known.size:
                found[at, axis] = float(np.mean(known**2))
        for number, horizon in enumerate(HORIZONS):
            if elapsed[-1] >= 0.98 * horizon:
                found[at, 3 + number] = float(error[own, 0][int(np.argmin(np.abs(elapsed - horizon)))] ** 2)
    return found


def _random_forces(model: PlanarOptimum, time: FloatArray, offsets: IntArray, shape: tuple[int, ...]) -> FloatArray:
    """Gauss-Markov forces of the fitted disturbance; zeros in the columns of rudders."""
    generator, forces = np.random.default_rng(0), np.zeros(shape)
    numbers = model.coordinates.noise(model.x)
    for axis in range(INPUT_COUNT):
        size, memory = float(numbers[axis]), float(numbers[INPUT_COUNT + axis])
        white = generator.standard_normal(len(time))
        for begin, end in zip(offsets[:-1].tolist(), offsets[1:].tolist(), strict=True):
            value = size * white[begin]
            for at in range(begin, end):
                if at > begin:
                    decay = math.exp(-(time[at] - time[at - 1]) / memory)
                    value = decay * value + size * math.sqrt(1.0 - decay * decay) * white[at]
                forces[at, axis] = value
    return forces


def noise_floors(parts: Parts, fitted: PlanarOptimum) -> HeldOut:
    """Errors of a perfect model: what the fitted disturbance moves in the same windows, and the sensors' noise."""
    _, states = fitted.likelihood.filtered(fitted.x, keep=True)
    squares = window_errors(parts, fitted, states, range(len(parts.windows)), disturbed=True)
    noise = fitted.coordinates.noise(fitted.x)[NOISE_SENSOR : NOISE_SENSOR + len(SENSORS)]
    for axis, name in enumerate(AXIS_SPEEDS):
        if name in parts.data.sensors:
            squares[:, axis] += float(noise[SENSORS.index(name)]) ** 2
    if "heading" in parts.data.sensors:
        squares[:, 3:] += float(noise[SENSORS.index("heading")]) ** 2
    return HeldOut(parts, np.zeros(parts.count), squares)


class Gate:
    """Held-out predictions of models, computed once."""

    def __init__(self, search: PlanarSearch, parts: Parts) -> None:
        self.search, self.parts = search, parts
        self._known: dict[frozenset[str], tuple[PlanarOptimum, HeldOut]] = {}

    def held_out(self, fitted: PlanarOptimum) -> HeldOut:
        """Held-out predictions of a model."""
        key = frozenset(effect.key for effect in fitted.effects)
        known = self._known.get(key)
        if known is None or known[0] is not fitted:
            known = self._known[key] = fitted, held_out(self.parts, fitted, self.search.line(fitted))
        return known[1]

    def tested(self, model: PlanarOptimum, effect: Effect) -> tuple[Finding, dict[str, float]]:
        """What the tests say of one ``effect`` of the ``model``, and by how much it makes errors larger.

        The estimate is that of the search. The growth of each held-out error is certain; see `certain_growth`.
        """
        search = self.search
        rest = search.polish(search.without(model, effect))
        bic_gain = search.score(model) - search.score(rest)
        with_it, without = self.held_out(model), self.held_out(rest)
        held_out_gain = with_it.log_likelihood - without.log_likelihood
        estimate = model.effect_estimate(effect)
        errors = size_in_errors(effect, estimate, model.coordinates.sizes.effects)
        found: dict[str, OtherCause] = {}  # Other causes in the place of ``effect``, best first.
        for one in search.replacements(model, effect):
            other = one.effects[-1]
            if other.id != effect.id and not search.is_banned(one):
                found.setdefault(other.id, OtherCause(other, search.score(one) - search.score(rest)))
        others = tuple(found.values())
        close = bic_gain - THRESHOLDS.tie(max(bic_gain, 0.0))
        equivalent = tuple(one.effect for one in others if one.bic_gain > close)
        # Correlated innovations count as fewer: by the sandwich errors, the gain is half the square of the distance.
        robust = bic_gain if model.is_white else min(bic_gain, 0.5 * errors**2)
        gains = {effect.id: robust} | {one.effect.id: one.bic_gain + robust - bic_gain for one in others}
        cap = probability_not_a_stand_in(held_out_gain, robust, white=model.is_white)
        names = [effect.id, *(one.id for one in equivalent)]
        probability = posterior_probability(gains, names, search.causes_tried, cap=cap)
        probability = min(recalibrated(probability, white=model.is_white), THRESHOLDS.max_probability)
        finding = Finding(
            effect=effect,
            estimate=estimate,
            gain=rest.value - model.value,
            bic_gain=bic_gain,
            held_out_gain=held_out_gain,
            standard_errors=errors,
            probability=probability,
            alternatives=others,
            indistinguishable=equivalent,
            white=model.is_white,
        )
        pairs = zip(with_it.by_part.T[:3], without.by_part.T[:3], strict=True)
        growths = [certain_growth(own[:, None], other[:, None]) for own, other in pairs]
        growths.append(certain_growth(with_it.by_part[:, 3:], without.by_part[:, 3:]))
        return finding, dict(zip((*AXIS_SPEEDS, "heading"), growths, strict=True))

    def established(
        self, model: PlanarOptimum, tested: Sequence[Finding], sure: Sequence[Finding]
    ) -> tuple[list[Finding], PlanarOptimum, list[str]]:
        """The ``sure`` ones of the ``tested`` causes that make no held-out error larger; their model; messages.

        A cause that makes an error larger is tested again without the weaker ones before it, which may stand for it.
        """
        found, lost, messages, search = list[Finding](), list[Finding](), list[str](), self.search
        for one in tested:
            rest = search.polish(search.without(model, one.effect))
            worse = self._worsened(model, rest) if one in sure else ""
            if worse and found:
                alone = model
                for weaker in found:
                    alone = search.polish(search.without(alone, weaker.effect))
                if not self._worsened(alone, search.polish(search.without(alone, one.effect))):
                    messages += [_STANDS_IN.format(two.effect.title, one.effect.title, worse) for two in found]
                    model, found, worse = alone, [], ""
            if one in sure and not worse:
                found.append(one)
                continue
            model = rest
            if worse:
                lost.append(one)
                messages.append(_WORSENED.format(one.effect.title, worse))
        for one in found if lost else ():
            # Its test was next to causes that are gone, and that it may stand for.
            if self.tested(model, one.effect)[0].probability < THRESHOLDS.established:
                messages.append(_NOT_ALONE.format(one.effect.title, " and ".join(two.effect.title for two in lost)))
                model = search.polish(search.without(model, one.effect))
                found = [two for two in found if two is not one]
        if found and (worse := self._worsened(model, search.base)):
            messages.append(_WORSENED.format(" and ".join(one.effect.title for one in found), worse))
            return [], search.base, messages
        return found, model, messages

    def _worsened(self, model: PlanarOptimum, other: PlanarOptimum) -> str:
        """The held-out error of yaw rate or heading that is larger than with an ``other`` model, as text; or empty.

        An error within the floors of a perfect model, that is larger by chance only, does not count.
        """
        if model is other:
            return ""
        own, rest = self.held_out(model), self.held_out(other)
        named = ("the yaw rate", *(f"the heading after {horizon:g} s" for horizon in HORIZONS))
        names = dict(enumerate(named, start=AXIS_SPEEDS.index("yaw_rate")))
        growths = {at: own.errors[at] / rest.errors[at] - 1.0 for at in names if rest.errors[at] > 0.0}
        grown = [at for at, growth in growths.items() if growth > THRESHOLDS.held_out_growth]
        for at in sorted(grown, key=lambda one: -growths[one]):
            by_chance = not certain_growth(own.by_part[:, [at]], rest.by_part[:, [at]])
            if not by_chance or own.errors[at] > noise_floors(self.parts, model).errors[at]:
                return f"the held-out error of {names[at]} is {100.0 * growths[at]:.0f} % larger"
        return ""
