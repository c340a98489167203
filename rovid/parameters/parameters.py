"""The parameter file: values, units, standard errors, covariance, and the logs they came from."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from rovid import __version__
from rovid.campaign.axis import YAW, Axis
from rovid.campaign.trial import Campaign
from rovid.effects import effect_named
from rovid.ground.errors import ConfigError
from rovid.ground.files import Claim, Output
from rovid.ground.files.form import PARAMETERS
from rovid.ground.quoting import encodable
from rovid.identify.estimate import PER_INERTIA, Estimate
from rovid.model.model import Model
from rovid.model.names import base_names, effect_ids

# 1/s; no motion dies out faster, and none could be followed that did.
_FASTEST = 1e3
SCHEMA = "rovid-parameters"
SCHEMA_VERSION = 1


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

    def write(self) -> None:
        """Write the file as it is here, whatever another process wrote.

        Raises
        ------
        OutputError
            It cannot be written, or what stands there is no parameter file.
        """
        Claim([self.output]).write({self.output: self.text()})

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
