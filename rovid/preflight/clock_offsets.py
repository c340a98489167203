"""Offsets between the clocks of one trial's files, from signals in both files or from the response of the vehicle.

Two files with the same signal (a heading, a yaw rate, a copy of a command) are aligned by that signal. Where one file
holds only the commands, the response of the vehicle dates them. A clock offset then looks like a delay of the
thrusters, except that no vehicle responds before the command. The maximum likelihood fit estimates a delay of either
sign in each trial, with a lag of the thrusters in addition where it is significant.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import RovidError
from rovid.core.stats import chi2_sf
from rovid.effects import Effect, effect_named
from rovid.effects.base import ActuatorInputs, EffectParameter, OnTorque, Values
from rovid.effects.clock_offset import mean_shifted
from rovid.effects.further_terms import form_name
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.maximum_likelihood import INNOVATIONS_R2, fit_innovations
from rovid.estimate.nested_fits import fit_with_effects
from rovid.estimate.output_error import fit_output_error
from rovid.faults.clocks_apart import OCTAVES
from rovid.faults.response_delay import ShiftedTorque, response_delay
from rovid.preflight.clock_alignment import SIGNIFICANT, ClockOffset, ClockOffsets, align_clocks
from rovid.preflight.raw_columns import Log, RawColumn
from rovid.readers.formats import all_channels, relative_name
from rovid.trial.config import Config
from rovid.trial.log_files import Join
from rovid.trial.preprocessing import Run, prepare, shift_commands
from rovid.trial.rates import choose_cutoff
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

# Samples of all stretches together that the fits take, and the shortest stretch in periods of the cut-off.
_MAX_READINGS, _SHORTEST = 6000, 24.0
# Minimum log-likelihood gain to accept a lag in addition to the shifts, and minimum reduction of the shifts as a share
# of that lag: a lag far longer than the reduction describes another deficiency of the model.
_MIN_GAIN, _MIN_REDUCTION = 8.0, 0.4
# Significance level of the test that all offsets are equal.
_LEVEL = 0.01
# s, standard error from which equal offsets of independent clocks are no coincidence.
_PRECISE = 0.03
_LAG = "thruster_lag"
# Fields of a trial that the response needs not.
_NO_TILT: dict[str, Any] = {"roll": None, "pitch": None, "extras": {}}


def estimate_clock_offsets(trials: Sequence[Trial], config: Config) -> ClockOffsets:
    """Clock offsets of the files that ``trials`` were joined from."""
    joined = [trial for trial in trials if trial.companion_files] if config.join else []
    wholes = {_parent(trial): trial for trial in joined}
    if not wholes:
        return ClockOffsets()
    measured = config.signals.get(config.measured_signal)
    motion = set() if measured is None else set(measured.sources.values())
    starts: dict[str, float | None] = {}
    aligned: list[ClockOffset] = []
    command_files: dict[str, tuple[str, float]] = {}
    for name, trial in wholes.items():
        files = _read_files(trial, config)
        home = _file_with(files, motion)
        if home is None:
            continue
        for file in files.keys() - {home}:
            starts[relative_name(file, config)] = trial.start_epoch
            alignment = align_clocks(files[home], files[file])
            if alignment is not None:
                aligned.append(replace(alignment.at_start, name=relative_name(file, config)))
        owners = {_file_with(files, set(command.sources.values())) for command in config.commands}
        owner = owners.pop() if len(owners) == 1 else None
        if owner is not None and owner != home:
            intervals = [float(np.median(np.diff(c.time))) for c in files[owner].values() if len(c.time) > 1]
            command_files[name] = relative_name(owner, config), max(intervals, default=0.0)
    known = {clock.name for clock in aligned}
    unknown = {name: file for name, (file, _) in command_files.items() if file not in known}
    # A command may have changed at any time since the sample before, in all trials alike: root mean square of that.
    interval = max((seconds for _, seconds in command_files.values()), default=0.0) / 3.0**0.5
    delays, lag = _response_delays([trial for trial in joined if _parent(trial) in unknown], config.vehicle)
    responses = [
        ClockOffset(name=unknown[name], offset=delay, error=error, middle=0.5 * wholes[name].duration)
        for name, (delay, error) in delays.items()
    ]
    changes = [np.count_nonzero(np.diff(wholes[name].commands, axis=0).any(axis=1)) for name in delays]
    scatter = interval / max(float(np.median(changes)), 1.0) ** 0.5 if changes else 0.0
    offsets = pooled_offsets(aligned, starts, config.join)
    for clock in pooled_offsets(responses, starts, config.join, scatter):
        offsets.append(replace(clock, error=math.hypot(clock.error, interval)))
    if any(clock.certain and not clock.by for clock in offsets):
        # A vehicle that drifts at rest, or in a tank whose water swings back and forth, only seems to respond early: a
        # memory of the water and a torque of the heading explain it.
        runs = prepare(Campaign(trials=tuple(joined), sources=()), config.vehicle.with_logged_torque(joined)).items
        found = response_delay(runs, memories=OCTAVES)
        if found is None or found.delay >= -SIGNIFICANT * found.error:
            offsets = [clock for clock in offsets if clock.by or not clock.certain]
    return ClockOffsets(offsets=tuple(replace(clock, given=_given(clock.name, config)) for clock in offsets), lag=lag)


def _given(name: str, config: Config) -> tuple[float, float]:
    """Setting of [join] for the clock of a file, or of a part: s and ppm."""
    join = config.join
    if join is None:
        return 0.0, 0.0
    if name in join.parts:
        return join.offset.get(name, 0.0), join.drift.get(name, 0.0)
    return join.clock_correction(name)


def _read_files(trial: Trial, config: Config) -> dict[Path, dict[str, RawColumn]]:
    """Log of each file of a trial; empty if one cannot be read."""
    try:
        channels = all_channels(trial.path, config)
    except RovidError:
        return {}
    files: dict[Path, dict[str, RawColumn]] = {}
    for file, found in channels.items():
        files[file] = {
            source: RawColumn(source=source, time=channel.time, values=channel.values, radians=channel.radians)
            for source, channel in found.items()
        }
    return files


def _file_with(files: Mapping[Path, Log], sources: set[str]) -> Path | None:
    return next((file for file, columns in files.items() if sources & columns.keys()), None)


# ---- files of one part


def pooled_offsets(
    clocks: Sequence[ClockOffset], starts: Mapping[str, float | None], join: Join | None, scatter: float = 0.0
) -> list[ClockOffset]:
    """One clock for all files of a part if the offsets agree, or a common drift, or else the clocks themselves.

    A file with a setting of its own under [join] stays by itself.

    ``scatter``: s, standard deviation between the offsets of files with one clock, besides their errors.
    """
    parts: dict[str, list[ClockOffset]] = {}
    for clock in clocks:
        name = "" if join is None else join.part(clock.name)
        if join is not None and not join.is_corrected_by_part(clock.name):
            name = clock.name
        parts.setdefault(name, []).append(clock)
    pooled: list[ClockOffset] = []
    for part, own in parts.items():
        times = [(starts[clock.name], clock.middle) for clock in own]
        known = np.array([start + middle for start, middle in times if start is not None])
        precise = float(np.median([clock.error for clock in own])) < _PRECISE
        # Clocks that start at zero in each file agree by coincidence only, unless they agree precisely.
        if len(own) < 2 or any(clock.drift for clock in own) or not (len(known) == len(own) or precise):
            pooled += own
        elif (line := _fit_line(own, np.zeros(len(own)), scatter)) is not None:
            pooled.append(replace(own[0], name=part, offset=line[0][0], error=line[1][0]))
        else:
            # By one clock, no log begins before the middle of another.
            logs = sorted((begin, half) for begin, half in times if begin is not None)
            in_turn = all(after >= begin + half for (begin, half), (after, _) in itertools.pairwise(logs))
            if len(known) == len(own) > 2 and in_turn:
                line = _fit_line(own, known - known.mean(), scatter)
            pooled += own if line is None else _on_line(own, known - known.mean(), line)
    return pooled


def _fit_line(
    clocks: Sequence[ClockOffset], time: FloatArray, scatter: float
) -> tuple[list[float], list[float]] | None:
    """Weighted mean offset, and slope over ``time`` unless constant, with standard errors; None if chi^2 rejects it."""
    errors = np.array([math.hypot(clock.error, scatter) for clock in clocks])
    x = np.column_stack((np.ones(len(time)), time)[: 1 + bool(np.ptp(time))]) / errors[:, None]
    y = np.array([clock.offset for clock in clocks]) / errors
    covariance = np.linalg.inv(x.T @ x)
    values = covariance @ (x.T @ y)
    chi2, freedom = float(np.sum((y - x @ values) ** 2)), max(len(y) - len(values), 1)
    if chi2_sf(freedom, chi2) < _LEVEL:
        return None
    inflation = max(1.0, chi2 / freedom) ** 0.5
    return values.tolist(), (inflation * np.sqrt(np.diag(covariance))).tolist()


def _on_line(
    clocks: Sequence[ClockOffset], time: FloatArray, line: tuple[list[float], list[float]]
) -> list[ClockOffset]:
    """Clocks with offset and drift of a ``line`` over the (n,) times of their middles; unchanged if it is level."""
    (offset, drift), (error, drift_error) = line
    if not abs(drift) > SIGNIFICANT * drift_error:
        return list(clocks)
    drifting = []
    for clock, middle in zip(clocks, time.tolist(), strict=True):
        start = middle - clock.middle
        own = replace(clock, offset=offset + drift * start, error=math.hypot(error, drift_error * start), middle=0.0)
        drifting.append(replace(own, drift=1e6 * drift, drift_error=1e6 * drift_error))
    return drifting


# ---- response of the vehicle


def _response_delays(trials: Sequence[Trial], vehicle: Vehicle) -> tuple[dict[str, tuple[float, float]], float]:
    """Delay of the response in s with standard error, by log; lag of the thrusters in s, 0 if not significant.

    One delay common to all logs decides on the lag. Each log's own delay is fitted from there. The fits take a stretch
    of each log: a few thousand readings determine a delay better than the interval between commands allows.
    """
    if not trials or not trials[0].has_actuators:
        return {}, 0.0
    try:
        shifts = ShiftedTorque(prepare(Campaign(trials=tuple(trials), sources=()), vehicle).items).coarse_delays()
        bare = [replace(trial, rate=trial.rate if trial.rate_only else None, **_NO_TILT) for trial in trials]
        long = [trial for trial in bare if abs(shifts.get(_parent(trial), math.inf)) < 0.5 * trial.duration]
        if not long:
            return {}, 0.0
        shifted = _stretches([shift_commands(trial, shifts[_parent(trial)]) for trial in long], vehicle)
        runs = prepare(Campaign(trials=tuple(shifted), sources=()), vehicle.with_logged_torque(shifted)).items
        names = list(dict.fromkeys(_parent(run.trial) for run in runs))
        fitted = _fit_delays(runs, vehicle, names)
    except RovidError:
        return {}, 0.0
    if fitted is None:
        return {}, 0.0
    values = dict(zip(fitted.model.names, fitted.model.values.tolist(), strict=True))
    errors = dict(zip(fitted.model.names, _errors(fitted).tolist(), strict=True))
    sizes = [f"{fitted.effects[0].key}.{parameter.name}" for parameter in fitted.effects[0].parameters]
    delays = {}
    for name, size in zip(names, sizes, strict=True):
        if math.isfinite(errors[size]):
            delays[name] = shifts[name] + values[size], errors[size]
    return delays, values.get(f"{_LAG}.time_constant", 0.0)


def _fit_delays(runs: Sequence[Run], vehicle: Vehicle, names: Sequence[str]) -> FitResult | None:
    """Fit with a delay of each log, and with a lag of the thrusters if it is significant; None for a poor model."""
    start = fit_output_error(runs, min_sigmas=0.0)
    data = InnovationData(runs, vehicle, start, gyro=False)
    common, each, lag = _clock_effect(), _clock_effect(names), effect_named(_LAG)
    best = plain = fit_with_effects(fit_innovations(data, data.free_run_r2(start)), (common,))
    objective = plain.objective.with_effects((common, lag))
    starts = [np.concatenate((plain.x, lags)) for lags in objective.parametrization.initial_values()]
    (start_with_lag,) = objective.most_likely(starts, 1)
    lagged = fit(objective, start_with_lag, goal=plain.value - _MIN_GAIN)
    if plain.value - lagged.value > _MIN_GAIN:
        value, error = lagged.model.values[-1], _errors(lagged)[-1]
        reduction = plain.model.values[-1] - lagged.model.values[-2]
        if value > SIGNIFICANT * error and reduction > _MIN_REDUCTION * value:
            best = lagged
    if best.simulated_r2 < INNOVATIONS_R2 and not best.is_adequate:
        return None
    rest, x = best.without(common)
    begin = best.objective.parametrization.effects_begin
    own = np.concatenate((x[:begin], np.full(len(names), best.effect_coordinates(common)[0]), x[begin:]))
    return fit(best.objective.with_effects((each, *rest)), own)


def _errors(fitted: FitResult) -> FloatArray:
    """(p,) standard errors."""
    return np.sqrt(np.diag(fitted.covariance(sandwich=not fitted.is_white)))


def _stretches(trials: Sequence[Trial], vehicle: Vehicle) -> list[Trial]:
    """The part of each trial in which the torque varies most; together `_MAX_READINGS` samples."""
    total = sum(len(trial.time) for trial in trials)
    if total <= _MAX_READINGS:
        return list(trials)
    cutoff = choose_cutoff(trials)
    parts = []
    for trial in trials:
        torque, count = vehicle.torque(trial), len(trial.time)
        width = count * max(_MAX_READINGS / total, _SHORTEST / (cutoff * trial.duration))
        length = min(int(width) + 1, count)
        moved = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(torque)))))
        first = int(np.argmax(moved[length - 1 :] - moved[: count - length + 1]))
        parts.append(trial.part(slice(first, first + length), trial.name))
    return parts


def _clock_effect(names: Sequence[str] = ()) -> Effect:
    """A delay of either sign, common to all trials, or one for each of the ``names``."""
    size = EffectParameter(
        name="offset", unit="s", neutral=0.0, low=-3.0, high=3.0, initial_values=(0.0,), scale="time"
    )
    sizes = tuple(replace(size, name=f"{size.name}_{number}") for number in range(1, len(names) + 1)) or (size,)

    def delayed(where: ActuatorInputs, torque: FloatArray, values: Values) -> FloatArray:
        out = torque.copy()
        for trial in where.trials:
            own = values[sizes[names.index(trial.parent) if names else 0].name]
            out[trial.rows] = mean_shifted(where.time[trial.rows], torque[trial.rows], own)
        return out

    acts = OnTorque(delayed, settling_time=lambda *_: math.inf)
    form = form_name(names) if names else ""
    effect = effect_named("command_delay")
    return replace(effect, id="clock", form=form, parameters=sizes, size_count=len(sizes), acts=acts)


def _parent(trial: Trial) -> str:
    """Name of the log that a trial is, or is a part of."""
    return trial.parent or trial.name
