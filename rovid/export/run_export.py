"""One export: the file, its verification by re-simulation, and what the format leaves out, for both models."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, suggestion
from rovid.core.output_files import OutputFile, export_mark, export_signature
from rovid.export import ALIASES, FORMATS
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.planar_input import PlanarExportResult, PlanarInput, rovid_motion, verification_shares
from rovid.export.resimulation import Mismatch, compare_rates, rovid_rate, verification_commands
from rovid.export.stability import Stability, judge_stability, judge_yaw
from rovid.export.thruster_curves import TrimShare, constant_trim
from rovid.planar.model import PlanarModel
from rovid.trial.assumptions import Assumptions

# % of range, promised limit of the mismatch of what a file represents.
_VISIBLE = 0.1

Exporter = Callable[[ExportInput], ExportResult]


@dataclass(frozen=True, kw_only=True)
class ExportLoss:
    """Part of the model that a file cannot represent, with its effect on the yaw rate in percent of the range."""

    what: str
    why: str
    percent_of_range: float


@dataclass(frozen=True, kw_only=True, eq=False)
class VerifiedExport:
    """Content of a file, with its mismatch against rovid's model.

    ``mismatch`` is against the whole model, ``kept_mismatch`` against the part that the file represents.
    """

    content: str | bytes
    mismatch: Mismatch
    kept_mismatch: Mismatch
    losses: tuple[ExportLoss, ...]
    stability: Stability
    warnings: tuple[str, ...]
    trim: tuple[TrimShare, ...] = ()  #: Cancels the constant torque of the model.


def load_exporter(name: str, suffix: str = "") -> Exporter:
    """Exporter of one of `rovid.export.FORMATS`, for a file with this ``suffix``."""
    form = FORMATS[name]
    module = import_module(f"rovid.export.{form.module}")
    return cast("Exporter", getattr(module, form.other.get(suffix, form.function)))


def require_format(name: str) -> None:
    """Refuse a ``name`` that no format has."""
    if name not in FORMATS:
        raise ConfigError(f"is {name!r}. {suggestion(name, FORMATS, ALIASES)}", where="FORMAT")


def select_exporter(name: str, path: Path | None) -> tuple[Exporter, OutputFile]:
    """Exporter of the format ``name``, and the file to write. Raises ConfigError if there is no such format."""
    require_format(name)
    target = path or Path(FORMATS[name].file)
    return load_exporter(name, target.suffix), OutputFile(target, export_signature(name))


def with_notice(content: str | bytes, guess: Assumptions) -> str | bytes:
    """``content`` with a notice of guessed values; JSON and MATLAB files have their own."""
    if not guess or isinstance(content, bytes):
        return content
    # The notice follows the mark of the author.
    return re.sub(rf"{export_mark('')}[^.\n]*\.", rf"\g<0> {guess.file_notice}", content, count=1)


def verified_export(exporter: Exporter, subject: ExportInput) -> VerifiedExport:
    """Export ``subject``, and compare the simulator's equation with rovid's on the verification commands."""
    result = exporter(subject)
    commands = verification_commands(subject)
    whole = rovid_rate(subject, subject.model, commands)
    kept = rovid_rate(subject, subject.with_effects(result.kept_effects), commands)
    theirs = np.full(len(commands), np.nan) if result.simulate is None else result.simulate(commands)
    kept_mismatch = compare_rates(kept, theirs)
    losses = []
    for what, why in result.base_losses:
        percent = kept_mismatch.percent_of_range
        if result.simulate is None:
            without: dict[str, Any] = {what: 0.0}
            bare = replace(subject.model, **without)
            percent = compare_rates(whole, rovid_rate(subject, bare, commands)).percent_of_range
        losses.append(ExportLoss(what=what, why=why, percent_of_range=percent))
    for effect in subject.model.effects:
        if effect.key in result.kept_effects:
            continue
        others = subject.with_effects(frozenset(subject.effects) - {effect.key})
        percent = compare_rates(whole, rovid_rate(subject, others, commands)).percent_of_range
        why = f"the format has nothing for {effect.title} ({effect.equation})"
        if effect.is_wave or effect.needs:
            percent = math.nan
            cause = " and ".join(effect.needs) or "a random phase"
            why += f"; the verification does not show its size, because it depends on {cause}"
        losses.append(ExportLoss(what=effect.key, why=why, percent_of_range=percent))
    notes, trim = [*subject.notes, *result.notes], constant_trim(subject)
    if trim:
        parts = [f"{one.thruster} by {one.text}" for one in trim]
        torque = subject.value("bias_torque", "torque")
        notes.append(f"A constant torque of {torque:.3g} N m acts. A trim of {' and '.join(parts)} cancels it.")
    if not result.base_losses and kept_mismatch.percent_of_range > _VISIBLE:
        notes.append("The rest of the mismatch is due to the coarse integration step: a smaller step reduces it.")
    return VerifiedExport(
        content=with_notice(result.content, subject.guess),
        mismatch=compare_rates(whole, theirs),
        kept_mismatch=kept_mismatch,
        losses=tuple(losses),
        stability=judge_yaw(result.equation, subject.largest_rate),
        trim=tuple(trim),
        warnings=tuple(notes),
    )


# Names of the velocities in messages and JSON, and their units.
VELOCITIES = {"surge_velocity": "m/s", "sway_velocity": "m/s", "yaw_rate": "rad/s"}
# Least range of a velocity in percentages, as a share of the envelope of the logs.
_LEAST_RANGE = 0.05

PlanarExporter = Callable[[PlanarInput], PlanarExportResult]


@dataclass(frozen=True, kw_only=True)
class PlanarMismatch:
    """Difference between the velocities of a simulator and of rovid, by the names of `VELOCITIES`."""

    percent_of_range: Mapping[str, float]  #: Largest difference relative to the range of rovid's.
    rms: Mapping[str, float]  #: m/s and rad/s.

    @property
    def largest(self) -> float:
        """Largest percentage."""
        return max(self.percent_of_range.values())


@dataclass(frozen=True, kw_only=True)
class PlanarLoss:
    """Part of the model that a file cannot represent, with its effect on each velocity in percent of the range."""

    what: str
    why: str
    percent_of_range: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class VerifiedPlanarExport:
    """Content of a file with its mismatch against rovid's model: the whole, and the part that the file represents."""

    content: str | bytes
    mismatch: PlanarMismatch
    kept_mismatch: PlanarMismatch
    losses: tuple[PlanarLoss, ...]
    stability: Stability
    warnings: tuple[str, ...]


def select_planar_exporter(name: str, path: Path | None) -> tuple[PlanarExporter, OutputFile]:
    """Exporter of the format ``name`` for the coupled model, and the file to write.

    Raises ConfigError if there is no such format, or it cannot hold the coupled model.
    """
    require_format(name)
    planar = FORMATS[name].planar
    if planar is None:
        raise ConfigError(
            f"is {name!r}, which cannot hold surge, sway and yaw together.",
            where="FORMAT",
            mend=f"Give one of {', '.join(one for one, form in FORMATS.items() if form.planar)}.",
        )
    module, function = planar
    exporter = cast("PlanarExporter", getattr(import_module(f"rovid.export.{module}"), function))
    return exporter, OutputFile(path or Path(FORMATS[name].file), export_signature(name))


def verified_planar_export(exporter: PlanarExporter, subject: PlanarInput) -> VerifiedPlanarExport:
    """Export ``subject``, compare the simulator's equation with rovid's, and judge its stability."""
    result = exporter(subject)
    commands = subject.commands_at(verification_shares(subject))
    whole = rovid_motion(subject, subject.model, commands)
    kept_model, kept_commands = subject.with_effects(result.kept_effects), commands
    losses = []

    def lose(what: str, why: str, other: FloatArray) -> None:
        percent = compare_motions(subject, whole, other).percent_of_range
        losses.append(PlanarLoss(what=what, why=why, percent_of_range=percent))

    for one in subject.model.effects:
        if one.effect.key not in result.kept_effects:
            others = subject.with_effects(frozenset(subject.effects) - {one.effect.key})
            why = f"the format has nothing for {one.effect.title} ({one.effect.equation})"
            lose(one.effect.key, why, rovid_motion(subject, others, commands))
    if not result.keeps_angles:
        for column, actuator in enumerate(subject.vehicle.thrusters):
            if not actuator.is_angle:
                continue
            kept_commands = kept_commands.copy()
            kept_commands[:, column] = 0.0
            without, straight = subject.model, commands.copy()
            straight[:, column] = 0.0
            if actuator.rudder is not None:
                own = f"rudder.{actuator.name}.lift"
                without = _without(without, own)
                kept_model = _without(kept_model, own)
            what = "rudder" if actuator.rudder is not None else "azimuth angle"
            lose(actuator.name, f"the file has no {what}", rovid_motion(subject, without, straight))
    theirs = result.simulate(commands)
    kept_mismatch = compare_motions(subject, rovid_motion(subject, kept_model, kept_commands), theirs)
    for what, why in result.base_losses:
        losses.append(PlanarLoss(what=what, why=why, percent_of_range=kept_mismatch.percent_of_range))
    return VerifiedPlanarExport(
        content=with_notice(result.content, subject.guess),
        mismatch=compare_motions(subject, whole, theirs),
        kept_mismatch=kept_mismatch,
        losses=tuple(losses),
        stability=judge_stability(result.equation, subject.envelope),
        warnings=(*subject.notes, *result.notes),
    )


def _without(model: PlanarModel, name: str) -> PlanarModel:
    return model.with_values(np.where(np.array(model.names) == name, 0.0, model.values))


def compare_motions(subject: PlanarInput, rovid: FloatArray, other: FloatArray) -> PlanarMismatch:
    """Mismatch of the (n, 4) motion ``other``: heading, and the velocities that are compared."""
    percents, sizes = {}, {}
    for axis, name in enumerate(VELOCITIES, start=1):
        error = np.abs(other[:, axis] - rovid[:, axis])
        span = max(float(np.ptp(rovid[:, axis])), _LEAST_RANGE * float(subject.envelope[axis - 1]), 1e-12)
        percents[name] = 100.0 * float(np.max(error)) / span if np.all(np.isfinite(error)) else float("inf")
        # The square of an unstable solution would overflow.
        scale = float(np.max(error)) or 1.0
        sizes[name] = scale * float(np.sqrt(np.mean((error / scale) ** 2))) if np.isfinite(scale) else float("inf")
    return PlanarMismatch(percent_of_range=percents, rms=sizes)
