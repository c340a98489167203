"""Waves beside what predictions found: each next reading, which knows their phase, is asked for them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.diagnose.bic import fitted_together, is_plausible, quickly_climbed, worth
from rovid.diagnose.cross_validation import cross_validate, log_likelihood
from rovid.diagnose.posterior import ESTABLISHED, POSSIBLE, confidence, surest
from rovid.diagnose.splitting import Piece
from rovid.effects import Effect
from rovid.estimate.filter_data import Readings
from rovid.estimate.fit_result import Fitted
from rovid.estimate.innovation_likelihood import InnovationMisfit
from rovid.estimate.objective import UNLIMITED, Misfit
from rovid.estimate.parametrization import COMMON, DISTURBANCE, MEMORY

_FIRST_ITERATIONS, _ITERATIONS = 3, 20
_BEGUN = 3
# Sizes of the disturbance, of the torque in use, and memories in s, to begin with.
_SHARES, _MEMORIES = (0.01, 0.1, 1.0), (0.3, 4.0)


@dataclass(frozen=True, eq=False)
class Waves:
    """A model by the next reading without and with waves; what they gain there, and on pieces that were not fitted.

    ``fitted`` is None where waves gain nothing.
    """

    records: Readings
    plain: Fitted
    pieces: Sequence[Piece]
    fitted: Fitted | None = None
    gain: float = 0.0
    worth: float = 0.0

    @cached_property
    def held_out_gain(self) -> float:
        """What waves gain on pieces that were not fitted."""
        if self.fitted is None:
            return 0.0
        return self._held_out(self.fitted) - self._held_out(self.plain)

    def _held_out(self, fitted: Fitted) -> float:
        """Log-likelihood of the pieces, each by a fit to the others."""
        return log_likelihood(cross_validate(fitted, self.pieces))

    @cached_property
    def confidence(self) -> float:
        """Probability that there are such waves."""
        if self.fitted is None:
            return 0.0
        name = self.fitted.effects[-1].id
        # Holding out takes long, and makes nothing surer.
        sure = confidence({name: self.worth}, (name,), 1)
        if sure < POSSIBLE:
            return sure
        borne_out = min(self.worth, self.held_out_gain)
        return confidence({name: borne_out}, (name,), 1, most=surest(self.held_out_gain, self.worth, white=True))

    @property
    def likelier(self) -> Fitted:
        """With the waves where they are worth their parameters, else without."""
        if self.fitted is None or self.worth <= 0.0:
            return self.plain
        return self.fitted

    @property
    def established(self) -> Fitted | None:
        """With the waves, where they are established."""
        return self.fitted if self.confidence >= ESTABLISHED else None

    @property
    def passed_for(self) -> tuple[str, ...]:
        """Ids of causes that such waves pass for; none where the waves are not established."""
        return () if self.established is None else self.established.effects[-1].rivals


def look_for_waves(records: Readings, beside: Fitted, wave: Effect | None, pieces: Sequence[Piece]) -> Waves:
    """Look for ``wave`` beside the effects of a model that predictions found.

    Two kinds of disturbance are compared: one that fades, of any size, and that with waves besides.
    """
    plain = _without_waves(records, beside)
    if wave is None:
        return Waves(records, plain, pieces)
    with_waves = _with_waves(plain, wave)
    if not is_plausible(with_waves) or worth(with_waves) <= worth(plain):
        return Waves(records, plain, pieces)
    # Readings whose misfits are not white tell less than they seem to: no more than the stretches of time bear out.
    borne_out = min(worth(with_waves) - worth(plain), _borne_out(with_waves, plain))
    return Waves(records, plain, pieces, with_waves, plain.cost - with_waves.cost, borne_out)


def _without_waves(records: Readings, beside: Fitted) -> Fitted:
    """The model beside a disturbance as large as it likes: waves have to be more than that."""
    misfit = InnovationMisfit(records, UNLIMITED, beside.effects)
    begin = misfit.coordinates.first()
    other = np.r_[0:DISTURBANCE, COMMON : len(begin)]
    begin[other] = beside.x[other]
    return quickly_climbed(misfit, _disturbed(misfit, begin), _ITERATIONS)


def _with_waves(plain: Fitted, wave: Effect) -> Fitted:
    misfit = plain.misfit.like((*plain.effects, wave))
    begins = [np.concatenate((plain.x, start)) for start in misfit.coordinates.starts()]
    begun = misfit.likeliest(begins, _BEGUN)
    tried = fitted_together([misfit] * len(begun), lambda at: quickly_climbed(misfit, begun[at], _FIRST_ITERATIONS))
    best = min(tried, key=lambda fitted: fitted.cost)
    return quickly_climbed(misfit, best.x, _ITERATIONS)


def _disturbed(misfit: Misfit, x: FloatArray) -> FloatArray:
    """``x`` with the likeliest of a few disturbances: unlimited, a climb from one far too small goes astray."""
    pairs = itertools.product(_SHARES, _MEMORIES)
    begins = [_with_disturbance(misfit, x, share, memory) for share, memory in pairs]
    (likeliest,) = misfit.likeliest(begins, 1)
    return likeliest


def _with_disturbance(misfit: Misfit, x: FloatArray, share: float, memory: float) -> FloatArray:
    """``x`` with a disturbance of a ``share`` of the torque in use and a ``memory`` in s, within the bounds."""
    begin = x.copy()
    begin[DISTURBANCE] = math.log(share * misfit.records.torque)
    begin[MEMORY] = math.log(memory)
    return np.clip(begin, *misfit.coordinates.bounds)


def _borne_out(better: Fitted, plain: Fitted) -> float:
    """Log-likelihood of a gain in every stretch of time, by the scatter between them (Vuong 1989)."""
    block = plain.records.block
    gains = np.bincount(block, weights=plain.misfit.costs(plain.x) - better.misfit.costs(better.x))
    gains = gains[np.bincount(block) > 0]
    count = len(gains)
    spread = float(np.std(gains, ddof=1)) * math.sqrt(count) if count > 1 else math.inf
    away = float(gains.sum()) / max(spread, 1e-300)
    # As Student's distribution has it, for the scatter is known no better than the stretches are many.
    return math.copysign(0.5 * count * math.log1p(away**2 / count), away)
