"""The history next to a parameter file: one line for each model that the file held, with time, version and logs."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rovid.core.atomic_write import Content, OutputFile, OutputSet
from rovid.core.errors import ConfigError
from rovid.core.signatures import HISTORY, PARAMETERS
from rovid.store.load import parse_parameters, read_parameters
from rovid.store.parameter_file import Parameters

_HEAD = json.dumps({"schema": "rovid-history/1"}).encode()
_SUFFIX = ".history"
# Maximum length of a file name in bytes.
_LONGEST = 255
# Keys of a record that do not describe the model.
_METADATA = ("written", "rovid_version")
_MEND = "Restore it from a copy, or move it away: rovid then starts a new history."


@dataclass(frozen=True, kw_only=True)
class HistoryRecord:
    """One model."""

    parameters: Parameters
    written: str  # Time of writing in UTC, as ISO 8601
    version: str  # Version of rovid
    # Effect id -> smallest detectable size, for effects that a diagnosis tested and did not find
    detection_limits: Mapping[str, float] = field(default_factory=dict)

    @property
    def digests(self) -> frozenset[str]:
        """Digests of the logs."""
        return frozenset(source.sha256 for source in self.parameters.sources)


def history_output(parameters: Path) -> OutputFile:
    """The history file of a parameter file."""
    stem = parameters.stem
    while len(os.fsencode(f"{stem}{_SUFFIX}")) > _LONGEST:
        stem = stem[:-1]
    return OutputFile(parameters.with_name(f"{stem}{_SUFFIX}"), HISTORY)


def read_history(parameters: Path) -> Iterator[HistoryRecord]:
    """Records of a parameter file, the latest first; none without a history file.

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
        mend = "Move it away, or name another file with -p."
        raise ConfigError(f"is not {HISTORY.description}.", where=path, mend=mend)
    for number in range(len(lines), 1, -1):
        yield _record(path, number, lines[number - 1], parameters)


def _record(path: Path, number: int, line: str, parameters: Path) -> HistoryRecord:
    try:
        document = json.loads(line)
        limits = {str(name): float(size) for name, size in document.get("seen", {}).items()}
        written, version = (str(document[name]) for name in _METADATA)
    except (ValueError, TypeError, AttributeError, KeyError) as error:
        raise ConfigError("is damaged.", where=f"{path}:{number}", mend=_MEND) from error
    found = replace(parse_parameters(path, document), path=parameters)
    return HistoryRecord(parameters=found, written=written, version=version, detection_limits=limits)


def update_parameters(
    stored: Parameters,
    outputs: OutputSet,
    change: Callable[[Parameters], Parameters],
    *,
    detection_limits: Mapping[str, float] | None = None,
) -> Parameters:
    """Apply ``change`` to the current parameter file, including another process' results, and return the new content.

    With ``detection_limits`` the history gets a line as well. Either both files are written or none.

    Raises
    ------
    OutputError
        A file cannot be written, or was replaced by another kind of file. The message names the file that holds the
        result instead.
    """
    written = stored

    def changed() -> str:
        nonlocal written
        written = change(_current(stored))
        return written.text()

    contents: dict[OutputFile, Content] = {stored.output: changed}
    if detection_limits is not None:
        # Evaluated after the parameter file.
        contents[history_output(stored.path)] = lambda: appended_history(written, detection_limits)
    try:
        outputs.write(contents)
    except ConfigError as error:
        outputs.save_elsewhere({stored.output: change(stored).text().encode()}, error)
    return written


def _current(stored: Parameters) -> Parameters:
    """The current content of the file; ``stored`` if the file was deleted or is to be replaced."""
    if not stored.path.exists() or not PARAMETERS.matches(stored.path):
        return stored
    current = read_parameters(stored.path)
    if current.axis is not stored.axis:
        raise ConfigError(f"now holds the parameters of {current.axis.name}.", where=stored.path)
    return replace(current, path=stored.path)


def appended_history(found: Parameters, detection_limits: Mapping[str, float]) -> bytes:
    """The history of ``found.path`` with one more line, unless the last line already holds the same model."""
    target = history_output(found.path).target
    limits = {name: size for name, size in detection_limits.items() if math.isfinite(size)}
    line = json.dumps({**found.document(), "seen": limits}, default=str).encode()
    before = target.read_bytes() if target.exists() else b""
    text = before.rstrip() if HISTORY.pattern.search(before) else _HEAD
    if _model(text.rpartition(b"\n")[2]) == _model(line):
        return before
    return b"%b\n%b\n" % (text, line)


def _model(line: bytes) -> Any:
    """The part of a line that describes the model; the line itself if it is damaged."""
    try:
        document = json.loads(line)
    except ValueError:
        return line
    return {key: value for key, value in document.items() if key not in _METADATA}
