"""Search for causes in the planar model: candidates, score tests, fits of candidates, stepwise selection, challenge.

A candidate is fitted by the chord method: the Jacobian of the model that it extends is kept, gets a column for each new
parameter, and is corrected by Broyden's update after each step. A fit then takes some ten passes of the filter instead
of some ten for each parameter. Every fit begins at the model that it extends, and never ends less likely.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.budget import Budget
from rovid.core.errors import DataError
from rovid.core.threads import thread_map
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import PLANAR_FORMS, Effect
from rovid.effects.base import SensorPlace, WaterCurrent
from rovid.estimate.fisher_information import inverse_information
from rovid.planar.dataset import PlanarData
from rovid.planar.effect_fits import add_effect
from rovid.planar.optimum import (
    Linearisation,
    PlanarOptimum,
    change_between,
    chord_fit,
    coordinates_without,
    neutral_values,
    residual_of,
)

# Share of the way from the neutral value to an initial value at which a score test takes its difference quotient.
_PROBE = 0.05
# Most steps with a complete Jacobian, after a chord fit that is kept.
_POLISH = 20
# Best forms of the first screens, whose causes later screens test.
_HOPEFUL = 10
# Starts of a current: speeds in RMS speeds ahead, and number of directions.
_SPEEDS, _DIRECTIONS = (0.1, 0.3, 0.7, 1.2), 8
# Forms of one cause, and causes, that are fitted after a screening.
_FORMS, _CAUSES = 2, 4
# Share of the best gain from which fits are compared after complete steps, and most of these fits.
_CLOSE, _POLISHED = 0.25, 3
# Least share of the best predicted gain for a fit. Score tests are good to a factor of a few.
_SHARE = 0.1

Key = frozenset[str]


@dataclass(frozen=True, eq=False)
class PlanarScoreTest:
    """Predicted gain of one form next to a model, by the score test (Rao 1948)."""

    effect: Effect
    gain: float  #: Nats.
    start: FloatArray  #: (k,) initial values of a fit, in units of the scales.
    detectable: float  #: Smallest distance of the first size from its neutral value that a search would add, SI.


@dataclass(eq=False)
class PlanarSearch:
    """Stepwise selection of causes by BIC, with all fits remembered."""

    data: PlanarData
    base: PlanarOptimum
    candidates: tuple[Effect, ...]
    budget: Budget
    banned: set[str] = field(default_factory=set)
    #: Effect keys -> fit; the best form of an exchanged cause has a key of its own.
    fits: dict[Key, PlanarOptimum] = field(default_factory=dict)
    _hopeful: set[str] | None = None
    _polished: set[Key] = field(default_factory=set)
    _lines: dict[Key, Linearisation] = field(default_factory=dict)
    _tests: dict[Key, list[PlanarScoreTest]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.remember(self.base)
        self._polished.add(_key(self.base.effects))

    def remember(self, fitted: PlanarOptimum) -> PlanarOptimum:
        """Remember a fit in place of an earlier one of the same model."""
        key = _key(fitted.effects)
        self.fits[key] = fitted
        self._polished.discard(key)
        if key == _key(self.base.effects):
            self.base = fitted
        return fitted

    def causes(self, fitted: PlanarOptimum) -> tuple[Effect, ...]:
        """Effects of a model beyond those of the base model."""
        return fitted.effects[len(self.base.effects) :]

    @property
    def causes_tried(self) -> int:
        """Number of different effects among the candidates."""
        return len({effect.id for effect in self.candidates})

    @property
    def penalty(self) -> float:
        """BIC penalty of one parameter in nats (Schwarz 1978)."""
        return 0.5 * math.log(max(float(self.base.likelihood.grid.used.sum()), 1.0))

    @property
    def threshold(self) -> float:
        """BIC gain in nats that a further cause needs."""
        return THRESHOLDS.bic_margin + math.log(max(self.causes_tried, 1))

    def score(self, fitted: PlanarOptimum) -> float:
        """Log-likelihood less the BIC penalty of all parameters of effects."""
        return -fitted.value - self.penalty * sum(len(effect.parameters) for effect in self.causes(fitted))

    def line(self, fitted: PlanarOptimum) -> Linearisation:
        """Linearisation of a model; the last few are remembered."""
        key = _key(fitted.effects)
        known = self._lines.get(key)
        if known is None or known.optimum is not fitted:
            while len(self._lines) > 3:
                del self._lines[next(iter(self._lines))]
            known = self._lines[key] = Linearisation.of(fitted)
        return known

    def is_usable(self, fitted: PlanarOptimum) -> bool:
        """Whether the criterion has derivatives at a model, so that the search can go on from it."""
        try:
            self.line(fitted)
        except DataError:
            return False
        return True

    # --- Screening ----------------------------------------------------------------------------------------------------

    def screen(self, fitted: PlanarOptimum) -> list[PlanarScoreTest]:
        """Score tests of all candidates next to a model, the largest predicted gain first."""
        key = _key(fitted.effects)
        if key not in self._tests:
            line = self.line(fitted)
            taken = {effect.id for effect in fitted.effects}
            forms = [one for one in self.candidates if one.id not in taken and one.key not in self.banned]
            if self._hopeful is not None:
                forms = [one for one in forms if one.id in self._hopeful]
            information = line.matrix.T @ line.matrix
            inverse = inverse_information(information)
            gradient = line.matrix.T @ residual_of(line.innovations)
            found = thread_map(lambda form: self._test(line, form, inverse, gradient), forms)
            tests = [test for test in found if test is not None]
            self._tests[key] = sorted(tests, key=lambda test: -test.gain)
            if self._hopeful is None and len(self.causes(fitted)) == 1:
                # Later screens leave out what is promising neither alone nor next to the first cause.
                first = [self._tests.get(_key(self.base.effects), []), self._tests[key]]
                self._hopeful = {test.effect.id for tests in first for test in tests[:_HOPEFUL]}
        return [test for test in self._tests[key] if test.effect.key not in self.banned]

    def _test(
        self, line: Linearisation, effect: Effect, inverse: FloatArray, gradient: FloatArray
    ) -> PlanarScoreTest | None:
        likelihood = line.optimum.likelihood.with_coordinates(line.optimum.coordinates.with_effect(effect))
        at, residual = line.optimum.coordinates.noise_begin, residual_of(line.innovations)
        best: PlanarScoreTest | None = None
        for start in effect.initial_values[: 2 if isinstance(effect.acts, WaterCurrent) else None]:
            neutral = neutral_values(effect, start)
            step = next((p.step for p in effect.parameters if p.piecewise_constant), _PROBE)
            share = max(step, _PROBE) if step <= 1e-2 else 1.0
            columns, sizes = [], []
            for number in range(effect.size_count):
                own = neutral.copy()
                own[number] += share * (start[number] - neutral[number])
                point = np.concatenate((line.optimum.x[:at], own, line.optimum.x[at:]))
                columns.append(change_between(line.innovations, likelihood.evaluate(point)) / share)
                sizes.append(start[number] - neutral[number])
            matrix = np.column_stack(columns)
            with np.errstate(over="ignore", invalid="ignore"):
                cross = line.matrix.T @ matrix
                score = matrix.T @ residual - cross.T @ (inverse @ gradient)
                power = matrix.T @ matrix - cross.T @ inverse @ cross
            power[np.diag_indices_from(power)] *= 1.0 + 1e-9
            if not (np.isfinite(power).all() and np.isfinite(score).all()):
                continue  # The filter diverges at the model or next to this start.
            shift = -np.linalg.lstsq(power, score, rcond=1e-12)[0]
            gain = -0.5 * float(score @ shift)
            if not gain > (best.gain if best else -math.inf):
                continue
            begin = neutral.copy()
            begin[: len(sizes)] += np.array(sizes) * np.clip(shift, -5.0, 5.0)
            low, high = np.array([(one.low, one.high) for one in effect.parameters]).T
            needed = 2.0 * (self.threshold + self.penalty * len(start))
            unit = line.optimum.coordinates.sizes.effects.unit_size(effect.parameters[0])
            least = abs(sizes[0]) * math.sqrt(needed / max(float(power[0, 0]), 1e-300)) * unit
            best = PlanarScoreTest(effect, gain, np.clip(begin, low, high), least)
        return best

    # --- Fits ---------------------------------------------------------------------------------------------------------

    def extended(self, fitted: PlanarOptimum, test: PlanarScoreTest) -> PlanarOptimum:
        """The best fit of a model with one more effect."""
        key = _key((*fitted.effects, test.effect))
        if key not in self.fits:
            self.fits[key] = self._extend(fitted, test)
        return self.fits[key]

    def _extend(self, fitted: PlanarOptimum, test: PlanarScoreTest) -> PlanarOptimum:
        if isinstance((effect := test.effect).acts, WaterCurrent):
            return self._with_current(fitted, test)
        if isinstance(effect.acts, SensorPlace):
            return add_effect(fitted, effect, self.data)
        coordinates, at = fitted.coordinates.with_effect(effect), fitted.coordinates.noise_begin
        likelihood, line = fitted.likelihood.with_coordinates(coordinates), self.line(fitted)

        def point(own: FloatArray) -> FloatArray:
            return coordinates.projected(np.concatenate((fitted.x[:at], own, fitted.x[at:])))

        neutral = neutral_values(effect, test.start)
        starts = [*(neutral + share * (test.start - neutral) for share in (1.0, 0.3, 0.1)), *effect.initial_values]
        values = likelihood.values([point(one) for one in starts])
        start = point(starts[int(np.argmin(values))])
        begin = start[at : at + len(effect.parameters)]
        # Derivatives by the form's parameters at the start, those of the other parameters at the model.
        here = likelihood.evaluate(start)
        steps = coordinates.steps(start)
        columns = []
        for number in range(at, at + len(begin)):
            size = max(float(steps[number]), 1e-3 * max(abs(float(start[number])), 1e-3))
            size = -size if start[number] + size > coordinates.high[number] else size
            ahead = likelihood.evaluate(start + size * (np.arange(len(start)) == number))
            columns.append(change_between(here, ahead) / size)
        matrix = np.hstack((line.matrix[:, :at], np.column_stack(columns), line.matrix[:, at:]))
        best = chord_fit(likelihood, start, matrix)
        if best.value < fitted.value + THRESHOLDS.search_tolerance:
            return best
        # Never less likely than the nested model.
        nested = point(neutral)
        value = likelihood.value(nested)
        return best if best.value <= value else PlanarOptimum(likelihood, nested, value)

    def _with_current(self, fitted: PlanarOptimum, test: PlanarScoreTest) -> PlanarOptimum:
        """The fit with a current, which may change the speeds much: with the Jacobian at its start."""
        effect, at = test.effect, fitted.coordinates.noise_begin
        if isinstance(effect.acts, WaterCurrent) and effect.acts.wanders:
            plain = next(one for one in PLANAR_FORMS if isinstance(one.acts, WaterCurrent) and not one.acts.wanders)
            nested = self.extended(fitted, replace(test, effect=plain, start=test.start[:2]))
            own = nested.x[at : at + 2]
            starts = [np.array([*own, size, time]) for size in (0.0, 0.02, 0.1, 0.3) for time in (5.0, 40.0)]
            fitted, rest = nested, np.delete(nested.x, [at, at + 1])
        else:
            turns = 2.0 * math.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
            circles = [np.array([speed, turn]) for speed in _SPEEDS for turn in turns.tolist()]
            starts, rest = [np.zeros(2), test.start, *circles], fitted.x
        coordinates = self.base.coordinates
        for one in (*(one for one in self.causes(fitted) if one.id != effect.id), effect):
            coordinates = coordinates.with_effect(one)
        likelihood = fitted.likelihood.with_coordinates(coordinates)
        points = [coordinates.projected(np.concatenate((rest[:at], own, rest[at:]))) for own in starts]
        values = likelihood.values(points)
        begin = PlanarOptimum(likelihood, points[int(np.argmin(values))], min(values))
        try:
            return chord_fit(likelihood, begin.x, Linearisation.of(begin).matrix)
        except DataError:
            # Next to this start the filter diverges: the candidate stays without a current.
            return PlanarOptimum(likelihood, points[0], values[0])

    def without(self, fitted: PlanarOptimum, effect: Effect) -> PlanarOptimum:
        """The fit of a model without one of its effects, no less likely than that model with the effect left out."""
        coordinates, x, columns = coordinates_without(fitted, effect)
        key, x = _key(coordinates.effects), coordinates.projected(x)
        likelihood, known = fitted.likelihood.with_coordinates(coordinates), self.fits.get(key)
        if known is None or likelihood.value(x) < known.value - THRESHOLDS.search_tolerance:
            self._tests.pop(key, None)
            known = self.remember(chord_fit(likelihood, x, self.line(fitted).matrix[:, columns].copy()))
        return known

    def polish(self, fitted: PlanarOptimum) -> PlanarOptimum:
        """The model after some steps with complete Jacobians."""
        key = _key(fitted.effects)
        if key not in self._polished or self.fits.get(key) is not fitted:
            self.remember(PlanarOptimum.fit(fitted.likelihood, fitted.x, _POLISH))
            self._polished.add(key)
        return self.fits[key]

    # --- Selection ----------------------------------------------------------------------------------------------------

    def extensions(self, fitted: PlanarOptimum, *, needed: float | None = None) -> list[PlanarOptimum]:
        """Fits of the most promising causes next to a model, the best score first."""
        tests = self.screen(fitted)
        groups: dict[str, list[PlanarScoreTest]] = {}
        for test in tests:
            least = THRESHOLDS.screening_share * (self.penalty * len(test.effect.parameters) + self.threshold)
            if needed is not None:
                least = THRESHOLDS.challenger_share * needed
            # Forms that act alike in these logs have the same gain: one is enough.
            alike = any(math.isclose(test.gain, one.gain, rel_tol=1e-6) for one in groups.get(test.effect.id, ()))
            if test.gain >= max(least, _SHARE * tests[0].gain) and not alike:
                groups.setdefault(test.effect.id, []).append(test)
        found, since = [], self.budget.clock()
        # A place that rovid.toml lacks is tried first: causes imitate it.
        chosen = sorted(groups.values(), key=lambda group: not isinstance(group[0].effect.acts, SensorPlace))[:_CAUSES]
        for done, group in enumerate(chosen):
            if self.budget.skips(group[0].effect.id):
                continue
            self.budget.tell("Fitting", done, len(chosen), since)
            forms = [test for test in group if not getattr(test.effect.acts, "wanders", False)]
            found += [self.extended(fitted, test) for test in forms[:_FORMS]]
        found = [one for one in found if not self.is_unresolved(one)]
        wandering = [test for test in tests if getattr(test.effect.acts, "wanders", False)]
        best = max(found, key=self.score, default=fitted)
        # A current wanders only where a constant one explains most.
        if wandering and self.causes(best) and best.effects[-1].id == wandering[0].effect.id:
            found.append(self.extended(fitted, wandering[0]))
        # A chord fit may end early where an effect changes much: the best ones are compared after complete steps.
        found.sort(key=lambda one: -self.score(one))
        least = self.score(fitted) + _CLOSE * (self.score(found[0]) - self.score(fitted)) if found else math.inf
        close = [one for one in found if self.score(one) > max(least, self.score(fitted))]
        if len(close) > 1:
            found = [*map(self.polish, close[:_POLISHED]), *(one for one in found if one not in close[:_POLISHED])]
        return sorted(found, key=lambda one: -self.score(one))

    def is_unresolved(self, fitted: PlanarOptimum) -> bool:
        """Whether the last effect is a time below the usual interval of the logs, which they do not resolve."""
        size, value = fitted.effects[-1].parameters[0], fitted.model.value(fitted.effects[-1].parameter_names[0])
        return size.unit == "s" and 0.0 < value < min(float(np.median(np.diff(run.time))) for run in self.data.runs)

    def run(self, start: PlanarOptimum) -> PlanarOptimum:
        """Add and remove causes from ``start`` on, until the model no longer changes."""
        model = start
        for _ in range(THRESHOLDS.max_effects):
            if len(self.causes(model)) >= THRESHOLDS.max_effects or self.budget.skips("more effects"):
                break
            better = next(filter(self.is_usable, self.extensions(model)), None)
            if better is None or self.score(better) - self.score(model) < self.allowance(model):
                break
            model = self.eliminated(self.polish(better))
        return model

    def allowance(self, model: PlanarOptimum) -> float:
        """Gain that a further cause needs: the threshold, and what approximate equations of the others may explain."""
        own = THRESHOLDS.misspecification_share * (self.score(model) - self.score(self.base))
        return max(self.threshold, min(own, THRESHOLDS.misspecification_cap))

    def eliminated(self, model: PlanarOptimum) -> PlanarOptimum:
        """The model without causes that lost their gain."""
        while causes := self.causes(model):
            weakest = max(causes, key=lambda one: self.score(self.without(model, one)))
            rest = self.without(model, weakest)
            if self.score(model) - self.score(rest) >= self.threshold:
                break
            model = self.polish(rest)
        return model

    # --- Challenge ----------------------------------------------------------------------------------------------------

    def challenged(self, model: PlanarOptimum) -> PlanarOptimum:
        """The model, or a better set of causes in its place; see `rovid.diagnose.selection`."""
        for _ in range(THRESHOLDS.max_challenges):
            if not self.causes(model) or self.budget.skips("the final challenge"):
                break
            better = []
            for one in self._rivals(model):
                further = self.threshold * max(len(one.effects) - len(model.effects), 0)
                needed = self.score(model) + further + THRESHOLDS.exchange_gain
                if self.score(one) > needed and not self.is_banned(one):
                    better.append(one)
            best = next(filter(self.is_usable, sorted(better, key=self.score, reverse=True)), None)
            if best is None:
                break
            model = self.run(self.eliminated(self.polish(best)))
        return model

    def _rivals(self, model: PlanarOptimum) -> Iterator[PlanarOptimum]:
        own = _key(model.effects)
        singles = self.extensions(self.base)
        yield from (one for one in singles if _key(one.effects) != own)
        best = [one for one in singles if self.causes(one) and self.is_usable(one)][:3]
        for first, second in combinations(best, 2):
            if first.effects[-1].id == second.effects[-1].id or self.budget.is_late:
                continue
            test = next((t for t in self.screen(first) if t.effect.key == second.effects[-1].key), None)
            if test is not None and _key((*first.effects, test.effect)) != own:
                yield self.extended(first, test)
        for effect in self.causes(model):
            rest = self.without(model, effect)
            if self.causes(rest):
                yield rest
            yield from self.replacements(model, effect)

    def replacements(self, model: PlanarOptimum, effect: Effect) -> list[PlanarOptimum]:
        """Fits with another cause in the place of ``effect``, the best score first."""
        rest = self.without(model, effect)
        found = self.extensions(rest, needed=rest.value - model.value)
        return [one for one in found if _key(one.effects) != _key(model.effects)]

    def is_banned(self, fitted: PlanarOptimum) -> bool:
        """Whether a model has a banned effect."""
        return any(effect.key in self.banned for effect in fitted.effects)


def _key(effects: Sequence[Effect]) -> Key:
    return frozenset(effect.key for effect in effects)
