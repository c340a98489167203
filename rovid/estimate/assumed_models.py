"""Models and causes before any log has fitted them: from size and mass, or as large as a programme of runs shows."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError
from rovid.core.threads import thread_map
from rovid.effects import Effect, forms_for
from rovid.estimate.dataset import effect_scales, rms, rms_nonzero, time_constant
from rovid.estimate.experiment_design import CandidateModel
from rovid.estimate.nested_fits import scaled_start
from rovid.model.model import Model
from rovid.trial.trial import Trial
from rovid.trial.vehicle import USUAL_INERTIA_RATIO, Vehicle, cross_flow_drags

# Sizes of a cause without a fitted one: the RMS change of the simulated rate over the RMS rate. The first one that the
# programme shows counts: a part of the change of the rate may equal that by other parameters. Convention.
SIZE_SHARES = (0.02, 0.08, 0.3)
# Drag coefficient of a bluff body across the flow (Hoerner 1965, chapter 3: 1 to 1.2), on the area it shows.
_DRAG_COEFFICIENT = 1.1
# Share of the linear term in the drag at the rate of full thrust. Convention.
_LINEAR_SHARE = 0.1
# Disturbance over the full torque. Convention: calm water of a tank.
_DISTURBANCE_SHARE = 0.003
# Interval between readings in s, and the errors of a heading (rad), a position (m), a yaw rate (rad/s) and a speed
# (m/s): of usual instruments.
_INTERVAL = 0.1
_ERRORS = {(True, False): 0.001, (False, False): 0.02, (True, True): 0.002, (False, True): 0.01}
# The sides of the hull across the flow.
_SHOWN_SIDES = {
    "yaw": ("length", "height"), "surge": ("width", "height"),
    "sway": ("length", "height"), "heave": ("length", "width"),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class SizedCause:
    """A possible cause with its parameters in SI units."""

    effect: Effect
    values: FloatArray  # (k,)
    share: float | None = None  # RMS change of the simulated rate over the RMS rate, of `SIZE_SHARES`; None: fitted

    @property
    def name(self) -> str:
        """Key of the effect."""
        return self.effect.key


def split_causes(fitted: CandidateModel, named: Sequence[Effect]) -> tuple[CandidateModel, list[SizedCause]]:
    """The model without the ``named`` effects, and these effects at their fitted sizes."""
    own = {one.effect: one.parameters for one in fitted.model.bound_effects}
    kept = [effect for effect in fitted.model.effects if effect not in named]
    values = [float(value) for effect in kept for value in own[effect]]
    model = replace(fitted.model, effects=tuple(kept), effect_values=tuple(values))
    return replace(fitted, model=model), [SizedCause(effect=effect, values=own[effect]) for effect in named]


def sized_causes(base: CandidateModel, vehicle: Vehicle, programme: Sequence[Trial]) -> list[SizedCause]:
    """One form of each effect that can be tested and that ``base`` lacks, at the smallest of `SIZE_SHARES`."""
    forms: dict[str, Effect] = {}
    for form in forms_for(vehicle, channels(programme)):
        # The phase of waves is random: no simulation shows them.
        if not form.is_wave and form.id not in {effect.id for effect in base.model.effects}:
            forms.setdefault(form.id, form)
    sized = thread_map(lambda form: sized_cause(form, base, vehicle, programme), forms.values())
    return [cause for cause in sized if cause is not None]


def tested_causes(
    base: CandidateModel,
    fitted: Sequence[SizedCause],
    wanted: Sequence[Effect],
    vehicle: Vehicle,
    programme: Sequence[Trial],
) -> list[SizedCause]:
    """The ``wanted`` causes, or all if there are none, at their ``fitted`` sizes or the least of `SIZE_SHARES`."""
    own = {cause.effect.id: cause for cause in fitted}
    if not wanted:
        return [own.get(cause.effect.id, cause) for cause in sized_causes(base, vehicle, programme)]
    sized = [own.get(effect.id) or sized_cause(effect, base, vehicle, programme) for effect in wanted]
    return [cause for cause in sized if cause is not None]


def sized_cause(
    effect: Effect, base: CandidateModel, vehicle: Vehicle, programme: Sequence[Trial], share: float = SIZE_SHARES[0]
) -> SizedCause | None:
    """The cause at the size that changes the simulated rate by a ``share``; None where no size does."""
    from scipy import optimize  # The import takes long.

    model = base.model
    plain = simulated_rates(model, vehicle, programme)
    rate = rms(plain)
    torques = [model.torque_input(vehicle, trial).torque for trial in programme]
    constant = time_constant(model, rate)
    scales = effect_scales(programme, vehicle, rms_nonzero(np.concatenate(torques)), rate, constant)
    units = np.array(list(map(scales.unit_size, effect.parameters)))
    start = effect.initial_values[0]

    def at(size: float) -> FloatArray:
        scaled = scaled_start(effect, start, size)
        for k, parameter in enumerate(effect.parameters[: effect.size_count]):
            if parameter.neutral_at_infinity:
                scaled[k] = np.clip(start[k] / size, parameter.low, parameter.high)
        return np.asarray(scaled * units)

    def excess(exponent: float) -> float:
        changed = simulated_rates(with_effect(model, effect, at(math.exp(exponent))), vehicle, programme)
        difference = rms([one - other for one, other in zip(changed, plain, strict=True)])
        return math.log(difference / rate / share) if math.isfinite(difference) else 1.0

    low, high = math.log(1e-3), math.log(30.0)
    if excess(high) < 0.0:
        return None
    exponent = low if excess(low) > 0.0 else float(optimize.brentq(excess, low, high, xtol=0.02))
    return SizedCause(effect=effect, values=at(math.exp(exponent)), share=share)


def with_effect(model: Model, effect: Effect, values: FloatArray) -> Model:
    """``model`` with an ``effect`` of (k,) ``values`` added."""
    return replace(model, effects=(*model.effects, effect), effect_values=(*model.effect_values, *map(float, values)))


def simulated_rates(model: Model, vehicle: Vehicle, programme: Sequence[Trial]) -> list[FloatArray]:
    """(n,) rate of each free-running simulation, in rad/s or m/s."""
    return [model.simulate(trial, model.torque_input(vehicle, trial))[0] for trial in programme]


def channels(programme: Sequence[Trial]) -> set[str]:
    """Channels that all runs have."""
    return set.intersection(*(set(trial.channels) for trial in programme))


def estimated_model(vehicle: Vehicle, *, integrated: bool) -> CandidateModel:
    """Model of a vehicle of this mass and size, with ``integrated`` if the rate alone is measured; covariance zero.

    The inertia is the usual one over that of the rigid body. The drag is that of a bluff body across the flow.

    Raises ConfigError if mass or size is not given, or gravity rights the vehicle.
    """
    axis, rigid = vehicle.axis, vehicle.rigid_body_inertia
    if axis.self_righting:
        text = f"the model of {axis.name} needs a restoring torque, which mass and size do not determine."
        raise ConfigError(text, where="--axis", mend="Give LOGS of a decay test.")
    height = vehicle.height or vehicle.width
    known = {"mass": vehicle.mass, "length": vehicle.length, "width": vehicle.width, "height": height}
    shown = _SHOWN_SIDES[axis.name]
    needed = shown if rigid is not None else ("mass", *(("length", "width") if axis.angular else ()), *shown)
    if missing := [key for key in dict.fromkeys(needed) if known[key] is None]:
        text = f"gives no {' and no '.join(missing)}; without a log, the model follows from mass and size."
        raise ConfigError(text, where="[vehicle] of rovid.toml", mend="Add it in kg or m, or give LOGS.")
    first, second = (known[side] or math.nan for side in shown)
    straight, turning = cross_flow_drags(first, second, _DRAG_COEFFICIENT)
    drag = turning if axis.angular else straight
    full = sum(abs(thruster.arm) * thruster.full_thrust for thruster in vehicle.thrusters)
    fast = math.sqrt(full / drag)
    inertia, linear_drag = USUAL_INERTIA_RATIO * (rigid or math.nan), _LINEAR_SHARE * drag * fast
    model = Model(inertia=inertia, quadratic_drag=(1.0 - _LINEAR_SHARE) * drag, linear_drag=linear_drag, axis=axis)
    return CandidateModel(
        name="the estimate from mass and size",
        model=model,
        covariance=np.zeros((len(model.values), len(model.values))),
        disturbance=_DISTURBANCE_SHARE * full,
        memory=model.inertia / (model.linear_drag + 2.0 * model.quadratic_drag * fast),
        noise=_ERRORS[axis.angular, integrated],
        integrated=integrated,
    )


def full_range_trial(vehicle: Vehicle, signals: Collection[str]) -> Trial:
    """A trial at rest whose commands span the thrust curves, as the template of runs.

    Those of the ``signals`` that are not of the motion, such as a supply voltage, are 1.

    Raises ConfigError if a thruster has no curve.
    """
    ends = []
    for thruster in vehicle.thrusters:
        if thruster.curve is None:
            text = f"{thruster.name} has no thrust curve, so its largest command is unknown."
            raise ConfigError(text, where="[[thrusters]]", mend="Give its `curve`, or LOGS.")
        ends.append(thruster.curve.command[[0, -1]])
    axis = vehicle.axis
    motion = {*axis.position_signals, axis.rate_signal, *axis.fix_signals, "roll", "pitch"}
    time, reference = np.array([0.0, _INTERVAL]), {name: 1.0 for name in signals if name not in motion}
    return Trial.from_commands(time, np.column_stack(ends), name="full range", reference=reference)
