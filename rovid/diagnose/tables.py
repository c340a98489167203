"""What tables of steady turns and sine trials show that the model misses: amplitudes, without a time series."""

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
from rovid.effects import Effect, forms_for
from rovid.effects.base import OnHeading, Scales, WaveTorque
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import InertiaFit
from rovid.estimate.inertia_table import row_names, table_drag
from rovid.model.command_series import CommandSeries
from rovid.model.model import Model
from rovid.model.torque_input import MAX_SUBDIVISION
from rovid.trial.tables import CsvTable
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle

if TYPE_CHECKING:
    from scipy import optimize

# Periods of a simulated sine, the last of which is looked at, and samples in each.
_PERIODS, _SAMPLES = 6, 80
# Time constants of a simulated hold, and how many samples of its end are looked at.
_HOLD, _HOLD_SAMPLES, _HOLD_END = 20.0, 320, 80
# Standard deviation of a rate as read, in its last printed digit.
_READING = 0.5
# Of the fastest hold: one that is slower has no longer to settle.
_SLOWEST = 0.05
# Where fewer right models than this would miss as much, the misfit is not one of reading.
_BY_CHANCE = 0.05
# Total over rigid-body inertia that an explanation may ask for; a closed hull full of water has 4.
_RATIOS = (1.0, 4.0)
_NUDGE = 1e-3
# A fit goes on from the best of its starts, until it gains no more than so small a share.
_STARTS, _FIRST_EVALUATIONS, _EVALUATIONS, _FINE = 3, 8, 30, 1e-3


@dataclass(frozen=True, kw_only=True)
class SinePrediction:
    """Peak yaw rate in rad/s of a sine trial as measured, and simulated with the inertia in kg m^2 of a method."""

    trial: str
    method: str
    inertia: float
    measured: float
    predicted: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Explanation:
    """The model with at most one effect that comes nearest to all rows of the tables.

    Attributes
    ----------
    misfit
        Sum of squared misfits of the rates over the variance of their reading.
    chance
        Share of right models that would miss as much; NaN with no more rows than parameters.
    """

    model: Model
    chi2: float
    p_value: float

    @property
    def sizes(self) -> dict[str, tuple[float, str]]:
        """Value and unit of each parameter of the effect; a command is the torque here."""
        sizes = {}
        for parameter, value in zip(self.model.effects[0].parameters, self.model.effect_values, strict=True):
            sizes[parameter.name] = (value, parameter.unit.replace("command", "N m"))
        return sizes

    @property
    def explains(self) -> bool:
        """Whether the reading of the rates accounts for what is left."""
        if math.isnan(self.p_value):
            return self.chi2 < _BY_CHANCE
        return self.p_value > _BY_CHANCE


@dataclass(frozen=True, kw_only=True, eq=False)
class TableDiagnosis:
    """Tables against the model; where that misses them, of each effect its best form, the nearest effect first.

    ``inertias`` are the least and the largest that were allowed, kg m^2.
    """

    predictions: tuple[SinePrediction, ...]
    without_effect: Explanation
    with_one_effect: tuple[Explanation, ...]
    inertias: tuple[float, float]

    @property
    def causes(self) -> tuple[Explanation, ...]:
        """Those that would explain the tables; none where nothing asks for one."""
        return tuple(each for each in self.with_one_effect if each.explains)

    @property
    def ruled_out(self) -> tuple[Effect, ...]:
        """Those that would not, by themselves."""
        return tuple(each.model.effects[0] for each in self.with_one_effect if not each.explains)

    @property
    def missing(self) -> str:
        """What these tables leave open, and why."""
        if self.without_effect.explains:
            return (
                "the plain model agrees with the tables as closely as they were read. Amplitudes without a time series "
                "show no more, and nothing can be held out: record the runs as logs."
            )
        return (
            f"no plain model agrees with the tables, with an inertia of {self.inertias[0]:.4g} to "
            f"{self.inertias[1]:.4g} kg m^2; {len(self.causes)} effects would, each by itself. Amplitudes without a "
            "time series do not tell which, and nothing can be held out: record the runs as logs."
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Rows:
    """The rows of the tables as runs whose torque is known, the sines first.

    Attributes
    ----------
    rates
        (n,) rad/s, the peak of each sine and the mean of each hold.
    errors
        (n,) standard deviations of their reading.
    start
        Inertia and drag to start from.
    vehicle
        Its one command is the torque in N m.
    drag_known
        Whether the drag is given, for want of holds to fit it to.
    inertias
        The least and the largest that an explanation may ask for, kg m^2.
    """

    runs: list[Trial]
    rates: FloatArray
    errors: FloatArray
    start: Model
    vehicle: Vehicle
    drag_known: bool
    inertias: tuple[float, float]

    def simulated(self, model: Model) -> FloatArray:
        """(n,) rad/s, what tables would say: the peak of a sine and the mean of a hold, once it has settled."""
        drive = model.actuators.torque_inputs(self._given[model.actuators.subdivision])
        return np.array([*map(_as_told, self.runs, model.simulate_rates(self.runs, drive))])

    @cached_property
    def _given(self) -> dict[int, CommandSeries]:
        """The commands of all runs, by the parts into which each interval is cut."""
        return {parts: CommandSeries.from_trials(self.vehicle, self.runs, parts) for parts in (1, MAX_SUBDIVISION)}

    def misfits(self, model: Model) -> FloatArray:
        """(n,) in standard deviations of their reading."""
        return (self.simulated(model) - self.rates) / self.errors

    def nearest(self, begin: Model, effects: Sequence[Effect | None]) -> list[Explanation]:
        """Inertia, each effect and the drag, unless it is known, fitted to all rows together from ``begin``."""
        problems = [_Problem(self, begin, effect) for effect in effects]
        solved = parallel_map(lambda problem: problem.solved(), problems)
        return [problem.explained(*told) for problem, told in zip(problems, solved, strict=True)]


class _Problem:
    """Inertia, drag unless it is known, and one effect as coordinates to fit to ``rows``.

    The inertia stands there by its logarithm; all else in its own size. ``low`` and ``high`` are the bounds.
    """

    def __init__(self, rows: _Rows, begin: Model, effect: Effect | None) -> None:
        self.rows, self.begin = rows, begin
        self.effects = () if effect is None else (effect,)
        self.starts = [()] if effect is None else effect.initial_values
        parameters = () if effect is None else effect.parameters
        torque = float(rows.vehicle.thrusters[0].command_range() / 2.0)
        rate = float(rows.rates.max())
        scales = Scales(command=torque, torque=torque, rate=rate, wash=math.sqrt(torque))
        # Neither drag alone can be much larger than all of it at the largest torque and rate.
        self.most = [] if rows.drag_known else [2.0 * torque / rate**2, 2.0 * torque / rate]
        drags = len(self.most)
        self.own = 1 + drags
        sizes = [scales.unit_size(parameter) for parameter in parameters]
        self.units = np.array([1.0, *self.most, *sizes])
        least, largest = rows.inertias
        self.low = np.array([math.log(least), *[0.0] * drags, *[one.low for one in parameters]])
        self.high = np.array([math.log(largest), *[1.0] * drags, *[one.high for one in parameters]])

    def begins(self) -> list[FloatArray]:
        """Where a fit may start: the inertia and drag of ``begin`` with each start of the effect."""
        known = np.array([self.begin.quadratic_drag, self.begin.linear_drag])
        drag = known[: len(self.most)] / self.most
        rest = np.array([math.log(self.begin.inertia), *drag])
        return [np.clip(np.concatenate((rest, start)), self.low, self.high) for start in self.starts]

    def model(self, x: FloatArray) -> Model:
        """The model at (q,) ``x``."""
        sizes = x[self.own :] * self.units[self.own :]
        values = tuple(float(value) for value in sizes)
        model = replace(self.begin, inertia=math.exp(x[0]), effects=self.effects, effect_values=values)
        if not self.most:
            return model
        quadratic, linear = x[1 : self.own] * self.units[1 : self.own]
        return replace(model, quadratic_drag=float(quadratic), linear_drag=float(linear))

    def misfits(self, x: FloatArray) -> FloatArray:
        """(n,) of the rows."""
        return self.rows.misfits(self.model(x))

    def misfit(self, x: FloatArray) -> float:
        """Their sum of squares."""
        return float(np.sum(self.misfits(x) ** 2))

    def solved(self) -> tuple[FloatArray, float]:
        """(q,) where that is least, and how much it is."""
        begins = sorted(self.begins(), key=self.misfit)[:_STARTS]
        tried = [self.fitted(x, _FIRST_EVALUATIONS) for x in begins]
        best = min(tried, key=lambda fit: float(fit.cost))
        fit = self.fitted(best.x, _EVALUATIONS)
        # The solver's cost is half the sum of squares.
        return fit.x, 2.0 * float(fit.cost)

    def explained(self, x: FloatArray, misfit: float) -> Explanation:
        """What (q,) ``x`` with such a ``misfit`` comes to."""
        spare = len(self.rows.rates) - len(self.low)
        chance = chi2_sf(spare, misfit) if spare > 0 else math.nan
        return Explanation(model=self.model(x), chi2=misfit, p_value=chance)

    def fitted(self, x: FloatArray, evaluations: int) -> optimize.OptimizeResult:
        """Least squares from ``x``."""
        from scipy import optimize

        return optimize.least_squares(
            self.misfits,
            x,
            bounds=(self.low, self.high),
            diff_step=np.full(len(self.low), _NUDGE),
            max_nfev=evaluations,
            ftol=_FINE,
            xtol=0.1 * _FINE,
        )


def diagnose_tables(
    sine: CsvTable, steady: CsvTable | None, drag: Estimate | None, inertia: InertiaFit, rigid_body: float | None
) -> TableDiagnosis:
    """Look for effects with which one model agrees with every row of the tables.

    Parameters
    ----------
    drag
        From the steady turns, where they are known; with their table, it is fitted anew together with the sines.
    rigid_body
        kg m^2; no explanation may ask for an inertia below it.

    Raises
    ------
    RovidError
        A cell is no number, or no drag is known.
    """
    quadratic, linear = table_drag(sine, drag)
    value = inertia.estimate.value("inertia")
    start = Model(inertia=value, quadratic_drag=float(quadratic[0]), linear_drag=float(linear[0]))
    rows = _rows(sine, steady, start, rigid_body)
    (plain,) = rows.nearest(rows.start, [None])
    with_effect = () if plain.explains else _with_effect(rows, plain.model)
    own = [replace(start, quadratic_drag=q, linear_drag=d) for q, d in zip(quadratic, linear, strict=True)]
    return TableDiagnosis(
        predictions=tuple(_predictions(sine, rows, own, inertia)),
        without_effect=plain,
        with_one_effect=with_effect,
        inertias=rows.inertias,
    )


def _with_effect(rows: _Rows, plain: Model) -> tuple[Explanation, ...]:
    """Of each effect its best form beside ``plain``, the nearest effect first."""
    from rovid.model.kernels import is_compiled

    # Amplitudes tell nothing of waves, nor of what acts by the heading.
    tried = [effect for effect in forms_for(rows.vehicle) if not isinstance(effect.acts, OnHeading | WaveTorque)]
    with forked_workers(enabled=is_compiled()):
        return _best_forms(rows.nearest(plain, tried))


def _best_forms(fits: Sequence[Explanation]) -> tuple[Explanation, ...]:
    """The likeliest of each effect, the likeliest effect first."""
    best: dict[str, Explanation] = {}
    for fit in sorted(fits, key=_unlikely):
        best.setdefault(fit.model.effects[0].id, fit)
    return tuple(best.values())


def _predictions(sine: CsvTable, rows: _Rows, models: Sequence[Model], inertia: InertiaFit) -> Iterator[SinePrediction]:
    """Every sine with the inertia of every method and the drag that the table gives it."""
    for key, reading in inertia.methods.items():
        # Rates go on with the holds after the sines: the names end first.
        for at, (name, model, rate) in enumerate(zip(row_names(sine), models, rows.rates, strict=False)):
            yield SinePrediction(
                trial=name,
                method=key,
                inertia=reading.value,
                measured=float(rate),
                predicted=float(rows.simulated(replace(model, inertia=reading.value))[at]),
            )


def _rows(sine: CsvTable, steady: CsvTable | None, start: Model, rigid_body: float | None) -> _Rows:
    period, torque = sine.numbers("period_s"), sine.numbers("torque_amplitude_Nm")
    runs = [_sine(float(p), float(amplitude)) for p, amplitude in zip(period, torque, strict=True)]
    tables = [(sine, "peak_yaw_rate_rad_s")]
    if steady is not None:
        runs += _holds(steady, start)
        tables.append((steady, "yaw_rate_rad_s"))
    rates = [table.numbers(column) for table, column in tables]
    digits = [table.resolution(column) for table, column in tables]
    largest = max(float(np.abs(run.commands).max()) for run in runs)
    return _Rows(
        runs=runs,
        rates=np.concatenate(rates),
        errors=_READING * np.concatenate(digits),
        start=start,
        vehicle=_of_torque(largest),
        drag_known=steady is None,
        inertias=_inertias(start, rigid_body),
    )


def _inertias(start: Model, rigid_body: float | None) -> tuple[float, float]:
    """The least and the largest that there may be, water set in motion included, in kg m^2."""
    # Without a rigid body's inertia, what was found may itself be the largest of its kind, or the least.
    least = rigid_body or start.inertia / _RATIOS[1]
    most = rigid_body or start.inertia
    return _RATIOS[0] * least, _RATIOS[1] * most


def _holds(steady: CsvTable, start: Model) -> list[Trial]:
    """A hold for each row of the steady turns."""
    torque, rate = steady.numbers("torque_Nm"), np.abs(steady.numbers("yaw_rate_rad_s"))
    reached = np.maximum(rate, _SLOWEST * np.max(rate))
    pairs = zip(torque.tolist(), reached.tolist(), strict=True)
    return [_hold(held, speed, start) for held, speed in pairs]


def _sine(period: float, amplitude: float) -> Trial:
    """A sine of torque, ``period`` in s and ``amplitude`` in N m, from its peak on."""
    time = np.linspace(0.0, _PERIODS * period, _PERIODS * _SAMPLES + 1, dtype=np.float64)
    # The mean over each interval, for which it is held. A rate that starts at the torque's peak has least to forget.
    torque = amplitude * np.cos(2.0 * np.pi * (time + 0.5 * period / _SAMPLES) / period)
    return Trial.from_commands(time, torque[:, None], name="sine")


def _hold(torque: float, rate: float, start: Model) -> Trial:
    """A ``torque`` in N m held for several time constants at about ``rate`` in rad/s."""
    slope = 2.0 * start.quadratic_drag * rate + start.linear_drag
    constant = start.inertia / max(slope, 1e-12)
    time = np.linspace(0.0, _HOLD * constant, _HOLD_SAMPLES, dtype=np.float64)
    return Trial.from_commands(time, np.full((len(time), 1), torque), name="hold")


def _of_torque(most: float) -> Vehicle:
    """A vehicle whose command is the torque itself, up to ``most`` N m."""
    ends = np.array([-most, 0.0, most])
    curve = ThrustCurve(command=ends, thrust=ends)
    return Vehicle(name="", thrusters=(Thruster(name="torque", arm=1.0, curve=curve, clamp=True),))


def _as_told(run: Trial, rate: FloatArray) -> float:
    """What a table says of the (n,) ``rate`` of ``run``, rad/s."""
    if run.name == "sine":
        return float(rate[-_SAMPLES:].max())
    return float(rate[-_HOLD_END:].mean())


def _unlikely(fit: Explanation) -> tuple[float, float]:
    """To sort by: what chance allows first; where there are no rows to spare, last."""
    if math.isnan(fit.p_value):
        return 1.0, fit.chi2
    return -fit.p_value, fit.chi2
