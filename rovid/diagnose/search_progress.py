"""What a stepwise search has seen, and why it ended early."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from rovid.estimate.objective import ModelKey


class SearchStop(enum.Enum):
    """Why a search ended before its model no longer changed."""

    ADEQUATE = enum.auto()  # `StepwiseSearch.is_adequate`; of the last run alone
    HOPELESS = enum.auto()  # `StepwiseSearch.is_hopeless`
    CUT_SHORT = enum.auto()  # `THRESHOLDS.max_screenings`, or `THRESHOLDS.max_effects` rounds without an end
    OUT_OF_TIME = enum.auto()  # `StepwiseSearch.budget`


@dataclass(eq=False)
class SearchProgress:
    """Models that a search has seen, and why it ended early."""

    exchanged: set[ModelKey] = field(default_factory=set)  # models that an exchange replaced
    screened: set[ModelKey] = field(default_factory=set)  # models with fitted extensions
    stops: set[SearchStop] = field(default_factory=set)
