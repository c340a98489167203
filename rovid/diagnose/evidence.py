"""Evidence for a cause in four words, by its gain on held-out trials and its size in standard errors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum

from rovid.diagnose.thresholds import ESTABLISHED, THRESHOLDS


class Evidence(StrEnum):
    """How well the logs support a cause, the best first."""

    CONFIRMED = "confirmed"
    LIKELY = "likely"
    POSSIBLE = "possible"


# What people read where the logs do not decide between causes, or decide nothing.
CANNOT_TELL = "cannot tell"


def confirming_gain(*, white: bool) -> float:
    """Held-out gain in nats at which a stand-in is `THRESHOLDS.confirmed_odds` times rarer than a true cause."""
    scale = THRESHOLDS.stand_in_scale_white if white else THRESHOLDS.stand_in_scale
    return THRESHOLDS.stand_in_gain + scale * math.log(THRESHOLDS.confirmed_odds)


def grade(
    probability: float, held_out_gain: float, standard_errors: float, *, white: bool, is_conclusive: bool = True
) -> Evidence:
    """Evidence for a cause.

    Parameters
    ----------
    probability
        That the cause, or one that cannot be told from it, acts.
    held_out_gain
        Log-likelihood gain on trials that were not fitted, in nats.
    standard_errors
        Distance of the size from its value without the effect.
    white
        Whether the one-step prediction errors are white.
    is_conclusive
        Whether the search came to its end, and no other cause explains the logs as well.
    """
    established = probability >= ESTABLISHED
    is_far = standard_errors >= THRESHOLDS.confirmed_standard_errors
    if established and is_conclusive and is_far and held_out_gain >= confirming_gain(white=white):
        return Evidence.CONFIRMED
    if probability >= THRESHOLDS.likely and standard_errors >= THRESHOLDS.likely_standard_errors:
        return Evidence.LIKELY
    return Evidence.POSSIBLE


# One sentence for each word that people read.
DEFINITIONS: Mapping[str, str] = {
    Evidence.CONFIRMED.value: (
        f"The cause is established, its size is {THRESHOLDS.confirmed_standard_errors:.0f} standard errors or more "
        f"from nothing, and its gain on trials that were not fitted is {confirming_gain(white=False):.0f} nats or more "
        f"({confirming_gain(white=True):.0f} if the one-step prediction errors are white)."
    ),
    Evidence.LIKELY.value: (
        "The cause is more probable than not, and its size is "
        f"{THRESHOLDS.likely_standard_errors:.0f} standard errors or more from nothing."
    ),
    Evidence.POSSIBLE.value: "The cause may act, but chance or another effect may look the same.",
    CANNOT_TELL: "Several causes explain these logs equally well, or the logs decide nothing.",
}
