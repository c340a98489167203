"""Measurement, simulation, residual torque and commands of each trial as MCAP."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError
from rovid.core.formatting import field_names
from rovid.core.output_files import RECORDING, RECORDING_LIBRARY, OutputFile, OutputSet
from rovid.model.model import Model
from rovid.model.simulation import TrialSimulation
from rovid.present.residuals import ResidualTorque, unexplained_torques
from rovid.readers.convert import OutputTopic, mcap_bytes, name_with_unit
from rovid.trial.preprocessing import PreparedRuns
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle

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
    counts = Counter(name.with_suffix(_SUFFIX) for name in names)
    for place, name in enumerate(names):
        names[place] = name.with_suffix(_SUFFIX)
        if counts[names[place]] > 1:
            names[place] = name.with_name(name.name + _SUFFIX)
    return names


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
    rate = {
        "measured": simulation.measured,
        "simulated": simulation.simulated,
        "residual": simulation.measured - simulation.simulated,
    }
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
