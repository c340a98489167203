"""How far the clocks of one trial's files are apart: by what two of them saw alike, or by when the vehicle answers.

Where two files hold the same (a heading, a yaw rate, a copy of a command), their clocks can be brought together. Where
one holds the commands alone, what is known is when the vehicle answers them. A clock and a delay of the thrusters do
the same to that; but nothing answers before it was told to. So the maximum likelihood of `identify` is asked for a
delay that may be negative, of each trial by itself, with a lag of the thrusters beside it where the logs show one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import RovidError
from rovid.core.stats import chi2_sf
from rovid.effects import Effect, effect_named, restoring_effect
from rovid.effects.base import ActuatorInputs, EffectParameter, OnTorque, Values
from rovid.effects.per_trial import form_name, one_size_per_trial
from rovid.effects.restoring import regressors
from rovid.estimate.maximum_likelihood import LikelihoodFit, fit_likelihood
from rovid.preflight.clock_alignment import ClockAlignment, align_clocks
from rovid.preflight.clock_report import SURE, ClockOffset, ClockOffsets
from rovid.preflight.raw_columns import RawColumn
from rovid.readers.join_files import all_channels, relative_name
from rovid.signals.preprocessing import PreparedRuns, Run, prepare
from rovid.signals.rates import Rates
from rovid.trial.config import Config
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

# Shifts are looked for in such steps over so many s, and so many readings are enough for that.
_STEP, _LONGEST, _READINGS = 0.02, 5.0, 20_000
# A trial by itself is shifted otherwise than all where that leaves less than this share.
_OWN = 0.5
# A lag beside the shift is believed from so much log-likelihood on.
_GAINED = 8.0
# and where the shift gives way to so much of it: one that is far longer is something else that the model lacks.
_GIVES_WAY = 0.4
# How seldom offsets that are one differ so much by chance.
_CHANCE = 0.01
# Offsets known to so many s that agree are no chance.
SURELY = 0.03
_LAG = "thruster_lag"
# Instants of a trial on moved clocks are so many to a period.
_FINE = 50.0


def estimate_clock_offsets(trials: Sequence[Trial], config: Config) -> ClockOffsets:
    """What ``trials``, some of which were joined of several files, tell of those files' clocks."""
    joined = [trial for trial in trials if trial.companion_files] if config.join else []
    whole = {_whole(trial): trial for trial in joined}
    if not whole:
        return ClockOffsets()
    began: dict[str, float | None] = {}
    alike: list[ClockOffset] = []
    commanding: dict[str, tuple[str, float]] = {}
    for name, trial in whole.items():
        files = _files(trial, config)
        home = _home(files, config)
        if home is None:
            continue
        for file in files.keys() - {home}:
            found = align_clocks(files[home], files[file])
            began[relative_name(file, config)] = trial.start_epoch
            if found is not None:
                alike.append(_clock(file, found, config))
        if (owner := _owner(files, config)) is not None and owner != home:
            commanding[name] = relative_name(owner, config), _between(files[owner])
    known = {clock.name for clock in alike}
    open_ = {name: file for name, (file, _) in commanding.items() if file not in known}
    answers, lag = _answers([trial for trial in joined if _whole(trial) in open_], config.vehicle)
    told = [
        ClockOffset(name=open_[name], offset=offset, error=error, middle=0.5 * whole[name].duration)
        for name, (offset, error) in answers.items()
    ]
    # A change of a command may be as old as a reading, in all trials alike: the mean square over all that it may be.
    between = max((seconds for _, seconds in commanding.values()), default=0.0) / 3.0**0.5
    answered = [replace(clock, error=math.hypot(clock.error, between)) for clock in _shared(told, began, config)]
    every = (*_shared(alike, began, config), *answered)
    return ClockOffsets(offsets=tuple(replace(clock, given=_given(clock.name, config)) for clock in every), lag=lag)


def _given(name: str, config: Config) -> tuple[float, float]:
    """What [join] adds to the clock of a file, or of a part."""
    join = config.join
    if join is None:
        return 0.0, 0.0
    if name in join.parts:
        return join.offset.get(name, 0.0), join.drift.get(name, 0.0)
    return join.clock_correction(name)


def _between(found: dict[str, RawColumn]) -> float:
    """S between two readings, within which nobody knows when a command changed."""
    several = [seen.time for seen in found.values() if len(seen.time) > 1]
    return max((float(np.median(np.diff(time))) for time in several), default=0.0)


def _files(trial: Trial, config: Config) -> dict[Path, dict[str, RawColumn]]:
    """What the files of a trial hold; nothing of those that cannot be read whole."""
    try:
        every = all_channels(trial.path, config)
    except RovidError:
        return {}
    return {
        file: {
            source: RawColumn(source=source, time=channel.time, values=channel.values, radians=channel.radians)
            for source, channel in found.items()
        }
        for file, found in every.items()
    }


def _home(files: dict[Path, dict[str, RawColumn]], config: Config) -> Path | None:
    """The file in whose time the vehicle's motion stands."""
    sources = (
        set(config.signals[config.measured_signal].sources.values())
        if config.measured_signal in config.signals
        else set()
    )
    return next((file for file, found in files.items() if sources & found.keys()), None)


def _owner(files: dict[Path, dict[str, RawColumn]], config: Config) -> Path | None:
    """The file that holds all commands; None where several do."""
    wanted = [set(command.sources.values()) for command in config.commands]
    owners = [next((file for file, found in files.items() if sources & found.keys()), None) for sources in wanted]
    return owners[0] if len(set(owners)) == 1 else None


def _clock(file: Path, found: ClockAlignment, config: Config) -> ClockOffset:
    """Of what is alike; a drift that does not show is left out."""
    name = relative_name(file, config)
    if abs(found.drift) <= SURE * found.drift_error:
        return ClockOffset(name=name, offset=found.offset, error=found.error, by=found.columns, middle=found.middle)
    begin = found.offset - found.drift * found.middle
    error = math.hypot(found.error, found.drift_error * found.middle)
    return ClockOffset(
        name=name,
        offset=begin,
        error=error,
        drift=1e6 * found.drift,
        drift_error=1e6 * found.drift_error,
        by=found.columns,
    )


def _shared(clocks: Sequence[ClockOffset], began: Mapping[str, float | None], config: Config) -> list[ClockOffset]:
    """Of each part one clock for all its files where they differ by chance alone, or a drift through the day."""
    parts: dict[str, list[ClockOffset]] = {}
    for clock in clocks:
        parts.setdefault(config.join.part(clock.name) if config.join else "", []).append(clock)
    shared: list[ClockOffset] = []
    for part, own in parts.items():
        times = [began[clock.name] for clock in own]
        known = np.array([time + clock.middle for time, clock in zip(times, own, strict=True) if time is not None])
        surely = float(np.median([clock.error for clock in own])) < SURELY
        # Files that count from their own beginning were not begun at one moment, unless that shows.
        if len(own) < 2 or any(clock.drift for clock in own) or not (len(known) == len(own) or surely):
            shared += own
        elif (line := _line(own, np.zeros(len(own)))) is not None:
            shared.append(replace(own[0], name=part, offset=line[0][0], error=line[1][0]))
        elif len(known) == len(own) > 2 and (line := _line(own, known - known.mean())) is not None:
            shared += _through_the_day(own, known - known.mean(), line)
        else:
            shared += own
    return shared


def _through_the_day(
    clocks: Sequence[ClockOffset], time: FloatArray, line: tuple[list[float], list[float]]
) -> Iterator[ClockOffset]:
    """Each by a ``line`` over the (n,) times of their middles, where that rises or falls for sure."""
    (offset, drift), (error, drift_error) = line
    for clock, middle in zip(clocks, time.tolist(), strict=True):
        begin = middle - clock.middle
        by_line = replace(
            clock,
            offset=offset + drift * begin,
            error=math.hypot(error, drift_error * begin),
            drift=1e6 * drift,
            drift_error=1e6 * drift_error,
            middle=0.0,
        )
        yield by_line if abs(drift) > SURE * drift_error else clock


def _line(clocks: Sequence[ClockOffset], time: FloatArray) -> tuple[list[float], list[float]] | None:
    """Offset, and its growth over ``time`` if that varies, with standard errors; None where chance scatters less."""
    errors = np.array([clock.error for clock in clocks])
    x = np.column_stack((np.ones(len(time)), time)[: 1 + bool(np.ptp(time))]) / errors[:, None]
    y = np.array([clock.offset for clock in clocks]) / errors
    covariance = np.linalg.inv(x.T @ x)
    values = covariance @ (x.T @ y)
    scatter, freedom = float(np.sum((y - x @ values) ** 2)), max(len(y) - len(values), 1)
    if chi2_sf(freedom, scatter) < _CHANCE:
        return None
    # Errors that are too small show in the scatter.
    wide = max(1.0, scatter / freedom) ** 0.5
    return values.tolist(), (wide * np.sqrt(np.diag(covariance))).tolist()


# ---- by when the vehicle answers


def _answers(trials: Sequence[Trial], vehicle: Vehicle) -> tuple[dict[str, tuple[float, float]], float]:
    """S after which the vehicle answers, with its standard error, by trial; and the lag of the thrusters beside it."""
    if not trials or not trials[0].has_actuators:
        return {}, 0.0
    try:
        shifts = coarse_shifts(prepare(Campaign(trials=tuple(trials), sources=()), vehicle))
        moved = [_moved(trial, shifts[_whole(trial)]) for trial in trials if _whole(trial) in shifts]
        runs = prepare(Campaign(trials=tuple(moved), sources=()), vehicle.with_logged_torque(moved)).items
        names = list(dict.fromkeys(_whole(run.trial) for run in runs))
        effects = (_clock_effect(names),)
        plain = fit_likelihood(runs, vehicle, effects)
        lagged = fit_likelihood(runs, vehicle, (*effects, effect_named(_LAG)))
    except RovidError:
        return {}, 0.0
    lag, spread = _sizes(lagged, [f"{_LAG}.time_constant"])[0]
    without, beside = (_offsets(fit, names, shifts) for fit in (plain, lagged))
    gives = float(np.median([without[name][0] - beside[name][0] for name in names]))
    gained = lagged.log_likelihood - plain.log_likelihood
    if gained > _GAINED and lag > SURE * spread and gives > _GIVES_WAY * lag:
        return beside, lag
    return without, 0.0


def _offsets(fit: LikelihoodFit, names: Sequence[str], shifts: dict[str, float]) -> dict[str, tuple[float, float]]:
    parameters = [f"clock:{form_name(names)}.offset_{number}" for number in range(1, len(names) + 1)]
    found = zip(names, _sizes(fit, parameters), strict=True)
    return {name: (shifts[name] + value, error) for name, (value, error) in found}


def _sizes(fit: LikelihoodFit, parameters: Sequence[str]) -> list[tuple[float, float]]:
    """Value and standard error of each."""
    at = [fit.estimate.names.index(parameter) for parameter in parameters]
    errors = np.sqrt(np.diag(fit.estimate.covariance))[at]
    return list(zip(fit.estimate.values[at].tolist(), errors.tolist(), strict=True))


def _clock_effect(names: Sequence[str]) -> Effect:
    """A clock of its own in each trial, ahead or behind."""
    size = EffectParameter(name="offset", unit="s", neutral=0.0, low=-2.0, high=2.0, initial_values=(0.0,))
    sizes = tuple(replace(one, initial_values=(0.0,)) for one in one_size_per_trial(size, len(names), 0.0))

    def late(where: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
        own = {name: values[one.name] for name, one in zip(names, sizes, strict=True)}
        out = torque.copy()
        for trial in where.trials:
            out[trial.rows] = _put_off(where.time[trial.rows], torque[trial.rows], own[trial.parent])
        return out

    return replace(
        effect_named("command_delay"),
        id="clock",
        form=form_name(names),
        parameters=sizes,
        size_count=len(sizes),
        acts=OnTorque(late, settling_time=lambda *_: math.inf),
    )


def _put_off(time: FloatArray, values: FloatArray, late: float) -> FloatArray:
    """Means until the next of (n,) instants of the held ``values``, so many s later, or earlier."""
    ends = np.append(time, time[-1] + 1.0)
    integral = np.concatenate(([0.0], np.cumsum(values * np.diff(ends))))
    at = ends - late
    # Before the first and after the last the command stays.
    before, after = np.minimum(at - ends[0], 0.0), np.maximum(at - ends[-1], 0.0)
    moved = np.interp(at, ends, integral) + before * values[0] + after * values[-1]
    width = np.diff(ends)
    return np.where(width > 0.0, np.diff(moved) / np.where(width > 0.0, width, 1.0), values)


def _moved(trial: Trial, late: float) -> Trial:
    """``trial`` with its commands so many s later, and what was measured of the motion; nothing else."""
    # No two instants are to be all but one.
    fine = trial.sampling_interval / _FINE
    measured, commanded = (fine * np.round(time / fine) for time in (trial.time[trial.measured], trial.time + late))
    base = fine * np.unique(np.round(np.concatenate((measured, commanded)) / fine))
    first, last = max(measured[0], commanded[0]), min(measured[-1], commanded[-1])
    base = base[(base >= first - 0.5 * fine) & (base <= last + 0.5 * fine)]
    inside = (measured >= base[0] - 0.5 * fine) & (measured <= base[-1] + 0.5 * fine)
    position = np.full(len(base), np.nan)
    position[np.searchsorted(base, measured[inside] - 0.5 * fine)] = trial.position[trial.measured][inside]
    rows = np.maximum(np.searchsorted(commanded, base + 0.5 * fine, side="right") - 1, 0)
    rate = None
    if trial.rate_only and trial.rate is not None:
        rate = np.interp(base, measured, trial.rate[trial.measured])
    return replace(
        trial,
        time=base - base[0],
        position=position,
        commands=trial.commands[rows],
        rate=rate,
        roll=None,
        pitch=None,
        extras={},
    )


def _whole(trial: Trial) -> str:
    """Name of the log that a trial is of, or is a part of."""
    return trial.parent or trial.name


def coarse_shifts(runs: PreparedRuns) -> dict[str, float]:
    """S after which the vehicle answers, to a step, by log; the same in all unless one is far off."""
    steps, period = _steps(runs, _LONGEST)
    each = np.array([[_misfit([run], runs, int(step)) for step in steps] for run in runs.items])
    together = np.nansum(
        np.log(np.where(each > 0.0, each, np.nan)) * [[len(run.filtered_torque)] for run in runs.items], axis=0
    )
    common = int(np.argmin(together))
    shifts: dict[str, float] = {}
    for run, misfits in zip(runs.items, each, strict=True):
        alone = int(np.nanargmin(misfits)) if np.isfinite(misfits).any() else common
        best = alone if misfits[alone] < _OWN * misfits[common] else common
        shifts.setdefault(_whole(run.trial), float(steps[best] * period))
    return shifts


def response_lead(runs: PreparedRuns, longest: float) -> float | None:
    """S before its commands at which the vehicle answers, negative where it does after them; None if nothing tells."""
    steps, period = _steps(runs, longest)
    misfits = np.array([_misfit(runs.items, runs, int(step)) for step in steps])
    if not np.isfinite(misfits).all():
        return None
    best = int(np.argmin(misfits))
    return -float(steps[best] * period) if 0 < best < len(steps) - 1 else None


def _steps(runs: PreparedRuns, longest: float) -> tuple[IntArray, float]:
    """Shifts in samples to be tried, and the period of a sample."""
    period = runs.items[0].rates.kernel.period
    each = max(round(_STEP / period), 1)
    most = round(longest / (each * period))
    return each * np.arange(-most, most + 1), period


def _misfit(own: Sequence[Run], runs: PreparedRuns, shift: int) -> float:
    """Mean square that a regression leaves of a drive ``shift`` samples later."""
    restoring = restoring_effect(runs.axis)
    readings = sum(len(run.filtered_torque) for run in own)
    each = readings // _READINGS + 1
    rows, drives = [], []
    for run in own:
        drive = _later(run.filtered_torque, shift)
        known = np.flatnonzero(run.rates.valid & np.isfinite(drive))[::each]
        rows.append(_regressors(run.rates, known, restoring))
        drives.append(drive[known])
    x = np.concatenate(rows)
    y = np.concatenate(drives)
    if len(y) < 10 * x.shape[1]:
        return math.nan
    values = np.linalg.lstsq(x, y, rcond=None)[0]
    left = y - x @ values
    return float(np.mean(left**2))


def _regressors(rates: Rates, rows: IntArray, restoring: Effect | None) -> FloatArray:
    """(n, k) what the drive of these rows works against: inertia, drag, a constant, and what brings back."""
    rate = rates.rate[rows]
    plain = (rates.acceleration[rows], np.abs(rate) * rate, rate, np.ones(len(rate)))
    return np.column_stack((*plain, regressors(restoring, rates.position[rows])))


def _later(drive: FloatArray, shift: int) -> FloatArray:
    """The drive ``shift`` samples later, or earlier where that is negative; NaN where it was not logged."""
    late, early = max(shift, 0), max(-shift, 0)
    moved = np.full(len(drive), np.nan)
    moved[late : len(drive) - early] = drive[early : len(drive) - late]
    return moved
