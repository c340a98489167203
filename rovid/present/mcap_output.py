"""Each trial's measurement, its simulation and what is left over, as MCAP beside the commands."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.atomic_write import OutputFile, OutputSet
from rovid.core.errors import ConfigError
from rovid.core.escaping import field_names
from rovid.core.signatures import RECORDING, RECORDING_LIBRARY
from rovid.model.model import Model
from rovid.model.simulation import TrialSimulation
from rovid.present.page.residual_torque import ResidualTorque, unexplained_torques
from rovid.readers.mcap_writer import OutputTopic, mcap_bytes, name_with_unit
from rovid.signals.preprocessing import PreparedRuns
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

_SUFFIX = ".mcap"


def recording_paths(target: Path, trials: Sequence[Trial]) -> list[Path]:
    """Where the recording of each trial goes: ``target`` itself for a single one, else into it as a folder.

    Raises
    ------
    ConfigError
        ``target`` names one file, and there are more trials; or a log would be written over.
    """
    place = f"--mcap {target}"
    paths = [target]
    if target.suffix.lower() != _SUFFIX or target.is_dir():
        paths = [target / name for name in _names(trials)]
    elif len(trials) > 1:
        several = f"names one file, but there are {len(trials)} trials."
        raise ConfigError(several, where=place, mend="Name a folder, for one file a trial.")
    logs = {trial.path.resolve() for trial in trials}
    for path in paths:
        if path.resolve() in logs:
            raise ConfigError(f"would write over the log {path}.", where=place, mend="Choose another place.")
    return paths


def _names(trials: Sequence[Trial]) -> Iterator[Path]:
    """A recording's name for each trial; with the log's format in it where two differ by that alone."""
    names = [_inside(Path(trial.name)) for trial in trials]
    plain = [name.with_suffix(_SUFFIX) for name in names]
    for name, short in zip(names, plain, strict=True):
        if plain.count(short) == 1:
            yield short
        else:
            yield name.with_name(name.name + _SUFFIX)


def _inside(name: Path) -> Path:
    """``name`` with nothing that leads out of a folder: a trial from elsewhere may be called by its whole path."""
    return Path(*(part for part in name.parts if part not in {"..", name.anchor}))


def write_recordings(
    claim: OutputSet,
    outputs: Sequence[OutputFile],
    simulations: Sequence[TrialSimulation],
    runs: PreparedRuns,
    model: Model,
    vehicle: Vehicle,
) -> None:
    """Write one recording a trial, all or none.

    Raises
    ------
    OutputError
        One cannot be written.
    """
    residuals = unexplained_torques(runs, model, vehicle)
    recordings = []
    for simulation, residual in zip(simulations, residuals, strict=True):
        topics = simulation_topics(simulation, residual, vehicle)
        recordings.append(mcap_bytes(topics, RECORDING_LIBRARY))
    claim.write(dict(zip(outputs, recordings, strict=True)))


def recording_outputs(target: Path, trials: Sequence[Trial]) -> list[OutputFile]:
    """As `recording_paths`."""
    return [OutputFile(path, RECORDING) for path in recording_paths(target, trials)]


def simulation_topics(simulation: TrialSimulation, residual: ResidualTorque, vehicle: Vehicle) -> list[OutputTopic]:
    """Rate, position, torques and commands of one trial; rates and torques behind the filter they share."""
    trial, rates = simulation.run.trial, simulation.run.rates
    axis = trial.axis
    residuals = simulation.measured - simulation.simulated
    rate = {"measured": simulation.measured, "simulated": simulation.simulated, "residual": residuals}
    guessed = vehicle.assumptions.is_placeholder(axis.force_unit)
    push = {"drive": residual.thruster_torque, "disturbance": residual.residual}
    return [
        _topic(axis.rate_signal, rates.time, rate, axis.rate_unit),
        _topic(axis.position_signal, trial.time, _positions(simulation), axis.display_unit[0]),
        # Whoever sees the recording sees no other word of rovid's.
        _topic(f"{'guessed_' * guessed}{axis.force_name}", residual.run.rates.time, push, axis.force_unit),
        _topic("commands", trial.time, _commands(trial, vehicle), ""),
    ]


def _positions(simulation: TrialSimulation) -> dict[str, FloatArray]:
    """(n,) in deg or m; what was integrated from a rate was not measured."""
    trial = simulation.run.trial
    _, factor = trial.axis.display_unit
    positions = {"simulated": simulation.position * factor}
    if trial.rate_only:
        return positions
    return {"measured": trial.position * factor} | positions


def _commands(trial: Trial, vehicle: Vehicle) -> dict[str, FloatArray]:
    """(n,) of each thruster, as logged."""
    names = field_names([thruster.name for thruster in vehicle.thrusters])
    return dict(zip(names, trial.commands.T, strict=True))


def _topic(name: str, time: FloatArray, fields: dict[str, FloatArray], unit: str) -> OutputTopic:
    """What is known of the ``fields``."""
    named = {}
    for field, values in fields.items():
        if np.isfinite(values).any():
            named[name_with_unit(field, unit)] = values
    return OutputTopic(name=f"/{name}", time=time, fields=named, units=dict.fromkeys(named, unit))
