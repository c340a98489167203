"""From trials to runs: parts between faults, commands moved in time, torque and rates through one filter."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.core.errors import ConfigError, DataError
from rovid.trial.axis import Axis
from rovid.trial.log_files import is_called
from rovid.trial.rates import Rates, choose_cutoff, compute_rates, highest_cutoff
from rovid.trial.segments import find_releases, swing_level
from rovid.trial.trial import Campaign, Remark, Trial
from rovid.trial.vehicle import Vehicle

# Measured positions that a part of a log needs to be kept.
_MIN_READINGS = 10
# A command that changes across a hole by less than this share of its range has not changed.
_SAME = 0.01
# Ratio of the change across a hole to the usual change over as many intervals, up to which the command is smooth.
_SMOOTH = 3.0
# Sampling intervals; instants as close as this are one.
_TICK = 1e-3
# Sampling intervals; commands in longer holes are unknown even if they are the same before and after.
_LONG_INTERVALS = 20.0


@dataclass(frozen=True, kw_only=True)
class Exclusion:
    """An interval of a log that rovid.toml excludes: a caught tether, a hand on the vehicle."""

    log: str  #: Name of the log, or a pattern such as "hold_*.csv".
    #: ``begin``, ``end``: s from the beginning of the log.
    begin: float = 0.0
    end: float = np.inf
    reason: str = ""  #: Text for people; may be empty.

    @property
    def is_whole(self) -> bool:
        """Whether no part of the log is left."""
        return self.begin <= 0.0 and self.end == np.inf

    def __str__(self) -> str:
        """The interval, as "12 to 30.5 s"."""
        if np.isfinite(self.end):
            return f"{self.begin:g} to {self.end:g} s"
        if self.begin > 0.0:
            return f"all from {self.begin:g} s on"
        return "all of it"

    def applies_to(self, name: str) -> bool:
        """Whether the log ``name`` is meant, with or without its folder."""
        return is_called(name, self.log)


def split(trial: Trial, exclusions: Sequence[Exclusion] = ()) -> list[Trial]:
    """The parts of ``trial`` between its cuts and exclusions, without unknown commands; none if all is excluded."""
    own = [exclusion for exclusion in exclusions if exclusion.applies_to(trial.name)]
    if not own and not trial.cuts and not trial.unknown:
        return [trial]
    trial, excluded = _without_unknown(trial)
    lost = np.flatnonzero(excluded)
    remarks = list(trial.remarks)
    for exclusion in own:
        covered = (exclusion.begin <= trial.time) & (trial.time <= exclusion.end)
        excluded |= covered
        reason = f": {exclusion.reason.rstrip('.')}." if exclusion.reason else ", as rovid.toml says."
        text = f"Left out, {exclusion}{reason}"
        remarks.append(Remark(kind="left out", count=int(covered.sum()), text=text))
    # Each row belongs to the part with its number; rows of number zero are left out.
    begins = np.concatenate(([True], excluded[:-1])) & ~excluded
    cuts = np.searchsorted(trial.time, trial.cuts)
    begins[cuts[cuts < len(begins)]] = True
    part = np.where(excluded, 0, np.cumsum(begins))
    edges = np.flatnonzero(np.diff(part, prepend=0, append=0))
    spans = [slice(*pair) for pair in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True) if part[pair[0]]]
    kept = measured_spans(trial, spans)
    trial = replace(trial, cuts=(), unknown=())
    parts: list[Trial] = []
    for rows in kept:
        span, before = trial.time[rows], lost[lost < rows.start]
        name = trial.name if len(kept) == 1 else f"{trial.name}, {span[0]:.1f} to {span[-1]:.1f} s"
        # The commands since the last lost row are known.
        one = trial.part(rows, name, int(before[-1]) + 1 if before.size else 0)
        # The first part carries the remarks and the faults.
        parts.append(replace(one, remarks=(), faults=()) if parts else replace(one, remarks=tuple(remarks)))
    return parts


def measured_spans(trial: Trial, spans: Iterable[slice]) -> list[slice]:
    """The ``spans`` of rows from their first to their last measurement, without those with few measurements."""
    measured = np.flatnonzero(trial.measured)
    found = []
    for rows in spans:
        first, last = np.searchsorted(measured, (rows.start, rows.stop)).tolist()
        if last - first >= _MIN_READINGS:
            found.append(slice(int(measured[first]), int(measured[last - 1]) + 1))
    return found


def _without_unknown(trial: Trial) -> tuple[Trial, BoolArray]:
    """``trial`` with commands that run on smoothly through holes, cut at other holes; and (n,) rows to leave out.

    The log is cut where a command stepped in a hole, because the instant of the step is unknown. A command that changes
    at each of its ticks is interpolated at the ticks within the hole.
    """
    time, commands = trial.time, trial.commands.copy()
    excluded = np.zeros(len(time), dtype=bool)
    ticks, usual = _changes(time, commands)
    same = _SAME * np.ptp(commands, axis=0)
    interval = trial.sampling_interval
    instants, values, cuts = list[FloatArray](), list[FloatArray](), list(trial.cuts)
    for begin, end in trial.unknown:
        before, after = int(np.searchsorted(time, begin, side="right")) - 1, int(np.searchsorted(time, end))
        is_long = end - begin > _LONG_INTERVALS * interval
        if before < 0 or after >= len(time) or is_long:
            excluded[max(before + 1, 0) : after] = True
            cuts += time[after : after + 1].tolist()
            continue
        change = np.abs(commands[after] - commands[before])
        if np.all(change <= same):
            continue
        # A command that changes less often than once in such a hole steps.
        smooth = np.where(ticks <= end - begin, _SMOOTH * usual * (end - begin) / ticks, 0.0)
        if np.any(change > np.maximum(same, smooth)):
            excluded[before + 1 : after] = True
            cuts.append(time[after])
            continue
        tick = float(ticks[change > same].min())
        instants.append(begin + tick * np.arange(1.0, round((end - begin) / tick)))
        share = tick * np.floor((time[before + 1 : after] - begin) / tick + _TICK) / (end - begin)
        commands[before + 1 : after] = commands[before] + share[:, np.newaxis] * (commands[after] - commands[before])
        at = instants[-1][:, np.newaxis]
        values.append(commands[before] + (at - begin) / (end - begin) * (commands[after] - commands[before]))
    moved = replace(trial, commands=commands, cuts=tuple(sorted(set(cuts))))
    if not instants:
        return moved, excluded
    added, held = np.concatenate(instants), np.concatenate(values)
    rows = np.searchsorted(time, added)
    # Rows of another clock may lie at the ticks.
    is_new = np.minimum(np.abs(time[rows] - added), np.abs(added - time[rows - 1])) > _TICK * interval
    rows = rows[is_new]
    return with_rows(moved, added[is_new], held[is_new], rows), np.insert(excluded, rows, False)


def _changes(time: FloatArray, commands: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(k,) median time between the changes of each command in s, infinite without any, and (k,) usual large change."""
    ticks, usual = np.full(commands.shape[1], np.inf), np.zeros(commands.shape[1])
    for column, changes in enumerate(np.abs(np.diff(commands, axis=0)).T):
        rows = np.flatnonzero(changes)
        if len(rows) > 1:
            ticks[column], usual[column] = np.median(np.diff(time[rows])), np.percentile(changes[rows], 90.0)
    return ticks, usual


def with_rows(trial: Trial, instants: FloatArray, commands: FloatArray, at: IntArray) -> Trial:
    """``trial`` with rows at the (n,) ``instants`` in s, before its rows ``at``, with the (n, k) ``commands``."""
    unmeasured = dict.fromkeys(("position", "rate"), np.nan)
    rows = {}
    for name, values in trial.arrays().items():
        rows[name] = np.insert(values, at, unmeasured.get(name, values[at]), axis=0)
    rows["time"] = np.insert(trial.time, at, instants)
    rows["commands"] = np.insert(trial.commands, at, commands, axis=0)
    extras = {name: np.insert(values, at, values[at]) for name, values in trial.extras.items()}
    return replace(trial, **rows, extras=extras)


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
