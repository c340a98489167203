"""Inertia from a table of sine trials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rovid.campaign.tables import SINE_COLUMNS, Table
from rovid.ground.arrays import FloatArray
from rovid.ground.errors import DataError
from rovid.identify.estimate import Estimate
from rovid.identify.inertia import METHODS, InertiaFit, plausibility
from rovid.identify.sine import Inertia


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
    ends = []
    for edge in (rate + -1.0 * half, rate + 1.0 * half):
        surplus = torque**2 - _oscillating_drag(edge, quadratic, linear) ** 2
        ends.append(np.sqrt(np.clip(surplus, 0, None)) / (omega * edge))
    # A rounding error is uniform over the last digit.
    errors = np.abs(ends[0] - ends[1]) / math.sqrt(12.0)
    names = _names(table)
    weights = 1.0 / errors**2
    value = float(weights @ values / weights.sum())
    error = float(1.0 / np.sqrt(weights.sum()))
    # No inertia lies between the ends of all rows.
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
    warnings += plausibility(estimate, rigid_body)
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


def _names(table: Table) -> list[str]:
    """Of every row, as the table has it, else by its line."""
    if "trial" in table.header:
        return table.text("trial")
    return [f"row {line}" for line in table.lines]


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
    if not {"steady_torque_Nm", "peak_acceleration_rad_s2"} <= set(table.header):
        return {}
    steady = table.numbers("steady_torque_Nm", empty_allowed=True)
    acceleration = table.numbers("peak_acceleration_rad_s2", empty_allowed=True)
    known = np.isfinite(steady) & np.isfinite(acceleration)
    if not known.any():
        return {}
    values = (torque - steady)[known] / acceleration[known]
    runs = tuple((name, float(v), math.nan) for name, v in zip(np.array(names)[known], values, strict=True))
    return {"peak": Inertia(value=float(values.mean()), standard_error=math.nan, runs=runs)}
