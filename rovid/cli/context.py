"""Steps that the commands share: parameter file, logs, output files, progress and printing."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import typer

from rovid.cli.streams import SOON, progress
from rovid.core.errors import ConfigError, join_words

if TYPE_CHECKING:
    from rich.console import Console

    from rovid.api.results import Record
    from rovid.cli.options import SharedOptions
    from rovid.core.output_files import Content, OutputFile, OutputSet
    from rovid.readers.campaign import PrefetchedReader, TrialReader
    from rovid.store.parameter_file import Parameters
    from rovid.store.planar_study import PlanarStudy
    from rovid.store.study import Study
    from rovid.trial.assumptions import Assumptions
    from rovid.trial.axis import Axis

# Columns of the output if the terminal's width is unknown.
_WIDTH = 160


def is_planar(shared: SharedOptions, **unsupported: object) -> bool:
    """Whether the coupled model of surge, sway and yaw is wanted.

    ``unsupported`` are options that the coupled model does not have, by name, besides --cutoff. Raises ConfigError if
    there are no such axes, or a single axis or an unsupported option is given as well.
    """
    from rovid.trial.axis import PLANAR

    axes, axis = shared.axes, shared.axis
    if axes is None:
        return False
    if axes != PLANAR.name:
        mend = "Give --axes planar for surge, sway and yaw together, or --axis for one of them."
        raise ConfigError(f"is {axes!r}; planar was expected.", where="--axes", mend=mend)
    if axis is not None:
        mend = "Leave --axis out, or leave --axes out."
        raise ConfigError(f"is given together with --axis {axis}.", where="--axes", mend=mend)
    for name, value in {**unsupported, "cutoff": shared.cutoff}.items():
        if value:
            option = f"--{name.replace('_', '-')}"
            raise ConfigError(f"does not exist with --axes {axes}.", where=option, mend=f"Leave {option} out.")
    return True


def parameters_at(shared: SharedOptions, *, planar: bool = False, force: bool = False) -> Parameters:
    """The parameter file, or an empty one if the file does not exist or is replaced with --force."""
    from rovid.core.output_files import PARAMETERS
    from rovid.store.parameter_file import Parameters
    from rovid.trial.axis import PLANAR

    file = _parameter_path(shared, planar=planar)
    if file.exists() and not (force and file.is_file() and not PARAMETERS.matches(file)):
        return existing_parameters(shared, planar=planar)
    return Parameters(path=file, axis=PLANAR if planar else named_axis(shared.axis))


def existing_parameters(shared: SharedOptions, *, planar: bool = False) -> Parameters:
    """The parameter file, which has to exist and to be of this axis, or of the coupled model if ``planar``.

    Raises ConfigError if the file is missing or damaged, or holds the parameters of another model.
    """
    from rovid.store.load import read_parameters
    from rovid.trial.axis import PLANAR

    file, axis = _parameter_path(shared, planar=planar), shared.axis
    if planar and not file.exists():
        mend = "Run `rovid fit --axes planar LOGS` first, or give a parameter file with -p."
        raise ConfigError("there is no such parameter file.", where=file, mend=mend)
    stored = read_parameters(file)
    mend = "Give another file with -p."
    if planar and stored.axis is not PLANAR:
        text = f"holds the parameters of {stored.axis.name}, but --axes is planar."
    elif stored.axis is PLANAR and not planar:
        text = "holds the parameters of surge, sway and yaw together."
        mend = "Give --axes planar where the command has it, or fit yaw alone: `rovid fit LOGS`, and its file with -p."
    elif axis and stored.axis.name != axis:
        text = f"holds the parameters of {stored.axis.name}, but --axis is {axis}."
    else:
        return stored
    raise ConfigError(text, where=stored.path, mend=mend)


def yaw_parameters(shared: SharedOptions) -> Parameters:
    """The parameter file, which has to exist and to be of yaw."""
    from rovid.trial.axis import YAW

    stored = existing_parameters(shared)
    if stored.axis is not YAW:
        text = f"holds the parameters of {stored.axis.name}; those of yaw were expected."
        raise ConfigError(text, where=stored.path, mend="Give the file of yaw with -p.")
    return stored


def _parameter_path(shared: SharedOptions, *, planar: bool = False) -> Path:
    from rovid.trial.axis import PLANAR, parameter_file_name

    return shared.parameters or Path(parameter_file_name(PLANAR.name if planar else named_axis(shared.axis).name))


def named_axis(name: str | None) -> Axis:
    """The axis of this name; yaw without a name."""
    from rovid.trial.axis import YAW, axis_named

    return axis_named(name) if name else YAW


def stored_logs(stored: Parameters) -> list[Path]:
    """The logs that the parameter file names; an error if there are none."""
    from rovid.core.input_files import require_exists
    from rovid.trial.axis import PLANAR

    for path in stored.logs:
        try:
            require_exists(path)
        except ConfigError as error:
            raise ConfigError(f"names logs that cannot be read: {error}", where=stored.path) from error
    if stored.logs:
        return list(stored.logs)
    text, mend = "names no logs.", "Give LOGS, or run `rovid fit-drag LOGS` first."
    if not stored.path.exists():
        text = "there is no such parameter file, and no logs were given."
        if stored.axis is PLANAR:
            mend = "Give LOGS: `rovid fit --axes planar LOGS`."
    raise ConfigError(text, where=stored.path, mend=mend)


def open_logs(paths: Sequence[Path], cutoff: float | None, axis: Axis, reading: TrialReader | None = None) -> Study:
    """Read the logs; ``reading`` replaces the reader of single logs."""
    compile_in_background()
    announce_compilation()
    from rovid.store.study import open_study

    with progress("Reading the logs …", first=SOON) as report:
        return open_study(paths, cutoff=cutoff, axis=axis, reading=reading, report=report)


def open_planar_logs(paths: Sequence[Path]) -> PlanarStudy:
    """Read the logs for surge, sway and yaw together."""
    from rovid.store.planar_study import open_planar_study

    with progress("Reading the logs …", first=SOON) as report:
        return open_planar_study(paths, report)


def prefetch_logs(logs: Sequence[Path] | None, shared: SharedOptions) -> PrefetchedReader:
    """Read the logs in a copy of this process while this process imports the diagnosis, which takes a second."""
    from rovid.readers.campaign import PrefetchedReader

    def import_diagnosis() -> None:
        from rovid.diagnose.objectives import preload

        preload()

    def logs_and_axis() -> tuple[Sequence[Path], Axis]:
        if logs and not _parameter_path(shared).exists():
            return logs, named_axis(shared.axis)
        stored = parameters_at(shared, force=shared.force)
        return logs or stored_logs(stored), stored.axis

    return PrefetchedReader(logs_and_axis, import_diagnosis)


def write_missing_config(paths: Sequence[Path], axis: Axis) -> list[str]:
    """Remarks on a rovid.toml, written if there is none. Raises ConfigError if a signal was not recognised."""
    from rovid.trial.config import NoConfigError, find_config

    try:
        find_config(paths)
    except NoConfigError:
        pass
    else:
        return []
    from rovid.preflight.config_writer import write_config
    from rovid.preflight.log_survey import SurveyOptions, survey

    found, (config, *_) = write_config(survey(paths, SurveyOptions(axis=axis)), paths, force=False)
    if found.unrecognised:
        mend = "rovid just wrote this file from the logs: complete its open entries."
        raise ConfigError(f"no column was recognised as {' and '.join(found.unrecognised)}.", where=config, mend=mend)
    vehicle = "" if found.profile is None else f" The vehicle was taken for a {found.profile.name}."
    return [f"There was no rovid.toml. rovid wrote {config} from the logs: please check it.{vehicle}", *found.warnings]


def reserve_outputs(outputs: Sequence[OutputFile], logs: Sequence[Path], *inputs: Path, force: bool) -> OutputSet:
    """Reserve output files; the input files and the files of the logs are protected."""
    from rovid.core.output_files import OutputSet
    from rovid.store.study import input_files

    return OutputSet(outputs, force=force, protected=[*input_files(logs), *inputs])


def write_outputs(outputs: OutputSet, contents: Mapping[OutputFile, Content]) -> list[str]:
    """Write the files; a remark where they replace files of an earlier run with other contents."""
    names = join_words([str(path) for path in outputs.write(contents)])
    return [f"Replaced the earlier {names}. Another name of the output keeps both."] if names else []


def without_stale_values(stored: Parameters, study: Study) -> tuple[Parameters, list[str]]:
    """``stored`` for a new fit, emptied if its inputs changed, with a remark in that case."""
    from rovid.store.checks import check_freshness

    freshness = check_freshness(stored, study.provenance)
    if not freshness.changes:
        return stored, []
    names = ", ".join(stored.entries)
    note = f"{stored.path.name} was out of date and was started again without {names}: {freshness.reason}."
    return stored.cleared(), [note]


def require_fresh(stored: Parameters, study: Study | PlanarStudy | None) -> list[str]:
    """Remarks on a parameter file. Raises ConfigError if its inputs changed."""
    from rovid.store.checks import check_freshness

    freshness = check_freshness(stored, None if study is None else study.provenance)
    if freshness.changes:
        mend = "Fit again: `rovid report`, `rovid diagnose` or `rovid fit`."
        raise ConfigError(f"is out of date: {freshness.reason}.", where=stored.path, mend=mend)
    return [*freshness.remarks, *(study.unusual_values(stored) if study else ())]


def model_assumptions(stored: Parameters, study: Study | PlanarStudy | None) -> Assumptions:
    """Guesses about the vehicle that the parameters and the logs depend on."""
    from rovid.trial.assumptions import Assumptions

    own = Assumptions() if stored.settings is None else stored.settings.assumptions
    if study is None:
        return own
    # For the parameters' own logs a guess that was confirmed since is no guess.
    return study.vehicle.assumptions if study.provenance.logs == stored.logs else own | study.vehicle.assumptions


def require_usable(
    stored: Parameters, study: Study | PlanarStudy | None, *, force: bool
) -> tuple[list[str], Assumptions]:
    """Remarks on a file, and its guesses. Raises ConfigError if inputs changed or, unless forced, there are guesses."""
    remarks, assumptions = require_fresh(stored, study), model_assumptions(stored, study)
    if assumptions and not force:
        mend = "Or give --force, and keep the results apart."
        raise ConfigError(assumptions.refusal, where=stored.path, mend=mend)
    return remarks, assumptions


def compile_in_background() -> bool:
    """Start a second process that compiles missing kernels; return whether it was needed."""
    from rovid.model.kernels import start_compiling

    return start_compiling()


def announce_compilation() -> None:
    """Explain on a terminal why the first run takes some seconds longer."""
    if not sys.stderr.isatty():
        return
    from rovid.model.kernels import is_compiled

    if not is_compiled():
        sys.stderr.write("Compiling the simulation for this machine, once …\n")


def print_json(document: Mapping[str, Any]) -> None:
    """Print the document of --json."""
    from rovid.core.formatting import to_json

    if "rovid.effects.plugins" in sys.modules and "warnings" in document:
        from rovid.effects.plugins import plugin_warnings

        document = {**document, "warnings": [*plugin_warnings(), *document["warnings"]]}
    typer.echo(to_json(document))


def print_either(document: Mapping[str, Any], show: Callable[..., None], *shown: Any, json: bool) -> None:
    """Print the document of --json, or else what ``show`` prints of ``shown``."""
    if json:
        print_json(document)
    else:
        show(console(), *shown)


def print_record(record: Record, *, json: bool, document: Mapping[str, Any] = MappingProxyType({})) -> None:
    """Print a result, or its document with further keys of ``document``."""
    print_either({**record.document, **document}, record.show, json=json)


def console() -> Console:
    """The console for tables."""
    from rovid.core.formatting import SafeConsole

    # rich uses COLUMNS or the terminal of standard input, output or error. Without them nothing is cut.
    known = "COLUMNS" in os.environ or any(map(os.isatty, range(3)))
    return SafeConsole(width=None if known else _WIDTH)
