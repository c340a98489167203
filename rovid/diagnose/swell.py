"""Each next reading beside what predictions show: it knows the phase of waves, and is right under feedback."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rovid.diagnose.heldout import cross_validate, log_likelihood
from rovid.diagnose.odds import ESTABLISHED, POSSIBLE, confidence
from rovid.diagnose.parts import Piece
from rovid.diagnose.search import Fitted, worth
from rovid.effects import Effect
from rovid.identify.innovations import BASE, DISTURBANCE, Likelihood, Records
from rovid.identify.likelihood import covariance, physical, starts
from rovid.trial import FloatArray

# The plain disturbance may be as large as it likes: waves have to be more than that.
_UNLIMITED = 1.0
_FIRST_ITERATIONS, _ITERATIONS, _TOLERANCE = 3, 20, 0.1
_BEGUN = 3
# What shrinks to less than this share, by more than so many standard errors, is no longer the same cause.
_SHRUNK, _APART = 0.7, 2.0


@dataclass(frozen=True, eq=False)
class Swell:
    """A model by the next reading without and with waves; what they gain there, and on pieces that were not fitted.

    ``fitted`` is None where waves gain nothing.
    """

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
        waves, none = (log_likelihood(cross_validate(fitted, self.pieces)) for fitted in (self.fitted, self.plain))
        return waves - none

    @cached_property
    def confidence(self) -> float:
        """Probability that there are such waves."""
        if self.fitted is None:
            return 0.0
        name = self.fitted.effects[-1].id
        # Holding out takes long, and makes nothing surer.
        sure = confidence({name: self.worth}, (name,), 1)
        return sure if sure < POSSIBLE else confidence({name: min(self.worth, self.held_out_gain)}, (name,), 1)

    @property
    def likelier(self) -> Fitted:
        """With the waves where they are worth their parameters, else without."""
        return self.plain if self.fitted is None or self.worth <= 0.0 else self.fitted

    @property
    def passed_for(self) -> tuple[str, ...]:
        """Ids of causes that such waves pass for; none where the waves are not established."""
        return self.fitted.effects[-1].rivals if self.fitted and self.confidence >= ESTABLISHED else ()


def swell(records: Records, beside: Fitted, wave: Effect | None, pieces: Sequence[Piece]) -> Swell:
    """Look for ``wave`` beside the effects of a model that predictions found.

    Two kinds of disturbance are compared: one that fades, of any size, and that with waves besides.
    """
    likelihood = Likelihood(records, _UNLIMITED, beside.effects)
    begin = likelihood.first()
    other = np.r_[0:DISTURBANCE, BASE : len(begin)]
    begin[other] = beside.x[other]
    plain = _climbed(likelihood, begin, _ITERATIONS)
    if wave is None:
        return Swell(plain, pieces)
    wavy = likelihood.like((*beside.effects, wave))
    begins = sorted((np.concatenate((plain.x, start)) for start in starts(wave)), key=wavy.cost)[:_BEGUN]
    tried = [_climbed(wavy, begin, _FIRST_ITERATIONS) for begin in begins]
    found = _climbed(wavy, min(tried, key=lambda fitted: fitted.cost).x, _ITERATIONS)
    if not found.plausible or worth(found) <= worth(plain):
        return Swell(plain, pieces)
    # Readings whose misfits are not white tell less than they seem to: no more than the stretches of time bear out.
    borne_out = min(worth(found) - worth(plain), _borne_out(found, plain))
    return Swell(plain, pieces, found, plain.cost - found.cost, borne_out)


def one_size(found: Fitted, near: Fitted, effect: Effect) -> bool:
    """Whether ``effect`` of ``found``, by predictions, is as large in ``near``, by each next reading beside waves.

    A cause that acts has one size. Under feedback a model may predict better some time ahead with what does not act:
    commands that answer waves go against what the waves do. The next reading is free of that (Ljung 1999, section 13.4)
    and finds less.
    """
    if effect not in near.effects:
        likelihood = near.likelihood.like((*near.effects, effect))
        near = _climbed(likelihood, np.concatenate((near.x, found.own(effect))), _ITERATIONS)
    (ahead, error), (here, other) = (_size(fitted, effect) for fitted in (found, near))
    if effect.canonical is not None:
        # Turned by half a cycle a negative amplitude is a positive one.
        ahead, here = abs(ahead), abs(here)
    here = math.copysign(1.0, ahead) * here
    return here >= _SHRUNK * abs(ahead) or abs(ahead) - here <= _APART * math.hypot(error, other)


def _size(fitted: Fitted, effect: Effect) -> tuple[float, float]:
    """How far the first parameter of ``effect`` is from nothing, and its standard error."""
    size = effect.parameters[0]
    at = fitted.likelihood.model(fitted.x).names.index(f"{effect.key}.{size.name}")
    error = math.sqrt(covariance(fitted.likelihood, fitted.x, sandwich=True)[at, at])
    value = float(physical(fitted.likelihood, fitted.x)[at])
    # The inverse of an endless null is the quantity that is nothing at nothing.
    if size.endless:
        return 1.0 / value, error / value**2
    return value - size.null * fitted.likelihood.records.scales.of(size), error


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
