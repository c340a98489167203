"""Tables of rovid.toml about the logs: intervals to leave out, files to join, faults to keep."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

from rovid.core.errors import ConfigError
from rovid.trial.cutting import Exclusion
from rovid.trial.fault import FAULT_IDS, FaultOverrides
from rovid.trial.log_files import Join
from rovid.trial.signal_names import Signal

_JOIN_KEYS = ("parts", "offset", "drift", "time")
_EXCLUSION_KEYS = ("log", "from", "to", "reason")


class TableParser(Protocol):
    """Checks of tables, blocks and values in rovid.toml."""

    def error(self, place: str, message: str, mend: str = "") -> ConfigError:
        """The error at this place of the file."""

    def table(self, document: Mapping[str, Any], name: str) -> Mapping[str, Any]:
        """The table of this name; empty where there is none."""

    def blocks(self, document: Mapping[str, Any], name: str) -> list[Any]:
        """The blocks of this name."""

    def require_block(self, block: Any, name: str, place: str, keys: Sequence[str]) -> None:
        """Refuse all but a block with known ``keys``."""

    def require_known(self, table: Mapping[str, Any] | list[str], keys: Sequence[str], place: str) -> None:
        """Refuse unknown keys."""

    def number(self, value: Any, place: str, *, positive: bool = False) -> float:
        """The value as a number."""

    def name(self, value: Any, place: str) -> str:
        """The value as a name."""

    def signal(self, name: str, value: Any, place: str, *, like: str = "") -> Signal:
        """The signal of this value."""


def exclusions(document: Mapping[str, Any], parser: TableParser) -> Iterator[Exclusion]:
    """The intervals of [[leave_out]]."""
    for index, block in enumerate(parser.blocks(document, "leave_out")):
        place = f"[[leave_out]] number {index + 1}"
        parser.require_block(block, "leave_out", place, _EXCLUSION_KEYS)
        if not isinstance(block.get("log"), str) or not isinstance(block.get("reason", ""), str):
            raise parser.error(place, "has no log and reason that are text.", 'Add log = "hold_03.csv".')
        begin = parser.number(block.get("from", 0.0), f"{place} from")
        end = parser.number(block["to"], f"{place} to") if "to" in block else math.inf
        if not end > begin:
            raise parser.error(place, f"ends at {end:g} s and begins at {begin:g} s.", "Give from and to in s.")
        log, reason = parser.name(block["log"], f"{place} log"), parser.name(block.get("reason", ""), f"{place} reason")
        yield Exclusion(log=log, begin=begin, end=end, reason=reason)


def join(document: Mapping[str, Any], parser: TableParser) -> Join | None:
    """The table [join]; None where there is none."""
    table = parser.table(document, "join")
    if not table:
        return None
    parser.require_known(table, _JOIN_KEYS, "[join]")
    parts = table.get("parts")
    if not isinstance(parts, list) or len(parts) < 2 or not all(isinstance(part, str) for part in parts):
        raise parser.error("[join]", "has no parts: two words or more were expected.", 'Add parts = ["ins", "thr"].')
    times = parser.table(table, "time")
    parser.require_known(times, parts, "[join] time")
    clocks = {}
    for part, value in times.items():
        signal = parser.signal("time", value, f"[join] time {part}")
        clocks[part] = next(iter(signal.sources.values()), ""), signal.unit
    offset, drift = (_clock_corrections(table, key, parts, parser) for key in ("offset", "drift"))
    return Join(parts=tuple(parts), offset=offset, drift=drift, time=clocks)


def kept_faults(document: Mapping[str, Any], parser: TableParser) -> FaultOverrides:
    """The table [faults]."""
    table = parser.table(document, "faults")
    parser.require_known(table, FAULT_IDS, "[faults]")
    kept = {}
    for fault, value in table.items():
        logs = ["*"] if value == "keep" else value
        if not isinstance(logs, list) or not all(isinstance(log, str) for log in logs):
            raise parser.error(f"[faults] {fault}", f'is {value!r}; "keep" or a list of logs was expected.')
        kept[fault] = tuple(logs)
    return FaultOverrides(kept=kept)


def _clock_corrections(
    table: Mapping[str, Any], key: str, parts: Sequence[str], parser: TableParser
) -> dict[str, float]:
    """Numbers by part, or by file name or pattern, which has a dot, a star or a slash in it."""
    entries = parser.table(table, key)
    parser.require_known([name for name in entries if not {".", "*", "/"} & set(name)], parts, f"[join] {key}")
    return {name: parser.number(value, f"[join] {key} {name}") for name, value in entries.items()}
