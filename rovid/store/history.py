"""What was found when, from which logs, by which version: a line for each model that a parameter file ever held."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rovid.core.atomic_write import OutputFile
from rovid.core.errors import ConfigError
from rovid.core.signatures import HISTORY
from rovid.store.load import parse_parameters
from rovid.store.parameter_file import Parameters

_HEAD = json.dumps({"schema": "rovid-history/1"}).encode()
_SUFFIX = ".history"
# Bytes that a file's name may have; what is longer is cut.
_LONGEST = 255
# Of a record, what says when and by which rovid it was written; the rest is what was found.
_ABOUT = ("written", "rovid_version")
_MEND = "Put it back from a copy, or move it away: a new one is begun then."


@dataclass(frozen=True, kw_only=True)
class HistoryRecord:
    """One model that was found.

    Attributes
    ----------
    written
        When, in UTC, as ISO 8601.
    version
        Of the rovid that found it.
    seen
        Effect's id -> size that would have been seen, of those that a diagnosis looked for and did not find; empty
        where none looked.
    """

    parameters: Parameters
    written: str
    version: str
    detection_limits: Mapping[str, float] = field(default_factory=dict)

    @property
    def digests(self) -> frozenset[str]:
        """Of the logs that it rests on."""
        return frozenset(source.sha256 for source in self.parameters.sources)


def history_output(parameters: Path) -> OutputFile:
    """The history that stands beside a parameter file."""
    stem = parameters.stem
    while len(os.fsencode(f"{stem}{_SUFFIX}")) > _LONGEST:
        stem = stem[:-1]
    return OutputFile(parameters.with_name(f"{stem}{_SUFFIX}"), HISTORY)


def appended_history(found: Parameters, seen: Mapping[str, float]) -> bytes:
    """The history beside ``found``, damaged or not, and a line more for that, if it is not what the last line says."""
    target = history_output(found.path).target
    document = {**found.document(), "seen": {name: size for name, size in seen.items() if math.isfinite(size)}}
    line = json.dumps(document, default=str).encode()
    before = target.read_bytes() if target.exists() else b""
    text = before.rstrip() if HISTORY.pattern.search(before) else _HEAD
    if _found(text.rpartition(b"\n")[2]) == _found(line):
        return before
    return b"%b\n%b\n" % (text, line)


def _found(line: bytes) -> Any:
    """What a line says was found; the line itself where it is damaged."""
    try:
        document = json.loads(line)
    except ValueError:
        return line
    return {key: value for key, value in document.items() if key not in _ABOUT}


def read_history(parameters: Path) -> Iterator[HistoryRecord]:
    """The records beside a parameter file, the last first; none where there is no history.

    Raises
    ------
    ConfigError
        A line is damaged.
    """
    path = history_output(parameters).path
    if not path.exists():
        return
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot be read ({error}).", where=path, mend=_MEND) from error
    if not HISTORY.matches(path):
        raise ConfigError(
            f"is not {HISTORY.description}.", where=path, mend="Move it away, or name another file with -p."
        )
    for number in range(len(lines), 1, -1):
        yield _record(path, number, lines[number - 1], parameters)


def _record(path: Path, number: int, line: str, parameters: Path) -> HistoryRecord:
    try:
        document = json.loads(line)
        seen = {str(name): float(size) for name, size in document.get("seen", {}).items()}
        about = [str(document[name]) for name in _ABOUT]
    except (ValueError, TypeError, AttributeError, KeyError) as error:
        raise ConfigError("is damaged.", where=f"{path}:{number}", mend=_MEND) from error
    found = replace(parse_parameters(path, document), path=parameters)
    return HistoryRecord(parameters=found, written=about[0], version=about[1], detection_limits=seen)
