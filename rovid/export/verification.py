"""Verified export: re-simulation with the target's equation, mismatch, losses, and a verdict on stability.

Stability: whether an exported model comes to rest at the simulator's step, and the largest step at which it does. Two
conditions, in still water without thrust: the eigenvalues of one step of the linearised equation at rest, filter states
included, lie within the unit circle; and the integration from speeds all over the envelope of the logs, with the
simulator's own scheme, loses its kinetic energy in about the time that the exact equation takes.
"""

import itertools
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError, suggestion
from rovid.core.output_files import OutputFile, export_mark, export_signature
from rovid.export import ALIASES, FORMATS
from rovid.export.body_equation import AT_REST, BodyEquation, Scheme
from rovid.export.interface import ExportInput, ExportResult
from rovid.export.planar_input import PlanarInput
from rovid.export.thruster_curves import TrimShare, constant_trim
from rovid.trial.assumptions import Assumptions

# % of range, promised limit of the mismatch of what a file represents.
_VISIBLE = 0.1
# Share of the initial kinetic energy for a simulator, after `_PATIENCE` times the time to rest of the exact equation.
_SIMULATED_REST, _PATIENCE = 0.02, 4.0
# Least number of steps of one integration: close to the limit a motion rings for long.
_LEAST_STEPS = 200
# Tolerance of eigenvalues: with quadratic drag alone they are exactly 1 at rest.
_ROUNDING = 1e-9
# Largest number of steps of one integration. A longer one takes larger steps, far below the fastest time constant.
_MOST_STEPS = 100_000
# Step that follows the exact equation, in shares of its fastest time constant.
_RESOLVED = 0.02
# Steps of the exact equation in its fastest time constant, and the longest integration in those time constants.
_FINE, _LONGEST = 10.0, 2_000.0
_BISECTIONS, _DOUBLINGS = 12, 24
# Number of random speeds inside the envelope, half of which are mirror images.
_INSIDE = 32
# Shares of the envelope for yaw alone.
_ALONE = (-1.0, -0.5, -0.2, 0.2, 0.5, 1.0)
# A step counts as stable only with these shares of it: beyond the limit there are islands of chance stability.
_SHARES = (1.0, 0.85, 0.7)

Exporter = Callable[[Any], ExportResult]  # of an `ExportInput`, or of a `PlanarInput`


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


@lru_cache(maxsize=2)  # the same for all formats
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


@dataclass(frozen=True, kw_only=True)
class ExportLoss:
    """Part of the model that a file cannot represent, with its effect on each velocity in percent of the range."""

    what: str
    why: str
    percent_of_range: Mapping[str, float]


class Stability(NamedTuple):
    """Verdict about one file."""

    stable: bool
    step: float  #: s, of the simulator.
    largest_stable_step: float | None  #: s; None where no step is stable.
    rest_time: float | None  #: s to a tenth of the speed in the exact equation; None where it does not come to rest.
    envelope: tuple[float, float, float]  #: Largest speeds in m/s and rad/s, in both directions.
    text: str


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
    trim: tuple[TrimShare, ...] = ()  #: Cancels the constant torque of the model.

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
    notes, trim = [*subject.notes, *result.notes], list[TrimShare]()
    if isinstance(subject, ExportInput):
        torque = subject.value("bias_torque", "torque")
        trim = constant_trim(subject.curves, torque)
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


# ---- stability


def envelope_starts(envelope: FloatArray) -> FloatArray:
    """(m, 3) velocities all over the envelope: corners, edges and faces, the same at half of it, and random ones.

    Port and starboard are alike: the first of sway and yaw that is not zero is positive. Yaw alone has both signs.
    """
    if not np.any(envelope[:2]):
        return np.outer(_ALONE, envelope)
    grid = np.array(list(itertools.product((-1.0, 0.0, 1.0), repeat=3)))
    inside = np.random.default_rng(0).uniform(-1.0, 1.0, (_INSIDE, 3))
    shares = np.concatenate((grid, 0.5 * grid, inside))
    shares = shares[(shares[:, 1] > 0.0) | ((shares[:, 1] == 0.0) & (shares[:, 2] >= 0.0))]
    starts = shares * envelope
    return np.unique(starts[np.any(starts != 0.0, axis=1)], axis=0)


@lru_cache(maxsize=32)
def judge_stability(equation: BodyEquation, speeds: tuple[float, float, float]) -> Stability:
    """The verdict for the largest ``speeds`` in m/s and rad/s; one equation of several formats is judged once."""
    starts = envelope_starts(np.array(speeds))
    # The largest rate in 1/s of the equation, linearised at the starts.
    fastest = max(*(float(np.max(np.abs(np.linalg.eigvals(_jacobian(equation, start))))) for start in starts), 1e-9)
    # Whether a small motion grows by the linear damping of the exact equation.
    rates = np.linalg.eigvals(np.linalg.solve(equation.total_mass, equation.linear))
    grows_at_rest = bool(np.min(rates.real) < -_ROUNDING * max(1.0, float(np.max(np.abs(rates)))))
    rest = None if grows_at_rest else _time_to_rest(equation, starts, fastest)
    if rest is None:
        text = "The model itself does not come to rest from every speed in the logs: its drag is too small along one "
        text += "axis, or its coupling terms feed energy. No step of the simulator mends this."
        return Stability(False, equation.step, None, None, speeds, text)

    def is_stable(step: float) -> bool:
        return all(_is_stable(equation, starts, share * step, rest, fastest) for share in _SHARES)

    stable = is_stable(equation.step)
    largest = _largest_step(is_stable, equation.step, stable, rest)
    return Stability(stable, equation.step, largest, rest, speeds, _text(stable, equation.step, largest, rest))


def _text(stable: bool, step: float, largest: float | None, rest: float) -> str:
    if stable:
        within = f"up to a step of {largest:.2g} s" if largest is not None else ""
        text = f"Stable at the simulator's step of {step:g} s: from every speed in the logs the model slows to a tenth "
        return f"{text}within {rest:.3g} s. Stable {within}."
    if largest is None:
        return (
            f"Unstable at the simulator's step of {step:g} s and at every smaller one: the added mass multiplies the "
            "acceleration of the step before, and that loop diverges."
        )
    return f"Unstable at the simulator's step of {step:g} s. The largest stable step is {largest:.2g} s."


def _jacobian(equation: BodyEquation, speeds: FloatArray) -> FloatArray:
    """(3, 3) derivative of the accelerations by the velocities in still water, nothing lagged."""
    exact = replace(equation, constant=np.zeros(3), current=np.zeros(2), scheme=Scheme.BODY_EULER)
    columns = []
    for axis in range(3):
        size = 1e-6 * max(abs(float(speeds[axis])), 1e-3)
        ends = [_acceleration(exact, speeds + sign * size * np.eye(3)[axis]) for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2.0 * size))
    return np.column_stack(columns)


def _acceleration(equation: BodyEquation, nu: FloatArray) -> FloatArray:
    mass = equation.total_mass
    drag = equation.linear @ nu + np.einsum("ijk,j,k", equation.absolute, nu, np.abs(nu))
    drag[2] = (drag[2] + equation.cubic * nu[2] ** 3) * (equation.ratio if nu[2] < 0.0 else 1.0)
    momentum = mass @ nu
    turning = np.array([-momentum[1] * nu[2], momentum[0] * nu[2], momentum[1] * nu[0] - momentum[0] * nu[1]])
    return np.asarray(np.linalg.solve(mass, -drag - turning), dtype=np.float64)


def _time_to_rest(equation: BodyEquation, starts: FloatArray, fastest: float) -> float | None:
    """Time in s in which the exact equation comes to rest from all ``starts``; None if never."""
    exact = replace(
        equation, mass=equation.total_mass, lagged=np.zeros((3, 3)), scheme=Scheme.RUNGE_KUTTA, filter_weight=1.0
    )
    step = 1.0 / (_FINE * fastest)
    count = int(_FINE)
    while count <= _FINE * _LONGEST:
        ends, last = exact.decay(starts, step, count).T
        if np.max(ends) < AT_REST:
            return float(np.max(last)) * step
        count *= 2
    return None


def _is_stable(equation: BodyEquation, starts: FloatArray, step: float, rest: float, fastest: float) -> bool:
    if _spectral_radius(equation, step) > 1.0 + _ROUNDING:
        return False
    if not np.any(equation.lagged):
        # A much smaller step follows the exact equation as closely as this one.
        step = max(step, _RESOLVED / fastest)
    count = max(math.ceil(_PATIENCE * rest / step), _LEAST_STEPS)
    if count > _MOST_STEPS:
        step, count = _PATIENCE * rest / _MOST_STEPS, _MOST_STEPS
    ends = equation.decay(starts, step, count)[:, 0]
    return bool(np.all(ends < _SIMULATED_REST))


def _spectral_radius(equation: BodyEquation, step: float) -> float:
    """Largest magnitude of the eigenvalues of one step, linearised at rest: velocities, acceleration and its filter."""
    inverse, damping = np.linalg.inv(equation.mass), equation.linear
    identity = np.eye(3)
    if equation.scheme is Scheme.RUNGE_KUTTA:
        x = -step * np.linalg.inv(equation.total_mass) @ damping
        return _radius(identity + x + x @ x / 2.0 + x @ x @ x / 6.0 + x @ x @ x @ x / 24.0)
    if equation.scheme is Scheme.WORLD_IMPLICIT:
        return _radius(np.asarray(np.linalg.solve(equation.mass + step * damping, equation.mass), dtype=np.float64))
    weight = equation.filter_weight
    # x = (nu, acceleration of the step before, filtered acceleration).
    filtered = np.hstack((np.zeros((3, 3)), weight * identity, (1.0 - weight) * identity))
    acceleration = inverse @ (-np.hstack((damping, np.zeros((3, 6)))) - equation.lagged @ filtered)
    velocity = np.hstack((identity, np.zeros((3, 6)))) + step * acceleration
    return _radius(np.vstack((velocity, acceleration, filtered)))


def _radius(matrix: FloatArray) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(matrix))))


def _largest_step(is_stable: Callable[[float], bool], step: float, stable: bool, rest: float) -> float | None:
    """The largest stable step to two digits, by doubling or halving and bisection; at most the time to rest."""
    low = high = step
    for _ in range(_DOUBLINGS):
        if stable:
            high = min(2.0 * low, max(rest, low))
            if not is_stable(high):
                break
            low = high
            if low >= rest:
                return low
        else:
            low = 0.5 * high
            if is_stable(low):
                break
            high = low
    else:
        return low if stable else None
    for _ in range(_BISECTIONS):
        middle = math.sqrt(low * high)
        if is_stable(middle):
            low = middle
        else:
            high = middle
        if high < 1.03 * low:
            break
    # Two digits, rounded down; never below a stable step of the simulator.
    digits = 10.0 ** (math.floor(math.log10(low)) - 1)
    rounded = math.floor(low / digits + 1e-9) * digits
    return max(rounded, step) if stable else rounded
