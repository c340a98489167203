"""Estimates of the same parameters in two campaigns, and tests of their difference.

Each campaign contributes its own estimate with its covariance, which is inflated if its innovations are not white.
Parameters that did not change are shared by classical minimum distance (Newey and McFadden 1994, section 2.2). This is
as precise as a joint likelihood, and still valid if a likelihood understates its errors.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.stats import chi2_sf
from rovid.diagnose.evidence import Evidence, grade, posterior_probability, probability_not_a_stand_in
from rovid.diagnose.thresholds import ESTABLISHED, POSSIBLE
from rovid.trial.assumptions import scales_with_thrust

THRUST_SCALE = "thrust_scale"
DRAG = "drag"
_DRAGS = ("quadratic_drag", "linear_drag")


@dataclass(frozen=True, kw_only=True, eq=False)
class EstimatePair:
    """Estimates of the same parameters in campaigns A and B."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    a: FloatArray  # (p,) values
    b: FloatArray
    covariance_a: FloatArray  # (p, p)
    covariance_b: FloatArray
    white: bool  # Whether the innovations of both models are white
    samples: int  # Number of samples of both campaigns

    @property
    def covariance(self) -> FloatArray:
        """(p, p) covariance of the difference."""
        return self.covariance_a + self.covariance_b

    @property
    def errors(self) -> FloatArray:
        """(p,) standard errors of the difference, which scale all computations."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def pooled(self) -> FloatArray:
        """(p,) inverse-variance weighted mean of A and B."""
        variances = [np.diag(self.covariance_a), np.diag(self.covariance_b)]
        weight_a, weight_b = (1.0 / np.maximum(variance, 1e-300) for variance in variances)
        return np.asarray((weight_a * self.a + weight_b * self.b) / (weight_a + weight_b))


@dataclass(frozen=True, kw_only=True, eq=False)
class ChangeCandidate:
    """A possible change."""

    name: str
    parameters: tuple[str, ...]  # Names of the parameters it affects
    directions: FloatArray  # (p, k) columns that span the change of the parameters
    is_factor: bool = True  # Whether all its parameters change by one factor
    # Whether it changes by the inverse factor: with less thrust all parameters relative to thrust seem larger
    inverse: bool = False


def change_candidates(
    pair: EstimatePair, weak_thrusters: Sequence[str] = (), remaining_thruster: str = ""
) -> list[ChangeCandidate]:
    """Possible changes: of each parameter, of all drag together, of all thrust together, and of each cause.

    ``weak_thrusters`` are keys of thruster gains among the parameters; ``remaining_thruster`` has no gain.
    """
    names = pair.names
    candidates = [_factor(pair, name, (name,)) for name in names if "." not in name]
    if set(_DRAGS) <= set(names):
        candidates.append(_factor(pair, DRAG, _DRAGS))
    torques = [name for name, unit in zip(names, pair.units, strict=True) if scales_with_thrust(unit)]
    if "inertia" in torques:
        candidates.append(replace(_factor(pair, THRUST_SCALE, torques), inverse=True))
        gains = [name for name in names if name.rpartition(".")[0] in weak_thrusters]
        if remaining_thruster and gains:
            candidates.append(replace(_factor(pair, remaining_thruster, [*torques, *gains]), inverse=True))
    for key in dict.fromkeys(name.rpartition(".")[0] for name in names if "." in name):
        own = tuple(name for name in names if name.rpartition(".")[0] == key)
        directions = np.array([[float(name == parameter) for parameter in own] for name in names])
        directions *= pair.errors[:, np.newaxis]
        candidates.append(ChangeCandidate(name=key, parameters=own, directions=directions, is_factor=False))
    return candidates


def _factor(pair: EstimatePair, name: str, parameters: Sequence[str]) -> ChangeCandidate:
    """A change of the ``parameters`` by one factor."""
    affected = [parameter in parameters for parameter in pair.names]
    direction = np.where(affected, pair.pooled, 0.0)
    # Parameters that are zero in both campaigns cannot change by a factor. The error is the step then.
    if not np.any(np.abs(direction) > 0.0):
        direction = np.where(affected, pair.errors, 0.0)
    return ChangeCandidate(name=name, parameters=tuple(parameters), directions=direction[:, np.newaxis])


# Log-likelihood ratio beyond which an alternative is ruled out: 1 in 20; a decision.
_RULED_OUT = math.log(20.0)
# Maximum number of changes.
_MOST_CHANGES = 6
RELEVANT_CHANGE = 0.1  # Relative change of a parameter that is relevant by default.
# Standard errors from zero above which a parameter may be a divisor.
_FROM_ZERO = 3.0
# Smallest eigenvalue of the scaled covariance.
_TINY = 1e-12
# Share of the estimated correlations that is used if the innovations are not white. Few independent data then determine
# the correlations, and no combination of parameters should seem much more precise than each parameter.
_CORRELATION_SHARE = 0.9


@dataclass(frozen=True, kw_only=True, eq=False)
class ParameterChange:
    """An established or possible change."""

    candidate: ChangeCandidate
    ratio: float  #: B over A if all unchanged parameters are shared; NaN unless the change is a factor.
    standard_error: float
    bic_score: float  #: Gain in log-likelihood minus the BIC penalty.
    standard_errors: float  #: Size of the change.
    confidence: float  #: Probability that this change, or one that is indistinguishable from it, occurred.
    indistinguishable: tuple[ChangeCandidate, ...]  #: Changes that explain the difference about as well.
    white: bool  #: Whether the one-step prediction errors of both campaigns are white.

    @property
    def established(self) -> bool:
        """Whether the probability suffices for a finding."""
        return self.confidence >= ESTABLISHED

    @property
    def evidence(self) -> Evidence:
        """Evidence for the change; of several indistinguishable ones, none is confirmed."""
        decided = not self.indistinguishable
        # Each campaign was fitted without the other.
        return grade(self.confidence, self.bic_score, self.standard_errors, white=self.white, is_conclusive=decided)


@dataclass(frozen=True, kw_only=True, eq=False)
class DifferenceTest:
    """Changes between two campaigns and the joint estimate."""

    pair: EstimatePair
    changes: tuple[ParameterChange, ...]  # Established and possible changes, the most probable first
    probabilities: Mapping[str, float]  # Parameter -> probability that it changed
    joint: FloatArray  # (2p,) of A, then of B, with all unchanged parameters shared
    joint_covariance: FloatArray
    detectable_changes: Mapping[str, float]  # Factor -> smallest relative change that would have been established
    p_value: float  # Probability of a larger remaining difference by chance

    @property
    def established(self) -> tuple[ParameterChange, ...]:
        """The findings."""
        return tuple(change for change in self.changes if change.established)

    def ratio(self, name: str) -> tuple[float, float] | None:
        """B over A of a parameter with its standard error; None if A is not significantly different from zero.

        The ratio of a parameter that changed is that of the change, with all unchanged parameters shared.
        """
        for change in self.changes:
            factor = change.candidate.is_factor and not change.candidate.inverse
            if factor and change.candidate.parameters == (name,) and math.isfinite(change.ratio):
                return change.ratio, change.standard_error
        (a, error_a), (b, error_b) = self.separate_values(name)
        if not abs(a) > _FROM_ZERO * error_a:
            return None
        return b / a, math.hypot(error_b, b / a * error_a) / abs(a)

    def separate_values(self, name: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """Estimate of a parameter in A and in B, each campaign by itself, with standard errors."""
        pair, at = self.pair, self.pair.names.index(name)
        errors = [math.sqrt(covariance[at, at]) for covariance in (pair.covariance_a, pair.covariance_b)]
        return (float(pair.a[at]), errors[0]), (float(pair.b[at]), errors[1])

    def difference(self, name: str) -> tuple[float, float]:
        """B minus A of a parameter with its standard error."""
        at = self.pair.names.index(name)
        return float(self.pair.b[at] - self.pair.a[at]), float(math.sqrt(self.pair.covariance[at, at]))

    def inertia_over(
        self, drag: str
    ) -> tuple[tuple[tuple[float, float], tuple[float, float]], tuple[float, float]] | None:
        """Inertia over a drag in A and in B, and B's ratio over A's, with standard errors.

        None if one of the two is missing or not significantly larger than zero.
        """
        pair = self.pair
        if not {"inertia", drag} <= set(pair.names):
            return None
        at = [pair.names.index("inertia"), pair.names.index(drag)]
        ratios, relative_errors = [], []
        for values, covariance in ((pair.a, pair.covariance_a), (pair.b, pair.covariance_b)):
            both, both_covariance = values[at], covariance[np.ix_(at, at)]
            if not np.all(both > _FROM_ZERO * np.sqrt(np.diag(both_covariance))):
                return None
            gradient = np.array([1.0, -1.0]) / both
            relative_error = math.sqrt(max(float(gradient @ both_covariance @ gradient), 0.0))
            ratio = float(both[0] / both[1])
            ratios.append((ratio, ratio * relative_error))
            relative_errors.append(relative_error)
        over = ratios[1][0] / ratios[0][0]
        return (ratios[0], ratios[1]), (over, over * math.hypot(*relative_errors))

    def joint_values(self, name: str) -> tuple[tuple[float, float], tuple[float, float]]:
        """Joint estimate of a parameter in A and in B, with standard errors."""
        in_a = self.pair.names.index(name)
        in_b = in_a + len(self.pair.names)
        errors = np.sqrt(np.maximum(np.diag(self.joint_covariance), 0.0))
        return (float(self.joint[in_a]), float(errors[in_a])), (float(self.joint[in_b]), float(errors[in_b]))


class _Selection:
    """Forward selection of changes by BIC; see `find_changes`."""

    def __init__(self, pair: EstimatePair, candidates: Sequence[ChangeCandidate]) -> None:
        self.pair, self.candidates = pair, candidates
        share = 1.0 if pair.white else _CORRELATION_SHARE
        both = (pair.covariance_a, pair.covariance_b)
        self._covariances = [share * each + (1.0 - share) * np.diag(np.diag(each)) for each in both]
        # Whitening transform of the difference.
        values, vectors = np.linalg.eigh(sum(self._covariances) / np.outer(pair.errors, pair.errors))
        self._whiten = (vectors / np.sqrt(np.maximum(values, _TINY))).T / pair.errors
        self._z = self._whiten @ (pair.b - pair.a)
        self._penalty = 0.5 * math.log(max(pair.samples, 2))
        self._gains: dict[tuple[ChangeCandidate, ...], tuple[float, int]] = {}

    def bic_score(self, chosen: Sequence[ChangeCandidate]) -> float:
        """Gain minus the BIC penalty."""
        gain, count = self._gain_and_count(chosen)
        return gain - self._penalty * count

    def _gain_and_count(self, chosen: Sequence[ChangeCandidate]) -> tuple[float, int]:
        """Gain in log-likelihood over no change, and free parameters. Linearly dependent directions count once."""
        key = tuple(chosen)
        if key not in self._gains:
            residual = self._residual(chosen)
            count = int(np.linalg.matrix_rank(self._directions(chosen), rtol=1e-9)) if chosen else 0
            self._gains[key] = 0.5 * float(self._z @ self._z - residual @ residual), count
        return self._gains[key]

    def p_value(self, chosen: Sequence[ChangeCandidate]) -> float:
        """Probability of a larger residual by chance (chi-square test)."""
        residual, dof = self._residual(chosen), len(self._z) - self._gain_and_count(chosen)[1]
        return chi2_sf(dof, float(residual @ residual)) if dof else 1.0

    def _directions(self, chosen: Sequence[ChangeCandidate]) -> FloatArray:
        return np.column_stack([self._whiten @ candidate.directions for candidate in chosen])

    def _residual(self, chosen: Sequence[ChangeCandidate]) -> FloatArray:
        return self._project_out(self._directions(chosen), self._z) if chosen else self._z

    def _project_out(self, directions: FloatArray, vector: FloatArray) -> FloatArray:
        return np.asarray(vector - directions @ np.linalg.lstsq(directions, vector, rcond=None)[0])

    def run(self) -> list[ChangeCandidate]:
        """Add the best change while the BIC score grows, then drop changes that later ones made unnecessary."""
        chosen: list[ChangeCandidate] = []
        while len(chosen) < _MOST_CHANGES:
            left = [one for one in self.candidates if one not in chosen]
            best = self._best(left, chosen) if left else None
            if best is None or self.bic_score([*chosen, best]) <= self.bic_score(chosen):
                break
            chosen.append(best)
        for candidate in chosen.copy():
            others = [other for other in chosen if other is not candidate]
            if self.bic_score(others) >= self.bic_score(chosen):
                chosen = others
        causes = [candidate for candidate in chosen if not candidate.is_factor]
        count = len(chosen) - len(causes)
        if count > 1 and any(candidate.inverse for candidate in chosen):
            # Inertia and drag that change by two factors would else be named as thrust and one of them.
            own = [candidate for candidate in self.candidates if candidate.is_factor and not candidate.inverse]
            swap = max(itertools.combinations(own, count), key=lambda one: self.bic_score([*one, *causes]), default=())
            if swap and self.bic_score([*swap, *causes]) > self.bic_score(chosen) - _RULED_OUT:
                return [*swap, *causes]
        return chosen

    def _best(self, candidates: Sequence[ChangeCandidate], chosen: Sequence[ChangeCandidate]) -> ChangeCandidate:
        """The candidate with the best score, or a single parameter of it with a similar score."""
        scores = [self.bic_score([*chosen, candidate]) for candidate in candidates]
        best = candidates[scores.index(max(scores))]
        for candidate, score in zip(candidates, scores, strict=True):
            if score > max(scores) - _RULED_OUT and len(candidate.parameters) == 1 and candidate.is_factor:
                return candidate if set(candidate.parameters) <= set(best.parameters) else best
        return best

    def assess(self, candidate: ChangeCandidate, chosen: Sequence[ChangeCandidate]) -> ParameterChange:
        """Size and probability of a change, given the other chosen changes."""
        others = [other for other in chosen if other is not candidate]
        rest = [other for other in self.candidates if other not in others]
        base = self.bic_score(others)
        scores = {other.name: self.bic_score([*others, other]) - base for other in rest}
        score = scores[candidate.name]
        limit = max(score - _RULED_OUT, 0.0)
        similar = [other for other in rest if other is not candidate and scores[other.name] > limit]
        equivalent = [candidate.name, *(other.name for other in similar)]
        gain = self._gain_and_count([*others, candidate])[0] - self._gain_and_count(others)[0]
        cap = probability_not_a_stand_in(gain, gain, white=self.pair.white)
        ratio, error = self._ratio(candidate, others)
        return ParameterChange(
            candidate=candidate,
            ratio=ratio,
            standard_error=error,
            bic_score=score,
            # The test is of Gaussian estimates: twice the gain is the square of the distance in standard errors.
            standard_errors=math.sqrt(2.0 * max(gain, 0.0)),
            confidence=posterior_probability(scores, equivalent, len(self.candidates), cap=cap),
            indistinguishable=tuple(similar),
            white=self.pair.white,
        )

    def _ratio(self, candidate: ChangeCandidate, others: Sequence[ChangeCandidate]) -> tuple[float, float]:
        """B over A of a factor with its standard error, with all unchanged parameters shared."""
        if not candidate.is_factor:
            return math.nan, math.nan
        values, covariance = self.joint([*others, candidate])
        at = [in_a := int(np.flatnonzero(candidate.directions[:, 0])[0]), in_a + len(self.pair.names)]
        a, b = values[at]
        if not abs(a) > _FROM_ZERO * math.sqrt(covariance[in_a, in_a]):
            return math.nan, math.nan
        ratio = b / a
        gradient = np.array([-ratio, 1.0]) / a
        error = math.sqrt(max(float(gradient @ covariance[np.ix_(at, at)] @ gradient), 0.0))
        return (1.0 / ratio, error / ratio**2) if candidate.inverse else (ratio, error)

    def detectable_change(self, candidate: ChangeCandidate, chosen: Sequence[ChangeCandidate]) -> float:
        """Smallest relative change of ``candidate`` that would be established, given the other chosen changes."""
        others = [other for other in chosen if not set(other.parameters) & set(candidate.parameters)]
        direction = (self._whiten @ candidate.directions)[:, 0]
        if others:
            direction = self._project_out(self._directions(others), direction)
        power = float(direction @ direction)
        # The gain in log-likelihood that establishes a change.
        prior = math.log(len(self.candidates) * ESTABLISHED / (1.0 - ESTABLISHED)) + self._penalty
        low, high = prior, prior
        while probability_not_a_stand_in(high, high, white=self.pair.white) < ESTABLISHED:
            high += 1.0
        for _ in range(30):
            middle = 0.5 * (low + high)
            if probability_not_a_stand_in(middle, middle, white=self.pair.white) >= ESTABLISHED:
                high = middle
            else:
                low = middle
        return math.sqrt(2.0 * high / power) if power > _TINY else math.inf

    def joint(self, chosen: Sequence[ChangeCandidate]) -> tuple[FloatArray, FloatArray]:
        """(2p,) values of A and B and their covariance, with all parameters shared that are not ``chosen``."""
        from scipy.linalg import block_diag, orth

        pair, count, scale = self.pair, len(self.pair.names), self.pair.errors
        directions = [candidate.directions / scale[:, np.newaxis] for candidate in chosen]
        basis = orth(np.column_stack(directions), rcond=1e-9) if chosen else np.zeros((count, 0))
        # A is the shared part, B the shared part plus the changes.
        design = np.block([[np.eye(count), np.zeros(basis.shape)], [np.eye(count), basis]])
        scales = np.outer(scale, scale)
        weight = block_diag(*(np.linalg.pinv(one / scales, hermitian=True) for one in self._covariances))
        covariance = np.linalg.pinv(design.T @ weight @ design, hermitian=True)
        measured = np.concatenate((pair.a / scale, pair.b / scale))
        values = design @ (covariance @ (design.T @ (weight @ measured)))
        twice = np.tile(scale, 2)
        return values * twice, (design @ covariance @ design.T) * np.outer(twice, twice)


def find_changes(pair: EstimatePair, candidates: Sequence[ChangeCandidate]) -> DifferenceTest:
    """Explain the difference by as few changes as possible.

    Changes are selected forward by BIC (Schwarz 1978). Their probabilities are computed as in a diagnosis: all
    candidates share the prior, and the gain in log-likelihood limits the probability.
    """
    selection = _Selection(pair, candidates)
    chosen = selection.run()
    # Candidates that were not chosen may still have changed.
    others = [candidate for candidate in candidates if candidate not in chosen]
    assessed = [selection.assess(candidate, chosen) for candidate in (*chosen, *others)]
    by_probability = sorted(assessed, key=lambda change: -change.confidence)
    probabilities = dict.fromkeys(pair.names, 0.0)
    for change in assessed:
        # Less thrust makes other parameters seem larger, but they did not change.
        if not change.candidate.inverse:
            for name in change.candidate.parameters:
                probabilities[name] = max(probabilities[name], change.confidence)
    joint, covariance = selection.joint(chosen)
    return DifferenceTest(
        pair=pair,
        changes=tuple(change for change in by_probability if change.confidence >= POSSIBLE),
        probabilities=probabilities,
        joint=joint,
        joint_covariance=covariance,
        detectable_changes={one.name: selection.detectable_change(one, chosen) for one in candidates if one.is_factor},
        p_value=selection.p_value(chosen),
    )
