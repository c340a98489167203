"""What one simulator makes of the subject: its file, and the equation of motion that the file is put into there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rovid.core.array_types import FloatArray

# A target's own equation of motion, stepped as the target steps it: (n, k) commands and the time in s that each is
# held -> (n,) yaw rate in rad/s at the start of each, from rest, positive as rovid's.
TargetSimulator = Callable[[FloatArray, float], FloatArray]


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportResult:
    """What one simulator makes of the subject.

    Attributes
    ----------
    content
        The file.
    plant
        The equation that the file's numbers are put into over there.
    holds
        Keys of the effects that are in the file and act there.
    misses
        (what, why) of the base model that the equation cannot hold.
    notes
        What was assumed, and what the reader has to know.
    """

    content: str | bytes
    simulate: TargetSimulator
    kept_effects: frozenset[str]
    base_losses: tuple[tuple[str, str], ...] = ()
    notes: tuple[str, ...] = ()
