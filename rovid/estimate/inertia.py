"""Inertia by every method side by side, and which one to believe."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.formatting import plus_minus, significant
from rovid.estimate.estimate import Estimate
from rovid.estimate.instrumental_variables import Regression, fit_regression
from rovid.estimate.sine_inertia import (
    InertiaReading,
    SineTrial,
    harmonic_balance,
    orbit_integral,
    peak_bias,
    peak_method,
    require_motion,
    sine_trials,
)
from rovid.model.model import Model
from rovid.signals.preprocessing import Run
from rovid.trial.axis import Axis
from rovid.trial.vehicle import PLAUSIBLE_INERTIA_RATIO

METHODS = {
    "peak": "peak method of the founding paper (biased)",
    "orbit_integral": "orbit integral over whole periods",
    "harmonic_balance": "harmonic balance at the fundamental",
    "regression": "regression on all excited data",
}
# Degrees taken for radians, or the reverse, put the ratio off by 57.
_IMPOSSIBLE_RATIO = 20.0
_DISAGREE_SIGMAS = 4.0
SINE_ADVICE = (
    "Run a sine on the command: five periods or more of about ten vehicle time constants each "
    "(40 s for a work-class vehicle, 4 s for a small one), at two amplitudes, autopilot off."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class InertiaFit:
    """Inertia by every method that the data allow.

    Attributes
    ----------
    estimate
        The inertia to use; with the drag where that came from the regression too.
    chosen
        Key of ``methods`` behind ``estimate``.
    methods
        Key of ``METHODS`` -> reading.
    peak_bias
        What the peak method returns on the identified model's own motion, over its true inertia.
    added_inertia
        Inertia less the rigid body's, in kg m^2, or None where the rigid body is not known.
    trials
        The sine runs.
    refused
        Method -> why it could not be used.
    """

    estimate: Estimate
    chosen: str
    methods: dict[str, InertiaReading]
    peak_bias: float | None
    added_inertia: float | None
    trials: tuple[SineTrial, ...]
    regression: Regression | None
    refused: dict[str, str]


def fit_inertia(runs: Sequence[Run], *, drag: Estimate | None, rigid_body: float | None) -> InertiaFit:
    """Read the inertia from sine runs and from all excited data.

    Parameters
    ----------
    drag
        Steady drag, where it is known; the sine methods that need it use it.
    rigid_body
        Rigid-body yaw inertia in kg m^2.

    Raises
    ------
    DataError
        No method has the data it needs, or the result is impossible beside the rigid body.
    """
    axis = runs[0].trial.axis
    if not runs[0].trial.has_actuators:
        raise DataError(
            f"nothing drives these logs in {axis.name}, so that the inertia cannot be known.",
            mend="Run `rovid fit`: it gives frequency, damping and their ratios to the inertia.",
        )
    trials = [] if axis.self_righting else sine_trials(runs)
    require_motion(trials, axis)
    regression, refused = _regression(runs)
    if not trials:
        refused |= dict.fromkeys(("peak", "orbit_integral", "harmonic_balance"), _no_sines(axis))
    methods = _sine_methods(trials, drag)
    if regression is not None:
        methods["regression"] = _as_inertia(regression)
    if not methods:
        raise _no_method(refused, axis)
    # Without a steady drag the regression gives inertia and drag that belong together.
    if trials and (drag is not None or regression is None):
        chosen, estimate = "orbit_integral", _single(methods["orbit_integral"], trials, axis)
    else:
        assert regression is not None  # noqa: S101 - it is one of the methods
        chosen = "regression"
        estimate = regression.estimate if drag is None else _inertia_alone(regression.estimate)
    value = estimate.value("inertia")
    warnings = (
        *estimate.warnings,
        *_method_warnings(methods, refused, axis),
        *plausibility_warnings(estimate, rigid_body),
    )
    return InertiaFit(
        estimate=replace(estimate, warnings=warnings),
        chosen=chosen,
        methods=methods,
        peak_bias=peak_bias(trials, _model(value, drag)) if trials and drag is not None else None,
        added_inertia=None if rigid_body is None else value - rigid_body,
        trials=tuple(trials),
        regression=regression,
        refused=refused,
    )


def _regression(runs: Sequence[Run]) -> tuple[Regression | None, dict[str, str]]:
    """The regression on all excited data; None, and why it could not be used."""
    try:
        return fit_regression(runs), {}
    except DataError as error:
        return None, {"regression": str(error)}


def _no_sines(axis: Axis) -> str:
    """Why no method of the sines can be used."""
    if axis.self_righting:
        return "in a sine, what brings the vehicle back looks like less inertia."
    return f"the logs hold no sine-shaped {axis.force_name} of three or more equal periods. {SINE_ADVICE}"


def _no_method(refused: dict[str, str], axis: Axis) -> DataError:
    why, sines = refused["regression"], refused["orbit_integral"]
    if not axis.self_righting:
        why += f" {sines[:1].upper()}{sines[1:]}"
    return DataError(why)


def _sine_methods(trials: Sequence[SineTrial], drag: Estimate | None) -> dict[str, InertiaReading]:
    if not trials:
        return {}
    orbit = orbit_integral(trials)
    if drag is None:
        return {"orbit_integral": orbit, "harmonic_balance": harmonic_balance(trials, None)}
    model = _model(1.0, drag)
    balance = _with_drag_error(harmonic_balance(trials, model), trials, drag)
    return {"peak": peak_method(trials, model), "orbit_integral": orbit, "harmonic_balance": balance}


def _with_drag_error(balance: InertiaReading, trials: Sequence[SineTrial], drag: Estimate) -> InertiaReading:
    """Add to the harmonic balance what the drag's own uncertainty makes of it."""
    places = [drag.names.index(name) for name in ("quadratic_drag", "linear_drag")]
    slopes = []
    for at in places:
        step = max(1e-3 * abs(float(drag.values[at])), 1e-6)
        values = drag.values.copy()
        values[at] += step
        moved = harmonic_balance(trials, _drag_model(values))
        slopes.append((moved.value - balance.value) / step)
    gradient = np.array(slopes)
    covariance = np.nan_to_num(drag.covariance[np.ix_(places, places)])
    extra = float(gradient @ covariance @ gradient)
    error = math.sqrt(balance.standard_error**2 + extra)
    return replace(balance, standard_error=error)


def _drag_model(values: FloatArray) -> Model:
    """Model of 1 kg m^2 with (2,) quadratic and linear drag."""
    return Model(inertia=1.0, quadratic_drag=float(values[0]), linear_drag=float(values[1]))


def _model(inertia: float, drag: Estimate) -> Model:
    return Model(
        inertia=inertia,
        quadratic_drag=drag.value("quadratic_drag"),
        linear_drag=drag.value("linear_drag"),
    )


def _as_inertia(regression: Regression) -> InertiaReading:
    """By the regression over all runs at once, in kg m^2."""
    estimate = regression.estimate
    return InertiaReading(value=estimate.value("inertia"), standard_error=estimate.standard_error("inertia"), runs=())


def _inertia_alone(estimate: Estimate) -> Estimate:
    """The inertia of a regression, where the drag is known better from steady turns."""
    return replace(
        estimate, names=estimate.names[:1], values=estimate.values[:1], covariance=estimate.covariance[:1, :1]
    )


def _single(reading: InertiaReading, trials: Sequence[SineTrial], axis: Axis) -> Estimate:
    return Estimate(
        axis=axis,
        names=("inertia",),
        values=np.array([reading.value]),
        covariance=np.array([[reading.standard_error**2]]),
        degrees_of_freedom=float(sum(trial.cycles - 1 for trial in trials)),
        method=METHODS["orbit_integral"],
        samples=sum(trial.cycles for trial in trials),
    )


def _method_warnings(methods: dict[str, InertiaReading], refused: dict[str, str], axis: Axis) -> list[str]:
    """What is said of methods that gave nothing, of sine runs that disagree, and of methods that do."""
    texts, unit = [], axis.unit("kg m^2")
    for reason in dict.fromkeys(refused.values()):
        names = " and ".join(METHODS[name] for name in refused if refused[name] == reason and name != "peak")
        texts.append(f"Not possible, {names}: {reason}")
    orbit = methods.get("orbit_integral")
    if orbit is not None and orbit.consistent is False:
        runs = ", ".join(f"{name} {plus_minus(value, error)} {unit}" for name, value, error in orbit.runs)
        texts.append(
            f"No single inertia fits all sine runs ({runs}): lag, delay or water set in motion, not drag, "
            "makes the orbit integral change with period or amplitude."
        )
    return [*texts, *_disagreements(methods, unit)]


def _disagreements(methods: dict[str, InertiaReading], unit: str) -> Iterator[str]:
    """What is said of each two methods whose values lie too far apart."""
    sure = [name for name in ("orbit_integral", "harmonic_balance", "regression") if name in methods]
    for first, second in combinations(sure, 2):
        a, b = methods[first], methods[second]
        gap = abs(a.value - b.value) / math.hypot(a.standard_error, b.standard_error)
        if gap > _DISAGREE_SIGMAS:
            yield (
                f"{METHODS[first]} and {METHODS[second]} disagree by {gap:.0f} standard errors "
                f"({significant(a.value, 4)} against {significant(b.value, 4)} {unit}): the base model misses "
                "something."
            )


def plausibility_warnings(estimate: Estimate, rigid_body: float | None) -> list[str]:
    """What is said of an inertia that no vehicle of this rigid body has."""
    value, axis, unit = estimate.value("inertia"), estimate.axis, estimate.unit("inertia")
    if not value > 0.0:
        raise DataError(
            f"the inertia comes out at {value:.3g} {unit}: the vehicle moves against its {axis.force_name}.",
            mend=f"Check in rovid.toml the signs of {axis.arm_key}, command and {axis.required_signals}.",
        )
    if rigid_body is None:
        return []
    ratio = value / rigid_body
    if ratio > _IMPOSSIBLE_RATIO or ratio < 1.0 / _IMPOSSIBLE_RATIO:
        raise DataError(
            f"the inertia comes out at {value:.3g} {unit}, {ratio:.3g} times the rigid body's {rigid_body:.3g}, which "
            "no vehicle has.",
            mend=f"Check in rovid.toml the unit of {axis.required_signals}, mass, {axis.arm_key} and the curve's newtons.",
        )
    return rigid_body_warnings(estimate, rigid_body)


def rigid_body_warnings(estimate: Estimate, rigid_body: float | None) -> list[str]:
    """What is odd about the inertia beside the ``rigid_body``'s in kg m^2 or kg; nothing where that is not known."""
    if rigid_body is None or "inertia" in estimate.refused:
        return []
    low, high = PLAUSIBLE_INERTIA_RATIO
    ratio = estimate.value("inertia") / rigid_body
    if low < ratio < high:
        return []
    axis, unit = estimate.axis, estimate.unit("inertia")
    text = (
        f"The inertia is {ratio:.3g} times the rigid body's {significant(rigid_body, 4)} {unit}, outside what vehicles "
        f"show ({low} to {high}): look at {axis.arm_key}, thrust curve, mass and size, and at the units of time and "
        f"{axis.required_signals}."
    )
    return [text]
