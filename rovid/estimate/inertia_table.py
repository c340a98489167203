"""Inertia from a table of sine trials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

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
    Amplitudes without phase leave I = sqrt(T1^2 - D^2)/(w A) with D = 8/(3 pi) DQ A^2 + DL A. The error is
    that of the last printed digit of the rate.

    Raises
    ------
    DataError
        The torque is smaller than the drag, a period or an amplitude is not above 0, or no drag is known.
    """
    _require_positive(table)
    sines = _Sines.of(table, drag)
    balance, warnings = _balanced(sines)
    estimate = Estimate(
        names=("inertia",),
        values=np.array([balance.value]),
        covariance=np.array([[balance.standard_error**2]]),
        method=METHODS["harmonic_balance"] + ", amplitudes of a table",
        samples=len(sines.names),
    )
    warnings += plausibility_warnings(estimate, rigid_body)
    no_phase = "a table of amplitudes holds no phase"
    return InertiaFit(
        estimate=replace(estimate, warnings=tuple(warnings)),
        chosen="harmonic_balance",
        methods=_table_peak(table, sines) | {"harmonic_balance": balance},
        peak_bias=None,
        added_inertia=None if rigid_body is None else balance.value - rigid_body,
        trials=(),
        regression=None,
        refused={"orbit_integral": no_phase, "regression": no_phase},
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sines:
    """The rows of a table of sine trials.

    Attributes
    ----------
    names
        Of every row, as the table has it, else by its line.
    where
        File and line of every row.
    frequency
        (n,) rad/s.
    torque, rate
        (n,) amplitudes in N m and rad/s.
    digit
        (n,) rad/s, the last printed one of the rates.
    quadratic, linear
        (n,) drag.
    """

    names: list[str]
    where: list[str]
    frequency: FloatArray
    torque: FloatArray
    rate: FloatArray
    digit: FloatArray
    quadratic: FloatArray
    linear: FloatArray

    @classmethod
    def of(cls, table: CsvTable, drag: Estimate | None) -> Self:
        quadratic, linear = table_drag(table, drag)
        return cls(
            names=row_names(table),
            where=[f"{table.path}:{line}" for line in table.lines],
            frequency=2.0 * np.pi / table.numbers("period_s"),
            torque=table.numbers("torque_amplitude_Nm"),
            rate=table.numbers("peak_yaw_rate_rad_s"),
            digit=table.resolution("peak_yaw_rate_rad_s"),
            quadratic=quadratic,
            linear=linear,
        )

    def surplus(self, rate: FloatArray) -> FloatArray:
        """(n,) N^2 m^2: the square of the torque that is left for the inertia, were the amplitudes ``rate``."""
        drag = 8.0 / (3.0 * np.pi) * self.quadratic * rate**2 + self.linear * rate
        return np.asarray(self.torque**2 - drag**2)

    def inertia(self, rate: FloatArray) -> FloatArray:
        """(n,) kg m^2, were the amplitudes ``rate``; none where drag takes more than the torque."""
        return np.asarray(np.sqrt(np.clip(self.surplus(rate), 0, None)) / (self.frequency * rate))


def _balanced(sines: _Sines) -> tuple[InertiaReading, list[str]]:
    """The inertia that all rows agree on, and what is said where there is none."""
    _require_surplus(sines)
    values = sines.inertia(sines.rate)
    half = sines.digit / 2.0
    ends = [sines.inertia(edge) for edge in (sines.rate + -1.0 * half, sines.rate + 1.0 * half)]
    # A rounding error is uniform over the last digit.
    errors = np.abs(ends[0] - ends[1]) / math.sqrt(12.0)
    weights = 1.0 / errors**2
    value = float(weights @ values / weights.sum())
    error = float(1.0 / np.sqrt(weights.sum()))
    # No inertia lies between the ends of all rows.
    apart = bool(np.max(np.minimum(*ends)) > np.min(np.maximum(*ends)))
    warnings = []
    if apart:
        value, error = float(values.mean()), float(np.ptp(values)) / 2.0
        warnings.append(_said_apart(sines.names, values))
    rows = zip(sines.names, values.tolist(), errors.tolist(), strict=True)
    return InertiaReading(value=value, standard_error=error, runs=tuple(rows), consistent=not apart), warnings


def _said_apart(names: Sequence[str], values: FloatArray) -> str:
    listed = ", ".join(f"{name}: {value:.0f}" for name, value in zip(names, values, strict=True))
    return (
        f"No single inertia fits all sine trials ({listed} kg m^2), not even within the rounding of the rates; "
        "their mean stands with half their spread as its error."
    )


def _require_surplus(sines: _Sines) -> None:
    """Refuse a row in which drag takes all of the torque."""
    surplus = sines.surplus(sines.rate)
    if (surplus > 0.0).all():
        return
    at = int(np.argmin(surplus))
    raise DataError(
        f"the drag at {sines.rate[at]:g} rad/s exceeds the torque of {sines.torque[at]:g} N m: nothing is left for "
        "inertia.",
        where=sines.where[at],
        mend="Check the drag and the row.",
    )


def row_names(table: CsvTable) -> list[str]:
    """Of every row, as the table has it, else by its line."""
    if "trial" in table.header:
        return table.text("trial")
    return [f"row {line}" for line in table.lines]


def _require_positive(table: CsvTable) -> None:
    """Refuse a row with a period, torque or rate of nothing or less."""
    for name in SINE_COLUMNS:
        values = table.numbers(name)
        if (values <= 0.0).any():
            at = int(np.argmin(values))
            raise DataError(
                f"{name} is {values[at]:g}, a number above 0 was expected.",
                where=f"{table.path}:{table.lines[at]}",
                mend="Correct the cell or delete the row.",
            )


def table_drag(table: CsvTable, drag: Estimate | None) -> tuple[FloatArray, FloatArray]:
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


def _table_peak(table: CsvTable, sines: _Sines) -> dict[str, InertiaReading]:
    """The founding paper's method, where the table has what it needs."""
    if not {"steady_torque_Nm", "peak_acceleration_rad_s2"} <= set(table.header):
        return {}
    steady = table.numbers("steady_torque_Nm", empty_allowed=True)
    acceleration = table.numbers("peak_acceleration_rad_s2", empty_allowed=True)
    known = np.isfinite(steady) & np.isfinite(acceleration)
    if not known.any():
        return {}
    values = (sines.torque - steady)[known] / acceleration[known]
    names = np.array(sines.names)[known].tolist()
    runs = [(name, value, math.nan) for name, value in zip(names, values.tolist(), strict=True)]
    return {"peak": InertiaReading(value=float(values.mean()), standard_error=math.nan, runs=tuple(runs))}
