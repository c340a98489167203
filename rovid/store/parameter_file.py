"""The parameter file: values, units, standard errors, covariance, and the logs they came from."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import lru_cache
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any

import numpy as np

from rovid import __version__
from rovid.core.atomic_write import OutputFile, OutputSet
from rovid.core.errors import ConfigError
from rovid.core.escaping import encodable
from rovid.core.signatures import PARAMETERS
from rovid.effects import effect_named
from rovid.effects.base import Effect
from rovid.estimate.estimate import PER_INERTIA, Estimate
from rovid.model.model import Model
from rovid.model.parameter_names import base_names, effect_ids
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW, Axis
from rovid.trial.config_fingerprint import ConfigFingerprint

# 1/s; no motion dies out faster, and none could be followed that did.
_FASTEST = 1e3
SCHEMA = "rovid-parameters"
SCHEMA_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One parameter: its value, standard error, unit, and how it was found: the method, and options that were given."""

    value: float
    standard_error: float
    unit: str
    method: str
    options: str = ""


@dataclass(frozen=True, kw_only=True)
class Source:
    """One log the parameters rest on; a file of rovid 0.2 does not say where it is."""

    name: str
    sha256: str
    samples: int
    path: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """What an estimate comes of: LOGS as given, absolute; the logs in them; what of rovid.toml and which options."""

    logs: tuple[Path, ...]
    vehicle: str
    sources: tuple[Source, ...]
    settings: ConfigFingerprint
    options: str = ""


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
    settings
        What of rovid.toml all of them rest on; None where that is not known, as of a file of rovid 0.2.
    """

    path: Path
    vehicle: str = ""
    logs: tuple[Path, ...] = ()
    entries: Mapping[str, Entry] = field(default_factory=dict)
    covariance: Mapping[tuple[str, str], float] = field(default_factory=dict)
    sources: tuple[Source, ...] = ()
    axis: Axis = YAW
    settings: ConfigFingerprint | None = None

    def cleared(self) -> Parameters:
        """The same file without parameters; which logs it remembers stays."""
        return replace(self, entries={}, covariance={}, sources=(), settings=None)

    def with_estimate(self, estimate: Estimate, origin: Provenance | None = None) -> Parameters:
        """The same with the parameters of ``estimate`` put in or replaced; they come of ``origin``, if one is told."""
        found = self._with(estimate, "" if origin is None else origin.options)
        if origin is None:
            return found
        others = found.entries.keys() - set(estimate.names)
        unknown = others and self.settings is None
        kept = self.sources if others else ()
        sources = {(source.name, source.path): source for source in (*kept, *origin.sources)}
        return replace(
            found,
            vehicle=origin.vehicle,
            logs=origin.logs,
            sources=tuple(sources.values()),
            settings=None if unknown else origin.settings,
        )

    def _with(self, estimate: Estimate, options: str) -> Parameters:
        stale = set(estimate.names)
        covariance = {pair: value for pair, value in self.covariance.items() if stale.isdisjoint(pair)}
        # Effects belong to the fit that found them: another fit of the inertia does without, or finds them anew.
        if "inertia" in estimate.names:
            stale.update(filter(_of_an_effect, self.entries))
        entries = {name: entry for name, entry in self.entries.items() if name not in stale}
        entries |= _entries(estimate, options)
        covariance |= _covariance(estimate)
        return replace(self, entries=entries, covariance=covariance)

    def entries_for(self, paths: Sequence[Path]) -> Mapping[str, Entry]:
        """What methods said of the logs at ``paths``; nothing where the file rests on others."""
        if self.logs == absolute_paths(paths):
            return self.entries
        return {}

    def independent_drag(self) -> Estimate | None:
        """Quadratic and linear drag from elsewhere than the inertia; a refused linear drag is zero.

        None where there is no drag, or where it was found together with the inertia: it cannot judge that inertia, and
        a second `rovid fit-inertia` has to give what the first gave.
        """
        names = ("quadratic_drag", "linear_drag")
        quadratic, linear = map(self.entries.get, names)
        together = self.covariance.get(("inertia", "quadratic_drag"), 0.0) != 0.0
        if quadratic is None or together or self.per_inertia:
            return None
        return Estimate(
            names=names,
            values=np.array([quadratic.value, _value(linear)]),
            covariance=np.array(self._matrix(names)),
            method=quadratic.method,
            samples=0,
            axis=self.axis,
        )

    def base_estimate(self) -> Estimate:
        """Inertia, drag and what weight does, as far as they are here, whatever found them."""
        return self.estimate([name for name in base_names(self.axis) if name in self.entries])

    def estimate(self, names: Sequence[str]) -> Estimate:
        """The entries of these ``names``, whatever found them."""
        names = tuple(names)
        return Estimate(
            names=names,
            values=np.array([self.entries[name].value for name in names]),
            covariance=np.array(self._matrix(names)).reshape(len(names), len(names)),
            method="; ".join(dict.fromkeys(self.entries[name].method for name in names)),
            samples=0,
            axis=self.axis,
            assumptions=Assumptions() if self.settings is None else self.settings.assumptions,
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
        quadratic_drag = self._needed("quadratic_drag", "Run `rovid fit-drag LOGS` first.")
        inertia = 1.0
        if not self.per_inertia:
            inertia = self._needed("inertia", "Run `rovid fit-inertia` first.")
        linear_drag = _value(self.entries.get("linear_drag"))
        effects = tuple(map(effect_named, self.effects))
        # Behind the inertia and the two drags stands what weight and buoyancy do.
        righting = base_names(self.axis)[3:]
        restoring = [self._needed(name, "Run `rovid fit-inertia LOGS` first.") for name in righting]
        effect_values: list[float] = []
        for effect in effects:
            effect_values += self._effect_values(effect)
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
            effect_values=tuple(effect_values),
            axis=self.axis,
            restoring_values=tuple(restoring),
        )

    def _needed(self, name: str, mend: str) -> float:
        """The value of a parameter without which there is no model."""
        if name not in self.entries:
            raise ConfigError(f"holds no {name}.", where=self.path, mend=mend)
        return self.entries[name].value

    def _effect_values(self, effect: Effect) -> list[float]:
        mend = f"Run `rovid fit --effect {effect.key}`, or delete what is left of the effect."
        return [self._needed(f"{effect.key}.{parameter.name}", mend) for parameter in effect.parameters]

    def _matrix(self, names: Sequence[str]) -> list[list[float]]:
        """Covariance of ``names`` with each other."""
        return [[self._covariance_of(first, second) for second in names] for first in names]

    def _covariance_of(self, first: str, second: str) -> float:
        if (first, second) in self.covariance:
            return self.covariance[first, second]
        return self.covariance.get((second, first), 0.0)

    @property
    def effects(self) -> list[str]:
        """Ids of the effects whose parameters are here."""
        return effect_ids(self.entries)

    def _written(self, entry: Entry) -> dict[str, Any]:
        """One parameter for the file; whoever looks at it alone learns there that it is a placeholder."""
        marked = self.settings is not None and self.settings.assumptions.is_placeholder(entry.unit)
        written = asdict(entry) | ({"placeholder": True} if marked else {})
        return {key: value for key, value in written.items() if key != "options" or value}

    @property
    def output(self) -> OutputFile:
        """The file."""
        return OutputFile(self.path, PARAMETERS)

    def write(self) -> None:
        """Write the file as it is here, whatever another process wrote.

        Raises
        ------
        OutputError
            It cannot be written, or what stands there is no parameter file.
        """
        OutputSet([self.output]).write({self.output: self.text()})

    def text(self) -> str:
        """The content of the file."""
        import tomli_w

        return tomli_w.dumps(self.document())

    def document(self) -> dict[str, Any]:
        """What the file says, as TOML has it."""
        names = [name for name in base_names(self.axis) if name in self.entries]
        names += filter(_of_an_effect, self.entries)
        axis = {} if self.axis is YAW else {"axis": self.axis.name}
        return {
            "schema": f"{SCHEMA}/{SCHEMA_VERSION}",
            "rovid_version": __version__,
            "written": datetime.now(UTC).replace(microsecond=0),
            "vehicle": self.vehicle,
            **axis,
            "logs": [_relative(path, self.path.parent) for path in self.logs],
            "parameters": {name: self._written(self.entries[name]) for name in names},
            "covariance": {"names": names, "matrix": self._matrix(names)},
            **({} if self.settings is None else {"rests_on": asdict(self.settings)}),
            "sources": [_written(source, self.path.parent) for source in self.sources],
        }


def _of_an_effect(name: str) -> bool:
    return "." in name


def _value(entry: Entry | None) -> float:
    if entry is None:
        return 0.0
    return entry.value


def _entries(estimate: Estimate, options: str) -> dict[str, Entry]:
    """What an estimate says, but for what it refuses to say."""
    entries = {}
    for name in estimate.names:
        if name not in estimate.refused:
            entries[name] = Entry(
                value=estimate.value(name),
                standard_error=estimate.standard_error(name),
                unit=estimate.unit(name),
                method=estimate.method,
                options=options,
            )
    return entries


def _covariance(estimate: Estimate) -> dict[tuple[str, str], float]:
    """Each pair once, the one that is named first in front."""
    known = [(k, name) for k, name in enumerate(estimate.names) if name not in estimate.refused]
    pairs = combinations_with_replacement(known, 2)
    return {(first, second): float(estimate.covariance[i, j]) for (i, first), (j, second) in pairs}


def _written(source: Source, folder: Path) -> dict[str, Any]:
    place = {} if source.path is None else {"path": _relative(source.path, folder)}
    return {"name": source.name, "sha256": source.sha256, "samples": source.samples, **place}


def absolute_paths(paths: Sequence[Path]) -> tuple[Path, ...]:
    """``paths`` from the root, as text that a file can hold."""
    return tuple(Path(encodable(str(path.resolve()))) for path in paths)


def sha256(path: Path) -> str:
    """SHA-256 of a file, in hexadecimal; read again where its size, or when it was written, is another."""
    found = path.stat()
    return _sha256(path, found.st_size, found.st_mtime_ns)


@lru_cache(maxsize=4096)
def _sha256(path: Path, _size: int, _written: int) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def read_source(name: str, path: Path, samples: int) -> Source:
    """The log at ``path``, by its digest."""
    # A file may be called by bytes that are no text, and then cannot be found by what is written of it.
    (place,) = absolute_paths([path])
    return Source(name=encodable(name), sha256=sha256(path), samples=samples, path=place if place.exists() else None)


def _relative(path: Path, folder: Path) -> str:
    """Relative to the parameter file, so that both can be moved together."""
    try:
        return Path(os.path.relpath(path, folder.resolve())).as_posix()
    except ValueError:  # another drive on Windows
        return path.as_posix()
