"""The parameter file: values, units, standard errors, covariance, and the logs they came from."""

from __future__ import annotations

import hashlib
import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from rovid import __version__
from rovid.campaign.axis import YAW, Axis, axis_named
from rovid.campaign.trial import Campaign
from rovid.effects import effect_named
from rovid.ground.errors import ConfigError
from rovid.ground.files import Claim, Output
from rovid.ground.files.form import PARAMETERS
from rovid.ground.places import refuse_odd
from rovid.ground.quoting import encodable
from rovid.ground.toml import LARGEST, SMALLEST, number_wanted, read_toml
from rovid.identify.estimate import PER_INERTIA, Estimate
from rovid.model.model import Model, base_names, effect_ids

SCHEMA = "rovid-parameters"
SCHEMA_VERSION = 1
# Of a correlation: numbers rounded to three digits by hand are still a covariance.
_ROUNDING = 1e-3
_AGAIN = "Put it back, or delete it and run `rovid fit-drag LOGS` again."
_ANOTHER = "Point to a parameter file with -p, or to a name that is free."
# 1/s; no motion dies out faster, and none could be followed that did.
_FASTEST = 1e3


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One parameter: its value, standard error, unit, and how it was found."""

    value: float
    standard_error: float
    unit: str
    method: str


@dataclass(frozen=True, kw_only=True)
class Source:
    """One log the parameters rest on."""

    name: str
    sha256: str
    samples: int


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The content of a parameter file.

    Attributes
    ----------
    path
        Where it is, or will be.
    logs
        What the user gave as LOGS, absolute.
    covariance
        (first, second) -> covariance of two parameters, in the product of their units; pairs found by
        different methods are taken as uncorrelated and are absent.
    axis
        The degree of freedom that they are of.
    """

    path: Path
    vehicle: str = ""
    logs: tuple[Path, ...] = ()
    entries: Mapping[str, Entry] = field(default_factory=dict)
    covariance: Mapping[tuple[str, str], float] = field(default_factory=dict)
    sources: tuple[Source, ...] = ()
    axis: Axis = YAW

    def with_estimate(self, estimate: Estimate) -> Parameters:
        """The same with the parameters of ``estimate`` put in or replaced."""
        new = {
            name: Entry(
                value=estimate.value(name),
                standard_error=estimate.standard_error(name),
                unit=estimate.unit(name),
                method=estimate.method,
            )
            for name in estimate.names
            if name not in estimate.refused
        }
        kept = {pair: value for pair, value in self.covariance.items() if not set(pair) & set(estimate.names)}
        fresh = {
            (first, second): float(estimate.covariance[i, j])
            for i, first in enumerate(estimate.names)
            for j, second in enumerate(estimate.names)
            if i <= j and first in new and second in new
        }
        # Effects belong to the fit that found them: another fit of the inertia does without, or finds them anew.
        stale = set(estimate.names) | (
            {name for name in self.entries if "." in name} if "inertia" in estimate.names else set()
        )
        entries = {name: entry for name, entry in self.entries.items() if name not in stale}
        return replace(self, entries=entries | new, covariance=kept | fresh)

    def with_logs(self, paths: Sequence[Path], vehicle: str, campaign: Campaign | None) -> Parameters:
        """The same with the logs it rests on, each with its hash."""
        sources = (
            ()
            if campaign is None
            else tuple(_source(trial.name, trial.path, int(trial.measured.sum())) for trial in campaign.trials)
        )
        return replace(self, vehicle=vehicle, logs=_absolute(paths), sources=sources)

    def entries_of(self, paths: Sequence[Path]) -> Mapping[str, Entry]:
        """What methods said of the logs at ``paths``; nothing where the file rests on others."""
        return self.entries if self.logs == _absolute(paths) else {}

    def drag(self) -> Estimate | None:
        """Quadratic and linear drag from elsewhere than the inertia; a refused linear drag is zero.

        None where there is no drag, or where it was found together with the inertia: it cannot judge that inertia, and
        a second `rovid fit-inertia` has to give what the first gave.
        """
        names, needed = ("quadratic_drag", "linear_drag"), "quadratic_drag"
        together = self.covariance.get(("inertia", needed), 0.0) != 0.0
        if needed not in self.entries or together or self.per_inertia:
            return None
        values = [self.entries[name].value if name in self.entries else 0.0 for name in names]
        covariance = [[self.covariance.get((a, b), self.covariance.get((b, a), 0.0)) for b in names] for a in names]
        return Estimate(
            names=names,
            values=np.array(values),
            covariance=np.array(covariance),
            method=self.entries[needed].method,
            samples=0,
            axis=self.axis,
        )

    @property
    def per_inertia(self) -> bool:
        """Whether the inertia could not be known, and all else is that of 1 kg m^2."""
        entry = self.entries.get("quadratic_drag")
        return entry is not None and entry.unit.endswith(PER_INERTIA)

    def model(self) -> Model:
        """The model that these parameters describe.

        Raises
        ------
        ConfigError
            Inertia, drag or a parameter of an effect is missing, or the drag ends any motion at once.
        """
        for name, command in (("quadratic_drag", "fit-drag LOGS"), ("inertia", "fit-inertia")):
            if name not in self.entries and not (name == "inertia" and self.per_inertia):
                raise ConfigError(f"holds no {name}.", where=self.path, mend=f"Run `rovid {command}` first.")
        linear = self.entries.get("linear_drag")
        effects = tuple(effect_named(name) for name in self.effects)
        for name in self._restoring:
            if name not in self.entries:
                raise ConfigError(f"holds no {name}.", where=self.path, mend="Run `rovid fit-inertia LOGS` first.")
        for name in (f"{effect.key}.{parameter.name}" for effect in effects for parameter in effect.parameters):
            if name not in self.entries:
                mend = f"Run `rovid fit --effect {name.rpartition('.')[0]}`, or delete what is left of the effect."
                raise ConfigError(f"holds no {name}.", where=self.path, mend=mend)
        inertia = 1.0 if self.per_inertia else self.entries["inertia"].value
        quadratic_drag, linear_drag = self.entries["quadratic_drag"].value, 0.0 if linear is None else linear.value
        if quadratic_drag + linear_drag > _FASTEST * inertia:
            raise ConfigError(
                f"the drag of {quadratic_drag:.3g} and {linear_drag:.3g} would end a motion at 1 {self.axis.rate_unit} "
                f"of an inertia of {inertia:.3g} within {1.0 / _FASTEST} s: no vehicle brakes like that.",
                where=self.path,
                mend="Look for a slipped digit, or fit the parameters again.",
            )
        return Model(
            inertia=inertia,
            quadratic_drag=quadratic_drag,
            linear_drag=linear_drag,
            effects=effects,
            effect_values=tuple(self.entries[f"{e.key}.{p.name}"].value for e in effects for p in e.parameters),
            axis=self.axis,
            restoring_values=tuple(self.entries[name].value for name in self._restoring),
        )

    @property
    def _restoring(self) -> tuple[str, ...]:
        """Names of the parameters of what weight and buoyancy do."""
        return base_names(self.axis)[3:]

    @property
    def effects(self) -> list[str]:
        """Ids of the effects whose parameters are here."""
        return effect_ids(self.entries)

    def changed_sources(self, campaign: Campaign) -> list[str]:
        """Say which logs are not the ones that the parameters were fitted to."""
        known = {source.name: source.sha256 for source in self.sources}
        trials = [(encodable(trial.name), trial.path) for trial in campaign.trials]
        changed = [name for name, where in trials if name in known and sha256(where) != known[name]]
        if not changed:
            return []
        return [f"{', '.join(changed)}: not the same file as when the parameters were fitted."]

    @property
    def output(self) -> Output:
        """The file."""
        return Output(self.path, PARAMETERS)

    def update(self, claim: Claim, change: Callable[[Parameters], Parameters]) -> Parameters:
        """Make ``change`` to what the file holds now, another process' results included; return what was written.

        Raises
        ------
        OutputError
            It cannot be written, or what came to stand there is no parameter file of this axis; it says where the
            result is instead.
        """
        written = self

        def changed() -> str:
            nonlocal written
            written = change(self._as_it_is_now())
            return written.text()

        try:
            claim.write({self.output: changed})
        except ConfigError as error:
            claim.rescue({self.output: change(self).text().encode()}, error)
        return written

    def write(self) -> None:
        """Write the file as it is here, whatever another process wrote.

        Raises
        ------
        OutputError
            It cannot be written, or what stands there is no parameter file.
        """
        Claim([self.output]).write({self.output: self.text()})

    def _as_it_is_now(self) -> Parameters:
        # One that was deleted meanwhile, or replaced where that was asked for, begins with what was read of it.
        if not self.path.exists() or not PARAMETERS.marks(self.path):
            return self
        now = read_parameters(self.path)
        if now.axis is not self.axis:
            raise ConfigError(f"holds the parameters of {now.axis.name} by now.", where=self.path)
        return replace(now, path=self.path)

    def text(self) -> str:
        """The content of the file."""
        import tomli_w

        names = [name for name in base_names(self.axis) if name in self.entries] + [
            name for name in self.entries if "." in name
        ]
        matrix = [[self.covariance.get((a, b), self.covariance.get((b, a), 0.0)) for b in names] for a in names]
        document = {
            "schema": f"{SCHEMA}/{SCHEMA_VERSION}",
            "rovid_version": __version__,
            "written": datetime.now(UTC).replace(microsecond=0),
            "vehicle": self.vehicle,
            **({} if self.axis is YAW else {"axis": self.axis.name}),
            "logs": [_relative(path, self.path.parent) for path in self.logs],
            "parameters": {
                name: {"value": e.value, "standard_error": e.standard_error, "unit": e.unit, "method": e.method}
                for name, e in ((name, self.entries[name]) for name in names)
            },
            "covariance": {"names": names, "matrix": matrix},
            "sources": [{"name": s.name, "sha256": s.sha256, "samples": s.samples} for s in self.sources],
        }
        return tomli_w.dumps(document)


def read_parameters(path: Path) -> Parameters:
    """Read a parameter file.

    Raises
    ------
    ConfigError
        It is missing, not a parameter file, or of a schema newer than this rovid knows.
    """
    refuse_odd(path)
    if not path.is_file():
        raise ConfigError(
            "is a folder, not a parameter file." if path.exists() else "there is no such parameter file.",
            where=path,
            mend="Run `rovid fit-drag LOGS` first, or point to one with -p.",
        )
    document = read_toml(path, mend=_AGAIN if PARAMETERS.marks(path) else _ANOTHER)
    _check_schema(path, document.get("schema"))
    try:
        return _parse(path, document)
    except KeyError as error:
        raise ConfigError(
            f"is damaged: it has no {error.args[0]!r}.",
            where=path,
            mend=_AGAIN,
        ) from error
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise ConfigError(
            f"is damaged: {error}.",
            where=path,
            mend=_AGAIN,
        ) from error


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
    entries = {
        name: Entry(
            value=_number(e["value"], name),
            standard_error=_number_or_nan(e["standard_error"], f"standard_error of {name}"),
            unit=str(e["unit"]),
            method=str(e["method"]),
        )
        for name, e in document["parameters"].items()
    }
    for name, entry in entries.items():
        # Drag may be zero, not negative.
        if (name in base_names(YAW) and not entry.value >= 0.0) or (name == "inertia" and entry.value < SMALLEST):
            raise ValueError(f"{name} is {entry.value:g}, which no vehicle has")
        if entry.standard_error < 0.0:
            raise ValueError(f"standard_error of {name} is {entry.standard_error:g}; zero or more was expected")
    return Parameters(
        path=path,
        vehicle=str(document.get("vehicle", "")),
        axis=axis_named(str(document.get("axis", YAW.name))),
        logs=tuple((path.parent / str(item)).resolve() for item in document["logs"]),
        entries=entries,
        covariance=_covariance(document["covariance"]["names"], document["covariance"]["matrix"], entries),
        sources=tuple(
            Source(name=str(s["name"]), sha256=str(s["sha256"]), samples=_count(s["samples"]))
            for s in document["sources"]
        ),
    )


def _number(value: object, place: str, largest: float = LARGEST) -> float:
    wanted = number_wanted(value, largest=largest)
    if wanted or not isinstance(value, int | float):
        raise ValueError(f"{place} is {value!r}; {wanted} was expected")
    return float(value)


def _number_or_nan(value: object, place: str, largest: float = LARGEST) -> float:
    """As ``_number``; NaN for an error that one reading alone cannot tell."""
    return value if isinstance(value, float) and math.isnan(value) else _number(value, place, largest)


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
    found = written.reshape(len(names), len(names))[np.ix_(known, known)]
    if np.isnan(found).any():
        raise ValueError("a covariance is nan; a number was expected")
    spread = np.sqrt(np.maximum(np.diag(found), 0.0))
    most = np.outer(spread, spread)
    correlation = np.divide(found, most, out=np.zeros_like(found), where=most > 0.0)
    if not np.allclose(correlation, correlation.T, rtol=0.0, atol=_ROUNDING):
        raise ValueError("the covariance is not symmetric")
    if (
        np.any(np.abs(found) > (1.0 + _ROUNDING) * most)
        or np.linalg.eigvalsh(correlation).min(initial=0.0) < -_ROUNDING
    ):
        raise ValueError("the covariance is none: a variance is negative, or parameters go together more than wholly")
    return {(a, b): float(written[i, j]) for i, a in enumerate(names) for j, b in enumerate(names) if i <= j}


def _absolute(paths: Sequence[Path]) -> tuple[Path, ...]:
    return tuple(Path(encodable(str(path.resolve()))) for path in paths)


def sha256(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _source(name: str, path: Path, samples: int) -> Source:
    # A file may be called by bytes that are no text.
    return Source(name=encodable(name), sha256=sha256(path), samples=samples)


def _relative(path: Path, folder: Path) -> str:
    """Relative to the parameter file, so that both can be moved together."""
    try:
        return Path(os.path.relpath(path, folder.resolve())).as_posix()
    except ValueError:  # another drive on Windows
        return path.as_posix()
