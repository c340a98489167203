"""Makes an export: the subject from a parameter file, its file in a target's format, and the check by re-simulation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import cast

import numpy as np

from rovid.campaign.vehicle import Thruster, Vehicle
from rovid.effects import Effect
from rovid.export import FORMATS, uuv
from rovid.export.base import Subject, Target
from rovid.export.manoeuvre import PERIOD, Mismatch, compare, manoeuvre, rovid_rate
from rovid.ground.arrays import FloatArray
from rovid.ground.errors import ConfigError, nearest
from rovid.ground.files import Output
from rovid.ground.files.form import export_form
from rovid.parameters.parameters import Parameters
from rovid.study import Study

_VISIBLE = 0.1  # % of range; the promise for what a target holds
_ASSUMED_RATE = 0.3  # rad/s, where no log says how fast it turned

Exporter = Callable[[Subject], Target]


@dataclass(frozen=True, kw_only=True)
class Loss:
    """Something that the target does not hold; percent of the range of the yaw rate that it makes on the manoeuvre."""

    what: str
    why: str
    percent_of_range: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Exported:
    """A file's content and how far the target is from rovid's model.

    Attributes
    ----------
    mismatch, held
        Against the whole model, and against what of it the target holds.
    """

    content: str | bytes
    mismatch: Mismatch
    held: Mismatch
    losses: tuple[Loss, ...]
    warnings: tuple[str, ...]


def exporter_of(name: str) -> Exporter:
    """The exporter of one of `rovid.export.FORMATS`."""
    module = import_module(f"rovid.export.{name.replace('-', '_')}")
    return cast("Exporter", module.export)


def exporter(name: str, path: Path | None) -> tuple[Exporter, Output]:
    """The exporter of this format and the file to write.

    Raises
    ------
    ConfigError
        There is no such format.
    """
    if name not in FORMATS:
        raise ConfigError(f"is {name!r}. {nearest(name, FORMATS)}", where="FORMAT")
    target = path or Path(FORMATS[name])
    if name == "uuv" and target.suffix in {".yaml", ".yml"}:
        return uuv.export_yaml, Output(target, export_form("uuv as yaml"))
    return exporter_of(name), Output(target, export_form(name))


def subject_of(stored: Parameters, study: Study | None) -> Subject:
    """What a parameter file, and the logs that it remembers where they are there, say of the vehicle.

    Raises
    ------
    ConfigError
        The file holds no inertia or drag.
    """
    model = stored.model()
    vehicle = Vehicle(name=stored.vehicle or "vehicle", thrusters=()) if study is None else study.vehicle
    rate, used = _ASSUMED_RATE, None
    reference: dict[str, float] = {}
    notes: list[str] = []
    if study is not None and study.runs is not None and study.campaign is not None:
        study.require(model.effects)
        largest_rates = [np.nanmax(np.abs(run.rates.rate)) for run in study.runs.items]
        rate = float(max(largest_rates))
        every = np.concatenate([trial.commands for trial in study.campaign.trials])
        used = np.column_stack([np.nanmin(every, axis=0), np.nanmax(every, axis=0)])
        reference = dict(study.campaign.trials[0].reference)
    else:
        notes.append(
            f"No logs say how fast the vehicle turned or what its thrusters are: {rate:g} rad/s is assumed, and the "
            "yaw torque itself is the command."
        )
    if used is None:
        largest = float(model.drag(np.array(rate)))
        torque = Thruster(name="yaw_torque", arm=1.0, curve=None, most=largest)
        vehicle = replace(vehicle, thrusters=(torque,))
        used = np.array([[-largest, largest]])
    needed = {name for effect in model.effects for name in effect.needs}
    # A channel that an effect needs and no log has is taken to be one.
    channels = {name: reference.get(name, 1.0) for name in {*reference, *needed}}
    return Subject(
        model=model,
        vehicle=vehicle,
        entries=stored.entries,
        largest_rate=rate,
        commands=used,
        reference=channels,
        notes=tuple(notes),
    )


def export(function: Exporter, subject: Subject) -> Exported:
    """Write the subject in a target's format and simulate the target's own equation against rovid's."""
    target = function(subject)
    commands = manoeuvre(subject)
    whole = rovid_rate(subject, subject.model, commands)
    held = rovid_rate(subject, subject.holding(target.holds), commands)
    theirs = target.plant(commands, PERIOD)
    of_base = compare(held, theirs)
    losses = []
    for what, why in target.misses:
        losses.append(Loss(what=what, why=why, percent_of_range=of_base.percent_of_range))
    lost = [effect for effect in subject.model.effects if effect.key not in target.holds]
    losses += [_loss(subject, effect, commands, whole) for effect in lost]
    notes = [*subject.notes, *target.notes]
    if not target.misses and of_base.percent_of_range > _VISIBLE:
        notes.append("What the target holds differs by its coarse integration step: a smaller one brings it nearer.")
    return Exported(
        content=target.content,
        mismatch=compare(whole, theirs),
        held=of_base,
        losses=tuple(losses),
        warnings=tuple(notes),
    )


def _loss(subject: Subject, effect: Effect, commands: FloatArray, whole: FloatArray) -> Loss:
    rest = subject.holding(frozenset(subject.effects) - {effect.key})
    percent = compare(whole, rovid_rate(subject, rest, commands)).percent_of_range
    why = f"the format has nothing for {effect.title} ({effect.equation})"
    if effect.wave or effect.needs:
        percent = math.nan
        cause = " and ".join(effect.needs) or "a random phase"
        why += f"; the manoeuvre does not show it, for it depends on {cause}"
    return Loss(what=effect.key, why=why, percent_of_range=percent)
