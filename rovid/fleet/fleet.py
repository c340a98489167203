"""All campaigns together: what each says, by vehicle and in the order of time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from rovid.campaign.axis import axis_named
from rovid.fleet.record import Record
from rovid.model.names import base_names


@dataclass(frozen=True)
class Value:
    """A parameter in one campaign; the standard error is NaN where it is not known."""

    value: float
    error: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """The records of all campaigns, by name."""

    axis: str
    records: tuple[Record, ...]

    @cached_property
    def values(self) -> Mapping[str, Mapping[str, Value]]:
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
    def vehicles(self) -> Mapping[str, tuple[Record, ...]]:
        """Vehicle -> its campaigns in the order of time, those without a date last; what failed is of no vehicle."""
        done = sorted(self.done, key=lambda one: (one.start is None, one.start or 0.0, one.campaign))
        names = sorted({one.vehicle or "" for one in done})
        return {name: tuple(one for one in done if (one.vehicle or "") == name) for name in names}

    @property
    def done(self) -> tuple[Record, ...]:
        """The campaigns that were diagnosed."""
        return tuple(record for record in self.records if record.diagnosis is not None)

    @property
    def failed(self) -> tuple[Record, ...]:
        """The others."""
        return tuple(record for record in self.records if record.diagnosis is None)


def causes(record: Record, kind: str) -> list[str]:
    """Ids of the "findings" or the "suspects" of a campaign."""
    return [] if record.diagnosis is None else [str(one["effect"]) for one in record.diagnosis[kind]]


def verdict(record: Record) -> str | None:
    """The diagnosis in a word; None where there is none."""
    return None if record.diagnosis is None else str(record.diagnosis["verdict"])


def _values(record: Record) -> Mapping[str, Value]:
    diagnosis = record.diagnosis or {}
    side = diagnosis.get("extended") or diagnosis.get("base") or {"parameters": {}}
    found = side["parameters"].items()
    return {name: Value(one["value"], _error(one), one["unit"]) for name, one in found if one["value"] is not None}


def _error(one: Mapping[str, float | None]) -> float:
    error = one["standard_error"]
    return math.nan if error is None else error
