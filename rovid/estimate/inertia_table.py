"""Inertia from a table of sine trials."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import METHODS, InertiaFit, plausibility_warnings
from rovid.estimate.sine_inertia import InertiaReading
from rovid.trial.tables import SINE_COLUMNS, CsvTable


def fit_inertia_table(table: CsvTable, *, drag: Estimate | None, rigid_body: float | None) -> InertiaFit:
    """Inertia from a table of sine trials of which only amplitudes are known.

    Columns: period_s, torque_amplitude_Nm, peak_yaw_rate_rad_s; optional trial, peak_acceleration_rad_s2 and
    steady_torque_Nm (for the peak method), quadratic_drag and linear_drag (else the fitted drag is used).
    Amplitudes without phase give I = sqrt(T1^2 - D^2)/(w A) with D = 8/(3 pi) DQ A^2 + DL A. The standard error is
    that of the last printed digit of the rate.

    Raises
    ------
    DataError
        The torque is smaller than the drag, a period or an amplitude is not above 0, or no drag is known.
    """
    for name in SINE_COLUMNS:
        values = table.numbers(name)
        if (values <= 0.0).any():
            at = int(np.argmin(values))
            raise DataError(
                f"{name} is {values[at]:g}, a number above 0 was expected.",
                where=f"{table.path}:{table.lines[at]}",
                mend="Correct the cell or delete the row.",
            )
    names = row_names(table)
    balance, warnings = _harmonic_balance(table, drag, names)
    estimate = Estimate(
        names=("inertia",),
        values=np.array([balance.value]),
        covariance=np.array([[balance.standard_error**2]]),
        method=METHODS["harmonic_balance"] + ", amplitudes of a table",
        samples=len(names),
    )
    warnings += plausibility_warnings(estimate, rigid_body)
    no_phase = "a table of amplitudes holds no phase"
    return InertiaFit(
        estimate=replace(estimate, warnings=tuple(warnings)),
        chosen="harmonic_balance",
        methods=_peak_method(table, names) | {"harmonic_balance": balance},
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

    Raises
    ------
    RovidError
        There is neither, or a cell is not a number.
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


def _harmonic_balance(table: CsvTable, drag: Estimate | None, names: list[str]) -> tuple[InertiaReading, list[str]]:
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
        raise DataError(
            f"the drag at {rate[at]:g} rad/s exceeds the torque of {torque[at]:g} N m: nothing is left for inertia.",
            where=f"{table.path}:{table.lines[at]}",
            mend="Check the drag and the row.",
        )
    values = inertia(rate)
    half = table.resolution("peak_yaw_rate_rad_s") / 2.0
    ends = [inertia(edge) for edge in (rate + -1.0 * half, rate + 1.0 * half)]
    # A rounding error is uniform over the last digit.
    errors = np.abs(ends[0] - ends[1]) / math.sqrt(12.0)
    weights = 1.0 / errors**2
    value = float(weights @ values / weights.sum())
    error = float(1.0 / np.sqrt(weights.sum()))
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


def _peak_method(table: CsvTable, names: list[str]) -> dict[str, InertiaReading]:
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
