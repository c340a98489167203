"""Waves beside what predictions found: each next reading, which knows their phase, is asked for them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.diagnose.bic import bic_score, fit_coarse, fit_in_parallel, is_plausible
from rovid.diagnose.cross_validation import cross_validate, held_out_log_likelihood
from rovid.diagnose.posterior import ESTABLISHED, POSSIBLE, posterior_probability, stand_in_cap
from rovid.diagnose.splitting import CvPiece
from rovid.effects import Effect
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.objective import UNLIMITED, NegativeLogLikelihood
from rovid.estimate.parametrization import COMMON, DISTURBANCE, MEMORY

_FIRST_ITERATIONS, _ITERATIONS = 3, 20
_BEGUN = 3
# Sizes of the disturbance, of the torque in use, and memories in s, to begin with.
_SHARES, _MEMORIES = (0.01, 0.1, 1.0), (0.3, 4.0)


@dataclass(frozen=True, eq=False)
class WaveTest:
    """A model by the next reading without and with waves; what they gain there, and on pieces that were not fitted.

    ``fitted`` is None where waves gain nothing.
    """

    records: InnovationData
    plain: FitResult
    pieces: Sequence[CvPiece]
    fitted: FitResult | None = None
    gain: float = 0.0
    worth: float = 0.0

    @cached_property
    def held_out_gain(self) -> float:
        """What waves gain on pieces that were not fitted."""
        if self.fitted is None:
            return 0.0
        return self._held_out(self.fitted) - self._held_out(self.plain)

    def _held_out(self, fitted: FitResult) -> float:
        """Log-likelihood of the pieces, each by a fit to the others."""
        return held_out_log_likelihood(cross_validate(fitted, self.pieces))

    @cached_property
    def confidence(self) -> float:
        """Probability that there are such waves."""
        if self.fitted is None:
            return 0.0
        name = self.fitted.effects[-1].id
        # Holding out takes long, and makes nothing surer.
        sure = posterior_probability({name: self.worth}, (name,), 1)
        if sure < POSSIBLE:
            return sure
        borne_out = min(self.worth, self.held_out_gain)
        return posterior_probability(
            {name: borne_out}, (name,), 1, cap=stand_in_cap(self.held_out_gain, self.worth, white=True)
        )

    @property
    def likelier(self) -> FitResult:
        """With the waves where they are worth their parameters, else without."""
        if self.fitted is None or self.worth <= 0.0:
            return self.plain
        return self.fitted

    @property
    def established(self) -> FitResult | None:
        """With the waves, where they are established."""
        return self.fitted if self.confidence >= ESTABLISHED else None

    @property
    def passed_for(self) -> tuple[str, ...]:
        """Ids of causes that such waves pass for; none where the waves are not established."""
        return () if self.established is None else self.established.effects[-1].rivals


def run_wave_test(
    records: InnovationData, beside: FitResult, wave: Effect | None, pieces: Sequence[CvPiece]
) -> WaveTest:
    """Look for ``wave`` beside the effects of a model that predictions found.

    Two kinds of disturbance are compared: one that fades, of any size, and that with waves besides.
    """
    plain = _without_waves(records, beside)
    if wave is None:
        return WaveTest(records, plain, pieces)
    with_waves = _with_waves(plain, wave)
    if not is_plausible(with_waves) or bic_score(with_waves) <= bic_score(plain):
        return WaveTest(records, plain, pieces)
    # Readings whose misfits are not white tell less than they seem to: no more than the stretches of time bear out.
    borne_out = min(bic_score(with_waves) - bic_score(plain), _borne_out(with_waves, plain))
    return WaveTest(records, plain, pieces, with_waves, plain.value - with_waves.value, borne_out)


def _without_waves(records: InnovationData, beside: FitResult) -> FitResult:
    """The model beside a disturbance as large as it likes: waves have to be more than that."""
    misfit = InnovationLikelihood(records, UNLIMITED, beside.effects)
    begin = misfit.parametrization.initial()
    other = np.r_[0:DISTURBANCE, COMMON : len(begin)]
    begin[other] = beside.x[other]
    return fit_coarse(misfit, _disturbed(misfit, begin), _ITERATIONS)


def _with_waves(plain: FitResult, wave: Effect) -> FitResult:
    misfit = plain.objective.with_effects((*plain.effects, wave))
    begins = [np.concatenate((plain.x, start)) for start in misfit.parametrization.initial_values()]
    begun = misfit.most_likely(begins, _BEGUN)
    tried = fit_in_parallel([misfit] * len(begun), lambda at: fit_coarse(misfit, begun[at], _FIRST_ITERATIONS))
    best = min(tried, key=lambda fitted: fitted.value)
    return fit_coarse(misfit, best.x, _ITERATIONS)


def _disturbed(misfit: NegativeLogLikelihood, x: FloatArray) -> FloatArray:
    """``x`` with the likeliest of a few disturbances: unlimited, a climb from one far too small goes astray."""
    pairs = itertools.product(_SHARES, _MEMORIES)
    begins = [_with_disturbance(misfit, x, share, memory) for share, memory in pairs]
    (likeliest,) = misfit.most_likely(begins, 1)
    return likeliest


def _with_disturbance(misfit: NegativeLogLikelihood, x: FloatArray, share: float, memory: float) -> FloatArray:
    """``x`` with a disturbance of a ``share`` of the torque in use and a ``memory`` in s, within the bounds."""
    begin = x.copy()
    begin[DISTURBANCE] = math.log(share * misfit.data.rms_torque)
    begin[MEMORY] = math.log(memory)
    return np.clip(begin, *misfit.parametrization.bounds)


def _borne_out(better: FitResult, plain: FitResult) -> float:
    """Log-likelihood of a gain in every stretch of time, by the scatter between them (Vuong 1989)."""
    block = plain.data.block_index
    gains = np.bincount(
        block, weights=plain.objective.contributions(plain.x) - better.objective.contributions(better.x)
    )
    gains = gains[np.bincount(block) > 0]
    count = len(gains)
    spread = float(np.std(gains, ddof=1)) * math.sqrt(count) if count > 1 else math.inf
    away = float(gains.sum()) / max(spread, 1e-300)
    # As Student's distribution has it, for the scatter is known no better than the stretches are many.
    return math.copysign(0.5 * count * math.log1p(away**2 / count), away)
