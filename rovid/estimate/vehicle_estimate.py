"""Estimate of a model from size and mass alone, for runs that are planned before the first log exists."""

import math
from collections.abc import Collection

import numpy as np

from rovid.core.errors import ConfigError
from rovid.estimate.experiment_design import CandidateModel
from rovid.model.model import Model
from rovid.trial.trial import Trial
from rovid.trial.vehicle import USUAL_INERTIA_RATIO, Vehicle, cross_flow_drags

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


def estimated_model(vehicle: Vehicle, *, integrated: bool) -> CandidateModel:
    """Model of a vehicle of this mass and size, with ``integrated`` if the rate alone is measured; covariance zero.

    The inertia is the usual one over that of the rigid body. The drag is that of a bluff body across the flow.

    Raises ConfigError if mass or size is not given, or gravity rights the vehicle.
    """
    axis, rigid = vehicle.axis, vehicle.rigid_body_inertia
    if axis.self_righting:
        text = f"the model of {axis.name} needs a restoring torque, which mass and size do not determine."
        raise ConfigError(text, where="--axis", mend="Give LOGS of a decay test.")
    known = {
        "mass": vehicle.mass,
        "length": vehicle.length,
        "width": vehicle.width,
        "height": vehicle.height or vehicle.width,
    }
    shown = {
        "yaw": ("length", "height"),
        "surge": ("width", "height"),
        "sway": ("length", "height"),
        "heave": ("length", "width"),
    }[axis.name]
    needed = shown if rigid is not None else ("mass", *(("length", "width") if axis.angular else ()), *shown)
    if missing := [key for key in dict.fromkeys(needed) if known[key] is None]:
        text = f"gives no {' and no '.join(missing)}; without a log, the model follows from mass and size."
        raise ConfigError(text, where="[vehicle] of rovid.toml", mend="Add it in kg or m, or give LOGS.")
    first, second = (known[side] or math.nan for side in shown)
    straight, turning = cross_flow_drags(first, second, _DRAG_COEFFICIENT)
    drag = turning if axis.angular else straight
    full = sum(abs(thruster.arm) * thruster.full_thrust for thruster in vehicle.thrusters)
    fast = math.sqrt(full / drag)
    inertia = USUAL_INERTIA_RATIO * (rigid or math.nan)
    quadratic_drag = (1.0 - _LINEAR_SHARE) * drag
    model = Model(inertia=inertia, quadratic_drag=quadratic_drag, linear_drag=_LINEAR_SHARE * drag * fast, axis=axis)
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
