"""The parameter file: values, units, standard errors, covariance, and the logs they came from."""

import hashlib
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from functools import lru_cache
from itertools import combinations_with_replacement
from pathlib import Path
from typing import Any, Self

import numpy as np

from rovid import __version__
from rovid.core.errors import ConfigError
from rovid.core.formatting import encodable
from rovid.core.input_files import file_parts
from rovid.core.output_files import PARAMETERS, OutputFile, OutputSet
from rovid.effects import Effect, effect_named
from rovid.effects.base import Scales
from rovid.effects.plugins import Origin, origin, require_origins
from rovid.estimate.estimate import PER_INERTIA, Estimate
from rovid.model.model import Model
from rovid.model.parameter_names import base_names, effect_ids
from rovid.trial.assumptions import Assumptions, ConfigFingerprint
from rovid.trial.axis import PLANAR, YAW, Axis
from rovid.trial.trial import NO_FILE, Trial

# Largest decay rate of a motion in 1/s; faster decay is implausible and could not be integrated. A decision.
_FASTEST = 1e3
SCHEMA = "rovid-parameters"
SCHEMA_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One parameter with the method and the options of its fit."""

    value: float
    standard_error: float
    unit: str
    method: str
    options: str = ""
    from_prior: bool = False  #: Whether a prior decided the value, and not the logs.


@dataclass(frozen=True, kw_only=True)
class OpenCombination:
    """A combination of parameters that the logs of a coupled fit do not determine."""

    combination: Mapping[str, float]  #: Parameter -> its share, relative to the largest.
    text: str  #: A sentence for people.


@dataclass(frozen=True, kw_only=True)
class Source:
    """A log that the parameters were fitted to; files of rovid 0.2 hold no path."""

    name: str
    sha256: str
    samples: int
    path: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Origin of an estimate: the absolute paths of LOGS, the logs in them, settings of rovid.toml and options."""

    logs: tuple[Path, ...]
    vehicle: str
    sources: tuple[Source, ...]
    settings: ConfigFingerprint
    options: str = ""


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """The content of a parameter file."""

    path: Path  #: Path of the file, which may not exist yet.
    vehicle: str = ""
    logs: tuple[Path, ...] = ()  #: Absolute paths of the LOGS that the user gave.
    entries: Mapping[str, Entry] = field(default_factory=dict)
    #: (first, second) -> covariance of two parameters, in the product of their units. Pairs from different methods are
    #: absent: they are treated as uncorrelated.
    covariance: Mapping[tuple[str, str], float] = field(default_factory=dict)
    sources: tuple[Source, ...] = ()
    axis: Axis = YAW
    #: Fingerprint of the rovid.toml of the fits; None if unknown, as in a file of rovid 0.2.
    settings: ConfigFingerprint | None = None
    #: ``undetermined``, ``assumed``: of the coupled model, what the logs do not determine; and the values of the
    #: parameters in it that a simulation uses, which the logs neither support nor contradict.
    undetermined: tuple[OpenCombination, ...] = ()
    assumed: Mapping[str, float] = field(default_factory=dict)
    missing: str = ""  #: Clause on what the coupled model misses; empty where it explains the logs.
    #: Id of each effect outside the catalogue -> the plug-in that its values were fitted with.
    plugins: Mapping[str, Origin] = field(default_factory=dict)

    def cleared(self) -> Self:
        """A copy without parameters; the paths of the logs stay."""
        return replace(
            self, entries={}, covariance={}, sources=(), settings=None, undetermined=(), assumed={}, missing=""
        )

    def with_estimate(self, estimate: Estimate, provenance: Provenance | None = None) -> Self:
        """A copy with the parameters of ``estimate`` added or replaced."""
        replaced = set(estimate.names)
        if self.axis is PLANAR:  # All parameters of the coupled model come from one fit.
            replaced.update(self.entries)
        covariance = {pair: value for pair, value in self.covariance.items() if replaced.isdisjoint(pair)}
        # Effects belong to the fit that found them: another fit of the inertia removes them or fits them again.
        if "inertia" in estimate.names:
            replaced.update(filter(_is_of_effect, self.entries))
        kept = {name: entry for name, entry in self.entries.items() if name not in replaced}
        entries = kept | {
            name: Entry(
                value=estimate.value(name),
                standard_error=estimate.standard_error(name),
                unit=estimate.unit(name),
                method=estimate.method,
                options="" if provenance is None else provenance.options,
                from_prior=name in estimate.from_prior,
            )
            for name in estimate.names
            if name not in estimate.refused
        }
        ids = {key.partition(":")[0] for key in effect_ids(estimate.names)}
        plugins = {**self.plugins, **{name: found for name in ids if (found := origin(name))}}
        known = [(k, name) for k, name in enumerate(estimate.names) if name not in estimate.refused]
        pairs = combinations_with_replacement(known, 2)
        covariance |= {(first, second): float(estimate.covariance[i, j]) for (i, first), (j, second) in pairs}
        updated = replace(self, entries=entries, covariance=covariance, plugins=plugins)
        if provenance is None:
            return updated
        others = entries.keys() - set(estimate.names)
        sources = {(one.name, one.path): one for one in (*(self.sources if others else ()), *provenance.sources)}
        return replace(
            updated,
            vehicle=provenance.vehicle,
            logs=provenance.logs,
            sources=tuple(sources.values()),
            settings=None if others and self.settings is None else provenance.settings,
        )

    def entries_for(self, paths: Sequence[Path]) -> Mapping[str, Entry]:
        """The parameters if they were fitted to the logs at ``paths``; else none."""
        return self.entries if self.logs == absolute_paths(paths) else {}

    def independent_drag(self) -> Estimate | None:
        """Quadratic and linear drag that were fitted without the inertia; a refused linear drag is zero.

        None if there is no drag, or if it was fitted together with the inertia: such drag is not independent of the
        inertia, and a second `rovid fit-inertia` has to repeat the first result.
        """
        names = ("quadratic_drag", "linear_drag")
        quadratic, linear = map(self.entries.get, names)
        together = self.covariance.get(("inertia", "quadratic_drag"), 0.0) != 0.0
        if quadratic is None or together or self.per_inertia:
            return None
        return Estimate(
            names=names,
            values=np.array([quadratic.value, 0.0 if linear is None else linear.value]),
            covariance=np.array(self._matrix(names)),
            method=quadratic.method,
            samples=0,
            axis=self.axis,
        )

    def base_estimate(self) -> Estimate:
        """Inertia, drag and restoring terms, from any method."""
        return self.estimate([name for name in base_names(self.axis) if name in self.entries])

    def estimate(self, names: Sequence[str]) -> Estimate:
        """The parameters of these ``names``, from any method."""
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
        """Whether the inertia is unknown and all parameters are per unit inertia."""
        entry = self.entries.get("quadratic_drag")
        return entry is not None and entry.unit.endswith(PER_INERTIA)

    def model(self) -> Model:
        """The model. Raises ConfigError if a parameter of it is missing, or the drag is implausibly large."""
        quadratic_drag = self._needed("quadratic_drag", "Run `rovid fit-drag LOGS` first.")
        inertia = 1.0 if self.per_inertia else self._needed("inertia", "Run `rovid fit-inertia` first.")
        linear_drag = self.entries["linear_drag"].value if "linear_drag" in self.entries else 0.0
        effects = self.effect_forms()
        # The first three names are the inertia and the two drags; the others are restoring terms.
        restoring = [self._needed(name, "Run `rovid fit-inertia LOGS` first.") for name in base_names(self.axis)[3:]]
        effect_values = []
        for effect in effects:
            mend = f"Run `rovid fit --effect {effect.key}`, or delete the other entries of the effect."
            effect_values += [self._needed(f"{effect.key}.{parameter.name}", mend) for parameter in effect.parameters]
        if quadratic_drag + linear_drag > _FASTEST * inertia:
            text = f"quadratic drag {quadratic_drag:.3g} and linear drag {linear_drag:.3g} stop a motion at 1 "
            text += f"{self.axis.rate_unit} with inertia {inertia:.3g} within {1.0 / _FASTEST} s, which is implausible."
            raise ConfigError(text, where=self.path, mend="Look for a wrong digit, or fit the parameters again.")
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
        """The value of a parameter that the model requires."""
        if name not in self.entries:
            raise ConfigError(f"holds no {name}.", where=self.path, mend=mend)
        return self.entries[name].value

    def _matrix(self, names: Sequence[str]) -> list[list[float]]:
        """Covariance of ``names`` with each other."""
        both = {(second, first): value for (first, second), value in self.covariance.items()} | {**self.covariance}
        return [[both.get((first, second), 0.0) for second in names] for first in names]

    @property
    def effects(self) -> list[str]:
        """Ids of the effects whose parameters are here, with those that the logs do not determine."""
        return effect_ids([*self.entries, *self.assumed])

    def effect_forms(self) -> tuple[Effect, ...]:
        """Effects in the file.

        Raises ConfigError if one is unknown, its plug-in missing or in another version, or a value beyond its bounds.
        """
        require_origins(self._plugins_in_use(), self.path)
        return self.with_possible_values(map(effect_named, self.effects))

    def with_possible_values(self, effects: Iterable[Effect]) -> tuple[Effect, ...]:
        """The ``effects`` in the file. Raises ConfigError if a value of one is not possible."""
        checked = tuple(effects)
        for effect, text in self.values_beyond_bounds(checked):
            mend = f"Look for a wrong digit, or fit again: `rovid fit --effect {effect}`."
            raise ConfigError(f"{text} was expected.", where=self.path, mend=mend)
        return checked

    def values_beyond_bounds(
        self, effects: Iterable[Effect], scales: Scales | None = None
    ) -> Iterator[tuple[str, str]]:
        """Effect, and value with its bounds, of each parameter beyond its `EffectParameter.bounds`."""
        values = {name: entry.value for name, entry in self.entries.items()} | dict(self.assumed)
        for effect in effects:
            for name, parameter in zip(effect.parameter_names, effect.parameters, strict=True):
                low, high = parameter.bounds(scales)
                if name not in values or low <= values[name] <= high:
                    continue
                least = "zero or more" if low == 0.0 else "a positive number"
                wanted = least if math.isinf(high) else f"{low:.4g} to {high:.4g}"
                found = f"{values[name]:.6g} {parameter.unit}".removesuffix(" 1")
                yield effect.key, f"{name} is {found}; {wanted}"

    def unusual_values(self, effects: Iterable[Effect], scales: Scales) -> list[str]:
        """A sentence for each value far beyond its bounds for logs of these ``scales``."""
        return [f"{text} is usual for these logs." for _, text in self.values_beyond_bounds(effects, scales)]

    def _plugins_in_use(self) -> dict[str, Origin]:
        ids = {key.partition(":")[0] for key in self.effects}
        return {name: one for name, one in self.plugins.items() if name in ids}

    def _written(self, entry: Entry) -> dict[str, Any]:
        """One parameter for the file, marked if it is a placeholder or from a prior."""
        optional = {"options", "from_prior"}
        written: dict[str, Any] = {key: value for key, value in asdict(entry).items() if value or key not in optional}
        if self.settings is not None and self.settings.assumptions.is_placeholder(entry.unit):
            written["placeholder"] = True
        return written

    @property
    def output(self) -> OutputFile:
        """The output file."""
        return OutputFile(self.path, PARAMETERS)

    def write(self) -> None:
        """Replace the file. Raises OutputError if it cannot be written, or is no parameter file."""
        OutputSet([self.output]).write({self.output: self.text()})

    def text(self) -> str:
        """The content of the file."""
        import tomli_w

        return tomli_w.dumps(self.document())

    def document(self) -> dict[str, Any]:
        """The content as a TOML document."""
        names = [name for name in base_names(self.axis) if name in self.entries]
        names += filter(_is_of_effect, self.entries)
        sources = []
        for one in self.sources:
            place = {} if one.path is None else {"path": _relative(one.path, self.path.parent)}
            sources.append({"name": one.name, "sha256": one.sha256, "samples": one.samples, **place})
        document = {
            "schema": f"{SCHEMA}/{SCHEMA_VERSION}",
            "rovid_version": __version__,
            "written": datetime.now(UTC).replace(microsecond=0),
            "vehicle": self.vehicle,
            "axis": "" if self.axis is YAW else self.axis.name,
            "logs": [_relative(path, self.path.parent) for path in self.logs],
            "missing": self.missing,
            "parameters": {name: self._written(self.entries[name]) for name in names},
            "assumed": dict(self.assumed),
            "undetermined": list(map(asdict, self.undetermined)),
            "covariance": {"names": names, "matrix": self._matrix(names)},
            "plugins": {name: asdict(one) for name, one in self._plugins_in_use().items()},
            "rests_on": self.settings and asdict(self.settings),
            "sources": sources,
        }
        optional = {"axis", "missing", "assumed", "undetermined", "plugins", "rests_on"}
        return {key: value for key, value in document.items() if value or key not in optional}


def _is_of_effect(name: str) -> bool:
    return "." in name


def absolute_paths(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Absolute ``paths``."""
    return tuple(path.resolve() for path in paths)


def sha256(path: Path) -> str:
    """Hexadecimal SHA-256 of a file with its write-ahead log; cached by path, size and modification time."""
    parts = tuple(file_parts(path))
    return _sha256(parts, tuple((part.stat().st_size, part.stat().st_mtime_ns) for part in parts))


@lru_cache(maxsize=4096)
def _sha256(parts: tuple[Path, ...], _versions: tuple[tuple[int, int], ...]) -> str:
    digest = hashlib.sha256()
    for part in parts:
        with part.open("rb") as stream:
            hashlib.file_digest(stream, lambda: digest)
    return digest.hexdigest()


def read_source(name: str, path: Path, samples: int) -> Source:
    """The log at ``path`` with its digest."""
    return Source(name=encodable(name), sha256=sha256(path), samples=samples, path=path.resolve())


def trial_source(trial: Trial) -> Source:
    """The file of ``trial`` with its digest; for data that were never in a file the digest of the arrays."""
    samples = int(trial.measured.sum())
    if trial.path != NO_FILE:
        return read_source(trial.name, trial.path, samples)
    arrays = b"".join(map(bytes, (trial.time, trial.position, trial.commands)))
    return Source(name=trial.name, sha256=hashlib.sha256(arrays).hexdigest(), samples=samples)


def _relative(path: Path, folder: Path) -> str:
    """Path relative to the parameter file, because both may be moved together; bytes that are no text are escaped."""
    with suppress(ValueError):  # another drive on Windows
        path = Path(os.path.relpath(path, folder.resolve()))
    return encodable(path.as_posix())
