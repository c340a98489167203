"""Inertia by every method side by side, from logs or from a table of sine trials."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.formatting import plus_minus, significant
from rovid.estimate.estimate import Estimate
from rovid.estimate.oscillation_tests import (
    InertiaReading,
    SineTrial,
    harmonic_balance,
    orbit_integral,
    peak_bias,
    peak_method,
    require_motion,
    sine_trials,
)
from rovid.estimate.output_error import Regression, fit_regression
from rovid.model.model import Model
from rovid.trial.axis import YAW, Axis
from rovid.trial.preprocessing import Run
from rovid.trial.tables import SINE_COLUMNS, CsvTable
from rovid.trial.vehicle import PLAUSIBLE_INERTIA_RATIO

METHODS = {
    "peak": "peak method of the founding paper (biased)",
    "orbit_integral": "orbit integral over whole periods",
    "harmonic_balance": "harmonic balance at the fundamental",
    "regression": "regression on all excited data",
}
# Ratio to the rigid body's inertia beyond which the result is refused. Degrees for radians give a factor of 57.
_IMPOSSIBLE_RATIO = 20.0
# Ratio of two standard errors from which they differ: a standard error is known to about a fifth.
_REPORTED = 1.2
# Joint standard errors between two methods beyond which they are reported to disagree.
_DISAGREE_SIGMAS = 4.0
SINE_ADVICE = (
    "Run a sine on the command: five periods or more of about ten vehicle time constants each "
    "(40 s for a work-class vehicle, 4 s for a small one), at two amplitudes, autopilot off."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class InertiaFit:
    """Inertia by every method that the data allow."""

    estimate: Estimate  #: The inertia to use; with the drag where that is the regression's too.
    chosen: str  #: Key of ``methods`` behind ``estimate``.
    methods: dict[str, InertiaReading]  #: Key of ``METHODS`` -> reading.
    #: Ratio of the peak method's result on the identified model's own motion to its true inertia.
    peak_bias: float | None
    #: Inertia minus the rigid body's, in kg m^2, or None where the rigid body's is unknown.
    added_inertia: float | None
    trials: tuple[SineTrial, ...]  #: The sine runs.
    regression: Regression | None
    refused: dict[str, str]  #: Method -> why it could not be used.


def fit_inertia(runs: Sequence[Run], *, drag: Estimate | None, rigid_body: float | None) -> InertiaFit:
    """Inertia from sine runs and from all excited data.

    Raises DataError if no method has the data it needs, or the ratio to the rigid body's inertia is impossible.

    ``drag``: Steady drag, where it is known; two of the sine methods use it.
    ``rigid_body``: Rigid-body inertia in kg m^2 or kg.
    """
    axis = runs[0].trial.axis
    if not runs[0].trial.has_actuators:
        text = f"no actuator drives the vehicle in {axis.name} in these logs, so the inertia cannot be determined."
        raise DataError(text, mend="Run `rovid fit`: it gives frequency, damping and their ratios to the inertia.")
    trials = [] if axis.self_righting else sine_trials(runs)
    require_motion(trials, axis)
    regression, refused = None, dict[str, str]()
    try:
        regression = fit_regression(runs)
    except DataError as refusal:
        refused["regression"] = str(refusal)
    if not trials:
        why = f"the logs hold no sine-shaped {axis.force_name} of three or more equal periods. {SINE_ADVICE}"
        if axis.self_righting:
            why = "in a sine, the restoring torque looks like less inertia."
        refused |= dict.fromkeys(("peak", "orbit_integral", "harmonic_balance"), why)
    methods = _sine_methods(trials, drag)
    if regression is not None:
        value, error = regression.estimate.value("inertia"), regression.estimate.standard_error("inertia")
        methods["regression"] = InertiaReading(value=value, standard_error=error, runs=())
    # Without a steady drag, inertia and drag of the regression are used together.
    if trials and (drag is not None or regression is None):
        chosen, cycles = "orbit_integral", [trial.cycles for trial in trials]
        estimate = _estimate(methods[chosen], METHODS[chosen], sum(cycles), axis, float(sum(cycles) - len(cycles)))
    elif regression is not None:
        chosen, estimate = "regression", regression.estimate
        if drag is not None:
            # The drag is known better from steady turns.
            names, values, covariance = estimate.names[:1], estimate.values[:1], estimate.covariance[:1, :1]
            estimate = replace(estimate, names=names, values=values, covariance=covariance)
    else:
        why, sines = refused["regression"], refused["orbit_integral"]
        if not axis.self_righting:
            why += f" {sines[:1].upper()}{sines[1:]}"
        raise DataError(why)
    value = estimate.value("inertia")
    warnings = (
        *estimate.warnings,
        *_method_warnings(methods, refused, axis),
        *plausibility_warnings(estimate, rigid_body),
    )
    bias = None
    if trials and drag is not None:
        bias = peak_bias(trials, replace(_drag_model(_drags(drag)), inertia=value))
    return InertiaFit(
        estimate=replace(estimate, warnings=warnings),
        chosen=chosen,
        methods=methods,
        peak_bias=bias,
        added_inertia=None if rigid_body is None else value - rigid_body,
        trials=tuple(trials),
        regression=regression,
        refused=refused,
    )


def with_joint_error(fit: InertiaFit, joint: Estimate) -> InertiaFit:
    """``fit`` with the standard error of the ``joint`` estimate from the same logs, if that is larger.

    The joint estimate is the efficient one, and its errors include torques that the equation lacks; docs/method.md,
    (15a). No other method is more accurate on the same data.
    """
    estimate = fit.estimate
    own, error = estimate.standard_error("inertia"), joint.standard_error("inertia")
    if not error > _REPORTED * own:
        return fit
    at, scale = estimate.names.index("inertia"), np.ones(len(estimate.names))
    scale[at] = error / own
    text = (
        f"The standard error, {significant(error, 2)} {estimate.unit('inertia')}, is that of `rovid fit`: it includes "
        "what the equation lacks, such as motion along another axis, or a lag."
    )
    warnings = (*estimate.warnings, text)
    covariance = estimate.covariance * np.outer(scale, scale)
    return replace(fit, estimate=replace(estimate, covariance=covariance, warnings=warnings))


def _sine_methods(trials: Sequence[SineTrial], drag: Estimate | None) -> dict[str, InertiaReading]:
    if not trials:
        return {}
    orbit = orbit_integral(trials)
    if drag is None:
        return {"orbit_integral": orbit, "harmonic_balance": harmonic_balance(trials, None)}
    drags = _drags(drag)
    balance = harmonic_balance(trials, _drag_model(drags))
    # Errors of the drag propagate into the harmonic balance.
    places = list(map(drag.names.index, ("quadratic_drag", "linear_drag")))
    gradient = np.zeros(2)
    for at in range(2):
        step = max(1e-3 * abs(float(drags[at])), 1e-6)
        moved = harmonic_balance(trials, _drag_model(drags + step * (np.arange(2) == at)))
        gradient[at] = (moved.value - balance.value) / step
    covariance = np.nan_to_num(drag.covariance[np.ix_(places, places)])
    error = math.sqrt(balance.standard_error**2 + float(gradient @ covariance @ gradient))
    return {
        "peak": peak_method(trials, _drag_model(drags)),
        "orbit_integral": orbit,
        "harmonic_balance": replace(balance, standard_error=error),
    }


def _drags(drag: Estimate) -> FloatArray:
    """(2,) quadratic and linear drag."""
    return np.array([drag.value("quadratic_drag"), drag.value("linear_drag")])


def _drag_model(drags: FloatArray) -> Model:
    """Model of 1 kg m^2 with (2,) quadratic and linear drag."""
    return Model(inertia=1.0, quadratic_drag=float(drags[0]), linear_drag=float(drags[1]))


def _estimate(
    reading: InertiaReading, method: str, samples: int, axis: Axis = YAW, degrees_of_freedom: float = math.inf
) -> Estimate:
    return Estimate(
        axis=axis,
        names=("inertia",),
        values=np.array([reading.value]),
        covariance=np.array([[reading.standard_error**2]]),
        degrees_of_freedom=degrees_of_freedom,
        method=method,
        samples=samples,
    )


def _method_warnings(methods: dict[str, InertiaReading], refused: dict[str, str], axis: Axis) -> Iterator[str]:
    """Warnings of refused methods, of sine runs that disagree, and of methods that disagree."""
    unit = axis.unit("kg m^2")
    for reason in dict.fromkeys(refused.values()):
        names = " and ".join(METHODS[name] for name in refused if refused[name] == reason and name != "peak")
        yield f"Not possible, {names}: {reason}"
    orbit = methods.get("orbit_integral")
    if orbit is not None and orbit.consistent is False:
        runs = ", ".join(f"{name} {plus_minus(value, error)} {unit}" for name, value, error in orbit.runs)
        yield (
            f"No single inertia fits all sine runs ({runs}). A lag, a delay or moving water, but not drag, makes the "
            "orbit integral change with period or amplitude."
        )
    accurate = [name for name in ("orbit_integral", "harmonic_balance", "regression") if name in methods]
    for first, second in combinations(accurate, 2):
        a, b = methods[first], methods[second]
        gap = abs(a.value - b.value) / math.hypot(a.standard_error, b.standard_error)
        if gap > _DISAGREE_SIGMAS:
            yield (
                f"{METHODS[first]} and {METHODS[second]} disagree by {gap:.0f} standard errors "
                f"({significant(a.value, 4)} against {significant(b.value, 4)} {unit}): the base model misses "
                "an effect."
            )


def plausibility_warnings(estimate: Estimate, rigid_body: float | None) -> list[str]:
    """Warnings of an implausible ratio to the ``rigid_body``'s inertia; raise DataError for an impossible one."""
    value, axis, unit = estimate.value("inertia"), estimate.axis, estimate.unit("inertia")
    if not value > 0.0:
        text = f"the inertia comes out at {value:.3g} {unit}: the vehicle moves against its {axis.force_name}."
        mend = f"Check in rovid.toml the signs of {axis.arm_key}, command and {axis.required_signals}."
        raise DataError(text, mend=mend)
    if rigid_body is None:
        return []
    ratio = value / rigid_body
    if ratio > _IMPOSSIBLE_RATIO or ratio < 1.0 / _IMPOSSIBLE_RATIO:
        units = f"{axis.required_signals}, mass, {axis.arm_key}"
        raise DataError(
            f"the inertia comes out at {value:.3g} {unit}, {ratio:.3g} times the rigid body's {rigid_body:.3g}, which "
            "no vehicle has.",
            mend=f"Check in rovid.toml the unit of {units} and the curve's newtons.",
        )
    return rigid_body_warnings(estimate, rigid_body)


def rigid_body_warnings(estimate: Estimate, rigid_body: float | None) -> list[str]:
    """Warning of an inertia outside the usual range of ratios to the ``rigid_body``'s in kg m^2 or kg."""
    if rigid_body is None or "inertia" in estimate.refused:
        return []
    low, high = PLAUSIBLE_INERTIA_RATIO
    ratio = estimate.value("inertia") / rigid_body
    if low < ratio < high:
        return []
    axis, unit = estimate.axis, estimate.unit("inertia")
    text = (
        f"The inertia is {ratio:.3g} times the rigid body's {significant(rigid_body, 4)} {unit}, outside the usual "
        f"range of vehicles ({low} to {high}): check {axis.arm_key}, thrust curve, mass and size, and the units of "
        f"time and {axis.required_signals}."
    )
    return [text]


def fit_inertia_table(table: CsvTable, *, drag: Estimate | None, rigid_body: float | None) -> InertiaFit:
    """Inertia from the amplitudes of sine trials in a table.

    Columns: period_s, torque_amplitude_Nm, peak_yaw_rate_rad_s; optional trial, peak_acceleration_rad_s2 and
    steady_torque_Nm (for the peak method), quadratic_drag and linear_drag (else the fitted drag is used). Amplitudes
    without phase give I = sqrt(T1^2 - D^2)/(w A) with D = 8/(3 pi) DQ A^2 + DL A. The standard error is that of the
    last printed digit of the rate. Raises DataError if the torque is smaller than the drag, a period or an amplitude is
    not above 0, or no drag is known.
    """
    for name in SINE_COLUMNS:
        values = table.numbers(name)
        at = int(np.argmin(values))
        if values[at] <= 0.0:
            text = f"{name} is {values[at]:g}, a number above 0 was expected."
            raise DataError(text, where=f"{table.path}:{table.lines[at]}", mend="Correct the cell or delete the row.")
    names = row_names(table)
    balance, warnings = _table_harmonic_balance(table, drag, names)
    estimate = _estimate(balance, METHODS["harmonic_balance"] + ", amplitudes of a table", len(names))
    warnings += plausibility_warnings(estimate, rigid_body)
    no_phase = "a table of amplitudes holds no phase"
    return InertiaFit(
        estimate=replace(estimate, warnings=tuple(warnings)),
        chosen="harmonic_balance",
        methods=_table_peak_method(table, names) | {"harmonic_balance": balance},
        peak_bias=None,
        added_inertia=None if rigid_body is None else balance.value - rigid_body,
        trials=(),
        regression=None,
        refused={"orbit_integral": no_phase, "regression": no_phase},
    )


def row_names(table: CsvTable) -> list[str]:
    """Name of every row, from the column trial or its line number."""
    if "trial" in table.header:
        return table.text("trial")
    return [f"row {line}" for line in table.lines]


def table_drag(table: CsvTable, drag: Estimate | None) -> tuple[FloatArray, FloatArray]:
    """(n,) quadratic and linear drag for each row, from its own columns or ``drag``.

    Raises RovidError if there is neither, or a cell is not a number.
    """
    columns = []
    for name in ("quadratic_drag", "linear_drag"):
        if name in table.header:
            columns.append(table.numbers(name))
        elif drag is not None:
            columns.append(np.full(len(table.rows), drag.value(name)))
        else:
            text = f"no {name} is known."
            raise DataError(text, where=table.path, mend="Run `rovid fit-drag` first, or add the column.")
    return columns[0], columns[1]


def _table_harmonic_balance(
    table: CsvTable, drag: Estimate | None, names: list[str]
) -> tuple[InertiaReading, list[str]]:
    """Weighted mean of the rows' inertias, and a warning where the rows have no inertia in common."""
    quadratic, linear = table_drag(table, drag)
    frequency = 2.0 * np.pi / table.numbers("period_s")
    torque, rate = table.numbers("torque_amplitude_Nm"), table.numbers("peak_yaw_rate_rad_s")

    def inertia_torque_squared(amplitude: FloatArray) -> FloatArray:
        """(n,) square of the torque amplitude less that of the drag, N^2 m^2."""
        drag_torque = 8.0 / (3.0 * np.pi) * quadratic * amplitude**2 + linear * amplitude
        return np.asarray(torque**2 - drag_torque**2)

    def inertia(amplitude: FloatArray) -> FloatArray:
        """(n,) kg m^2 by the rate ``amplitude``; zero where the drag exceeds the torque."""
        return np.asarray(np.sqrt(np.clip(inertia_torque_squared(amplitude), 0, None)) / (frequency * amplitude))

    remaining = inertia_torque_squared(rate)
    if not (remaining > 0.0).all():
        at = int(np.argmin(remaining))
        text = f"the drag at {rate[at]:g} rad/s exceeds the torque of {torque[at]:g} N m: nothing is left for inertia."
        raise DataError(text, where=f"{table.path}:{table.lines[at]}", mend="Check the drag and the row.")
    values = inertia(rate)
    half = table.resolution("peak_yaw_rate_rad_s") / 2.0
    ends = inertia(rate - half), inertia(rate + half)
    # A rounding error is uniform over the last digit.
    errors = np.abs(ends[0] - ends[1]) / math.sqrt(12.0)
    weights = 1.0 / errors**2
    value, error = float(weights @ values / weights.sum()), float(1.0 / np.sqrt(weights.sum()))
    consistent = not np.max(np.minimum(*ends)) > np.min(np.maximum(*ends))
    warnings = []
    if not consistent:
        value, error = float(values.mean()), float(np.ptp(values)) / 2.0
        listed = ", ".join(f"{name}: {one:.0f}" for name, one in zip(names, values, strict=True))
        warnings.append(
            f"No single inertia fits all sine trials ({listed} kg m^2), even within the rounding of the rates. Their "
            "mean is given, with half their range as its error."
        )
    rows = tuple(zip(names, values.tolist(), errors.tolist(), strict=True))
    return InertiaReading(value=value, standard_error=error, runs=rows, consistent=consistent), warnings


def _table_peak_method(table: CsvTable, names: list[str]) -> dict[str, InertiaReading]:
    """The founding paper's method, where the table has its columns."""
    if not {"steady_torque_Nm", "peak_acceleration_rad_s2"} <= set(table.header):
        return {}
    steady = table.numbers("steady_torque_Nm", empty_allowed=True)
    acceleration = table.numbers("peak_acceleration_rad_s2", empty_allowed=True)
    known = np.isfinite(steady) & np.isfinite(acceleration)
    if not known.any():
        return {}
    values = (table.numbers("torque_amplitude_Nm") - steady)[known] / acceleration[known]
    known_names = np.array(names)[known].tolist()
    runs = tuple((name, value, math.nan) for name, value in zip(known_names, values.tolist(), strict=True))
    return {"peak": InertiaReading(value=float(values.mean()), standard_error=math.nan, runs=runs)}
