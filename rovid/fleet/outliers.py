"""Campaigns that are not like the rest of the fleet, by a rule that one bad campaign cannot bend."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.fleet.campaign_record import CampaignRecord
from rovid.fleet.results import UNLIKE, Fleet, ParameterValue

# Campaigns that have the parameter; of fewer none is told from the rest.
LEAST = 5
# Robust standard deviations; Iglewicz and Hoaglin (1993) take as many.
LIMIT = 3.5
# A normal scatter's standard deviation over the median of its distances.
_NORMAL = 1.4826
RULE = (
    f"Out of line is a campaign whose parameter lies more than {LIMIT:g} times √(S² + s²) from the fleet's median: S "
    f"is {_NORMAL} times the median distance from it, s the campaign's own standard error. Parameters positive "
    f"throughout are compared by their logarithms. At least {LEAST} campaigns have to have the parameter. Vehicles "
    f"whose medians differ by more than a factor of {UNLIKE:g} are no sisters: each is compared with itself."
)


@dataclass(frozen=True, kw_only=True)
class Outlier:
    """A parameter that is out of line; ``distance`` in the rule's units, signed."""

    campaign: str
    vehicle: str
    name: str
    value: ParameterValue
    median: float
    distance: float


def outliers(fleet: Fleet) -> list[Outlier]:
    """All of them, the farthest first."""
    found = [one for name in fleet.parameters for one in _of(fleet, name)]
    return sorted(found, key=lambda one: (-abs(one.distance), one.campaign, one.name))


def _of(fleet: Fleet, name: str) -> list[Outlier]:
    groups = [[pair for pair in known if pair[1].is_comparable] for known in fleet.campaigns_with(name).values()]
    if not fleet.dissimilar_medians(name):
        groups = [list(itertools.chain.from_iterable(groups))]
    return [one for there in groups for one in _among(there, name)]


def _among(there: Sequence[tuple[CampaignRecord, ParameterValue]], name: str) -> list[Outlier]:
    if len(there) < LEAST:
        return []
    values = np.array([one.value for _, one in there])
    errors = np.array([one.error for _, one in there])
    median = float(np.median(values))
    if (values > 0.0).all():
        values, errors = np.log(values), errors / values
    apart = values - np.median(values)
    scatter = _NORMAL * float(np.median(np.abs(apart)))
    distances = apart / np.sqrt(scatter**2 + errors**2)
    return [
        Outlier(
            campaign=record.campaign,
            vehicle=record.vehicle or "",
            name=name,
            value=one,
            median=median,
            distance=float(distance),
        )
        for (record, one), distance in zip(there, distances, strict=True)
        if abs(distance) > LIMIT
    ]
