"""Inertia by every method side by side, and which one to believe."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.campaign.axis import Axis
from rovid.campaign.tables import SINE_COLUMNS, Table
from rovid.campaign.vehicle import PLAUSIBLE_RATIO
from rovid.ground.arrays import FloatArray
from rovid.ground.errors import DataError
from rovid.identify.estimate import Estimate
from rovid.identify.regression import Regression, fit_regression
from rovid.identify.sine import (
    Inertia,
    SineTrial,
    harmonic_balance,
    orbit_integral,
    peak_bias,
    peak_method,
    sine_trials,
)
from rovid.model.model import Model
from rovid.motion.runs import Run

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
    methods: dict[str, Inertia]
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
    if not runs[0].trial.driven:
        raise DataError(
            f"nothing drives these logs in {axis.name}, so that the inertia cannot be known.",
            mend="Run `rovid fit`: it gives frequency, damping and their ratios to the inertia.",
        )
    trials = [] if axis.rights else sine_trials(runs)
    refused: dict[str, str] = {}
    regression: Regression | None = None
    try:
        regression = fit_regression(runs)
    except DataError as error:
        refused["regression"] = str(error)
    methods = _sine_methods(trials, drag)
    if not trials:
        text = (
            "in a sine, what brings the vehicle back looks like less inertia."
            if axis.rights
            else f"the logs hold no sine-shaped {axis.push} of three or more equal periods. {SINE_ADVICE}"
        )
        refused |= dict.fromkeys(("peak", "orbit_integral", "harmonic_balance"), text)
    if regression is not None:
        methods["regression"] = _as_inertia(regression)
    if not methods:
        sines = refused["orbit_integral"]
        raise DataError(refused["regression"] + ("" if axis.rights else f" {sines[:1].upper()}{sines[1:]}"))
    # Without a steady drag the regression gives inertia and drag that belong together.
    chosen = "orbit_integral" if trials and (drag is not None or regression is None) else "regression"
    if regression is None or chosen != "regression":
        estimate = _single(methods["orbit_integral"], trials, axis)
    else:
        estimate = regression.estimate if drag is None else _inertia_alone(regression.estimate)
    warnings = (
        *estimate.warnings,
        *_method_warnings(methods, refused, axis),
        *_plausibility(estimate, rigid_body),
    )
    bias = None
    if trials and drag is not None:
        bias = peak_bias(trials, _model(estimate.value("inertia"), drag))
    return InertiaFit(
        estimate=replace(estimate, warnings=warnings),
        chosen=chosen,
        methods=methods,
        peak_bias=bias,
        added_inertia=None if rigid_body is None else estimate.value("inertia") - rigid_body,
        trials=tuple(trials),
        regression=regression,
        refused=refused,
    )


def _sine_methods(trials: Sequence[SineTrial], drag: Estimate | None) -> dict[str, Inertia]:
    if not trials:
        return {}
    model = None if drag is None else _model(1.0, drag)
    methods = {} if model is None else {"peak": peak_method(trials, model)}
    balance = harmonic_balance(trials, model)
    if drag is not None:
        balance = _with_drag_error(balance, trials, drag)
    return methods | {"orbit_integral": orbit_integral(trials), "harmonic_balance": balance}


def _with_drag_error(balance: Inertia, trials: Sequence[SineTrial], drag: Estimate) -> Inertia:
    """Add to the harmonic balance what the drag's own uncertainty makes of it."""
    gradient = []
    for name in ("quadratic_drag", "linear_drag"):
        at, step = drag.names.index(name), max(1e-3 * abs(drag.value(name)), 1e-6)
        values = drag.values.copy()
        values[at] += step
        gradient.append((harmonic_balance(trials, _drag_model(values)).value - balance.value) / step)
    covariance = drag.covariance[np.ix_(*[[drag.names.index(n) for n in ("quadratic_drag", "linear_drag")]] * 2)]
    extra = float(np.array(gradient) @ np.nan_to_num(covariance) @ np.array(gradient))
    error = math.sqrt(balance.standard_error**2 + extra)
    return Inertia(value=balance.value, standard_error=error, runs=balance.runs, consistent=balance.consistent)


def _drag_model(values: FloatArray) -> Model:
    return Model(inertia=1.0, quadratic_drag=float(values[0]), linear_drag=float(values[1]))


def _model(inertia: float, drag: Estimate) -> Model:
    return Model(
        inertia=inertia,
        quadratic_drag=drag.value("quadratic_drag"),
        linear_drag=drag.value("linear_drag"),
    )


def _as_inertia(regression: Regression) -> Inertia:
    estimate = regression.estimate
    return Inertia(value=estimate.value("inertia"), standard_error=estimate.standard_error("inertia"), runs=())


def _inertia_alone(estimate: Estimate) -> Estimate:
    """The inertia of a regression, where the drag is known better from steady turns."""
    return replace(
        estimate, names=estimate.names[:1], values=estimate.values[:1], covariance=estimate.covariance[:1, :1]
    )


def _single(reading: Inertia, trials: Sequence[SineTrial], axis: Axis) -> Estimate:
    return Estimate(
        axis=axis,
        names=("inertia",),
        values=np.array([reading.value]),
        covariance=np.array([[reading.standard_error**2]]),
        degrees_of_freedom=float(sum(trial.cycles - 1 for trial in trials)),
        method=METHODS["orbit_integral"],
        samples=sum(trial.cycles for trial in trials),
    )


def _method_warnings(methods: dict[str, Inertia], refused: dict[str, str], axis: Axis) -> list[str]:
    texts, unit = [], axis.unit("kg m^2")
    for reason in dict.fromkeys(refused.values()):
        names = " and ".join(METHODS[name] for name in refused if refused[name] == reason and name != "peak")
        texts.append(f"Not possible, {names}: {reason}")
    orbit = methods.get("orbit_integral")
    if orbit is not None and orbit.consistent is False:
        runs = ", ".join(f"{name} {value:.4g} ± {error:.2g}" for name, value, error in orbit.runs)
        texts.append(
            f"No single inertia fits all sine runs ({runs} {unit}): lag, delay or water set in motion, not drag, "
            "makes the orbit integral change with period or amplitude."
        )
    sure = [name for name in ("orbit_integral", "harmonic_balance", "regression") if name in methods]
    for k, first in enumerate(sure):
        for second in sure[k + 1 :]:
            a, b = methods[first], methods[second]
            gap = abs(a.value - b.value) / math.hypot(a.standard_error, b.standard_error)
            if gap > _DISAGREE_SIGMAS:
                texts.append(
                    f"{METHODS[first]} and {METHODS[second]} disagree by {gap:.0f} standard errors "
                    f"({a.value:.4g} against {b.value:.4g} {unit}): the base model misses something."
                )
    return texts


def _plausibility(estimate: Estimate, rigid_body: float | None) -> list[str]:
    value, axis, unit = estimate.value("inertia"), estimate.axis, estimate.unit("inertia")
    if not value > 0.0:
        raise DataError(
            f"the inertia comes out at {value:.3g} {unit}: the vehicle moves against its {axis.push}.",
            mend=f"Check in rovid.toml the signs of {axis.arm}, command and {axis.measures}.",
        )
    if rigid_body is None:
        return []
    ratio = value / rigid_body
    if ratio > _IMPOSSIBLE_RATIO or ratio < 1.0 / _IMPOSSIBLE_RATIO:
        raise DataError(
            f"the inertia comes out at {value:.3g} {unit}, {ratio:.3g} times the rigid body's {rigid_body:.3g}, which "
            "no vehicle has.",
            mend=f"Check in rovid.toml the unit of {axis.measures}, mass, {axis.arm} and the curve's newtons.",
        )
    return unlike_rigid_body(estimate, rigid_body)


def unlike_rigid_body(estimate: Estimate, rigid_body: float | None) -> list[str]:
    """What is odd about the inertia beside the ``rigid_body``'s in kg m^2 or kg; nothing where that is not known."""
    if rigid_body is None or "inertia" in estimate.refused:
        return []
    low, high = PLAUSIBLE_RATIO
    ratio = estimate.value("inertia") / rigid_body
    if low < ratio < high:
        return []
    axis, unit = estimate.axis, estimate.unit("inertia")
    text = (
        f"The inertia is {ratio:.3g} times the rigid body's {rigid_body:.4g} {unit}, outside what vehicles show "
        f"({low} to {high}): look at {axis.arm}, thrust curve, mass and size, and at the units of time and "
        f"{axis.measures}."
    )
    return [text]


def fit_inertia_table(table: Table, *, drag: Estimate | None, rigid_body: float | None) -> InertiaFit:
    """Inertia from a table of sine trials of which only amplitudes are known.

    Columns: period_s, torque_amplitude_Nm, peak_yaw_rate_rad_s; optional trial, peak_acceleration_rad_s2 and
    steady_torque_Nm (for the peak method), quadratic_drag and linear_drag (else the fitted drag is used).
    Amplitudes without phase leave I = sqrt(T1^2 - D^2)/(w A) with D = 8/(3 pi) DQ A^2 + DL A. The error is
    that of the last printed digit of the rate.

    Raises
    ------
    DataError
        The torque is smaller than the drag, a period or an amplitude is not above 0, or no drag is known.
    """
    _require_positive(table)
    omega = 2.0 * np.pi / table.numbers("period_s")
    torque, rate = table.numbers("torque_amplitude_Nm"), table.numbers("peak_yaw_rate_rad_s")
    quadratic, linear = table_drag(table, drag)
    values = _from_amplitudes(table, torque, rate, omega, quadratic, linear)
    half = table.resolution("peak_yaw_rate_rad_s") / 2.0
    ends = [
        np.sqrt(np.clip(torque**2 - _oscillating_drag(rate + sign * half, quadratic, linear) ** 2, 0, None))
        / (omega * (rate + sign * half))
        for sign in (-1.0, 1.0)
    ]
    # A rounding error is uniform over the last digit.
    errors = np.abs(ends[0] - ends[1]) / math.sqrt(12.0)
    names = table.text("trial") if "trial" in table.header else [f"row {line}" for line in table.lines]
    weights = 1.0 / errors**2
    value = float(weights @ values / weights.sum())
    error = float(1.0 / np.sqrt(weights.sum()))
    apart = bool(np.max(np.minimum(*ends)) > np.min(np.maximum(*ends)))
    warnings: list[str] = []
    if apart:
        value, error = float(values.mean()), float(np.ptp(values)) / 2.0
        listed = ", ".join(f"{name}: {v:.0f}" for name, v in zip(names, values, strict=True))
        warnings.append(
            f"No single inertia fits all sine trials ({listed} kg m^2), not even within the rounding of the rates; "
            "their mean stands with half their spread as its error."
        )
    balance = Inertia(
        value=value,
        standard_error=error,
        runs=tuple((n, float(v), float(e)) for n, v, e in zip(names, values, errors, strict=True)),
        consistent=not apart,
    )
    methods = _table_peak(table, names, torque) | {"harmonic_balance": balance}
    estimate = Estimate(
        names=("inertia",),
        values=np.array([value]),
        covariance=np.array([[error**2]]),
        method=METHODS["harmonic_balance"] + ", amplitudes of a table",
        samples=len(names),
    )
    warnings += _plausibility(estimate, rigid_body)
    no_phase = "a table of amplitudes holds no phase"
    return InertiaFit(
        estimate=replace(estimate, warnings=tuple(warnings)),
        chosen="harmonic_balance",
        methods=methods,
        peak_bias=None,
        added_inertia=None if rigid_body is None else value - rigid_body,
        trials=(),
        regression=None,
        refused={"orbit_integral": no_phase, "regression": no_phase},
    )


def _require_positive(table: Table) -> None:
    for name in SINE_COLUMNS:
        values = table.numbers(name)
        if (values <= 0.0).any():
            at = int(np.argmin(values))
            raise DataError(
                f"{name} is {values[at]:g}, a number above 0 was expected.",
                where=f"{table.path}:{table.lines[at]}",
                mend="Correct the cell or delete the row.",
            )


def table_drag(table: Table, drag: Estimate | None) -> tuple[FloatArray, FloatArray]:
    """(n,) quadratic and linear drag for each row: of its own columns, or ``drag``.

    Raises
    ------
    RovidError
        There is neither, or a cell is no number.
    """
    columns = []
    for name in ("quadratic_drag", "linear_drag"):
        if name in table.header:
            columns.append(table.numbers(name))
        elif drag is not None:
            columns.append(np.full(len(table.rows), drag.value(name)))
        else:
            raise DataError(
                f"no {name} is known.", where=table.path, mend="Run `rovid fit-drag` first, or add the column."
            )
    return columns[0], columns[1]


def _oscillating_drag(rate: FloatArray, quadratic: FloatArray, linear: FloatArray) -> FloatArray:
    """Fundamental of the drag torque in a sine of peak ``rate``."""
    return np.asarray(8.0 / (3.0 * np.pi) * quadratic * rate**2 + linear * rate)


def _from_amplitudes(
    table: Table,
    torque: FloatArray,
    rate: FloatArray,
    omega: FloatArray,
    quadratic: FloatArray,
    linear: FloatArray,
) -> FloatArray:
    surplus = torque**2 - _oscillating_drag(rate, quadratic, linear) ** 2
    if (surplus <= 0.0).any():
        at = int(np.argmin(surplus))
        raise DataError(
            f"the drag at {rate[at]:g} rad/s exceeds the torque of {torque[at]:g} N m: nothing is left for inertia.",
            where=f"{table.path}:{table.lines[at]}",
            mend="Check the drag and the row.",
        )
    return np.asarray(np.sqrt(surplus) / (omega * rate))


def _table_peak(table: Table, names: Sequence[str], torque: FloatArray) -> dict[str, Inertia]:
    columns = ("steady_torque_Nm", "peak_acceleration_rad_s2")
    if not set(columns) <= set(table.header):
        return {}
    steady, acceleration = (table.numbers(column, empty_allowed=True) for column in columns)
    known = np.isfinite(steady) & np.isfinite(acceleration)
    if not known.any():
        return {}
    values = (torque - steady)[known] / acceleration[known]
    runs = tuple((name, float(v), math.nan) for name, v in zip(np.array(names)[known], values, strict=True))
    return {"peak": Inertia(value=float(values.mean()), standard_error=math.nan, runs=runs)}
