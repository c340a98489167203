"""The option --axes, and the steps that commands of the coupled model share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rovid.cli.context import reserve_outputs, stored_logs, without_stale_values
from rovid.cli.streams import SOON, progress
from rovid.core.errors import ConfigError

if TYPE_CHECKING:
    from rovid.core.output_files import OutputSet
    from rovid.planar.fit import PlanarFit
    from rovid.store.parameter_file import Parameters
    from rovid.store.planar_study import PlanarStudy


def is_planar(axes: str | None, axis: str | None, **unsupported: object) -> bool:
    """Whether the coupled model of surge, sway and yaw is wanted.

    ``unsupported`` are options that the coupled model does not have, by name. Raises ConfigError if there are no such
    ``axes``, or a single ``axis`` or an unsupported option is given as well.
    """
    from rovid.trial.axis import PLANAR

    if axes is None:
        return False
    if axes != PLANAR.name:
        mend = "Give --axes planar for surge, sway and yaw together, or --axis for one of them."
        raise ConfigError(f"is {axes!r}; planar was expected.", where="--axes", mend=mend)
    if axis is not None:
        mend = "Leave --axis out, or leave --axes out."
        raise ConfigError(f"is given together with --axis {axis}.", where="--axes", mend=mend)
    for name, value in unsupported.items():
        if value:
            option = f"--{name.replace('_', '-')}"
            raise ConfigError(f"does not exist with --axes {axes}.", where=option, mend=f"Leave {option} out.")
    return True


def planar_parameters(path: Path | None) -> Parameters:
    """The parameter file of the coupled model, which has to exist.

    Raises ConfigError if the file is missing or damaged, or holds the parameters of one axis.
    """
    from rovid.store.load import read_parameters
    from rovid.trial.axis import PLANAR

    file = _file(path)
    if not file.exists():
        mend = "Run `rovid fit --axes planar LOGS` first, or give a parameter file with -p."
        raise ConfigError("there is no such parameter file.", where=file, mend=mend)
    stored = read_parameters(file)
    if stored.axis is not PLANAR:
        text = f"holds the parameters of {stored.axis.name}, but --axes is planar."
        raise ConfigError(text, where=file, mend="Give another file with -p.")
    return stored


def planar_parameters_at(path: Path | None, *, force: bool = False) -> Parameters:
    """The parameter file of the coupled model, or an empty one if it does not exist or is replaced with --force."""
    from rovid.core.output_files import PARAMETERS
    from rovid.store.parameter_file import Parameters
    from rovid.trial.axis import PLANAR

    file = _file(path)
    if file.exists() and not (force and file.is_file() and not PARAMETERS.matches(file)):
        return planar_parameters(file)
    return Parameters(path=file, axis=PLANAR)


def _file(path: Path | None) -> Path:
    from rovid.trial.axis import PLANAR, parameter_file_name

    return path or Path(parameter_file_name(PLANAR.name))


@dataclass(frozen=True, kw_only=True)
class PlanarSession:
    """What a fit of the coupled model needs: parameter file without stale values, logs, reserved files, remarks."""

    stored: Parameters
    study: PlanarStudy
    outputs: OutputSet
    notes: list[str]


def open_planar_session(
    logs: Sequence[Path] | None, parameters: Path | None, *, force: bool, require_sound: bool = True
) -> PlanarSession:
    """Open the parameter file, reserve it with its history, and read the logs."""
    from rovid.store.load import history_output
    from rovid.store.planar_study import open_planar_study

    stored = planar_parameters_at(parameters, force=force)
    paths = logs or planar_logs(stored)
    outputs = reserve_outputs([stored.output, history_output(stored.path)], paths, force=force)
    with progress("Reading the logs …", first=SOON) as report:
        study = open_planar_study(paths, report)
    if require_sound and not force:
        study.logs.require_sound()
    stored, notes = without_stale_values(stored, study.logs)
    return PlanarSession(stored=stored, study=study, outputs=outputs, notes=notes)


def planar_logs(stored: Parameters) -> list[Path]:
    """The logs that the parameter file names; an error if there are none."""
    if not stored.path.exists():
        mend = "Give LOGS: `rovid fit --axes planar LOGS`."
        raise ConfigError("there is no such parameter file, and no logs were given.", where=stored.path, mend=mend)
    return stored_logs(stored)


def store_planar_fit(session: PlanarSession, fit: PlanarFit) -> Parameters:
    """Store a fit in the parameter file, with a line in its history."""
    from rovid.store.load import update_parameters
    from rovid.store.planar_study import with_fit

    provenance = session.study.provenance

    def change(current: Parameters) -> Parameters:
        return with_fit(current, fit, provenance)

    return update_parameters(session.stored, session.outputs, change, detection_limits={})
