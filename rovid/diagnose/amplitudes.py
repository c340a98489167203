"""What tables of steady turns and sine trials show that the model misses: amplitudes, without a time series."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize, stats

from rovid.campaign.tables import Table
from rovid.campaign.trial import Trial
from rovid.campaign.vehicle import ThrustCurve, Thruster, Vehicle
from rovid.effects import Effect, forms_for
from rovid.effects.base import Scales
from rovid.ground.arrays import FloatArray
from rovid.ground.workers import spread
from rovid.identify.estimate import Estimate
from rovid.identify.inertia import InertiaFit
from rovid.identify.inertia_table import table_drag
from rovid.model.model import Model

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
class Prediction:
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
    misfit: float
    chance: float

    @property
    def sizes(self) -> dict[str, tuple[float, str]]:
        """Value and unit of each parameter of the effect; a command is the torque here."""
        effect = self.model.effects[0]
        values = zip(effect.parameters, self.model.effect_values, strict=True)
        return {p.name: (value, p.unit.replace("command", "N m")) for p, value in values}

    @property
    def explains(self) -> bool:
        """Whether the reading of the rates accounts for what is left."""
        return self.misfit < _BY_CHANCE if math.isnan(self.chance) else self.chance > _BY_CHANCE


@dataclass(frozen=True, kw_only=True, eq=False)
class Amplitudes:
    """Tables against the model; where that misses them, of each effect its best form, the nearest effect first.

    ``inertias`` are the least and the largest that were allowed, kg m^2.
    """

    predictions: tuple[Prediction, ...]
    plain: Explanation
    with_effect: tuple[Explanation, ...]
    inertias: tuple[float, float]

    @property
    def causes(self) -> tuple[Explanation, ...]:
        """Those that would explain the tables; none where nothing asks for one."""
        return tuple(each for each in self.with_effect if each.explains)

    @property
    def ruled_out(self) -> tuple[Effect, ...]:
        """Those that would not, by themselves."""
        return tuple(each.model.effects[0] for each in self.with_effect if not each.explains)

    @property
    def missing(self) -> str:
        """What these tables leave open, and why."""
        if self.plain.explains:
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

    def simulated(self, run: Trial, model: Model) -> float:
        """What a table would say of ``run``, rad/s: the peak of a sine and the mean of a hold, once it has settled."""
        rate, _ = model.simulate(run, model.drive(self.vehicle, run))
        return float(rate[-_SAMPLES:].max() if run.name == "sine" else rate[-_HOLD_END:].mean())

    def misfits(self, model: Model) -> FloatArray:
        """(n,) in standard deviations of their reading."""
        return (np.array([self.simulated(run, model) for run in self.runs]) - self.rates) / self.errors

    def nearest(self, begin: Model, effect: Effect | None = None) -> Explanation:
        """Inertia, effect and the drag, unless it is known, fitted to all rows together from ``begin``."""
        torque, rate = float(self.vehicle.thrusters[0].command_range() / 2.0), float(self.rates.max())
        scales = Scales(command=torque, torque=torque, rate=rate, race=math.sqrt(torque))
        parameters = () if effect is None else effect.parameters
        # Neither drag alone can be much larger than all of it at the largest torque and rate.
        most = [] if self.drag_known else [2.0 * torque / rate**2, 2.0 * torque / rate]
        units = np.array([1.0, *most, *(scales.of(parameter) for parameter in parameters)])
        own = 1 + len(most)

        def model(x: FloatArray) -> Model:
            drag = x[1:own] * units[1:own]
            return replace(
                begin,
                inertia=math.exp(x[0]),
                quadratic_drag=float(drag[0]) if most else begin.quadratic_drag,
                linear_drag=float(drag[1]) if most else begin.linear_drag,
                effects=() if effect is None else (effect,),
                effect_values=tuple(float(value) for value in x[own:] * units[own:]),
            )

        def misfits(x: FloatArray) -> FloatArray:
            return self.misfits(model(x))

        low = np.array([math.log(self.inertias[0]), *(0.0 for _ in most), *(p.low for p in parameters)])
        high = np.array([math.log(self.inertias[1]), *(1.0 for _ in most), *(p.high for p in parameters)])
        drag = np.array([begin.quadratic_drag, begin.linear_drag])[: len(most)] / most
        rest = np.array([math.log(begin.inertia), *drag])
        begins = [
            np.clip(np.concatenate((rest, one)), low, high) for one in ([()] if effect is None else effect.starts)
        ]
        begins = sorted(begins, key=lambda x: float(np.sum(misfits(x) ** 2)))[:_STARTS]
        steps = np.full(len(low), _NUDGE)

        def fitted(x: FloatArray, evaluations: int) -> optimize.OptimizeResult:
            return optimize.least_squares(
                misfits, x, bounds=(low, high), diff_step=steps, max_nfev=evaluations, ftol=_FINE, xtol=0.1 * _FINE
            )

        tried = [fitted(x, _FIRST_EVALUATIONS) for x in begins]
        fit = fitted(min(tried, key=lambda fit: float(fit.cost)).x, _EVALUATIONS)
        misfit, spare = 2.0 * float(fit.cost), len(self.rates) - len(low)
        chance = float(stats.chi2.sf(misfit, spare)) if spare > 0 else math.nan
        return Explanation(model=model(fit.x), misfit=misfit, chance=chance)


def explain(
    sine: Table, steady: Table | None, drag: Estimate | None, inertia: InertiaFit, rigid_body: float | None
) -> Amplitudes:
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
    start = Model(
        inertia=inertia.estimate.value("inertia"), quadratic_drag=float(quadratic[0]), linear_drag=float(linear[0])
    )
    rows = _rows(sine, steady, start, rigid_body)
    plain = rows.nearest(rows.start)
    forms = () if plain.explains else forms_for(rows.vehicle)
    tried = [effect for effect in forms if not effect.wave and effect.on_heading is None]
    best: dict[str, Explanation] = {}
    for fit in sorted(spread(lambda effect: rows.nearest(plain.model, effect), tried), key=_unlikely):
        best.setdefault(fit.model.effects[0].id, fit)
    own = [replace(start, quadratic_drag=q, linear_drag=d) for q, d in zip(quadratic, linear, strict=True)]
    return Amplitudes(
        predictions=tuple(_predictions(sine, rows, own, inertia)),
        plain=plain,
        with_effect=tuple(best.values()),
        inertias=rows.inertias,
    )


def _predictions(sine: Table, rows: _Rows, models: Sequence[Model], inertia: InertiaFit) -> Iterator[Prediction]:
    """Every sine with the inertia of every method and the drag that the table gives it."""
    names = sine.text("trial") if "trial" in sine.header else [f"row {line}" for line in sine.lines]
    for key, reading in inertia.methods.items():
        for name, model, run, rate in zip(names, models, rows.runs, rows.rates, strict=False):
            yield Prediction(
                trial=name,
                method=key,
                inertia=reading.value,
                measured=float(rate),
                predicted=rows.simulated(run, replace(model, inertia=reading.value)),
            )


def _rows(sine: Table, steady: Table | None, start: Model, rigid_body: float | None) -> _Rows:
    period, torque = sine.numbers("period_s"), sine.numbers("torque_amplitude_Nm")
    runs = [_sine(float(p), float(amplitude)) for p, amplitude in zip(period, torque, strict=True)]
    tables = [(sine, "peak_yaw_rate_rad_s"), *([] if steady is None else [(steady, "yaw_rate_rad_s")])]
    if steady is not None:
        pairs = zip(steady.numbers("torque_Nm"), steady.numbers("yaw_rate_rad_s"), strict=True)
        slowest = _SLOWEST * float(np.max(np.abs(steady.numbers("yaw_rate_rad_s"))))
        runs += [_hold(float(push), max(abs(float(rate)), slowest), start) for push, rate in pairs]
    return _Rows(
        runs=runs,
        rates=np.concatenate([table.numbers(column) for table, column in tables]),
        errors=_READING * np.concatenate([table.resolution(column) for table, column in tables]),
        start=start,
        vehicle=_of_torque(max(float(np.abs(run.commands).max()) for run in runs)),
        drag_known=steady is None,
        inertias=(_RATIOS[0] * (rigid_body or start.inertia / _RATIOS[1]), _RATIOS[1] * (rigid_body or start.inertia)),
    )


def _sine(period: float, amplitude: float) -> Trial:
    time = np.linspace(0.0, _PERIODS * period, _PERIODS * _SAMPLES + 1, dtype=np.float64)
    # The mean over each interval, for which it is held. A rate that starts at the torque's peak has least to forget.
    torque = amplitude * np.cos(2.0 * np.pi * (time + 0.5 * period / _SAMPLES) / period)
    return Trial.imagined(time, torque[:, None], name="sine")


def _hold(torque: float, rate: float, start: Model) -> Trial:
    constant = start.inertia / max(2.0 * start.quadratic_drag * rate + start.linear_drag, 1e-12)
    time = np.linspace(0.0, _HOLD * constant, _HOLD_SAMPLES, dtype=np.float64)
    return Trial.imagined(time, np.full((len(time), 1), torque), name="hold")


def _of_torque(most: float) -> Vehicle:
    """A vehicle whose command is the torque itself, up to ``most`` N m."""
    ends = np.array([-most, 0.0, most])
    curve = ThrustCurve(command=ends, thrust=ends)
    return Vehicle(name="", thrusters=(Thruster(name="torque", arm=1.0, curve=curve, clamp=True),))


def _unlikely(fit: Explanation) -> tuple[float, float]:
    """To sort by: what chance allows first; where there are no rows to spare, last."""
    return (1.0 if math.isnan(fit.chance) else -fit.chance, fit.misfit)
