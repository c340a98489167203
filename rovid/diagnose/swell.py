"""A torque of waves beside what predictions show: they know nothing of its phase, the next reading does."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.diagnose.heldout import cross_validate, log_likelihood
from rovid.diagnose.odds import ESTABLISHED, confidence
from rovid.diagnose.parts import Piece
from rovid.diagnose.search import Fitted, worth
from rovid.effects import Effect
from rovid.identify.innovations import BASE, DISTURBANCE, Likelihood, Records
from rovid.identify.likelihood import starts
from rovid.trial import FloatArray

# The plain disturbance may be as large as it likes: waves have to be more than that.
_UNLIMITED = 1.0
_FIRST_ITERATIONS, _ITERATIONS, _TOLERANCE = 3, 20, 0.1
_BEGUN = 3


@dataclass(frozen=True, eq=False)
class Swell:
    """A model with waves, fitted by the next reading; what they gain there, and on pieces that were not fitted."""

    fitted: Fitted
    gain: float
    worth: float
    held_out_gain: float

    @property
    def confidence(self) -> float:
        """Probability that there are such waves."""
        name = self.fitted.effects[-1].id
        return confidence({name: min(self.worth, self.held_out_gain)}, (name,))

    @property
    def passed_for(self) -> tuple[str, ...]:
        """Ids of causes that such waves pass for; none where the waves are not established."""
        return self.fitted.effects[-1].rivals if self.confidence >= ESTABLISHED else ()


def swell(records: Records, beside: Fitted, wave: Effect, pieces: Sequence[Piece]) -> Swell | None:
    """Look for ``wave`` beside the effects of a model that predictions found; None where it gains nothing.

    Two kinds of disturbance are compared: one that fades, of any size, and that with waves besides.
    """
    likelihood = Likelihood(records, _UNLIMITED, beside.effects)
    begin = likelihood.first()
    other = np.r_[0:DISTURBANCE, BASE : len(begin)]
    begin[other] = beside.x[other]
    plain = _climbed(likelihood, begin, _ITERATIONS)
    wavy = likelihood.like((*beside.effects, wave))
    begins = sorted((np.concatenate((plain.x, start)) for start in starts(wave)), key=wavy.cost)[:_BEGUN]
    tried = [_climbed(wavy, begin, _FIRST_ITERATIONS) for begin in begins]
    found = _climbed(wavy, min(tried, key=lambda fitted: fitted.cost).x, _ITERATIONS)
    if not found.plausible or worth(found) <= worth(plain):
        return None
    held_out = (log_likelihood(cross_validate(fitted, pieces)) for fitted in (found, plain))
    gained = next(held_out) - next(held_out)
    # Readings whose misfits are not white tell less than they seem to: no more than the stretches of time bear out.
    return Swell(
        found,
        plain.cost - found.cost,
        min(worth(found) - worth(plain), _borne_out(found, plain)),
        gained,
    )


def _climbed(likelihood: Likelihood, x: FloatArray, iterations: int) -> Fitted:
    return Fitted(likelihood, *likelihood.climb(x, iterations=iterations, tolerance=_TOLERANCE))


def _borne_out(better: Fitted, plain: Fitted) -> float:
    """Log-likelihood of a gain in every stretch of time, by the scatter between them (Vuong 1989)."""
    block = plain.likelihood.records.block
    pieces = (fitted.likelihood.pieces(*fitted.likelihood.innovations(fitted.x)) for fitted in (plain, better))
    gains = np.bincount(block, weights=next(pieces) - next(pieces))
    gains = gains[np.bincount(block) > 0]
    spread = float(np.std(gains, ddof=1)) * math.sqrt(len(gains)) if len(gains) > 1 else math.inf
    away = float(gains.sum()) / max(spread, 1e-300)
    # As Student's distribution has it, for the scatter is known no better than the stretches are many.
    return math.copysign(0.5 * len(gains) * math.log1p(away**2 / len(gains)), away)
