"""From a fit to the run to make next, as a command file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.core.errors import DataError
from rovid.core.escaping import csv_line
from rovid.design.candidate_runs import RunLimits, RunScales, candidate_runs
from rovid.design.expected_information import DECISIVE_LLR, CandidateModel, ExpectedInformation, rank_runs
from rovid.estimate.maximum_likelihood import LikelihoodFit
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle


@dataclass(frozen=True, kw_only=True, eq=False)
class ExperimentPlan:
    """Runs to come, the best first.

    Attributes
    ----------
    beliefs
        The rivals, or the one model whose parameter ``narrow`` is to be surer.
    noise_rate
        Rate in rad/s or m/s that the disturbance drives: what differs by less is not seen.
    """

    models: tuple[CandidateModel, ...]
    parameter: str
    runs: tuple[ExpectedInformation, ...]
    thrusters: tuple[str, ...]
    disturbance_rate: float

    @property
    def best(self) -> ExpectedInformation:
        """The run to make next."""
        return self.runs[0]

    @property
    def is_decisive(self) -> bool:
        """Whether the best run is expected to tell the rivals apart; always true of a parameter."""
        return len(self.models) == 1 or self.best.gain >= DECISIVE_LLR


def plan_experiment(
    beliefs: Sequence[CandidateModel], vehicle: Vehicle, trials: Sequence[Trial], limits: RunLimits, narrow: str = ""
) -> ExperimentPlan:
    """Rank the runs that tell ``beliefs`` apart, or make ``narrow`` surer.

    Raises
    ------
    DataError
        There are no thrusters, they push one way only, or no run stays within the limits.
    """
    names = tuple(thruster.name for thruster in vehicle.thrusters)
    require_thrusters(vehicle)
    pace = RunScales.from_trials(beliefs[0].model, vehicle, trials, limits.share)
    runs = [replace(run, reference=trials[0].reference) for run in candidate_runs(pace, names)]
    if not narrow and len(beliefs) == 1:
        narrow = least_certain_parameter(beliefs[0])
    worths = rank_runs(runs, beliefs, vehicle, limits, narrow=narrow)
    rate = float(np.sqrt(np.mean(worths[0].rates ** 2)))
    return ExperimentPlan(
        models=tuple(beliefs),
        parameter=narrow,
        runs=tuple(worths),
        thrusters=names,
        disturbance_rate=beliefs[0].driven_rate(rate),
    )


def require_thrusters(vehicle: Vehicle) -> None:
    """Refuse to plan commands where nothing takes any.

    Raises
    ------
    DataError
        There are no thrusters.
    """
    if not vehicle.thrusters:
        raise DataError(
            f"nothing drives the vehicle in {vehicle.axis.name}: there are no commands to plan.",
            mend="Let go of it from a large and from a small tilt, at rest and at speed.",
        )


def least_certain_parameter(belief: CandidateModel) -> str:
    """The parameter that is least sure for its size."""
    return belief.model.names[int(np.argmax(_relative_spread(belief)))]


def _relative_spread(belief: CandidateModel) -> FloatArray:
    """(p,) standard deviations as shares of the values; 0 of a parameter of nothing, however large its spread."""
    values = np.abs(belief.model.values)
    spread = np.sqrt(np.maximum(np.diag(belief.covariance), 0.0))
    return np.where(values != 0.0, spread / np.maximum(values, 1e-300), 0.0)


def candidate_model(fit: LikelihoodFit, name: str) -> CandidateModel:
    """What a fit knows."""
    return CandidateModel(
        name=name,
        model=fit.model,
        covariance=fit.estimate.covariance,
        disturbance=fit.disturbance,
        memory=fit.correlation_time,
        noise=fit.position_noise,
        integrated=fit.rate_only,
    )


def command_changes(worth: ExpectedInformation) -> tuple[list[float], list[list[float]]]:
    """Instants in s at which a command changes, and the commands from then on; the last is where the run ends."""
    rows = _rows_of_change(worth.run.commands)
    times = [round(float(instant), 4) for instant in worth.run.time[rows]]
    return times, np.round(worth.run.commands[rows], 5).tolist()


def _rows_of_change(commands: FloatArray) -> IntArray:
    """The first row, those in which a command differs from the row before, and the last."""
    changes = np.any(np.diff(commands, axis=0) != 0.0, axis=1)
    changed = np.flatnonzero(changes) + 1
    return np.unique(np.concatenate(([0], changed, [len(commands) - 1])))


def commands_by_name(plan: ExperimentPlan) -> dict[str, list[float]]:
    """The best run's commands, a list for each thruster beside that of the times."""
    times, rows = command_changes(plan.best)
    columns = {"time_s": times}
    for place, name in enumerate(plan.thrusters):
        columns[name] = [row[place] for row in rows]
    return columns


def command_csv(runs: ExperimentPlan) -> str:
    """The best run as CSV: time_s and a column for each actuator; each row holds until the next.

    The quotes about time_s are the mark of what rovid wrote.
    """
    times, rows = command_changes(runs.best)
    lines = [f'"time_s",{csv_line(runs.thrusters)}']
    for time, row in zip(times, rows, strict=True):
        lines.append(",".join(f"{value:g}" for value in (time, *row)))
    return "\n".join(lines) + "\n"
