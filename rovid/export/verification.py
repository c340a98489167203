"""Verified export: re-simulation with the target's equation, mismatch, losses and stability."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, suggestion
from rovid.core.output_files import OutputFile, export_mark, export_signature
from rovid.export import ALIASES, FORMATS, thruster_curves
from rovid.export.body_equation import BodyEquation
from rovid.export.interface import PERIOD, ExportInput, ExportResult, Simulate
from rovid.export.planar_input import PlanarInput
from rovid.export.stability import Stability, judge_stability
from rovid.trial.assumptions import Assumptions
from rovid.trial.numba_loops import first_order_sum


@dataclass(frozen=True, kw_only=True)
class Mismatch:
    """Difference between the velocities of a simulator and of rovid, by the names of `VELOCITIES`."""

    percent_of_range: Mapping[str, float]  #: Largest difference relative to the range of rovid's.
    rms: Mapping[str, float]  #: m/s and rad/s.

    @property
    def largest(self) -> float:
        """Largest percentage."""
        return max(self.percent_of_range.values())


def compare_motions(subject: ExportInput | PlanarInput, rovid: FloatArray, other: FloatArray) -> Mismatch:
    """Mismatch of the (n, v) motion ``other``."""
    percents, sizes = {}, {}
    for name, mine, theirs, least in zip(subject.velocities, rovid.T, other.T, subject.least_ranges, strict=True):
        error = np.abs(theirs - mine)
        # The square of an unstable solution would overflow.
        scale = float(np.max(error))
        span = max(float(np.ptp(mine)), least, 1e-12)
        percents[name] = 100.0 * scale / span
        sizes[name] = scale
        if math.isfinite(scale) and scale > 0.0:
            sizes[name] *= float(np.sqrt(np.mean((error / scale) ** 2)))
    return Mismatch(percent_of_range=percents, rms=sizes)


def verification_commands(subject: ExportInput | PlanarInput) -> FloatArray:
    """(n, k) commands for `PERIOD` each, within the speeds of the logs."""
    shares, least, bisections = subject.verification_shares()
    limits = np.maximum(subject.envelope, 1e-9)

    def stays_within(factor: float) -> bool:
        motion = subject.motion(subject.model, subject.commands_at(factor * shares))
        return bool(np.all(np.max(np.abs(motion), axis=0) <= limits[-motion.shape[1] :]))

    low, high = 0.0, 1.0
    if stays_within(high):
        return subject.commands_at(shares)
    for _ in range(bisections):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if stays_within(middle) else (low, middle)
    # A bias or a current alone may exceed the envelope.
    return subject.commands_at(max(low, least) * shares)


def repeat_held(values: FloatArray, step: float) -> FloatArray:
    """(n*m, ...) of (n, ...) values that are held for `PERIOD`: one for each of its m steps."""
    return np.repeat(values, round(PERIOD / step), axis=0)


def first_order_lag(values: FloatArray, time_constant: float, step: float) -> FloatArray:
    """First-order lag of (m,) ``values`` from zero, updated exactly before each step."""
    if time_constant <= 0.0:
        return values
    fade = math.exp(-step / time_constant)
    return first_order_sum((1.0 - fade) * values, fade)


def unit_forces(
    subject: ExportInput | PlanarInput,
    commands: FloatArray,
    step: float,
    units: Sequence[thruster_curves.ThrusterUnit] | None = None,
    lag: thruster_curves.ThrusterLag = thruster_curves.NO_LAG,
    delay: float = 0.0,
) -> FloatArray:
    """(m, 3) forces along surge and sway, and torque in yaw, in each ``step`` in s under (n, k) ``commands``.

    ``units``: Thrusters of the file; by default those of the ``subject``. ``delay`` in s acts between curve and lag.
    """
    names = [one.name for one in subject.vehicle.thrusters]
    forces = np.zeros((len(commands) * round(PERIOD / step), 3))
    for unit in subject.units if units is None else units:
        curve = unit.curve
        beyond = repeat_held(commands[:, names.index(curve.name)] - curve.neutral, step)
        if lag.key == thruster_curves.COMMAND_LAG:
            beyond = first_order_lag(beyond, lag.time_constant, step)
        thrust = curve(curve.neutral + beyond)
        if delay:
            thrust = np.concatenate([np.full(round(delay / step), thrust[0]), thrust])[: len(thrust)]
        if lag.key == thruster_curves.THRUST_LAG:
            thrust = first_order_lag(thrust, lag.time_constant, step)
        forces += np.outer(thrust, unit.lever)
    return forces


def simulation(
    subject: ExportInput | PlanarInput,
    equation: BodyEquation,
    units: Sequence[thruster_curves.ThrusterUnit] | None = None,
    lag: thruster_curves.ThrusterLag = thruster_curves.NO_LAG,
    delay: float = 0.0,
) -> Simulate:
    """Simulation of ``equation`` with thrusters as in `unit_forces`."""

    def simulate(commands: FloatArray) -> FloatArray:
        forces = unit_forces(subject, commands, equation.step, units, lag, delay)
        return equation.simulate(forces, every=round(PERIOD / equation.step))[:, -len(subject.velocities) :]

    return simulate


# % of range, promised limit of the mismatch of what a file represents.
_VISIBLE = 0.1

Exporter = Callable[[Any], ExportResult]  # of an `ExportInput`, or of a `PlanarInput`


@dataclass(frozen=True, kw_only=True)
class ExportLoss:
    """Part of the model that a file cannot represent, with its effect on each velocity in percent of the range."""

    what: str
    why: str
    percent_of_range: Mapping[str, float]


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
    velocities: Mapping[str, str]  #: Velocities that were compared, with their units.
    trim: tuple[thruster_curves.TrimShare, ...] = ()  #: Cancels the constant torque of the model.

    @property
    def is_planar(self) -> bool:
        """Whether the model is that of surge, sway and yaw together."""
        return len(self.velocities) > 1


def load_exporter(name: str, suffix: str = "", *, planar: bool = False) -> Exporter:
    """Exporter of a format to a file with this ``suffix``. Raises ConfigError if there is none for this model."""
    if name not in FORMATS:
        raise ConfigError(f"is {name!r}. {suggestion(name, FORMATS, ALIASES)}", where="FORMAT")
    form = FORMATS[name]
    function = form.planar if planar else form.other.get(suffix, form.function)
    if not function:
        able = [one for one, form in FORMATS.items() if form.planar]
        text = f"is {name!r}, which cannot hold surge, sway and yaw together."
        mend = f"Give one of {', '.join(able)}. Or fit yaw alone, without --axes planar, and export that."
        raise ConfigError(text, where="FORMAT", mend=mend)
    exporter: Exporter = getattr(import_module(f"rovid.export.{form.module}"), function)
    return exporter


def select_exporter(name: str, path: Path | None, *, planar: bool = False) -> tuple[Exporter, OutputFile]:
    """Exporter of the format ``name``, and the file to write. Raises ConfigError as `load_exporter`."""
    exporter = load_exporter(name, path.suffix if path else "", planar=planar)
    return exporter, OutputFile(path or Path(FORMATS[name].file), export_signature(name))


def with_notice(content: str | bytes, guess: Assumptions) -> str | bytes:
    """``content`` with a notice of guessed values; JSON and MATLAB files have their own."""
    if not guess or isinstance(content, bytes):
        return content
    # The notice follows the mark of the author.
    return re.sub(rf"{export_mark('')}[^.\n]*\.", rf"\g<0> {guess.file_notice}", content, count=1)


def verified_export(exporter: Exporter, subject: ExportInput | PlanarInput) -> VerifiedExport:
    """Export ``subject``, compare the simulator's equation with rovid's, and judge its stability."""
    result, commands = exporter(subject), verification_commands(subject)
    whole = subject.motion(subject.model, commands)
    kept_model, kept_commands = subject.with_effects(result.kept_effects), commands
    losses, base = [], []

    def loss(what: str, why: str, other: FloatArray) -> ExportLoss:
        percent = compare_motions(subject, whole, other).percent_of_range
        return ExportLoss(what=what, why=why, percent_of_range=percent)

    for effect in [one.effect for one in subject.bound_effects if one.effect.key not in result.kept_effects]:
        why = f"the format has nothing for {effect.title} ({effect.equation})"
        other = subject.motion(subject.with_effects(frozenset(subject.effects) - {effect.key}), commands)
        if isinstance(subject, ExportInput) and (effect.is_wave or effect.needs):
            other = np.full_like(whole, np.nan)
            cause = " and ".join(effect.needs) or "a random phase"
            why += f"; the verification does not show its size, because it depends on {cause}"
        losses.append(loss(effect.key, why, other))
    for column, actuator in enumerate(subject.vehicle.thrusters):
        if result.keeps_angles or not actuator.is_angle:
            continue
        kept_commands, straight, without = kept_commands.copy(), commands.copy(), subject.model
        kept_commands[:, column] = straight[:, column] = 0.0
        if actuator.rudder is not None:
            without, kept_model = (_without_lift(each, actuator.name) for each in (without, kept_model))
        what = "azimuth angle" if actuator.rudder is None else "rudder"
        losses.append(loss(actuator.name, f"the file has no {what}", subject.motion(without, straight)))
    theirs = np.full_like(whole, np.nan) if result.simulate is None else result.simulate(commands)
    kept = compare_motions(subject, subject.motion(kept_model, kept_commands), theirs)
    for what, why in result.base_losses:
        if result.simulate is None:
            bare: dict[str, Any] = {what: 0.0}
            base.append(loss(what, why, subject.motion(replace(subject.model, **bare), commands)))
        else:
            base.append(ExportLoss(what=what, why=why, percent_of_range=kept.percent_of_range))
    notes, trim = [*subject.notes, *result.notes], list[thruster_curves.TrimShare]()
    if isinstance(subject, ExportInput):
        torque = subject.value("bias_torque", "torque")
        trim = thruster_curves.constant_trim(subject.curves, torque)
        if trim:
            parts = [f"{one.thruster} by {one.text}" for one in trim]
            error = subject.entries["bias_torque.torque"].standard_error
            doubt = "" if abs(torque) > 2.0 * error else " The logs do not distinguish this torque from zero."
            notes.append(
                f"A trim of {' and '.join(parts)} cancels the constant torque of {torque:.3g} ± {error:.2g} N m.{doubt}"
            )
        if not result.base_losses and kept.largest > _VISIBLE:
            notes.append("The rest of the mismatch is due to the coarse integration step: a smaller step reduces it.")
    surge, sway, yaw = map(float, subject.envelope)
    return VerifiedExport(
        content=with_notice(result.content, subject.guess),
        mismatch=compare_motions(subject, whole, theirs),
        kept_mismatch=kept,
        losses=(*base, *losses),
        stability=judge_stability(result.equation, (surge, sway, yaw)),
        velocities=subject.velocities,
        trim=tuple(trim),
        warnings=tuple(notes),
    )


def _without_lift(model: Any, rudder: str) -> Any:
    """A `PlanarModel` without the force of a rudder."""
    return model.with_values(np.where(np.array(model.names) == f"rudder.{rudder}.lift", 0.0, model.values))
