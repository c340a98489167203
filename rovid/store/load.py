"""A parameter file, read and checked."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np

from rovid import __version__
from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError
from rovid.core.paths import require_regular
from rovid.core.signatures import PARAMETERS
from rovid.core.toml import LARGEST, SMALLEST, expected_number, read_toml
from rovid.model.parameter_names import base_names
from rovid.store.parameter_file import SCHEMA, SCHEMA_VERSION, Entry, Parameters, Source
from rovid.trial.axis import YAW, axis_named
from rovid.trial.config_fingerprint import ConfigFingerprint

# Of a correlation: numbers rounded to three digits by hand are still a covariance.
_ROUNDING = 1e-3
_AGAIN = "Put it back, or delete it and run `rovid fit-drag LOGS` again."
_ANOTHER = "Point to a parameter file with -p, or to a name that is free."


def read_parameters(path: Path) -> Parameters:
    """Read a parameter file.

    Raises
    ------
    ConfigError
        It is missing, not a parameter file, or of a schema newer than this rovid knows.
    """
    _require_file(path)
    return parse_parameters(path, read_toml(path, mend=_AGAIN if PARAMETERS.matches(path) else _ANOTHER))


def parse_parameters(path: Path, document: Mapping[str, Any]) -> Parameters:
    """What a ``document`` in ``path`` says.

    Raises
    ------
    ConfigError
        It is none of parameters, or of a schema newer than this rovid knows.
    """
    _check_schema(path, document.get("schema"))
    try:
        return _parse(path, document)
    except KeyError as error:
        raise ConfigError(f"is damaged: it has no {error.args[0]!r}.", where=path, mend=_AGAIN) from error
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise ConfigError(f"is damaged: {error}.", where=path, mend=_AGAIN) from error


def _require_file(path: Path) -> None:
    require_regular(path)
    if not path.is_file():
        text = "is a folder, not a parameter file." if path.exists() else "there is no such parameter file."
        raise ConfigError(text, where=path, mend="Run `rovid fit-drag LOGS` first, or point to one with -p.")


def _check_schema(path: Path, schema: object) -> None:
    version = re.fullmatch(rf"{SCHEMA}/([0-9]{{1,9}})", str(schema))
    if version is None:
        raise ConfigError(f"has schema {schema!r}; {SCHEMA}/{SCHEMA_VERSION} was expected.", where=path, mend=_ANOTHER)
    if int(version[1]) > SCHEMA_VERSION:
        raise ConfigError(
            f"has schema {schema}, newer than the {SCHEMA}/{SCHEMA_VERSION} that rovid {__version__} reads.",
            where=path,
            mend="Use the rovid that wrote it, or a newer one.",
        )


def _parse(path: Path, document: Mapping[str, Any]) -> Parameters:
    entries = {name: _entry(name, written) for name, written in document["parameters"].items()}
    for name, entry in entries.items():
        _check_entry(name, entry)
    return Parameters(
        path=path,
        vehicle=str(document.get("vehicle", "")),
        axis=axis_named(str(document.get("axis", YAW.name))),
        logs=tuple((path.parent / str(item)).resolve() for item in document["logs"]),
        entries=entries,
        covariance=_covariance(document["covariance"]["names"], document["covariance"]["matrix"], entries),
        sources=tuple(_source(written, path.parent) for written in document["sources"]),
        settings=_settings(document.get("rests_on")),
    )


def _entry(name: str, written: Mapping[str, Any]) -> Entry:
    value = _number(written["value"], name)
    error = _number_or_nan(written["standard_error"], f"standard_error of {name}")
    return Entry(
        value=value,
        standard_error=error,
        unit=str(written["unit"]),
        method=str(written["method"]),
        options=str(written.get("options", "")),
    )


def _check_entry(name: str, entry: Entry) -> None:
    # Drag may be zero, not negative.
    negative = name in base_names(YAW) and not entry.value >= 0.0
    weightless = name == "inertia" and entry.value < SMALLEST
    if negative or weightless:
        raise ValueError(f"{name} is {entry.value:g}, which no vehicle has")
    if entry.standard_error < 0.0:
        raise ValueError(f"standard_error of {name} is {entry.standard_error:g}; zero or more was expected")


def _source(written: Mapping[str, Any], folder: Path) -> Source:
    place = written.get("path")
    return Source(
        name=str(written["name"]),
        sha256=str(written["sha256"]),
        samples=_count(written["samples"]),
        path=None if place is None else (folder / str(place)).resolve(),
    )


def _settings(written: Mapping[str, Any] | None) -> ConfigFingerprint | None:
    """What of rovid.toml the parameters rest on; None of a file of rovid 0.2."""
    if written is None:
        return None
    told = {
        key: {str(name): str(text) for name, text in written[key].items()} for key in ("drive", "signals", "further")
    }
    return ConfigFingerprint(**told, guessed=tuple(map(str, written["guessed"])))


def _number(value: object, place: str, largest: float = LARGEST) -> float:
    wanted = expected_number(value, largest=largest)
    if wanted or not isinstance(value, int | float):
        raise ValueError(f"{place} is {value!r}; {wanted} was expected")
    return float(value)


def _number_or_nan(value: object, place: str, largest: float = LARGEST) -> float:
    """As ``_number``; NaN for an error that one reading alone cannot tell."""
    if isinstance(value, float) and math.isnan(value):
        return value
    return _number(value, place, largest)


def _count(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise ValueError(f"samples is {value!r}; a whole number was expected")
    return value


def _covariance(
    names: Sequence[str], matrix: Sequence[Any], entries: Mapping[str, Entry]
) -> dict[tuple[str, str], float]:
    """Covariance of each pair of ``names``, where the matrix can be one.

    Its diagonal may be less than the square of the standard errors, which hold the scale of thrust too. Variance and
    standard error may be NaN together: nothing told them.
    """
    if not set(names) <= set(entries) or len(set(names)) < len(names):
        raise ValueError("names of the covariance are not those of parameters, each once")
    if [len(names)] * len(names) != [len(row) for row in matrix]:
        raise ValueError(f"the covariance of {len(names)} parameters is not a matrix of as many rows and columns")
    written = np.array([[_number_or_nan(cell, "a covariance", LARGEST**2) for cell in row] for row in matrix])
    variance = {name: float(written[i, i]) for i, name in enumerate(names)}
    for name, entry in entries.items():
        if math.isnan(entry.standard_error) and not math.isnan(variance.get(name, 0.0)):
            raise ValueError(f"standard_error of {name} is nan; a number was expected")
    known = [i for i, name in enumerate(names) if not math.isnan(entries[name].standard_error)]
    _check_covariance(written.reshape(len(names), len(names))[np.ix_(known, known)])
    pairs = combinations_with_replacement(enumerate(names), 2)
    return {(first, second): float(written[i, j]) for (i, first), (j, second) in pairs}


def _check_covariance(matrix: FloatArray) -> None:
    if np.isnan(matrix).any():
        raise ValueError("a covariance is nan; a number was expected")
    spread = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    most = np.outer(spread, spread)
    # As correlations all are of one size, whatever the units.
    correlation = np.divide(matrix, most, out=np.zeros_like(matrix), where=most > 0.0)
    if not np.allclose(correlation, correlation.T, rtol=0.0, atol=_ROUNDING):
        raise ValueError("the covariance is not symmetric")
    too_large = np.any(np.abs(matrix) > (1.0 + _ROUNDING) * most)
    if too_large or np.linalg.eigvalsh(correlation).min(initial=0.0) < -_ROUNDING:
        raise ValueError("the covariance is none: a variance is negative, or parameters go together more than wholly")
