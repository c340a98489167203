"""A fault of the logs: the record that every reader, result and screen shares."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from rovid.core.errors import shortened_list
from rovid.trial.log_files import is_called

if TYPE_CHECKING:  # numpy takes long to import.
    from rovid.core.array_types import FloatArray

# Ids of all faults, in the order in which they are listed; the files of `rovid.faults` have these names.
FAULT_IDS = (
    "wild_stamp", "arrival_bursts", "repeated_stamps", "clock_step", "lost_rows", "two_sources", "saturated_sensor",
    "absent_zero", "sentinel_command", "stale_commands", "heading_gaps", "heading_step", "position_step",
    "clocks_apart", "several_releases", "idle_ends", "same_run_twice", "unit_mismatch", "scaled_heading",
    "no_response", "foreign_log", "thrust_unit",
)  # fmt: skip
# The only difference between two sentences on the same fault of two logs.
_NUMBER = re.compile(r"[-+]?\d[\d.,]*(?:e[-+]?\d+)?")

Remedy = Literal["cut", "left_out", "unknown", "zero", "counted_once", "set_aside", "none"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Excerpt:
    """The signal around the spot of a fault, for a plot."""

    quantity: str  #: Name of the signal.
    unit: str  #: Its unit; empty where unknown.
    time: FloatArray  #: (n,) s from the beginning of the log.
    values: FloatArray  #: (n,) in ``unit``, as logged.

    @property
    def label(self) -> str:
        """Quantity and unit of ``displayed``."""
        unit = self.unit.replace("rad", "deg")
        return f"{self.quantity}, {unit}" if unit else self.quantity

    @property
    def displayed(self) -> FloatArray:
        """(n,) values in the unit that people read: degrees instead of radians."""
        return self.values * (180.0 / math.pi) if self.unit.startswith("rad") else self.values


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault of one log or of several, and its remedy."""

    fault: str  #: Id in the catalogue `rovid.faults.base`.
    logs: tuple[str, ...]  #: Names of the logs.
    text: str  #: Sentences for people: which log, when, how large, and the remedy that was applied.
    at: tuple[float, ...] = ()  #: s from the beginning of the log; empty where the whole log is meant.
    #: ``size``, ``standard_error``: in ``unit``; None where the fault has no size.
    size: float | None = None
    standard_error: float | None = None
    unit: str = ""
    confidence: float = 0.99  #: Probability that the fault is real.
    remedy: Remedy = "none"  #: The applied remedy.
    stops: bool = False  #: Whether no fit is valid before the fault is corrected.
    #: Whether causes that the plain model lacks may explain the fault: a diagnosis examines it once more.
    may_be_explained: bool = False
    excerpt: Excerpt | None = field(default=None, compare=False, repr=False)  #: None where there is nothing to plot.

    @property
    def title(self) -> str:
        """First log, and the fault in words."""
        return ": ".join((*self.logs[:1], self.fault.replace("_", " ")))


@dataclass(frozen=True, kw_only=True)
class FaultOverrides:
    """The [faults] table of rovid.toml: faults whose remedy the user rejects."""

    #: Id -> names or patterns of the logs that stay as logged.
    kept: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    def keep(self, fault: Fault) -> bool:
        """Whether the logs of ``fault`` stay as logged."""
        patterns = self.kept.get(fault.fault, ())
        return bool(patterns) and all(any(is_called(log, each) for each in patterns) for log in fault.logs)

    def __str__(self) -> str:
        """All settings that results depend on."""
        return ", ".join(f"{fault} of {' and '.join(logs)}" for fault, logs in sorted(self.kept.items()))


def fault_texts(faults: Iterable[Fault]) -> list[str]:
    """Sentences on the ``faults``, those that stop a fit first; one for all logs with the same fault."""
    groups: dict[tuple[str, str], list[Fault]] = {}
    for fault in sorted(faults, key=lambda fault: not fault.stops):
        words = fault.text
        for log in fault.logs:
            words = words.replace(log, "")
        groups.setdefault((fault.fault, _NUMBER.sub("", words)), []).append(fault)
    texts = []
    for first, *others in groups.values():
        logs = [log for log in dict.fromkeys(log for fault in others for log in fault.logs) if log not in first.logs]
        texts.append(f"{first.text} Likewise in {shortened_list(logs)}." if logs else first.text)
    return texts


def stopping(faults: Iterable[Fault]) -> list[Fault]:
    """The ``faults`` that no fit survives."""
    return [fault for fault in faults if fault.stops]
