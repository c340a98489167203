"""An inertia below the rigid body's: thrust in another unit (kgf, lbf), or a factor in arms, mass or size.

The water adds to the rigid body's inertia, so the total is never below it. The factor that is missing names the unit.
If the commands use a small part of the curve, and look like another unit, they are scaled to the whole curve. If the
inertia is possible then, the commands and the curve are of different units.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.faults.base import Detection, Detectors, RunsData, named
from rovid.faults.common_causes import unexplained, with_common_torque
from rovid.faults.foreign_log import significant_groups
from rovid.faults.log_regressors import solved
from rovid.faults.quick_model import fit_quick_model
from rovid.faults.unit_mismatch import mismatch_text, unit_of
from rovid.trial.fault import Fault
from rovid.trial.preprocessing import Run
from rovid.trial.vehicle import Vehicle

# Factors by which the inertia is too small, and what has them. A mean of two thrusters, or half an arm, is the last.
_UNITS = {
    9.80665: "kgf instead of N",
    4.44822: "lbf instead of N",
    57.2958: "a heading in degrees that is taken for radians",
    1000.0: "kN instead of N, or an arm in km",
    100.0: "an arm in cm or a command in percent",
    2.0: "a factor of two: one of two thrusters, or half the arm",
}
# Total over rigid-body inertia of vehicles: published ones have 1.1 to 2.5, a closed hull full of water up to 4.
_LEAST_RATIO, _USUAL_RATIO, _LARGEST_RATIO = 1.0, 1.5, 4.0
# Ratio below which the logs stop: hidden effects bias the quick model by at most 40 %, a fit by 20 %.
_QUICK_LIMIT, _FIT_LIMIT = 0.6, 0.8
# Ratio above which a mass near the middle may explain it: with 0.7 of the radius of gyration of a box.
_OF_A_BOX = 0.5
# Ratio above which no water explains the inertia: five times the largest published one. Factors that bring it back, by
# whether the axis is angular.
_IMPOSSIBLE, _RADIANS = 20.0, 1.0 / 57.2958
_TOO_LARGE = {
    True: {
        _RADIANS: "radians that are taken for degrees",
        1e-2: "an arm in cm that is taken for m",
        1e-3: "an arm in mm that is taken for m, or a mass in t",
    },
    False: {1e-2: "m that are taken for cm", 1e-3: "m that are taken for mm, or a mass in t"},
}
# Largest share of the curve that commands of another, smaller unit use: volts of a curve in percent use a half at most.
_SMALL_PART = 0.5
_WRONG = " A unit is wrong: "
_CAUSES = " Possible causes: "
# Standard errors by which a fit must be below its limit.
_SIGNIFICANT = 4.0
# Share of the torque that turned arms leave over the share that the logged ones leave: commands that go together fit
# both alike.
_AS_WELL = 1.2
# RMS residual over RMS torque, above which the quick model says nothing.
_MAX_MISFIT = 0.7


def _detect(data: RunsData) -> Iterator[Detection[RunsData]]:
    reference, model = data.vehicle.reference_inertia, fit_quick_model(data.runs, data.vehicle)
    if reference is None or model is None or min(log.misfit for log in model.logs) > _MAX_MISFIT:
        return
    others = partial(_others, data.runs, data.vehicle)
    fault = _fault(model.inertia, None, data.vehicle, _QUICK_LIMIT, others)
    if fault is None:
        return
    # A torque that all logs share, and that explains no less, may make the inertia a possible one.
    least, most = _QUICK_LIMIT * reference, _IMPOSSIBLE * reference
    for acting in with_common_torque(data.runs, model):
        other = fit_quick_model(acting, data.vehicle)
        if other and least < other.inertia < most and unexplained(other) < unexplained(model):
            return
    yield Detection(fault=_command_unit(model.inertia, data.runs, data.vehicle, fault) or fault)


def _others(runs: Sequence[Run], vehicle: Vehicle) -> tuple[str, ...]:
    """Causes of an impossible inertia besides a factor, in words."""
    model = fit_quick_model(runs, vehicle)
    groups = [] if model is None else significant_groups(model)
    mixed = max(groups, key=lambda each: each.ratio).smaller if groups else ()
    two = f"logs of two vehicles in one folder ({named(mixed)} and the others)"
    return (*((two,) if mixed else ()), *_turned_arms(runs, vehicle), *_other_unit(runs, vehicle))


def _turned_arms(runs: Sequence[Run], vehicle: Vehicle) -> Iterator[str]:
    """Thrusters with which the inertia is a possible one, and the torque fits as well, if their sign is turned."""
    model, reference = fit_quick_model(runs, vehicle), vehicle.reference_inertia
    if model is None or reference is None or len(vehicle.thrusters) < 2:
        return
    logs = model.regressors
    x, z = (np.concatenate([getattr(log, name) for log in logs]) for name in "xz")
    single = np.concatenate([log.centred(log.single) for log in logs])

    def fitted(signs: FloatArray) -> tuple[FloatArray, float]:
        torque = single @ signs
        values = solved(z.T @ x, z.T @ torque)
        return values, float(np.sum((torque - x @ values) ** 2) / np.sum(torque**2).clip(1e-300))

    _, usual = fitted(np.ones(len(vehicle.thrusters)))
    for at, thruster in enumerate(vehicle.thrusters):
        (inertia, *_), share = fitted(np.where(np.arange(len(vehicle.thrusters)) == at, -1.0, 1.0))
        if share < _AS_WELL * usual and _FIT_LIMIT < inertia / reference < _LARGEST_RATIO:
            yield (
                f"the sign of {vehicle.axis.arm_key} or command of {thruster.name} (with it turned around the inertia "
                f"is {inertia / reference:.2g} times the rigid body's)"
            )


def _other_unit(runs: Sequence[Run], vehicle: Vehicle) -> tuple[str, ...]:
    """The first thruster whose commands look like another unit than its curve, in words; empty without."""
    for at, thruster in enumerate(vehicle.thrusters):
        column = np.concatenate([run.trial.commands[:, at] for run in runs])
        values = column[np.isfinite(column) & (column != 0.0)]
        if thruster.curve is not None and values.size and unit_of(values) not in {"", unit_of(thruster.curve.command)}:
            ends = thruster.curve.command[[0, -1]]
            reach = f"{thruster.name} has {values.min():.4g} to {values.max():.4g}"
            return (f"commands in another unit than the curve: {reach}, the curve ends at {ends[0]:g} and {ends[1]:g}",)
    return ()


def _command_unit(inertia: float, runs: Sequence[Run], vehicle: Vehicle, fault: Fault) -> Fault | None:
    """The ``fault`` as a mismatch of the units of commands and curves, if it explains the ``inertia``; else None."""
    reference = vehicle.reference_inertia
    commands = np.vstack([run.trial.commands for run in runs])
    used, whole, texts = np.zeros(len(commands)), np.zeros(len(commands)), dict[str, list[str]]()
    for thruster, column in zip(vehicle.thrusters, commands.T, strict=True):
        curve = thruster.curve
        values = column[np.isfinite(column) & (column != 0.0)]
        if curve is None or not values.size:
            continue
        part = float(np.abs(values).max() / np.abs(curve.command).max())
        if part > _SMALL_PART or unit_of(values) in {"", unit_of(curve.command)}:
            return None
        used += thruster.torque(column)
        whole += thruster.torque(column / part)
        texts.setdefault(mismatch_text(curve, values), []).append(thruster.name)
    if reference is None or not texts or not used.any():
        return None
    factor = float(np.sqrt(np.mean(whole**2) / np.mean(used**2)))
    if not _FIT_LIMIT < factor * inertia / reference < _LARGEST_RATIO:
        return None
    text, names = next(iter(texts.items()))
    text = f"Commands of {' and '.join(names)} {text} {_inertia_text(inertia, vehicle, reference)}"
    return replace(fault, fault="unit_mismatch", text=text)


def inertia_fault(inertia: float, error: float, vehicle: Vehicle, runs: Sequence[Run] = ()) -> Fault | None:
    """The fault of a fitted ``inertia`` with its standard error in kg m^2 or kg; None where a vehicle can have it.

    Commands of ``runs`` may be another explanation.
    """
    return _fault(inertia, error, vehicle, _FIT_LIMIT, partial(_others, runs, vehicle) if runs else tuple)


def _fault(
    inertia: float, error: float | None, vehicle: Vehicle, limit: float, causes: Callable[[], Sequence[str]]
) -> Fault | None:
    """The fault of an inertia beyond the limits; ``causes`` gives those besides a factor, in words."""
    reference = vehicle.reference_inertia
    if reference is not None and inertia - _SIGNIFICANT * (error or 0.0) > _IMPOSSIBLE * reference:
        return _too_large(inertia, vehicle, reference, causes())
    if reference is None or not 0.0 < inertia + _SIGNIFICANT * (error or 0.0) < limit * reference:
        return None
    ratio, others = inertia / reference, causes()
    fitting = _fitting(ratio, _UNITS)
    causes_text = "; or ".join((*others, *(_UNITS[factor] for factor in fitting))) or "check the thrust"
    text = (
        f"{_inertia_text(inertia, vehicle, reference)}{_CAUSES if others else _WRONG}{causes_text}. "
        f"Check the curve's newtons, {vehicle.axis.arm_key}, mass and size."
    )
    if ratio > _OF_A_BOX and vehicle.axis.angular:
        text += " A mass that is near the middle has less than that of a box: then enter rigid_body_inertia."
    return Fault(fault="thrust_unit", logs=(), text=text, size=next(iter(fitting), 1.0 / ratio), stops=True)


def _fitting(ratio: float, factors: Iterable[float]) -> list[float]:
    """The ``factors`` that make the ``ratio`` of the inertia a possible one, first the one to the most usual ratio."""
    possible = [factor for factor in factors if _LEAST_RATIO < ratio * factor < _LARGEST_RATIO]
    return sorted(possible, key=lambda factor: abs(math.log(ratio * factor / _USUAL_RATIO)))


def _inertia_text(inertia: float, vehicle: Vehicle, reference: float) -> str:
    """Sentence on an inertia that is impossible next to the ``reference``, that of the rigid body."""
    unit, ratio = "kg m^2" if vehicle.axis.angular else "kg", inertia / reference
    why = "is impossible: water only adds to it" if ratio < 1.0 else "no vehicle has"
    return (
        f"The inertia of these logs is {inertia:.3g} {unit}, {ratio:.2g} times the rigid body's {reference:.4g} "
        f"{unit}, which {why}."
    )


def _too_large(inertia: float, vehicle: Vehicle, reference: float, others: Sequence[str]) -> Fault:
    """An inertia that no body of water explains: rates that are too small, or a thrust that is too large."""
    ratio = inertia / reference
    units = _TOO_LARGE[vehicle.axis.angular]
    fitting = _fitting(ratio, units)
    named_units = "; or ".join(units[factor] for factor in fitting) or "the unit of thrust, of time, or of the motion"
    text = (
        f"{_inertia_text(inertia, vehicle, reference)}{_WRONG}{'; or '.join((named_units, *others))}. Check the units "
        "in rovid.toml, mass and size."
    )
    fault = "scaled_heading" if fitting[:1] == [_RADIANS] else "thrust_unit"
    return Fault(fault=fault, logs=(), text=text, size=1.0 / next(iter(fitting), 1.0 / ratio), stops=True)


DETECTORS: Detectors = {"runs": (_detect,)}
