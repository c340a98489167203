"""Reading and validation of parameter files, and the history next to them: one line for each earlier model."""

import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np

from rovid import __version__
from rovid.core.errors import ConfigError
from rovid.core.formatting import decoded
from rovid.core.input_files import LARGEST, SMALLEST, expected_number, read_toml, require_regular
from rovid.core.output_files import HISTORY, PARAMETERS, Content, OutputFile, OutputSet
from rovid.effects.plugins import Origin
from rovid.model.parameter_names import PLANAR_UNITS, base_names, is_planar_base
from rovid.store.parameter_file import SCHEMA, SCHEMA_VERSION, Entry, OpenCombination, Parameters, Source
from rovid.trial.assumptions import ConfigFingerprint
from rovid.trial.axis import PLANAR, YAW, parameter_axis

# Tolerance of correlations: accepts numbers that a user rounded to three digits.
_ROUNDING = 1e-3
# Product of inertia of sway and yaw, the only parameter of the planar model's base with either sign.
_COUPLED = "sway_yaw.inertia"
_AGAIN = "Put it back, or delete it and run `rovid fit-drag LOGS` again."
_ANOTHER = "Give a parameter file, or the name of a new one, with -p."


def read_parameters(path: Path) -> Parameters:
    """Read a parameter file. Raises ConfigError if the file is missing, not a parameter file, or of a newer schema."""
    require_regular(path)
    if not path.is_file():
        text = "is a folder, not a parameter file." if path.exists() else "there is no such parameter file."
        raise ConfigError(text, where=path, mend="Run `rovid fit-drag LOGS` first, or give a parameter file with -p.")
    return parse_parameters(path, read_toml(path, mend=_AGAIN if PARAMETERS.matches(path) else _ANOTHER))


def parse_parameters(path: Path, document: Mapping[str, Any]) -> Parameters:
    """Parse the ``document`` of ``path``. Raises ConfigError if it is not of parameters, or of a newer schema."""
    schema = document.get("schema")
    version = re.fullmatch(rf"{SCHEMA}/([0-9]{{1,9}})", str(schema))
    if version is None:
        raise ConfigError(f"has schema {schema!r}; {SCHEMA}/{SCHEMA_VERSION} was expected.", where=path, mend=_ANOTHER)
    if int(version[1]) > SCHEMA_VERSION:
        text = f"has schema {schema}, newer than the {SCHEMA}/{SCHEMA_VERSION} that rovid {__version__} reads."
        raise ConfigError(text, where=path, mend="Use the version of rovid that wrote it, or a newer one.")
    try:
        return _parse(path, document)
    except KeyError as error:
        raise ConfigError(f"is damaged: it has no {error.args[0]!r}.", where=path, mend=_AGAIN) from error
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise ConfigError(f"is damaged: {error}.", where=path, mend=_AGAIN) from error


def _parse(path: Path, document: Mapping[str, Any]) -> Parameters:
    axis = parameter_axis(str(document.get("axis", YAW.name)))
    entries = {name: _entry(name, written) for name, written in document["parameters"].items()}
    assumed = {name: _number(value, name) for name, value in document.get("assumed", {}).items()}
    # Refuse parameters of the coupled model in another file, and the other way round.
    names = {**entries, **assumed}
    for name in names:
        if is_planar_base(name) and axis is not PLANAR:
            raise ValueError(f"{name} is a parameter of the coupled model, and the file is of {axis.name}")
        if axis is PLANAR and "." not in name:
            raise ValueError(f"{name} is no parameter of the coupled model")
    if axis is PLANAR:
        values = {name: entry.value for name, entry in entries.items()} | assumed
        for name in filter(PLANAR_UNITS.__contains__, values):
            least = SMALLEST if name.endswith(".inertia") else 0.0
            if name != _COUPLED and values[name] < least:
                raise ValueError(f"{name} is {values[name]:g}, which is not possible")
        sway, yaw, coupled = (values.get(name, math.nan) for name in ("sway.inertia", "yaw.inertia", _COUPLED))
        if coupled**2 >= sway * yaw:
            raise ValueError("the mass matrix of sway and yaw is not positive definite")
    covariance, undetermined, plugins = document["covariance"], [], {}
    for name, written in document.get("plugins", {}).items():
        plugins[str(name)] = Origin(plugin=str(written["plugin"]), version=str(written["version"]))
    for one in document.get("undetermined", []):
        combination = {str(name): _number(weight, str(name)) for name, weight in one["combination"].items()}
        undetermined.append(OpenCombination(combination=combination, text=str(one["text"])))
    return Parameters(
        path=path,
        vehicle=str(document.get("vehicle", "")),
        axis=axis,
        logs=tuple((path.parent / decoded(str(item))).resolve() for item in document["logs"]),
        entries=entries,
        covariance=_covariance(covariance["names"], covariance["matrix"], entries),
        sources=tuple(_source(written, path.parent) for written in document["sources"]),
        settings=_settings(document.get("rests_on")),
        assumed=assumed,
        plugins=plugins,
        undetermined=tuple(undetermined),
        missing=str(document.get("missing", "")),
    )


def _entry(name: str, written: Mapping[str, Any]) -> Entry:
    value = _number(written["value"], name)
    error = _number_or_nan(written["standard_error"], f"standard_error of {name}")
    # Drag may be zero but not negative. Inertia has to be positive.
    if (name in base_names(YAW) and not value >= 0.0) or (name == "inertia" and value < SMALLEST):
        raise ValueError(f"{name} is {value:g}, which is not possible")
    if error < 0.0:
        raise ValueError(f"standard_error of {name} is {error:g}; zero or more was expected")
    return Entry(
        value=value,
        standard_error=error,
        unit=str(written["unit"]),
        method=str(written["method"]),
        options=str(written.get("options", "")),
        from_prior=bool(written.get("from_prior", False)),
    )


def _source(written: Mapping[str, Any], folder: Path) -> Source:
    path, samples = written.get("path"), written["samples"]
    if isinstance(samples, bool) or not isinstance(samples, int) or samples < 0:
        raise ValueError(f"samples is {samples!r}; a whole number was expected")
    return Source(
        name=str(written["name"]),
        sha256=str(written["sha256"]),
        samples=samples,
        path=None if path is None else (folder / decoded(str(path))).resolve(),
    )


def _settings(written: Mapping[str, Any] | None) -> ConfigFingerprint | None:
    """Fingerprint of rovid.toml; None for a file of rovid 0.2."""
    if written is None:
        return None
    drive, signals, further = (
        {str(name): str(text) for name, text in written[key].items()} for key in ("drive", "signals", "further")
    )
    guessed = tuple(map(str, written["guessed"]))
    return ConfigFingerprint(drive=drive, signals=signals, further=further, guessed=guessed)


def _number(value: object, name: str, largest: float = LARGEST) -> float:
    expected = expected_number(value, largest=largest)
    if expected or not isinstance(value, int | float):
        raise ValueError(f"{name} is {value!r}; {expected} was expected")
    return float(value)


def _number_or_nan(value: object, name: str, largest: float = LARGEST) -> float:
    """A number; NaN is an error that the data did not determine."""
    if isinstance(value, float) and math.isnan(value):
        return value
    return _number(value, name, largest)


def _covariance(
    names: Sequence[str], matrix: Sequence[Any], entries: Mapping[str, Entry]
) -> dict[tuple[str, str], float]:
    """Covariance of each pair of ``names``, after validation of the matrix.

    A variance may be smaller than the squared standard error, which includes the uncertainty of the thrust's scale.
    Variance and standard error may be NaN together if the data did not determine them.
    """
    if not set(names) <= set(entries) or len(set(names)) < len(names):
        raise ValueError("the names of the covariance are not unique names of parameters")
    if [len(names)] * len(names) != list(map(len, matrix)):
        raise ValueError(f"the covariance is not a square matrix of {len(names)} rows")
    written = np.array([[_number_or_nan(cell, "a covariance", LARGEST**2) for cell in row] for row in matrix])
    variance = {name: float(written[i, i]) for i, name in enumerate(names)}
    for name, entry in entries.items():
        if math.isnan(entry.standard_error) and not math.isnan(variance.get(name, 0.0)):
            raise ValueError(f"standard_error of {name} is nan; a number was expected")
    known = [i for i, name in enumerate(names) if not math.isnan(entries[name].standard_error)]
    finite = written.reshape(len(names), len(names))[np.ix_(known, known)]
    if np.isnan(finite).any():
        raise ValueError("a covariance is nan; a number was expected")
    errors = np.sqrt(np.maximum(np.diag(finite), 0.0))
    largest = np.outer(errors, errors)
    # Correlations do not depend on the units.
    correlation = np.divide(finite, largest, out=np.zeros_like(finite), where=largest > 0.0)
    if not np.allclose(correlation, correlation.T, rtol=0.0, atol=_ROUNDING):
        raise ValueError("the covariance is not symmetric")
    too_large = np.any(np.abs(finite) > (1.0 + _ROUNDING) * largest)
    if too_large or np.linalg.eigvalsh(correlation).min(initial=0.0) < -_ROUNDING:
        raise ValueError("the covariance is not positive semidefinite")
    pairs = combinations_with_replacement(enumerate(names), 2)
    return {(first, second): float(written[i, j]) for (i, first), (j, second) in pairs}


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
    """Records of a parameter file, the latest first; none without a history. Raises ConfigError if one is damaged."""
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
        try:
            document = json.loads(lines[number - 1])
            limits = {str(name): float(size) for name, size in document.get("seen", {}).items()}
            written, version = (str(document[name]) for name in _METADATA)
        except (ValueError, TypeError, AttributeError, KeyError) as error:
            raise ConfigError("is damaged.", where=f"{path}:{number}", mend=_MEND) from error
        found = replace(parse_parameters(path, document), path=parameters)
        yield HistoryRecord(parameters=found, written=written, version=version, detection_limits=limits)


def update_parameters(
    stored: Parameters,
    outputs: OutputSet,
    change: Callable[[Parameters], Parameters],
    *,
    detection_limits: Mapping[str, float] | None = None,
) -> Parameters:
    """Apply ``change`` to the current parameter file, including another process' results, and return the new content.

    With ``detection_limits`` the history gets a line as well. Either both files are written or none. Raises OutputError
    if a file cannot be written, or was replaced by another kind of file. The message names the file that holds the
    result instead.
    """
    written = stored

    def changed() -> str:
        nonlocal written
        current = stored  # If the file was deleted or is to be replaced.
        if stored.path.exists() and PARAMETERS.matches(stored.path):
            current = replace(read_parameters(stored.path), path=stored.path)
            if current.axis is not stored.axis:
                raise ConfigError(f"now holds the parameters of {current.axis.name}.", where=stored.path)
        written = change(current)
        return written.text()

    contents: dict[OutputFile, Content] = {stored.output: changed}
    if detection_limits is not None:
        # Evaluated after the parameter file.
        contents[history_output(stored.path)] = lambda: _appended_history(written, detection_limits)
    try:
        outputs.write(contents)
    except ConfigError as error:
        outputs.save_elsewhere({stored.output: change(stored).text().encode()}, error)
    return written


def _appended_history(found: Parameters, detection_limits: Mapping[str, float]) -> bytes:
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
