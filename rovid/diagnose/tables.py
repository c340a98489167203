"""Diagnosis of tables of steady turns and sine trials: effects that explain amplitudes, without a time series."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.spmd import forked_workers, parallel_map
from rovid.core.stats import chi2_sf
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect, forms_for
from rovid.effects.base import OnHeading, Scales, WaveTorque
from rovid.estimate.dataset import time_constant
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import InertiaFit, row_names, table_drag
from rovid.model.actuator_model import CommandSeries
from rovid.model.model import Model
from rovid.model.torque_input import MAX_SUBDIVISION
from rovid.trial.tables import CsvTable
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle

if TYPE_CHECKING:
    from scipy import optimize

# Simulated sine: periods, of which the last one is evaluated, and samples of each.
_PERIODS, _SAMPLES = 6, 80
# Simulated hold: duration in time constants, samples, and samples of the end that are evaluated.
_HOLD, _HOLD_SAMPLES, _HOLD_END = 20.0, 320, 80
# Least squares: step of the differences, starts, evaluations of the first and of the final fit, and tolerance.
_STEP, _STARTS, _FIRST_EVALUATIONS, _EVALUATIONS, _TOLERANCE = 1e-3, 3, 8, 30, 1e-3


@dataclass(frozen=True, kw_only=True)
class SinePrediction:
    """Measured peak yaw rate in rad/s of a sine trial, and its simulation with the inertia in kg m^2 of a method."""

    trial: str
    method: str
    inertia: float
    measured: float
    predicted: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """Best fit to all rows of the tables of a model with at most one effect."""

    model: Model
    chi2: float  # sum of squared errors of the rates over their reading variance
    p_value: float  # probability of a larger chi-square of the true model; NaN without degrees of freedom

    @property
    def sizes(self) -> dict[str, tuple[float, str]]:
        """Value and unit of each parameter of the effect; the command is the torque."""
        sizes = {}
        for parameter, value in zip(self.model.effects[0].parameters, self.model.effect_values, strict=True):
            sizes[parameter.name] = (value, parameter.unit.replace("command", "N m"))
        return sizes

    @property
    def explains(self) -> bool:
        """Whether reading errors account for the remaining error."""
        if math.isnan(self.p_value):
            return self.chi2 < THRESHOLDS.table_p_value
        return self.p_value > THRESHOLDS.table_p_value


@dataclass(frozen=True, kw_only=True, eq=False)
class TableDiagnosis:
    """Fits to tables without an effect and, where that does not explain them, with the best form of each effect.

    ``inertias`` are the smallest and the largest that were allowed, in kg m^2.
    """

    predictions: tuple[SinePrediction, ...]
    without_effect: Explanation
    with_one_effect: tuple[Explanation, ...]
    inertias: tuple[float, float]

    @property
    def causes(self) -> tuple[Explanation, ...]:
        """Fits with an effect that explains the tables."""
        return tuple(each for each in self.with_one_effect if each.explains)

    @property
    def ruled_out(self) -> tuple[Effect, ...]:
        """Effects that do not explain the tables alone."""
        return tuple(each.model.effects[0] for each in self.with_one_effect if not each.explains)

    @property
    def missing(self) -> str:
        """Message on what the tables cannot decide, and what to do."""
        if self.without_effect.explains:
            return (
                "the plain model agrees with the tables within their reading error. Amplitudes without a time series "
                "show no more, and no data can be held out for validation: record the runs as logs."
            )
        return (
            f"no plain model agrees with the tables, with an inertia of {self.inertias[0]:.4g} to "
            f"{self.inertias[1]:.4g} kg m^2; {len(self.causes)} effects would, each by itself. Amplitudes without a "
            "time series cannot decide between them, and no data can be held out for validation: record the runs as "
            "logs."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rows:
    """Rows of the tables as trials with known torque, the sines first."""

    trials: list[Trial]
    rates: FloatArray  # (n,) rad/s, peak of each sine and mean of each hold
    errors: FloatArray  # (n,) standard deviations of their reading
    start: Model  # inertia and drag from which a fit starts
    vehicle: Vehicle  # its only command is the torque in N m
    drag_known: bool  # there are no holds to which the drag is fitted
    inertias: tuple[float, float]  # kg m^2, smallest and largest admissible

    def simulate(self, model: Model) -> FloatArray:
        """(n,) rad/s, the peak of a sine and the mean of a hold after settling."""
        torque = model.actuators.torque_inputs(self._commands[model.actuators.subdivision])
        values = []
        for trial, rate in zip(self.trials, model.simulate_rates(self.trials, torque), strict=True):
            values.append(rate[-_SAMPLES:].max() if trial.name == "sine" else rate[-_HOLD_END:].mean())
        return np.array(values, dtype=np.float64)

    @cached_property
    def _commands(self) -> dict[int, CommandSeries]:
        """Commands of all trials, by the subdivision of each interval."""
        return {parts: CommandSeries.from_trials(self.vehicle, self.trials, parts) for parts in (1, MAX_SUBDIVISION)}

    def fit(self, begin: Model, effects: Sequence[Effect | None]) -> list[Explanation]:
        """Fit inertia, drag unless it is known, and each effect to all rows from ``begin`` on."""
        problems = [_Problem(self, begin, effect) for effect in effects]
        solved = parallel_map(lambda problem: problem.solve(), problems)
        return [problem.explanation(*solution) for problem, solution in zip(problems, solved, strict=True)]


class _Problem:
    """Least-squares problem of logarithmic inertia, drag unless it is known, and one effect, within bounds."""

    def __init__(self, rows: _Rows, begin: Model, effect: Effect | None) -> None:
        self.rows, self.begin = rows, begin
        self.effects = () if effect is None else (effect,)
        self.starts = [()] if effect is None else effect.initial_values
        parameters = () if effect is None else effect.parameters
        torque, rate = float(rows.vehicle.thrusters[0].command_range() / 2.0), float(rows.rates.max())
        time = time_constant(begin, rate)
        scales = Scales(command=torque, torque=torque, rate=rate, wash=math.sqrt(torque), time=time)
        # Neither drag alone is much larger than the total drag at the largest torque and rate.
        self.drag_units = [] if rows.drag_known else [2.0 * torque / rate**2, 2.0 * torque / rate]
        drags = len(self.drag_units)
        self.effect_begins = 1 + drags
        self.units = np.array([1.0, *self.drag_units, *map(scales.unit_size, parameters)])
        least, largest = rows.inertias
        self.low = np.array([math.log(least), *[0.0] * drags, *[one.low for one in parameters]])
        self.high = np.array([math.log(largest), *[1.0] * drags, *[one.high for one in parameters]])

    def model(self, x: FloatArray) -> Model:
        """The model at (q,) ``x``."""
        values = tuple(map(float, x[self.effect_begins :] * self.units[self.effect_begins :]))
        model = replace(self.begin, inertia=math.exp(x[0]), effects=self.effects, effect_values=values)
        if not self.drag_units:
            return model
        quadratic, linear = x[1 : self.effect_begins] * self.units[1 : self.effect_begins]
        return replace(model, quadratic_drag=float(quadratic), linear_drag=float(linear))

    def residuals(self, x: FloatArray) -> FloatArray:
        """(n,) errors of the rates in standard deviations of their reading."""
        return (self.rows.simulate(self.model(x)) - self.rows.rates) / self.rows.errors

    def solve(self) -> tuple[FloatArray, float]:
        """(q,) solution and its sum of squares; the fit continues from the best of several starts."""
        drag = np.array([self.begin.quadratic_drag, self.begin.linear_drag])[: len(self.drag_units)] / self.drag_units
        rest = np.array([math.log(self.begin.inertia), *drag])
        begins = [np.clip(np.concatenate((rest, start)), self.low, self.high) for start in self.starts]
        begins = sorted(begins, key=lambda x: float(np.sum(self.residuals(x) ** 2)))[:_STARTS]
        best = min((self._least_squares(x, _FIRST_EVALUATIONS) for x in begins), key=lambda fit: float(fit.cost))
        fit = self._least_squares(best.x, _EVALUATIONS)
        # SciPy's cost is half the sum of squares.
        return fit.x, 2.0 * float(fit.cost)

    def explanation(self, x: FloatArray, chi2: float) -> Explanation:
        """Solution ``x`` with its p-value."""
        freedom = len(self.rows.rates) - len(self.low)
        p_value = chi2_sf(freedom, chi2) if freedom > 0 else math.nan
        return Explanation(model=self.model(x), chi2=chi2, p_value=p_value)

    def _least_squares(self, x: FloatArray, evaluations: int) -> optimize.OptimizeResult:
        from scipy import optimize

        return optimize.least_squares(
            self.residuals,
            x,
            bounds=(self.low, self.high),
            diff_step=np.full(len(self.low), _STEP),
            max_nfev=evaluations,
            ftol=_TOLERANCE,
            xtol=0.1 * _TOLERANCE,
        )


def diagnose_tables(
    sine: CsvTable, steady: CsvTable | None, drag: Estimate | None, inertia: InertiaFit, rigid_body: float | None
) -> TableDiagnosis:
    """Find effects with which one model agrees with every row of the tables.

    Raises RovidError if a cell is no number, or no drag is known.

    ``drag``: From steady turns; where their table is given, the drag is fitted again together with the sines.
    ``rigid_body``: Smallest inertia of an explanation in kg m^2.
    """
    from rovid.model.kernels import is_compiled

    quadratic, linear = table_drag(sine, drag)
    value = inertia.estimate.value("inertia")
    start = Model(inertia=value, quadratic_drag=float(quadratic[0]), linear_drag=float(linear[0]))
    rows = _read_rows(sine, steady, start, rigid_body)
    (plain,) = rows.fit(rows.start, [None])
    best: dict[str, Explanation] = {}
    if not plain.explains:
        # Amplitudes contain no waves, and no dependence on the heading.
        tried = [effect for effect in forms_for(rows.vehicle) if not isinstance(effect.acts, OnHeading | WaveTorque)]
        with forked_workers(enabled=is_compiled()):
            fits = rows.fit(plain.model, tried)
        for fit in sorted(fits, key=_rank):
            best.setdefault(fit.model.effects[0].id, fit)
    own = [replace(start, quadratic_drag=q, linear_drag=d) for q, d in zip(quadratic, linear, strict=True)]
    return TableDiagnosis(
        predictions=tuple(_predictions(sine, rows, own, inertia)),
        without_effect=plain,
        with_one_effect=tuple(best.values()),
        inertias=rows.inertias,
    )


def _rank(fit: Explanation) -> tuple[float, float]:
    """Sort key: the largest p-value first; fits without degrees of freedom last, by chi-square."""
    if math.isnan(fit.p_value):
        return 1.0, fit.chi2
    return -fit.p_value, fit.chi2


def _predictions(sine: CsvTable, rows: _Rows, models: Sequence[Model], inertia: InertiaFit) -> Iterator[SinePrediction]:
    """Each sine, simulated with the inertia of each method and the drag of its row."""
    for key, reading in inertia.methods.items():
        # The rates of holds follow those of the sines: the names end first.
        own = reading.value
        for at, (name, model, rate) in enumerate(zip(row_names(sine), models, rows.rates.tolist(), strict=False)):
            predicted = float(rows.simulate(replace(model, inertia=own))[at])
            yield SinePrediction(trial=name, method=key, inertia=own, measured=rate, predicted=predicted)


def _read_rows(sine: CsvTable, steady: CsvTable | None, start: Model, rigid_body: float | None) -> _Rows:
    period, amplitude = sine.numbers("period_s"), sine.numbers("torque_amplitude_Nm")
    trials = [_sine(*row) for row in zip(period.tolist(), amplitude.tolist(), strict=True)]
    tables = [(sine, "peak_yaw_rate_rad_s")]
    if steady is not None:
        torque, rate = steady.numbers("torque_Nm"), np.abs(steady.numbers("yaw_rate_rad_s"))
        reached = np.maximum(rate, THRESHOLDS.table_slowest_share * np.max(rate))
        trials += [_hold(*row, start) for row in zip(torque.tolist(), reached.tolist(), strict=True)]
        tables.append((steady, "yaw_rate_rad_s"))
    rates = [table.numbers(column) for table, column in tables]
    digits = [table.resolution(column) for table, column in tables]
    largest = max(float(np.abs(trial.commands).max()) for trial in trials)
    ends = np.array([-largest, 0.0, largest])
    torque_itself = Thruster(name="torque", arm=1.0, curve=ThrustCurve(command=ends, thrust=ends), clamp=True)
    # Without a rigid-body inertia, the fitted inertia may itself be the largest or the smallest admissible one.
    smallest_ratio, largest_ratio = THRESHOLDS.table_inertia_ratios
    smallest = rigid_body or start.inertia / largest_ratio
    return _Rows(
        trials=trials,
        rates=np.concatenate(rates),
        errors=THRESHOLDS.table_reading_digits * np.concatenate(digits),
        start=start,
        vehicle=Vehicle(name="", thrusters=(torque_itself,)),
        drag_known=steady is None,
        inertias=(smallest_ratio * smallest, largest_ratio * (rigid_body or start.inertia)),
    )


def _sine(period: float, amplitude: float) -> Trial:
    """Sine of torque from its peak on, ``period`` in s and ``amplitude`` in N m."""
    time = np.linspace(0.0, _PERIODS * period, _PERIODS * _SAMPLES + 1, dtype=np.float64)
    # Mean over each interval. The transient is shortest from the peak of the torque.
    torque = amplitude * np.cos(2.0 * np.pi * (time + 0.5 * period / _SAMPLES) / period)
    return Trial.from_commands(time, torque[:, None], name="sine")


def _hold(torque: float, rate: float, start: Model) -> Trial:
    """Constant ``torque`` in N m over several time constants at about ``rate`` in rad/s."""
    slope = 2.0 * start.quadratic_drag * rate + start.linear_drag
    constant = start.inertia / max(slope, 1e-12)
    time = np.linspace(0.0, _HOLD * constant, _HOLD_SAMPLES, dtype=np.float64)
    return Trial.from_commands(time, np.full((len(time), 1), torque), name="hold")
