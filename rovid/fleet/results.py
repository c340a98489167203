"""All campaigns together: what each says, by vehicle and in the order of time."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from rovid.fleet.campaign_record import CampaignRecord
from rovid.model.parameter_names import base_names
from rovid.trial.axis import axis_named

# Vehicles whose medians differ by more than this factor are no sisters.
UNLIKE = 3.0


@dataclass(frozen=True)
class ParameterValue:
    """A parameter in one campaign.

    Attributes
    ----------
    error
        Standard error; NaN where it is not known.
    placeholder
        Whether it hangs on a guessed arm or thrust curve, and compares with no other.
    """

    value: float
    error: float
    unit: str
    placeholder: bool = False

    @property
    def is_comparable(self) -> bool:
        """Whether it can be held against another campaign's."""
        return self.error > 0.0 and not self.placeholder


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """The records of all campaigns, by name."""

    axis: str
    records: tuple[CampaignRecord, ...]

    @cached_property
    def values(self) -> Mapping[str, Mapping[str, ParameterValue]]:
        """Campaign -> parameter -> what its last model says: that with the causes found, or the plain one."""
        return {record.campaign: _values(record) for record in self.records}

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Every parameter of any campaign: the plain model's first, then those of causes by name."""
        known = {name for values in self.values.values() for name in values}
        plain = [name for name in base_names(axis_named(self.axis)) if name in known]
        return (*plain, *sorted(known.difference(plain)))

    @cached_property
    def units(self) -> Mapping[str, str]:
        """Parameter -> its unit, where all campaigns have the same; else nothing."""
        units: dict[str, str] = {}
        for values in self.values.values():
            for name, one in values.items():
                units[name] = one.unit if units.setdefault(name, one.unit) == one.unit else ""
        return units

    @cached_property
    def vehicles(self) -> Mapping[str, tuple[CampaignRecord, ...]]:
        """Vehicle -> its campaigns in the order of time, those without a date last; no vehicle has what failed."""
        done = sorted(self.done, key=lambda one: (one.start is None, one.start or 0.0, one.campaign))
        names = sorted({one.vehicle or "" for one in done}, key=_counted)
        return {name: tuple(one for one in done if (one.vehicle or "") == name) for name in names}

    def campaigns_with(self, name: str) -> Mapping[str, list[tuple[CampaignRecord, ParameterValue]]]:
        """Vehicle -> its campaigns that have the parameter, in the order of time."""
        groups = {}
        for vehicle, records in self.vehicles.items():
            known = [(record, one) for record in records if (one := self.values[record.campaign].get(name)) is not None]
            if known:
                groups[vehicle] = known
        return groups

    def dissimilar_medians(self, name: str) -> Mapping[str, float]:
        """Vehicle -> its median, where these are so far apart that the vehicles are no sisters; else nothing."""
        every = {vehicle: [one for _, one in known] for vehicle, known in self.campaigns_with(name).items()}
        medians = {vehicle: median_of(values) for vehicle, values in every.items()}
        sizes = [abs(median) for median in medians.values()]
        return medians if sizes and min(sizes) > 0.0 and max(sizes) > UNLIKE * min(sizes) else {}

    @property
    def done(self) -> tuple[CampaignRecord, ...]:
        """The campaigns that were diagnosed."""
        return tuple(record for record in self.records if record.diagnosis is not None)

    @property
    def failed(self) -> tuple[CampaignRecord, ...]:
        """The others."""
        return tuple(record for record in self.records if record.diagnosis is None)


def median_of(values: Iterable[ParameterValue]) -> float:
    """Of those that compare with other campaigns, or of all where none does; there are some."""
    known = list(values)
    return statistics.median(one.value for one in [one for one in known if one.is_comparable] or known)


def causes(record: CampaignRecord, kind: str) -> list[str]:
    """Ids of the "findings" or the "suspects" of a campaign."""
    return [] if record.diagnosis is None else [str(one["effect"]) for one in record.diagnosis[kind]]


def verdict(record: CampaignRecord) -> str | None:
    """The diagnosis in a word; None where there is none."""
    return None if record.diagnosis is None else str(record.diagnosis["verdict"])


def guessed(record: CampaignRecord) -> list[str]:
    """What of the vehicle `rovid init` made up, by name."""
    return [] if record.diagnosis is None else list(record.diagnosis["guessed"])


def _counted(name: str) -> list[tuple[int, str]]:
    """By what names are sorted, their numbers as numbers: 2 before 10."""
    return [(int(part), "") if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", name)]


def _values(record: CampaignRecord) -> Mapping[str, ParameterValue]:
    diagnosis = record.diagnosis or {}
    side = diagnosis.get("extended") or diagnosis.get("base") or {"parameters": {}}
    return {name: _value(one) for name, one in side["parameters"].items() if one["value"] is not None}


def _value(one: Mapping[str, Any]) -> ParameterValue:
    error = math.nan if one["standard_error"] is None else one["standard_error"]
    return ParameterValue(one["value"], error, one["unit"], one.get("placeholder", False))
