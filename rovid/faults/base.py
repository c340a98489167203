"""The catalogue of log faults: detections, remedies, and the data that detectors examine at each stage of reading.

Each fault has a file, named by its id in `rovid.trial.fault`, with a table ``DETECTORS``.

The stages, in order: ``clock`` (the readings of one clock, as logged), ``clocks`` (the stamps of a log's several
clocks), ``signal`` (one measured signal), ``command`` (one command), ``trial`` (one log on one time base), ``campaign``
(all logs), ``runs`` (all logs with torque and rates).
A detector gets the data of its stage and yields detections, each with a function that applies the remedy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from importlib import import_module
from typing import Any, Generic, Literal, Self, TypeVar

import numpy as np

from rovid.core.array_types import BoolArray, FloatArray, IntArray
from rovid.trial.fault import FAULT_IDS, Excerpt, Fault, FaultOverrides
from rovid.trial.preprocessing import Run
from rovid.trial.segments import subsampled_median
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Thruster, Vehicle

Stage = Literal["clock", "clocks", "signal", "command", "trial", "campaign", "runs"]
Intervals = tuple[tuple[float, float], ...]
T = TypeVar("T")
# Number of samples around a fault that a plot shows.
_EXCERPT = 200


@dataclass(frozen=True, kw_only=True)
class ClockStep:
    """A clock that was set while it recorded."""

    before: float  #: ``before``, ``after``: s, last stamp before and first stamp after the step, as logged.
    after: float
    size: float  #: s by which the clock was set ahead; negative: set back.
    error: float  #: Standard error of ``size`` in s.
    at: float  #: s from the beginning of the log to the step, on the repaired clock.
    confidence: float = 0.99


@dataclass(frozen=True, kw_only=True, eq=False)
class ClockData:
    """The readings of one clock in the order logged, before they are sorted."""

    log: str  #: Name of the log.
    clock: str  #: Time column or topic, for messages.
    time: FloatArray  #: (n,) s; finite.
    rows: IntArray  #: (n,) number of each reading in the file; a remedy that removes readings removes their rows.
    values: Mapping[str, FloatArray]  #: Signal name -> (n,) as logged; NaN where missing.
    #: Signal name -> period of an angle in the unit of ``values``; absent for other signals.
    periods: Mapping[str, float] = field(default_factory=dict)
    measured: str = "heading"  #: Name of the signal that measures the motion; it may be on another clock.
    sortable: bool = False  #: Whether the format stores messages slightly out of order.
    cuts: tuple[float, ...] = ()  #: s on the repaired clock, at which the log is to be cut.
    unknown: Intervals = ()  #: s on the repaired clock, between which the commands are unknown.
    steps: tuple[ClockStep, ...] = ()  #: Steps of the measured signal's clock; the log's other clocks may share them.
    #: Number of a reading -> its place in the file, for messages.
    place: Callable[[int], str] = "reading {}".format

    @property
    def commands(self) -> tuple[str, ...]:
        """Names of the commands on this clock."""
        return tuple(name for name in self.values if name.startswith("command."))

    @cached_property
    def interval(self) -> float:
        """Median of the positive intervals in s; NaN without any."""
        with np.errstate(over="ignore"):
            steps = np.diff(np.sort(self.time) if self.sortable else self.time)
        return subsampled_median(steps[steps > 0.0])

    def select(self, kept: BoolArray) -> Self:
        """The readings where the (n,) ``kept`` is true."""
        values = {name: column[kept] for name, column in self.values.items()}
        return replace(self, time=self.time[kept], rows=self.rows[kept], values=values)


@dataclass(frozen=True, kw_only=True, eq=False)
class ClocksData:
    """The stamps of a log whose motion and commands have clocks, topics or files of their own."""

    log: str
    measured: FloatArray  #: (n,) s, increasing; readings of the motion.
    commands: tuple[FloatArray, ...]  #: The same of each clock with commands.
    unknown: Intervals = ()  #: s, between which nothing is logged.


@dataclass(frozen=True, kw_only=True, eq=False)
class SignalData:
    """A measured signal in order of time."""

    log: str
    name: str  #: Name of the signal, as "heading".
    time: FloatArray  #: (n,) s, strictly increasing.
    values: FloatArray  #: (n,) in SI, angles wrapped as logged; finite.
    period: float  #: 2 pi for an angle; infinite otherwise.
    unit: str  #: SI unit, for messages.
    clipped: bool = False  #: Whether clipped readings were left out.
    measured: bool = True  #: Whether this signal measures the motion that the model explains.
    unknown: Intervals = ()  #: s, between which neither this signal nor the commands are logged.
    logged: FloatArray = field(default_factory=lambda: np.zeros(0))  #: s of all readings, those left out included.

    def __post_init__(self) -> None:
        if not self.logged.size:
            object.__setattr__(self, "logged", self.time)


@dataclass(frozen=True, kw_only=True, eq=False)
class CommandData:
    """A command in order of time."""

    log: str
    name: str  #: Name of the thruster, or "torque".
    time: FloatArray  #: (n,) s, strictly increasing; instants of the command's messages or rows.
    values: FloatArray  #: (n,) in the unit of the thrust curve; NaN where missing.
    thruster: Thruster | None  #: None for a logged torque.
    measured: FloatArray  #: (m,) s, instants at which the motion was measured.
    #: (m,) position in rad or m at these instants; empty where it was not asked for.
    position: FloatArray = field(default_factory=lambda: np.zeros(0))
    others: Sequence[CommandData] = ()  #: The other commands of the log.
    alone: bool = False  #: Whether the command has messages of its own, rather than cells next to the motion's.
    source: str = ""  #: Column, or topic and field.
    #: Whether the format stores messages whose fields may be absent, as JSON and protobuf.
    sparse: bool = False
    unknown: Intervals = ()  #: s, between which the command is unknown.


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialData:
    """One log on one time base; a remedy replaces ``trial``, mostly its ``cuts`` or its ``unknown`` intervals."""

    trial: Trial
    vehicle: Vehicle
    known: frozenset[str] = frozenset()  #: Ids of the faults that were found in the log so far.
    #: (s, rad) of each reset of the heading that the log itself states.
    resets: tuple[tuple[float, float], ...] = ()

    def cut_at(self, *instants: float) -> Self:
        """The log, to be cut at further ``instants`` in s."""
        return replace(self, trial=replace(self.trial, cuts=tuple(sorted({*self.trial.cuts, *instants}))))


@dataclass(frozen=True, kw_only=True, eq=False)
class CampaignData:
    """All trials of a campaign; a remedy removes some of them."""

    trials: Sequence[Trial]
    vehicle: Vehicle


@dataclass(frozen=True, kw_only=True, eq=False)
class RunsData:
    """All runs of a campaign, with torque and rates; a remedy removes some of them."""

    runs: Sequence[Run]
    vehicle: Vehicle


def without(data: RunsData, log: str) -> RunsData:
    """``data`` without the runs of a log."""
    return replace(data, runs=[run for run in data.runs if log not in {run.trial.parent, run.trial.name}])


@dataclass(frozen=True, kw_only=True, eq=False)
class Detection(Generic[T]):
    """A fault that was found."""

    #: The fault; its text says what was found: which log, when, how large.
    fault: Fault
    done: str = ""  #: Sentence on the remedy, for people.
    repair: Callable[[T], T] = lambda data: data  #: Applies the remedy.


# From the data of a stage to what was found.
Detector = Callable[[Any], Iterable[Detection[Any]]]
# Detectors of one kind of fault by stage, in the order in which they look.
Detectors = Mapping[Stage, tuple[Detector, ...]]


@cache
def detectors_at(stage: Stage) -> tuple[Detector, ...]:
    """Detectors of all faults that are looked for at ``stage``."""
    modules = [import_module(f"rovid.faults.{name}") for name in FAULT_IDS]
    return tuple(detect for module in modules for detect in module.DETECTORS.get(stage, ()))


def examine_runs(
    runs: Sequence[Run], vehicle: Vehicle, overrides: FaultOverrides
) -> tuple[tuple[Run, ...], tuple[Fault, ...]]:
    """The runs that stay after the remedies, and the faults that torque and rates show."""
    data, faults = examine(detectors_at("runs"), RunsData(runs=runs, vehicle=vehicle), overrides)
    return tuple(data.runs), faults


def examine(detectors: Iterable[Detector], data: T, overrides: FaultOverrides) -> tuple[T, tuple[Fault, ...]]:
    """``data`` after all remedies of what the ``detectors`` find, in their order, and the faults.

    A fault that the user keeps is listed with the remedy "none" and stops nothing.
    """
    faults: list[Fault] = []
    examined = data  # as logged
    for detect in detectors:
        for detection in tuple(detect(data)):
            fault = detection.fault
            if not overrides.keep(fault):
                data = detection.repair(data)
            excerpt = fault.excerpt or _excerpt(examined, fault)
            faults.append(replace(resolve(fault, overrides, detection.done), excerpt=excerpt))
    return data, tuple(faults)


def resolve(fault: Fault, overrides: FaultOverrides, done: str = "") -> Fault:
    """``fault`` with the sentence ``done`` on its remedy; one that the user keeps has no remedy and stops nothing."""
    if overrides.keep(fault):
        fault, done = replace(fault, remedy="none", stops=False), "It was kept, as rovid.toml says."
    return replace(fault, text=f"{fault.text} {done}".strip())


def faults_of_all(found: Iterable[tuple[str, Iterable[Fault]]]) -> list[Fault]:
    """Faults of several actuators, each with the actuator's name; those with the same words become one."""
    names: dict[tuple[str, str], list[str]] = {}
    first: dict[tuple[str, str], tuple[str, Fault]] = {}
    for name, faults in found:
        for fault in faults:
            key = fault.fault, fault.text.replace(f"commands of {name} ", "commands of ")
            names.setdefault(key, []).append(name)
            first.setdefault(key, (name, fault))
    return [
        replace(fault, text=fault.text.replace(f"commands of {name} ", f"commands of {' and '.join(names[key])} "))
        for key, (name, fault) in first.items()
    ]


def _excerpt(data: object, fault: Fault) -> Excerpt | None:
    """The examined signal around the first instant of ``fault``; all of it where the whole log is meant."""
    trials: Sequence[Trial] = ()
    if isinstance(data, ClockData):
        name = data.measured if data.measured in data.values else next(iter(data.values), "")
        if not name:
            return None
        quantity, unit, time, values = name.removeprefix("command."), "", data.time, data.values[name]
        known = time[np.isfinite(time)]
        time = time - (known[0] if known.size else 0.0)
    elif isinstance(data, SignalData | CommandData):
        unit = data.unit if isinstance(data, SignalData) else ""
        quantity, time, values = data.name, data.time - data.time[0], data.values
    else:
        if isinstance(data, TrialData):
            trials = [data.trial]
        elif isinstance(data, CampaignData):
            trials = data.trials
        elif isinstance(data, RunsData):
            trials = [run.trial for run in data.runs]
        trial = next((one for one in trials if one.name in fault.logs), None)
        if trial is None:
            return None
        unit = trial.axis.unit("rad")
        quantity, time, values = trial.axis.position_words, trial.time[trial.measured], trial.position[trial.measured]
    rows = np.arange(len(time))
    if fault.at:
        near = int(np.nanargmin(np.abs(time - fault.at[0])))
        rows = rows[max(near - _EXCERPT // 2, 0) : near + _EXCERPT // 2]
    rows = rows[:: len(rows) // _EXCERPT + 1]
    return Excerpt(quantity=quantity, unit=unit, time=time[rows], values=values[rows])


def named(logs: Sequence[str], most: int = 5) -> str:
    """The first of the names of ``logs``, and the number of the others."""
    more = len(logs) - most
    return ", ".join(logs[:most]) + (f" and {more} more" if more > 0 else "")
