"""What differs between two estimates of the same parameters, and how sure that is.

Each campaign says what it can by itself: values with their covariance, inflated where its innovations are not white.
Sharing what did not change is then a matter of these alone (classical minimum distance: Newey & McFadden 1994, section
2.2): as sharp as one likelihood of both, and right where either likelihood is too sure of itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.stats import chi2_sf
from rovid.diagnose.posterior import posterior_probability, stand_in_cap
from rovid.diagnose.thresholds import ESTABLISHED, POSSIBLE
from rovid.trial.assumptions import scales_with_thrust

THRUST_SCALE = "thrust_scale"
DRAG = "drag"
_DRAGS = ("quadratic_drag", "linear_drag")
# Of log-likelihood: what is worth so much less cannot be the change in place of another. One in twenty.
_TOLD = math.log(20.0)
# No more than so many changes are looked for.
_MOST = 6
# A change of a size that matters, as a share, if nothing else is said.
RELEVANT_CHANGE = 0.1
# Standard errors from zero from which on a number may be divided by.
_FROM_ZERO = 3.0
_FLAT = 1e-12
# Where innovations are not white few stretches tell how errors go together: of their correlations so much is believed,
# so that no combination of parameters passes for much surer than each of them.
_BELIEVED = 0.9


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatePair:
    """Two campaigns' estimates of the same parameters.

    Attributes
    ----------
    a, b
        (p,) values.
    covariance_a, covariance_b
        (p, p) of each.
    white
        Whether both models explain their data to the noise.
    samples
        Of both.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    a: FloatArray
    b: FloatArray
    covariance_a: FloatArray
    covariance_b: FloatArray
    white: bool
    samples: int

    @property
    def difference(self) -> FloatArray:
        """(p,) what B has more than A."""
        return self.b - self.a

    @property
    def covariance(self) -> FloatArray:
        """(p, p) of the difference."""
        return self.covariance_a + self.covariance_b

    @property
    def pooled(self) -> FloatArray:
        """(p,) size of each parameter, as both together have it."""
        each = [np.diag(self.covariance_a), np.diag(self.covariance_b)]
        one, other = (1.0 / np.maximum(variance, 1e-300) for variance in each)
        return np.asarray((one * self.a + other * self.b) / (one + other))


@dataclass(frozen=True, kw_only=True, eq=False)
class ChangeCandidate:
    """One thing that may have changed.

    Attributes
    ----------
    changes
        Names of the parameters that it moves.
    ways
        (p, k) how they go: along the columns, each as far as it likes.
    factor
        Whether it is one factor on all that it moves.
    inverse
        Whether what it is called by goes with one over that factor: with less thrust all that is measured by thrust
        looks larger.
    """

    name: str
    parameters: tuple[str, ...]
    directions: FloatArray
    is_factor: bool = True
    inverse: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterChange:
    """One thing that changed, or may have.

    Attributes
    ----------
    ratio, standard_error
        B over A of what it moves, with all shared that did not change; NaN where it is no factor.
    worth
        Log-likelihood gained, less the price of its parameters.
    confidence
        Probability that it, or one of those it cannot be told from, changed.
    undecided
        What may have changed in its place.
    """

    candidate: ChangeCandidate
    ratio: float
    standard_error: float
    bic_score: float
    confidence: float
    indistinguishable: tuple[ChangeCandidate, ...]

    @property
    def established(self) -> bool:
        """Whether it is a finding."""
        return self.confidence >= ESTABLISHED


@dataclass(frozen=True, kw_only=True, eq=False)
class DifferenceTest:
    """What changed between two campaigns, and what both say together.

    Attributes
    ----------
    found
        Established or possible, the surest first.
    sure
        Parameter -> probability that it changed.
    joint, joint_covariance
        (2p,) and (2p, 2p) of A, then of B, where both share what did not change.
    seen
        Candidate -> share by which it would have had to change to be established; of factors alone.
    chance
        Probability that what both share differs as much by chance.
    """

    pair: EstimatePair
    changes: tuple[ParameterChange, ...]
    probabilities: Mapping[str, float]
    joint: FloatArray
    joint_covariance: FloatArray
    detectable_changes: Mapping[str, float]
    p_value: float

    @property
    def established(self) -> tuple[ParameterChange, ...]:
        """Those that are findings."""
        return tuple(change for change in self.changes if change.established)

    def ratio(self, name: str) -> tuple[float, float] | None:
        """B over A of a parameter, each by itself, with its standard error; None where A cannot be told from zero."""
        at = self.pair.names.index(name)
        one, other = self.pair.a[at], self.pair.b[at]
        errors = math.sqrt(self.pair.covariance_a[at, at]), math.sqrt(self.pair.covariance_b[at, at])
        if not abs(one) > _FROM_ZERO * errors[0]:
            return None
        ratio = other / one
        return float(ratio), float(math.hypot(errors[1], ratio * errors[0]) / abs(one))

    def difference(self, name: str) -> tuple[float, float]:
        """B less A of a parameter, each by itself, and its standard error."""
        at = self.pair.names.index(name)
        return float(self.pair.difference[at]), float(math.sqrt(self.pair.covariance[at, at]))

    def parameter_ratio(
        self, first: str, second: str
    ) -> tuple[tuple[tuple[float, float], tuple[float, float]], tuple[float, float]] | None:
        """One parameter over another in A and in B, and the second of these over the first, with standard errors.

        None where either cannot be told from zero.
        """
        if not {first, second} <= set(self.pair.names):
            return None
        at = [self.pair.names.index(first), self.pair.names.index(second)]
        sides, shares = [], []
        for values, covariance in ((self.pair.a, self.pair.covariance_a), (self.pair.b, self.pair.covariance_b)):
            own, spread = values[at], covariance[np.ix_(at, at)]
            if not np.all(own > _FROM_ZERO * np.sqrt(np.diag(spread))):
                return None
            slope = np.array([1.0, -1.0]) / own
            share = math.sqrt(max(float(slope @ spread @ slope), 0.0))
            value = float(own[0] / own[1])
            sides.append((value, value * share))
            shares.append(share)
        over = sides[1][0] / sides[0][0]
        return (sides[0], sides[1]), (over, over * math.hypot(*shares))

    def joint_values(self, name: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """Value and standard error of a parameter in A and in B, where both share what did not change."""
        at, count = self.pair.names.index(name), len(self.pair.names)
        errors = np.sqrt(np.maximum(np.diag(self.joint_covariance), 0.0))
        return (
            (float(self.joint[at]), float(errors[at])),
            (float(self.joint[count + at]), float(errors[count + at])),
        )


def change_candidates(pair: EstimatePair, weak: Sequence[str] = (), other: str = "") -> list[ChangeCandidate]:
    """What may have changed: each parameter, all drag, all thrust, each cause.

    ``weak`` are keys of thrusters' gains among the parameters, and ``other`` is that of the one thruster without.
    """
    names, usual = pair.names, pair.pooled
    found = [_single(pair, name) for name in names if "." not in name]
    if set(_DRAGS) <= set(names):
        found.append(_together(DRAG, pair, _DRAGS, usual))
    torques = [name for name, unit in zip(names, pair.units, strict=True) if scales_with_thrust(unit)]
    if "inertia" in torques:
        found.append(replace(_together(THRUST_SCALE, pair, torques, usual), inverse=True))
        gains = [name for name in names if name.rpartition(".")[0] in weak]
        if other and gains:
            found.append(replace(_together(other, pair, [*torques, *gains], usual), inverse=True))
    for key in dict.fromkeys(name.rpartition(".")[0] for name in names if "." in name):
        own = tuple(name for name in names if name.rpartition(".")[0] == key)
        ways = np.array([[float(name == one) for one in own] for name in names])
        found.append(
            ChangeCandidate(name=key, parameters=own, directions=ways * _size(pair)[:, np.newaxis], is_factor=False)
        )
    return found


def _size(pair: EstimatePair) -> FloatArray:
    """(p,) of the error of the difference: units in which all directions are alike."""
    return np.asarray(np.sqrt(np.diag(pair.covariance)))


def _single(pair: EstimatePair, name: str) -> ChangeCandidate:
    return _together(name, pair, (name,), pair.pooled)


def _together(name: str, pair: EstimatePair, those: Sequence[str], usual: FloatArray) -> ChangeCandidate:
    way = np.where([one in those for one in pair.names], usual, 0.0)
    # What both take for nothing cannot change by a factor: by its error then.
    if not np.any(np.abs(way) > 0.0):
        way = np.where([one in those for one in pair.names], _size(pair), 0.0)
    return ChangeCandidate(name=name, parameters=tuple(those), directions=way[:, np.newaxis])


class _Search:
    """Forward selection of what changed; see `changes_of`."""

    def __init__(self, pair: EstimatePair, candidates: Sequence[ChangeCandidate]) -> None:
        self.pair, self.candidates = pair, candidates
        self._errors = [_believed(one, white=pair.white) for one in (pair.covariance_a, pair.covariance_b)]
        # Whitened: errors of the difference are then independent and of one size.
        size = _size(pair)
        values, vectors = np.linalg.eigh(sum(self._errors) / np.outer(size, size))
        self._whiten = (vectors / np.sqrt(np.maximum(values, _FLAT))).T / size
        self._z = self._whiten @ pair.difference
        self._price = 0.5 * math.log(max(pair.samples, 2))

    def gain(self, chosen: Sequence[ChangeCandidate]) -> float:
        """Log-likelihood gained over no change at all."""
        left = self._left(chosen)
        return 0.5 * float(self._z @ self._z - left @ left)

    def worth(self, chosen: Sequence[ChangeCandidate]) -> float:
        """The same less the price of what is free."""
        return self.gain(chosen) - self._price * self._free(chosen)

    def chance(self, chosen: Sequence[ChangeCandidate]) -> float:
        """Probability that what is left of the difference is as large by chance (chi-square)."""
        left, count = self._left(chosen), len(self._z) - self._free(chosen)
        return chi2_sf(count, float(left @ left)) if count else 1.0

    def _ways(self, chosen: Sequence[ChangeCandidate]) -> FloatArray:
        return np.column_stack([np.zeros((len(self._z), 0)), *(self._whiten @ one.directions for one in chosen)])

    def _free(self, chosen: Sequence[ChangeCandidate]) -> int:
        # Of what goes the same way as others together nothing more is free.
        return int(np.linalg.matrix_rank(self._ways(chosen), rtol=1e-9)) if chosen else 0

    def _left(self, chosen: Sequence[ChangeCandidate]) -> FloatArray:
        ways = self._ways(chosen)
        return np.asarray(self._z - ways @ np.linalg.lstsq(ways, self._z, rcond=None)[0]) if chosen else self._z

    def run(self) -> list[ChangeCandidate]:
        """What is worth its price, the best first."""
        chosen: list[ChangeCandidate] = []
        while len(chosen) < _MOST:
            rest = [one for one in self.candidates if one not in chosen]
            best = self.best(rest, chosen)
            if best is None or self.worth([*chosen, best]) <= self.worth(chosen):
                break
            chosen.append(best)
        # What a later one explains as well goes again.
        for one in chosen.copy():
            others = [other for other in chosen if other is not one]
            if self.worth(others) >= self.worth(chosen):
                chosen = others
        return chosen

    def best(self, rest: Sequence[ChangeCandidate], beside: Sequence[ChangeCandidate]) -> ChangeCandidate | None:
        """The likeliest of ``rest``; of those that come near to it the simplest, which stands first."""
        worths = [self.worth([*beside, one]) for one in rest]
        if not worths:
            return None
        top = max(worths)
        near = [one for one, worth in zip(rest, worths, strict=True) if worth > top - _TOLD]
        simple = [one for one in near if len(one.parameters) == 1 and one.is_factor]
        likeliest = rest[worths.index(top)]
        return simple[0] if simple and set(simple[0].parameters) <= set(likeliest.parameters) else likeliest

    def change(self, one: ChangeCandidate, chosen: Sequence[ChangeCandidate]) -> ParameterChange:
        """What is said of ``one``, which is chosen or may be."""
        beside = [other for other in chosen if other is not one]
        rest = [other for other in self.candidates if other not in beside]
        base = self.worth(beside)
        worths = {other.name: self.worth([*beside, other]) - base for other in rest}
        own = worths[one.name]
        near = [other for other in rest if other is not one and worths[other.name] > max(own - _TOLD, 0.0)]
        alike = [one.name, *(other.name for other in near)]
        gain = self.gain([*beside, one]) - self.gain(beside)
        most = stand_in_cap(gain, gain, white=self.pair.white)
        ratio, error = self._factor(one, beside)
        return ParameterChange(
            candidate=one,
            ratio=ratio,
            standard_error=error,
            bic_score=own,
            confidence=posterior_probability(worths, alike, len(self.candidates), cap=most),
            indistinguishable=tuple(near),
        )

    def _factor(self, one: ChangeCandidate, beside: Sequence[ChangeCandidate]) -> tuple[float, float]:
        """B over A of what goes by one factor, with its standard error, where both share all that is left."""
        if not one.is_factor:
            return math.nan, math.nan
        values, covariance = self.joint([*beside, one])
        in_a = int(np.flatnonzero(one.directions[:, 0])[0])
        pair = [in_a, in_a + len(self.pair.names)]
        a, b = values[pair]
        if not abs(a) > _FROM_ZERO * math.sqrt(covariance[in_a, in_a]):
            return math.nan, math.nan
        ratio = b / a
        slope = np.array([-ratio, 1.0]) / a
        error = math.sqrt(max(float(slope @ covariance[np.ix_(pair, pair)] @ slope), 0.0))
        return (1.0 / ratio, error / ratio**2) if one.inverse else (ratio, error)

    def seen(self, one: ChangeCandidate, chosen: Sequence[ChangeCandidate]) -> float:
        """Share by which ``one`` would have had to change to be established, beside what else did."""
        beside = [other for other in chosen if not set(other.parameters) & set(one.parameters)]
        ways = self._ways(beside)
        own = (self._whiten @ one.directions)[:, 0]
        if beside:
            own = own - ways @ np.linalg.lstsq(ways, own, rcond=None)[0]
        power = float(own @ own)
        return math.sqrt(2.0 * self._needed() / power) if power > _FLAT else math.inf

    def _needed(self) -> float:
        """Log-likelihood that a change has to gain to be established."""
        odds = math.log(len(self.candidates) * ESTABLISHED / (1.0 - ESTABLISHED)) + self._price
        low, high = odds, odds
        while stand_in_cap(high, high, white=self.pair.white) < ESTABLISHED:
            high += 1.0
        for _ in range(30):
            middle = 0.5 * (low + high)
            low, high = (
                (low, middle) if stand_in_cap(middle, middle, white=self.pair.white) >= ESTABLISHED else (middle, high)
            )
        return high

    def joint(self, chosen: Sequence[ChangeCandidate]) -> tuple[FloatArray, FloatArray]:
        """(2p,) values of A and of B, and their covariance, where both share what is not ``chosen``."""
        pair, count = self.pair, len(self.pair.names)
        size = _size(pair)
        ways = np.column_stack([np.zeros((count, 0)), *(one.directions for one in chosen)]) / size[:, np.newaxis]
        basis = _basis(ways)
        # A is what is shared, B that and the changes; both were measured.
        of_both = np.block([[np.eye(count), np.zeros(basis.shape)], [np.eye(count), basis]])
        scale = np.outer(size, size)
        weights = [np.linalg.pinv(one / scale, hermitian=True) for one in self._errors]
        weight = np.block([[weights[0], np.zeros_like(scale)], [np.zeros_like(scale), weights[1]]])
        spread = np.linalg.pinv(of_both.T @ weight @ of_both, hermitian=True)
        measured = np.concatenate((pair.a / size, pair.b / size))
        both = of_both @ (spread @ (of_both.T @ (weight @ measured)))
        twice = np.concatenate((size, size))
        return both * twice, (of_both @ spread @ of_both.T) * np.outer(twice, twice)


def _believed(covariance: FloatArray, *, white: bool) -> FloatArray:
    """(p, p) covariance with as much of its correlations as is believed."""
    return covariance if white else _BELIEVED * covariance + (1.0 - _BELIEVED) * np.diag(np.diag(covariance))


def _basis(ways: FloatArray) -> FloatArray:
    """(p, r) independent columns that span those of ``ways``."""
    if not ways.shape[1]:
        return ways
    vectors, values, _ = np.linalg.svd(ways, full_matrices=False)
    return np.asarray(vectors[:, values > 1e-9 * values.max()])


def test_difference(pair: EstimatePair, candidates: Sequence[ChangeCandidate]) -> DifferenceTest:
    """Name what changed, by as few changes as explain the difference.

    One is added after another while it is worth its price (Schwarz 1978), and what a later one explains as well goes
    again. Odds are those of a diagnosis: all that was tried shares them, and none is surer than what it gains bears.
    """
    search = _Search(pair, candidates)
    chosen = search.run()
    found = [search.change(one, chosen) for one in chosen]
    # What is not chosen may still have changed.
    rest = [one for one in candidates if one not in chosen]
    possible = [search.change(one, chosen) for one in rest]
    every = sorted((*found, *(one for one in possible if one.confidence >= POSSIBLE)), key=lambda one: -one.confidence)
    # With less thrust all else looks larger, and is as it was.
    own = [one for one in (*found, *possible) if not one.candidate.inverse]
    sure = {
        name: max((one.confidence for one in own if name in one.candidate.parameters), default=0.0)
        for name in pair.names
    }
    joint, covariance = search.joint(chosen)
    return DifferenceTest(
        pair=pair,
        changes=tuple(one for one in every if one.confidence >= POSSIBLE),
        probabilities=sure,
        joint=joint,
        joint_covariance=covariance,
        detectable_changes={one.name: search.seen(one, chosen) for one in candidates if one.is_factor},
        p_value=search.chance(chosen),
    )
