"""Makes an export: the subject in a target's format, held against rovid's own motion."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import cast

from rovid.core.array_types import FloatArray
from rovid.core.atomic_write import OutputFile
from rovid.core.errors import ConfigError, suggestion
from rovid.core.signatures import export_mark, export_signature
from rovid.effects import Effect
from rovid.export import ALIASES, FORMATS, uuv
from rovid.export.export_input import ExportInput
from rovid.export.export_result import ExportResult
from rovid.export.resimulation import PERIOD, Mismatch, compare_rates, rovid_rate, verification_commands
from rovid.trial.assumptions import Assumptions

_VISIBLE = 0.1  # % of range; the promise for what a target holds

Exporter = Callable[[ExportInput], ExportResult]


@dataclass(frozen=True, kw_only=True)
class ExportLoss:
    """Something that the target does not hold; percent of the range of the yaw rate that it makes on the manoeuvre."""

    what: str
    why: str
    percent_of_range: float


@dataclass(frozen=True, kw_only=True, eq=False)
class VerifiedExport:
    """A file's content and how far the target is from rovid's model.

    Attributes
    ----------
    mismatch, held
        Against the whole model, and against what of it the target holds.
    """

    content: str | bytes
    mismatch: Mismatch
    kept_mismatch: Mismatch
    losses: tuple[ExportLoss, ...]
    warnings: tuple[str, ...]


# Module of a format whose own name belongs to the standard library.
_MODULES = {"json": "json_format"}


def load_exporter(name: str) -> Exporter:
    """The exporter of one of `rovid.export.FORMATS`."""
    module = import_module(f"rovid.export.{_MODULES.get(name, name.replace('-', '_'))}")
    return cast("Exporter", module.export)


def select_exporter(name: str, path: Path | None) -> tuple[Exporter, OutputFile]:
    """The exporter of this format and the file to write.

    Raises
    ------
    ConfigError
        There is no such format.
    """
    if name not in FORMATS:
        raise ConfigError(f"is {name!r}. {suggestion(name, FORMATS, ALIASES)}", where="FORMAT")
    target = path or Path(FORMATS[name])
    if name == "uuv" and target.suffix in {".yaml", ".yml"}:
        return uuv.export_yaml, OutputFile(target, export_signature("uuv as yaml"))
    return load_exporter(name), OutputFile(target, export_signature(name))


def verified_export(function: Exporter, subject: ExportInput) -> VerifiedExport:
    """Write the subject in a target's format and simulate the target's own equation against rovid's."""
    target = function(subject)
    commands = verification_commands(subject)
    whole = rovid_rate(subject, subject.model, commands)
    held = rovid_rate(subject, subject.with_effects(target.kept_effects), commands)
    theirs = target.simulate(commands, PERIOD)
    of_base = compare_rates(held, theirs)
    missed = [
        ExportLoss(what=what, why=why, percent_of_range=of_base.percent_of_range) for what, why in target.base_losses
    ]
    lost = [effect for effect in subject.model.effects if effect.key not in target.kept_effects]
    notes = [*subject.notes, *target.notes]
    if not target.base_losses and of_base.percent_of_range > _VISIBLE:
        notes.append("What the target holds differs by its coarse integration step: a smaller one brings it nearer.")
    return VerifiedExport(
        content=_marked(target.content, subject.guess),
        mismatch=compare_rates(whole, theirs),
        kept_mismatch=of_base,
        losses=(*missed, *(_loss(subject, effect, commands, whole) for effect in lost)),
        warnings=tuple(notes),
    )


def _marked(content: str | bytes, guess: Assumptions) -> str | bytes:
    """``content`` with a word on what is guessed where it says who wrote it; JSON and MATLAB have their own."""
    if not guess or isinstance(content, bytes):
        return content
    return re.sub(rf"{export_mark('')}[^.\n]*\.", rf"\g<0> {guess.file_notice}", content, count=1)


def _loss(subject: ExportInput, effect: Effect, commands: FloatArray, whole: FloatArray) -> ExportLoss:
    rest = subject.with_effects(frozenset(subject.effects) - {effect.key})
    percent = compare_rates(whole, rovid_rate(subject, rest, commands)).percent_of_range
    why = f"the format has nothing for {effect.title} ({effect.equation})"
    if effect.is_wave or effect.needs:
        percent = math.nan
        cause = " and ".join(effect.needs) or "a random phase"
        why += f"; the manoeuvre does not show it, for it depends on {cause}"
    return ExportLoss(what=effect.key, why=why, percent_of_range=percent)
