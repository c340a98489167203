"""From trials to runs: torque, rates, and both through one filter; commands moved in time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray
from rovid.core.errors import ConfigError, DataError
from rovid.trial.axis import Axis
from rovid.trial.rates import Rates, choose_cutoff, compute_rates, highest_cutoff
from rovid.trial.segments import find_releases, swing_level
from rovid.trial.trial import Campaign, Remark, Trial
from rovid.trial.vehicle import Vehicle

# Resolution of the time stamps of a shifted trial, per sampling interval.
_RESOLUTION = 50.0
# Difference between the angles about which decays swing, over the largest swing, from which one log has another level:
# smaller ones are a trim of all.
_ANOTHER_LEVEL = 0.05


def shift_commands(trial: Trial, delay: float) -> Trial:
    """``trial`` with its motion and further channels, and its commands ``delay`` s later; the common time alone.

    Raises DataError if the delay is longer than the trial.
    """
    if abs(delay) > trial.duration - 2.0 * trial.sampling_interval:
        raise DataError(f"{trial.name} is shorter than the offset of {abs(delay):.3g} s.")
    # Time stamps on a common grid do not nearly coincide.
    grid = trial.sampling_interval / _RESOLUTION
    measured = grid * np.round(trial.time[trial.measured] / grid)
    commanded = grid * np.round((trial.time + delay) / grid)
    base = grid * np.unique(np.round(np.concatenate((measured, commanded)) / grid))
    first, last = max(measured[0], commanded[0]), min(measured[-1], commanded[-1])
    base = base[(base >= first - 0.5 * grid) & (base <= last + 0.5 * grid)]
    inside = (measured >= base[0] - 0.5 * grid) & (measured <= base[-1] + 0.5 * grid)
    position = np.full(len(base), np.nan)
    position[np.searchsorted(base, measured[inside] - 0.5 * grid)] = trial.position[trial.measured][inside]

    def held(values: FloatArray, stamps: FloatArray) -> FloatArray:
        at: FloatArray = values[np.maximum(np.searchsorted(stamps, base + 0.5 * grid, side="right") - 1, 0)]
        return at

    def interpolated(values: FloatArray | None) -> FloatArray | None:
        if values is None or not np.isfinite(values).any():
            return values
        known = np.isfinite(values)
        at: FloatArray = np.interp(base, trial.time[known], values[known])
        return at

    return replace(
        trial,
        time=base - base[0],
        position=position,
        commands=held(trial.commands, commanded),
        rate=interpolated(trial.rate),
        roll=interpolated(trial.roll),
        pitch=interpolated(trial.pitch),
        extras={name: held(values, trial.time) for name, values in trial.extras.items()},
    )


# Tolerances of a logged rate against the position's derivative: of the gain, and of the offset as a share of the RMS
# rate. Beyond them the drag is biased noticeably.
_GYRO_GAIN, _GYRO_OFFSET = 0.03, 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One trial with everything derived from it."""

    trial: Trial
    torque: FloatArray  #: (n,) N m, held, at the trial's own instants.
    rates: Rates  #: Rate and acceleration on a uniform grid of m instants.
    filtered_torque: FloatArray  #: (m,) the torque through the same filter as the rates.

    @property
    def valid(self) -> BoolArray:
        """(m,) where rate, acceleration and torque are all known."""
        return np.asarray(self.rates.valid & np.isfinite(self.filtered_torque))


@dataclass(frozen=True, kw_only=True, eq=False)
class PreparedRuns:
    """The runs of a campaign, their common ``cutoff`` in Hz, whether it was ``chosen`` from the data, and remarks."""

    items: tuple[Run, ...]
    cutoff: float
    chosen: bool
    remarks: tuple[Remark, ...]
    set_aside: tuple[Run, ...] = ()  #: Runs of logs that the plain model alone calls foreign.
    clocks_agree: bool = False  #: The user keeps the clocks as logged: no offset of theirs is fitted.

    @property
    def axis(self) -> Axis:
        """Degree of freedom of the runs."""
        return self.items[0].trial.axis

    @property
    def rate_only(self) -> bool:
        """Whether only the rate was measured."""
        return self.items[0].trial.rate_only

    def noise(self) -> tuple[float, float, float]:
        """Medians over the runs of the sensor noise: as measured, of the filtered rate, and of the acceleration.

        Standard deviations. The measured quantity is the position, or the rate where only the rate was measured.
        """
        every = [run.rates for run in self.items]
        rows = [(rates.position_noise, rates.rate_noise, rates.acceleration_noise) for rates in every]
        measured, rate, acceleration = np.median(rows, axis=0).tolist()
        return measured, rate, acceleration


def prepare(campaign: Campaign, vehicle: Vehicle, *, cutoff: float | None = None) -> PreparedRuns:
    """Torque and rates of every trial, with the cut-off chosen from the data unless it is given in Hz.

    Raises DataError if no trial is long enough for the filter. Raises ConfigError if the cut-off is too high for the
    sampling rate.
    """
    trials, remarks = _usable_trials(campaign.trials)
    return prepare_trials(trials, vehicle, cutoff=cutoff, remarks=remarks)


def prepare_trials(
    trials: Sequence[Trial], vehicle: Vehicle, *, cutoff: float | None = None, remarks: Sequence[Remark] = ()
) -> PreparedRuns:
    """`prepare` of the ``trials`` as they are; each run keeps its trial. Trials too short for the filter are left out.

    Raises DataError if no trial is long enough for the filter. Raises ConfigError if the cut-off is too high for the
    sampling rate.
    """
    remarks = list(remarks)
    shared = choose_cutoff(trials) if cutoff is None else cutoff
    highest = highest_cutoff(trials)
    if shared > highest * (1.0 + 1e-6):
        text = f"is {shared:g} Hz; at this sampling rate rates can be had up to {highest:.3g} Hz."
        raise ConfigError(text, where="--cutoff")
    runs = []
    for trial in trials:
        torque = vehicle.torque(trial)
        try:
            rates = compute_rates(trial, cutoff=shared)
        except DataError as error:
            remarks.append(Remark(kind="left out", count=len(trial.time), text=str(error)))
            continue
        runs.append(Run(trial=trial, torque=torque, rates=rates, filtered_torque=rates.filter_held(trial, torque)))
    if not runs:
        raise DataError(remarks[0].text if remarks else "there is no trial.")
    remarks += _gyro_remarks(runs)
    return PreparedRuns(items=tuple(runs), cutoff=shared, chosen=cutoff is None, remarks=tuple(remarks))


def _usable_trials(trials: Sequence[Trial]) -> tuple[Sequence[Trial], list[Remark]]:
    """All trials, or the free swings of trials without actuators, and remarks on them."""
    if all(trial.has_actuators for trial in trials):
        return trials, []
    found, kept, rejected = list[Trial](), list[str](), list[str]()
    for trial in trials:
        parts = find_releases(trial)
        spans = [f"{trial.time[part][0]:.1f} to {trial.time[part][-1]:.1f} s" for part in parts]
        names = [f"{trial.name}, {span}" for span in spans] if len(spans) > 1 else [trial.name]
        found += map(trial.part, parts, names)
        if spans:
            kept.append(f"{trial.name} ({', '.join(spans)})")
        else:
            rejected.append(trial.name)
    if not found:
        axis = trials[0].axis
        text = f"no actuator drives the vehicle in {axis.name} in these logs, and they hold no decaying swings."
        mend = f"Give logs of releases, or map what drives the vehicle: [[thrusters]] with {axis.arm_key}."
        raise DataError(text, mend=mend)
    text = f"Only the free swings of these logs are used: {'; '.join(kept)}."
    found, shifted = _about_one_level(found)
    remarks = [Remark(kind="released", count=len(kept), text=text), *shifted]
    if rejected:
        text = f"Left out, because they hold no decaying swings: {', '.join(rejected)}."
        remarks.append(Remark(kind="left out", count=len(rejected), text=text))
    return found, remarks


def _about_one_level(trials: Sequence[Trial]) -> tuple[list[Trial], list[Remark]]:
    """The decays about one angle, and a remark on those that swing about another one, by ballast or a sensor's zero."""
    levels = [swing_level(trial.position[trial.measured]) for trial in trials]
    usual = float(np.median([level for level, _ in levels if math.isfinite(level)] or [np.nan]))
    found, remarks = [], []
    for trial, (level, largest) in zip(trials, levels, strict=True):
        if abs(level - usual) > _ANOTHER_LEVEL * largest:
            text = f"{trial.name} swings about {math.degrees(level):.3g} deg, and the usual log about "
            text += f"{math.degrees(usual):.3g} deg: the difference, of ballast or of the sensor's zero, was "
            text += "subtracted."
            remarks.append(Remark(kind="level", count=1, text=text))
            trial = replace(trial, position=trial.position - (level - usual))  # noqa: PLW2901 - the decay as used
        found.append(trial)
    return found, remarks


def _gyro_remarks(runs: Sequence[Run]) -> list[Remark]:
    """A remark on runs where the logged rate differs from the position's derivative by a bias, unit or sign."""
    compared = [run for run in runs if math.isfinite(run.rates.gyro_gain)]
    if not compared:
        return []
    # A unit or a sign is the same in all runs, and a short run shows it poorly.
    gain = float(np.median([run.rates.gyro_gain for run in compared]))
    is_scaled = abs(gain - 1.0) > _GYRO_GAIN
    off = []
    for run in compared:
        known = run.rates.rate[np.isfinite(run.rates.rate)]
        rms = float(np.linalg.norm(known)) / max(len(known), 1) ** 0.5
        if is_scaled or abs(run.rates.gyro_offset) > _GYRO_OFFSET * rms:
            off.append(run)
    if not off:
        return []
    axis, offset = off[0].trial.axis, float(np.median([run.rates.gyro_offset for run in off]))
    names = ", ".join(run.trial.name for run in off)
    scaled = f"is {gain:.3g} times the {axis.position_words}'s derivative, with" if is_scaled else "has"
    text = f"{names}: the logged {axis.rate_words} {scaled} an offset of {offset:.2g} {axis.rate_unit}. The results "
    text += f"rest on the logged {axis.rate_words}. Check its unit and sign, or delete {axis.rate_signal} in "
    text += f"rovid.toml to use the {axis.position_words}'s derivative instead."
    return [Remark(kind="gyro", count=len(off), text=text)]


def shared_channels(runs: Sequence[Run]) -> set[str]:
    """Names of the extra channels that every run has and at least one run has readings of."""
    every = [run.trial.channels for run in runs]
    shared: set[str] = set.intersection(*map(set, every))
    return {name for name in shared if any(np.isfinite(extras[name]).any() for extras in every)}
