"""The torque that the model does not explain, its statistics and drivers, and recordings of it as MCAP."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import ConfigError
from rovid.core.formatting import field_names
from rovid.core.output_files import RECORDING, RECORDING_LIBRARY, OutputFile, OutputSet
from rovid.core.stats import NORMAL_95
from rovid.effects import Effect
from rovid.model.model import Model
from rovid.model.simulation import TrialSimulation, filtered_input, terms_along
from rovid.model.torque_input import TorqueInput
from rovid.readers.convert import OutputTopic, mcap_bytes, name_with_unit
from rovid.trial.axis import YAW, Axis
from rovid.trial.preprocessing import PreparedRuns, Run, prepare, shared_channels
from rovid.trial.rates import fast_fft_length, finite_segments, power_spectral_density, resample
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

# Samples of a segment of the spectrum, and of the shortest stretch that counts.
_SEGMENT, _SHORTEST = 1024, 64
# Bins of means over a driver, and points of a smooth curve.
_DRIVER_BINS, _CURVE = 32, 300
# Smallest distance of two points of a curve, as a share of its length; convention.
_APART = 1e-6
# Share of the missing torque by which a driver has to exceed a simpler one, and the least that it has to explain.
_BETTER, _FOLLOWS = 0.02, 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class ResidualTorque:
    """Torques of one run in N m, or forces in N, (m,), after the same low-pass filter; NaN where not known."""

    run: Run
    thruster_torque: FloatArray  #: Of the thrusters, after every effect between command and torque.
    effect_inputs: FloatArray  #: As in `rovid.model.torque_input.TorqueInput`.
    #: T - I rdot - DQ |r| r - DL r, less weight and buoyancy; it contains the effects in the equation of motion.
    residual: FloatArray
    noise_sd: float  #: Standard deviation that sensor noise alone would cause.


def residual_torques(runs: Sequence[Run], model: Model, vehicle: Vehicle) -> list[ResidualTorque]:
    """Torque of each run that inertia, drag, weight and buoyancy do not explain."""
    items, base = [], model.with_effects()
    for run in runs:
        filtered = filtered_input(run, model, vehicle)
        torque = filtered.torque if model.effects else run.filtered_torque
        item = ResidualTorque(
            run=run,
            thruster_torque=torque,
            effect_inputs=filtered.effect_inputs,
            residual=np.asarray(torque - model.inertia * run.rates.acceleration - model.drag(run.rates.rate)),
            noise_sd=model.inertia * run.rates.acceleration_noise,
        )
        items.append(replace(item, residual=item.residual + _term_torques(item, base, vehicle)))
    return items


def unexplained_torques(runs: PreparedRuns, model: Model, vehicle: Vehicle) -> list[ResidualTorque]:
    """`residual_torques` less all effects in the equation of motion, with headings corrected for their deviation.

    Waves remain, because their phase is not a parameter.
    """
    items, base = [], model.with_effects()
    with_true_headings: Sequence[Run] = runs.items
    if model.heading_sensor.deviates:
        trials = []
        for run in runs.items:
            heading, _ = model.heading_sensor.to_true(run.trial.position)
            trials.append(replace(run.trial, position=heading))
        campaign = Campaign(trials=tuple(trials), sources=())
        with_true_headings = prepare(campaign, vehicle, cutoff=runs.cutoff).items
    for item in residual_torques(with_true_headings, model, vehicle):
        with_all = item.residual + _term_torques(item, model, vehicle)
        # Weight and buoyancy were subtracted before.
        items.append(replace(item, residual=with_all - _term_torques(item, base, vehicle)))
    return items


def _term_torques(item: ResidualTorque, model: Model, vehicle: Vehicle) -> FloatArray:
    """(m,) torque in N m of the terms in the equation of motion, at the measured rate and angle."""
    held = TorqueInput.held(item.thruster_torque, item.effect_inputs)
    return terms_along(item.run, model, vehicle, held)[0]


def all_residuals(items: Sequence[ResidualTorque]) -> FloatArray:
    """Residual torques of all runs, concatenated."""
    return np.concatenate([item.residual for item in items])


def all_thruster_torques(items: Sequence[ResidualTorque]) -> FloatArray:
    """Thruster torques of all runs, concatenated."""
    return np.concatenate([item.thruster_torque for item in items])


def rms_sizes(items: Sequence[ResidualTorque]) -> tuple[float, float, float]:
    """RMS in N m of residual torque, thruster torque, and the share of sensor noise in the residual; NaN if unknown."""
    residual = all_residuals(items)
    noise = np.concatenate([np.full(len(item.residual), item.noise_sd) for item in items])
    known = np.isfinite(residual)
    if not known.any():
        return math.nan, math.nan, math.nan
    signals = (residual, all_thruster_torques(items), noise)
    residual_rms, torque_rms, noise_rms = (float(np.sqrt(np.mean(values[known] ** 2))) for values in signals)
    return residual_rms, torque_rms, noise_rms


# Means over a driver in its increasing order: driver, mean, and its standard error, each (m,).
BinMeans = tuple[FloatArray, FloatArray, FloatArray]


def spectrum(items: Sequence[ResidualTorque], cutoff: float) -> tuple[FloatArray, FloatArray]:
    """Frequency in Hz up to the cut-off, and density in (N m)^2/Hz averaged over all stretches by their length."""
    frequency = np.linspace(0.0, cutoff, 256)[1:]
    total, weight = np.zeros(len(frequency)), 0.0
    for period, part in _stretches(items):
        density = power_spectral_density(part, _SEGMENT, period, about_mean=True)
        total += np.interp(frequency, np.fft.rfftfreq(_SEGMENT, period), density) * len(part) * period
        weight += len(part) * period
    if not weight:
        return frequency, np.full(len(frequency), np.nan)
    return frequency, total / weight


def autocorrelation(items: Sequence[ResidualTorque], longest: float) -> tuple[FloatArray, FloatArray]:
    """Lag in s up to ``longest``, and autocorrelation of the residual torque."""
    lags = np.linspace(0.0, longest, 200)
    total = np.zeros(len(lags))
    for period, part in _stretches(items):
        # Zero padding makes the correlation linear instead of circular.
        size = fast_fft_length(2 * len(part))
        products = np.fft.irfft(np.abs(np.fft.rfft(part, size)) ** 2, size)[: len(part)]
        total += np.interp(lags, period * np.arange(len(part)), products, right=0.0) * period
    if not total[0] > 0.0:
        return lags, np.full(len(lags), np.nan)
    return lags, total / total[0]


def _stretches(items: Sequence[ResidualTorque]) -> Iterator[tuple[float, FloatArray]]:
    """Sampling period in s and values of every unbroken stretch that is long enough for a spectrum."""
    for item in items:
        for start, stop in finite_segments(item.residual):
            if stop - start >= _SHORTEST:
                yield item.run.rates.kernel.period, item.residual[start:stop]


@dataclass(frozen=True, kw_only=True, eq=False)
class MissingTorque:
    """The torque or force that a model misses without one of its effects."""

    driver: str  #: Name and unit of the quantity on the horizontal axis.
    driver_values: FloatArray  #: (n,) values of that quantity.
    #: ``measured``, ``equation``: (n,) N m or N: missing torque according to the logs, and torque of the effect's
    #: equation.
    measured: FloatArray
    equation: FloatArray
    #: Driver and equation as a smooth curve in increasing order of the driver; the equation itself over time.
    line: tuple[FloatArray, FloatArray]
    independent: float  #: Share of independent values in ``measured``.


def missing_without(effect: Effect, runs: PreparedRuns, model: Model, vehicle: Vehicle) -> MissingTorque | None:
    """Torque that ``model`` misses without ``effect``, against the quantity that explains it best.

    Over time, in the run with most of it, if no quantity explains it. None for a wave, because its phase is not known.
    """
    if effect.is_wave:
        return None
    less = model.with_effects(lambda other: other.key != effect.key)
    with_effect, without = (unexplained_torques(runs, each, vehicle) for each in (model, less))
    equation = all_residuals(with_effect) - all_residuals(without)
    known = np.isfinite(equation)
    if not known.any() or not np.any(equation[known]):
        return None
    driver_values, share, driver = np.empty(0), -np.inf, ""
    for name, values in _drivers(runs.items, vehicle.axis):
        explained = _explained_share(values, equation)
        if explained > share + _BETTER:
            driver_values, share, driver = values, explained, name
    if share < _FOLLOWS:
        return _over_time([item.residual for item in with_effect], [item.residual for item in without], runs)
    return MissingTorque(
        driver=driver,
        driver_values=driver_values,
        measured=-all_residuals(without),
        equation=equation,
        line=_smooth_curve(*bin_means(driver_values, equation)[:2]),
        independent=independent_share(runs.items, runs.cutoff),
    )


def _drivers(runs: Sequence[Run], axis: Axis) -> Iterator[tuple[str, FloatArray]]:
    """Possible drivers with their values along all runs, the simplest first."""
    channels = sorted(shared_channels(runs))
    by_run = [dict(_run_drivers(run, axis, channels)) for run in runs]
    for name in by_run[0]:
        yield name, np.concatenate([drivers[name] for drivers in by_run])


def _run_drivers(run: Run, axis: Axis, channels: Sequence[str]) -> Iterator[tuple[str, FloatArray]]:
    """Possible drivers with their values along one run."""
    unit, factor = axis.display_unit
    trial, rates, torque = run.trial, run.rates, run.filtered_torque
    position = resample(trial, trial.position, rates.time)
    yield f"{axis.force_name} of the thrusters, {axis.force_unit}", torque
    yield f"{axis.rate_words}, {axis.rate_unit}", rates.rate
    yield f"change of the {axis.force_name}, {axis.force_unit}/s", np.gradient(torque, rates.kernel.period)
    yield f"acceleration, {axis.rate_unit}²", rates.acceleration
    if axis is YAW:
        yield "heading, deg", factor * position % 360.0
    yield f"{axis.position_words} from the start, {unit}", factor * (position - trial.first_position)
    yield "time in the trial, s", rates.time
    for name in channels:
        words = name if name in trial.extras else f"{name}, rad"  # a tilt
        yield words.replace("_", " "), resample(trial, trial.channels[name], rates.time)


def _explained_share(driver: FloatArray, equation: FloatArray) -> float:
    """Share of the square of ``equation`` that its mean at each value of ``driver`` explains."""
    known = np.isfinite(driver) & np.isfinite(equation)
    x, y = driver[known], equation[known]
    if x.size < _DRIVER_BINS or np.ptp(x) == 0.0:
        return -np.inf
    index = _bin_index(x, _DRIVER_BINS)
    mean = np.bincount(index, weights=y) / np.maximum(np.bincount(index), 1)
    return 1.0 - float(np.sum((y - mean[index]) ** 2) / np.sum(y**2))


def _bin_index(x: FloatArray, bins: int) -> IntArray:
    """(n,) bin of each value: half of the edges at equal distances, half at quantiles.

    Both the values about rest, which are many, and those far from rest are resolved.
    """
    widths = np.linspace(x.min(), x.max(), bins // 2 + 1)
    counts = np.quantile(x, np.linspace(0.0, 1.0, bins // 2 + 1))
    edges = np.unique(np.concatenate([widths, counts]))[1:-1]
    return np.asarray(np.searchsorted(edges, x, side="right"))


def bin_means(
    driver: FloatArray, values: FloatArray, bins: int = _DRIVER_BINS, fewest: int = 3, independent: float = 1.0
) -> BinMeans:
    """Means of ``driver`` and ``values`` in bins with at least ``fewest`` values.

    ``independent`` is the share of independent values, as by `independent_share`, on which the standard errors depend.
    """
    known = np.isfinite(driver) & np.isfinite(values)
    x, y = driver[known], values[known]
    if x.size < bins or np.ptp(x) == 0.0:
        return np.empty(0), np.empty(0), np.empty(0)
    index = _bin_index(x, bins)
    count = np.bincount(index)
    enough = count >= fewest
    mean_x, mean_y, square = (np.bincount(index, weights=each)[enough] / count[enough] for each in (x, y, y**2))
    effective = np.maximum(independent * count[enough], 1.0)
    return mean_x, mean_y, np.sqrt(np.maximum(square - mean_y**2, 0.0) / effective)


def independent_share(runs: Sequence[Run], cutoff: float) -> float:
    """Share of independent samples after a low pass at ``cutoff`` in Hz, which leaves two in each of its periods."""
    period = float(np.median([run.rates.kernel.period for run in runs]))
    return min(2.0 * cutoff * period, 1.0)


def white_band(items: Sequence[ResidualTorque], cutoff: float) -> float:
    """Half the width of the 95 % band of the autocorrelation of white noise after the same low pass."""
    duration = sum(period * len(part) for period, part in _stretches(items))
    return NORMAL_95 / math.sqrt(max(2.0 * cutoff * duration, 1.0))


def _smooth_curve(driver: FloatArray, mean: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A curve without overshoot through ``mean`` (piecewise cubic Hermite; Fritsch and Carlson 1980)."""
    # Values that a held command gives differ by rounding only, and may fill several bins.
    apart = np.diff(driver, prepend=-np.inf) > _APART * (driver[-1:] - driver[:1]).sum()
    driver, mean = driver[apart], mean[apart]
    if len(driver) < 2:
        return driver, mean
    from scipy.interpolate import PchipInterpolator

    smooth = np.linspace(driver[0], driver[-1], _CURVE)
    return smooth, np.asarray(PchipInterpolator(driver, mean)(smooth))


def _over_time(with_effect: Sequence[FloatArray], without: Sequence[FloatArray], runs: PreparedRuns) -> MissingTorque:
    """Missing torque over time, in the run in which the equation gives most."""
    sizes = [float(np.nansum((one - other) ** 2)) for one, other in zip(with_effect, without, strict=True)]
    most = int(np.argmax(sizes))
    run = runs.items[most]
    equation = with_effect[most] - without[most]
    return MissingTorque(
        driver=f"time in {run.trial.name}, s",
        driver_values=run.rates.time,
        measured=-without[most],
        equation=equation,
        line=(run.rates.time, equation),
        independent=independent_share([run], runs.cutoff),
    )


_SUFFIX = ".mcap"


def recording_outputs(target: Path, trials: Sequence[Trial]) -> list[OutputFile]:
    """Each trial's recording: ``target`` itself for a single trial, else files in the folder ``target``.

    Raises ConfigError if ``target`` is one file for several trials, or a log would be overwritten.
    """
    place = f"--mcap {target}"
    paths = [target]
    if target.suffix.lower() != _SUFFIX or target.is_dir():
        paths = [target / name for name in _recording_names(trials)]
    elif len(trials) > 1:
        several = f"names one file, but there are {len(trials)} trials."
        raise ConfigError(several, where=place, mend="Name a folder, for one file a trial.")
    logs = {trial.path.resolve() for trial in trials}
    for path in paths:
        if path.resolve() in logs:
            raise ConfigError(f"would write over the log {path}.", where=place, mend="Choose another place.")
    return [OutputFile(path, RECORDING) for path in paths]


def _recording_names(trials: Sequence[Trial]) -> list[Path]:
    """A file name for each trial, with the log's suffix where trials differ by that only."""
    names = []
    for trial in trials:
        path = Path(trial.name)
        names.append(Path(*(part for part in path.parts if part not in {"..", path.anchor})))
    short = [name.with_suffix(_SUFFIX) for name in names]
    counts = Counter(short)
    long = [name.with_name(name.name + _SUFFIX) for name in names]
    return [one if counts[one] == 1 else other for one, other in zip(short, long, strict=True)]


def write_recordings(
    claim: OutputSet,
    outputs: Sequence[OutputFile],
    simulations: Sequence[TrialSimulation],
    runs: PreparedRuns,
    model: Model,
    vehicle: Vehicle,
) -> None:
    """Write the recordings of all trials, or none. Raises OutputError if a recording cannot be written."""
    recordings = {}
    residuals = unexplained_torques(runs, model, vehicle)
    for output, simulation, residual in zip(outputs, simulations, residuals, strict=True):
        recordings[output] = mcap_bytes(simulation_topics(simulation, residual, vehicle), RECORDING_LIBRARY)
    claim.write(recordings)


def simulation_topics(simulation: TrialSimulation, residual: ResidualTorque, vehicle: Vehicle) -> list[OutputTopic]:
    """Rate, position, torques and commands of one trial; rates and torques after the same low-pass filter."""
    trial, time, axis = simulation.run.trial, simulation.run.rates.time, simulation.run.trial.axis
    unit, factor = axis.display_unit
    rate = {"measured": simulation.measured, "simulated": simulation.simulated}
    rate["residual"] = simulation.measured - simulation.simulated
    # A position that was integrated from a rate was not measured.
    position = {} if trial.rate_only else {"measured": trial.position * factor}
    position["simulated"] = simulation.position * factor
    torque = {"drive": residual.thruster_torque, "disturbance": residual.residual}
    # The topic's name marks guessed torques, because a recording has no other place for a caution.
    guessed = "guessed_" * vehicle.assumptions.is_placeholder(axis.force_unit)
    names = field_names([thruster.name for thruster in vehicle.thrusters])
    commands = dict(zip(names, trial.commands.T, strict=True))
    return [
        _topic(axis.rate_signal, time, rate, axis.rate_unit),
        _topic(axis.position_signal, trial.time, position, unit),
        _topic(guessed + axis.force_name, residual.run.rates.time, torque, axis.force_unit),
        _topic("commands", trial.time, commands, ""),
    ]


def _topic(name: str, time: FloatArray, signals: dict[str, FloatArray], unit: str) -> OutputTopic:
    """A topic with the signals that have any finite value."""
    known = {name_with_unit(signal, unit): values for signal, values in signals.items() if np.isfinite(values).any()}
    return OutputTopic(name=f"/{name}", time=time, fields=known, units=dict.fromkeys(known, unit))
