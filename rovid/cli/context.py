"""Steps that the commands share: parameter file, logs, output files, progress and printing."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import typer

from rovid.cli.streams import SOON, progress
from rovid.core.errors import ConfigError

if TYPE_CHECKING:
    from rich.console import Console

    from rovid.core.output_files import OutputFile, OutputSet
    from rovid.diagnose.result import Diagnosis
    from rovid.estimate.estimate import Estimate
    from rovid.estimate.inertia import InertiaFit
    from rovid.estimate.maximum_likelihood import LikelihoodFit
    from rovid.estimate.steady_drag import DragFit
    from rovid.readers.campaign import PrefetchedReader, TrialReader
    from rovid.store.parameter_file import Parameters
    from rovid.store.study import Study
    from rovid.trial.assumptions import Assumptions
    from rovid.trial.axis import Axis

    Fit = TypeVar("Fit", DragFit, InertiaFit, LikelihoodFit)

# Columns of the output if the terminal's width is unknown.
_WIDTH = 160


def parameters_at(path: Path | None, axis: str | None, *, force: bool = False) -> Parameters:
    """The parameter file, or an empty one if the file does not exist or is replaced with --force."""
    from rovid.core.output_files import PARAMETERS
    from rovid.store.parameter_file import Parameters

    file = _parameter_path(path, axis)
    if file.exists() and not (force and file.is_file() and not PARAMETERS.matches(file)):
        return existing_parameters(file, axis)
    return Parameters(path=file, axis=named_axis(axis))


def existing_parameters(path: Path | None, axis: str | None = None) -> Parameters:
    """The parameter file, which has to exist and to be of this axis."""
    from rovid.store.load import read_parameters
    from rovid.trial.axis import PLANAR

    stored = read_parameters(_parameter_path(path, axis))
    if stored.axis is PLANAR:
        raise ConfigError(
            "holds the parameters of surge, sway and yaw together.",
            where=stored.path,
            mend="Give --axes planar where the command has it, or the file of one axis with -p.",
        )
    if axis and stored.axis.name != axis:
        raise ConfigError(
            f"holds the parameters of {stored.axis.name}, but --axis is {axis}.",
            where=stored.path,
            mend="Give another file with -p.",
        )
    return stored


def yaw_parameters(path: Path | None) -> Parameters:
    """The parameter file, which has to exist and to be of yaw."""
    from rovid.trial.axis import YAW

    stored = existing_parameters(path)
    if stored.axis is not YAW:
        raise ConfigError(
            f"holds the parameters of {stored.axis.name}; those of yaw were expected.",
            where=stored.path,
            mend="Give the file of yaw with -p.",
        )
    return stored


def _parameter_path(path: Path | None, axis: str | None) -> Path:
    from rovid.trial.axis import parameter_file_name

    return path or Path(parameter_file_name(named_axis(axis).name))


def named_axis(name: str | None) -> Axis:
    """The axis of this name; yaw without a name."""
    from rovid.trial.axis import YAW, axis_named

    return axis_named(name) if name else YAW


def stored_logs(stored: Parameters) -> list[Path]:
    """The logs that the parameter file names; an error if there are none."""
    if not stored.logs:
        exists = stored.path.exists()
        raise ConfigError(
            "names no logs." if exists else "there is no such parameter file, and no logs were given.",
            where=stored.path,
            mend="Give LOGS, or run `rovid fit-drag LOGS` first.",
        )
    return list(stored.logs)


def open_logs(paths: Sequence[Path], cutoff: float | None, axis: Axis, reading: TrialReader | None = None) -> Study:
    """Read the logs; ``reading`` replaces the reader of single logs."""
    compile_in_background()
    announce_compilation()
    from rovid.store.study import open_study

    with progress("Reading the logs …", first=SOON) as report:
        return open_study(paths, cutoff=cutoff, axis=axis, reading=reading, report=report)


def prefetch_logs(
    logs: Sequence[Path] | None, parameters: Path | None, axis: str | None, *, force: bool
) -> PrefetchedReader:
    """Read the logs in a copy of this process while this process imports the diagnosis, which takes a second."""
    from rovid.readers.campaign import PrefetchedReader

    def import_diagnosis() -> None:
        from rovid.diagnose.objectives import preload

        preload()

    def logs_and_axis() -> tuple[Sequence[Path], Axis]:
        if logs and not _parameter_path(parameters, axis).exists():
            return logs, named_axis(axis)
        stored = parameters_at(parameters, axis, force=force)
        return logs or stored_logs(stored), stored.axis

    return PrefetchedReader(logs_and_axis, import_diagnosis)


def write_missing_config(paths: Sequence[Path], axis: Axis) -> list[str]:
    """Write a first rovid.toml if the logs have none, as `rovid init --axis` does, and return remarks on it.

    Raises ConfigError if a signal was not recognised.
    """
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
        raise ConfigError(
            f"no column was recognised as {' and '.join(found.unrecognised)}.",
            where=config,
            mend="rovid just wrote this file from the logs: complete its open entries.",
        )
    vehicle = "" if found.profile is None else f" The vehicle was taken for a {found.profile.name}."
    return [f"There was no rovid.toml. rovid wrote {config} from the logs: please check it.{vehicle}", *found.warnings]


def reserve_outputs(outputs: Sequence[OutputFile], logs: Sequence[Path], *inputs: Path, force: bool) -> OutputSet:
    """Reserve output files; the input files and the files of the logs are protected."""
    from rovid.core.output_files import OutputSet
    from rovid.store.study import input_files

    return OutputSet(outputs, force=force, protected=[*input_files(logs), *inputs])


@dataclass(frozen=True, kw_only=True)
class FitSession:
    """What a fit needs: the parameter file without stale values, the logs, the reserved files, and remarks."""

    stored: Parameters
    study: Study
    outputs: OutputSet
    notes: list[str]


def open_session(
    logs: Sequence[Path] | None,
    parameters: Path | None,
    axis: str | None,
    cutoff: float | None,
    *,
    force: bool,
    with_history: bool = False,
    require_sound: bool = True,
    prefetch: PrefetchedReader | None = None,
) -> FitSession:
    """Open the parameter file, reserve it (and its history), and read the logs.

    Logs with a fault that no fit survives raise a `LogError` if ``require_sound``, unless ``force`` is given.
    """
    from rovid.store.load import history_output
    from rovid.trial.fault import FAULT_IDS, FaultOverrides

    stored = parameters_at(parameters, axis, force=force)
    paths = logs or stored_logs(stored)
    files = [stored.output, history_output(stored.path)] if with_history else [stored.output]
    outputs = reserve_outputs(files, paths, force=force)
    study = open_logs(paths, cutoff, stored.axis, prefetch)
    if force:
        study = replace(study, overrides=FaultOverrides(kept=dict.fromkeys(FAULT_IDS, ("*",))))
    elif require_sound:
        from rovid.preflight.check import require_right_signs

        study.require_sound()
        require_right_signs(study)
    stored, notes = without_stale_values(stored, study)
    return FitSession(stored=stored, study=study, outputs=outputs, notes=notes)


def fit_and_store(
    session: FitSession,
    words: str,
    fit: Callable[[], Fit],
    document: Callable[[Fit, Study], dict[str, Any]],
    show: Callable[[Console, Fit], None],
    *options: str,
    json: bool,
) -> None:
    """Run a fit, store its estimate in the parameter file, and print the result."""
    from rovid.store.checks import method_disagreement

    with progress(words):
        result: Fit = fit()
    study, stored = session.study, session.stored
    disagreements: list[str] = method_disagreement(stored.entries_for(study.paths), result.estimate)
    warnings = (*result.estimate.warnings, *session.notes, *disagreements)
    warned = replace(result, estimate=replace(result.estimate, warnings=warnings))
    stored = store_estimate(stored, session.outputs, study, warned.estimate, *options)
    if json:
        print_json(document(warned, study))
        return
    from rovid.present.console import print_text
    from rovid.present.terminal.results import show_fit

    show_fit(console(), warned, show, study)
    print_text(console(), f"written to {stored.path}")


def diagnose_study(
    stored: Parameters, study: Study, report: Callable[[str], None], *, force: bool = False, budget: float | None = None
) -> Diagnosis:
    """Diagnose the logs and warn where ``stored`` disagrees; with ``force`` also logs with a fault that stops."""
    from rovid.diagnose.result import Diagnosis
    from rovid.preflight.check import reversed_thrusters
    from rovid.store.checks import method_disagreement

    if not force and (reversed_arms := reversed_thrusters(study)):
        return Diagnosis(verdict="bad_logs", missing=reversed_arms)
    stored, notes = without_stale_values(stored, study)
    seconds = budget or study.default_budget
    diagnosis = study.diagnosis(report, drag=stored.independent_drag(), force=force, budget=seconds)
    if diagnosis.extended is not None:
        notes = [*notes, *method_disagreement(stored.entries_for(study.paths), diagnosis.extended.estimate)]
    return replace(diagnosis, warnings=(*diagnosis.warnings, *notes))


def store_estimate(
    stored: Parameters,
    outputs: OutputSet,
    study: Study,
    estimate: Estimate,
    *options: str,
    detectable_sizes: Mapping[str, float] | None = None,
    with_history: bool = True,
) -> Parameters:
    """Store an estimate with its provenance in the parameter file, without values that are stale by now.

    A joint estimate of all parameters also goes into the history, with the effect sizes a diagnosis could detect.
    """
    from rovid.store.checks import JOINT_METHODS
    from rovid.store.load import update_parameters

    def change(current: Parameters) -> Parameters:
        fresh, _ = without_stale_values(current, study)
        provenance = study.provenance
        given = " ".join(filter(None, (provenance.options, *options)))
        return fresh.with_estimate(estimate, replace(provenance, options=given))

    limits = None
    if with_history and estimate.method in JOINT_METHODS:
        limits = detectable_sizes or {}
    return update_parameters(stored, outputs, change, detection_limits=limits)


def without_stale_values(stored: Parameters, study: Study) -> tuple[Parameters, list[str]]:
    """``stored`` for a new fit, emptied if its inputs changed, with a remark in that case."""
    from rovid.store.checks import check_freshness

    freshness = check_freshness(stored, study.provenance)
    if not freshness.changes:
        return stored, []
    names = ", ".join(stored.entries)
    note = f"{stored.path.name} was out of date and was started again without {names}: {freshness.reason}."
    return stored.cleared(), [note]


def require_fresh(stored: Parameters, study: Study | None) -> list[str]:
    """Refuse a parameter file whose inputs changed; return remarks on a valid one.

    Raises ConfigError if an input changed.
    """
    from rovid.store.checks import check_freshness

    freshness = check_freshness(stored, None if study is None else study.provenance)
    if freshness.changes:
        mend = "Fit again: `rovid report`, `rovid diagnose` or `rovid fit`."
        raise ConfigError(f"is out of date: {freshness.reason}.", where=stored.path, mend=mend)
    return list(freshness.remarks)


def model_assumptions(stored: Parameters, study: Study | None) -> Assumptions:
    """Guesses about the vehicle that the parameters and the logs depend on."""
    from rovid.trial.assumptions import Assumptions

    own = Assumptions() if stored.settings is None else stored.settings.assumptions
    if study is None:
        return own
    # For the parameters' own logs a guess that was confirmed since is no guess.
    return study.vehicle.assumptions if study.provenance.logs == stored.logs else own | study.vehicle.assumptions


def require_usable(stored: Parameters, study: Study | None, *, force: bool) -> tuple[list[str], Assumptions]:
    """Refuse a parameter file whose inputs changed or, unless forced, are guesses; return remarks and guesses.

    Raises ConfigError if an input changed, or the values depend on guesses.
    """
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


def print_json(document: Any) -> None:
    """Print the document of --json."""
    from rovid.core.formatting import to_json

    if "rovid.effects.plugins" in sys.modules and "warnings" in document:
        from rovid.effects.plugins import plugin_warnings

        document["warnings"] = [*plugin_warnings(), *document["warnings"]]
    typer.echo(to_json(document))


def console() -> Console:
    """The console for tables."""
    from rovid.core.formatting import SafeConsole

    # rich uses COLUMNS or the terminal of standard input, output or error. Without them nothing is cut.
    known = "COLUMNS" in os.environ or any(map(os.isatty, range(3)))
    return SafeConsole(width=None if known else _WIDTH)
