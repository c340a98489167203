"""Select an exporter, run it, and verify its result by re-simulation."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any, cast

import numpy as np

from rovid.core.errors import ConfigError, suggestion
from rovid.core.output_files import OutputFile, export_mark, export_signature
from rovid.export import ALIASES, FORMATS
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.resimulation import Mismatch, compare_rates, rovid_rate, verification_commands
from rovid.export.stability import Stability, judge_yaw
from rovid.export.thruster_curves import TrimShare, constant_trim
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
    """Exporter of the format ``name``, and the file to write.

    Raises
    ------
    ConfigError
        There is no such format.
    """
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
