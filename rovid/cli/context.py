"""What every command does around its work: files at hand, a session with the logs, words on the screen."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from rovid.cli import completion
from rovid.core.errors import ConfigError

# Columns where nobody says how many there are.
_WIDE = 160

if TYPE_CHECKING:
    from rich.console import Console

    from rovid.core.atomic_write import OutputFile, OutputSet
    from rovid.diagnose.result import Diagnosis
    from rovid.estimate.estimate import Estimate
    from rovid.readers.campaign import PrefetchedReader, TrialReader
    from rovid.store.parameter_file import Parameters
    from rovid.store.study import Study
    from rovid.trial.assumptions import Assumptions
    from rovid.trial.axis import Axis


def claim_of(outputs: Sequence[OutputFile], logs: Sequence[Path], *read: Path, force: bool) -> OutputSet:
    """Leave to write ``outputs``, but never over ``read`` or what is where the logs are."""
    from rovid.core.atomic_write import OutputSet
    from rovid.store.study import input_files

    return OutputSet(outputs, force=force, protected=[*input_files(logs), *read])


def claim_of_model(stored: Parameters, logs: Sequence[Path], *, force: bool) -> OutputSet:
    """Leave to write the parameter file and the history beside it."""
    from rovid.store.history import history_output

    return claim_of([stored.output, history_output(stored.path)], logs, force=force)


def standing_now(stored: Parameters, study: Study) -> tuple[Parameters, list[str]]:
    """``stored`` for a new fit, without what no longer holds, and the word that has to be said of that."""
    from rovid.store.staleness import check_freshness

    found = check_freshness(stored, study.provenance)
    if not found.changes:
        return stored, []
    names = ", ".join(stored.entries)
    return stored.cleared(), [f"{stored.path.name} no longer held, and was begun anew without {names}: {found.reason}."]


def require_holding(stored: Parameters, study: Study | None) -> list[str]:
    """Refuse a parameter file that no longer holds; what cannot be told of one that does.

    Raises
    ------
    ConfigError
        What it rests on has changed.
    """
    from rovid.store.staleness import check_freshness

    found = check_freshness(stored, None if study is None else study.provenance)
    if found.changes:
        mend = "Fit again: `rovid report`, `rovid diagnose` or `rovid fit`."
        raise ConfigError(f"no longer holds: {found.reason}.", where=stored.path, mend=mend)
    return list(found.remarks)


def compared(stored: Parameters, study: Study, estimate: Estimate, notes: Sequence[str] = ()) -> Estimate:
    """``estimate``, with ``notes`` and a warning where another method said another thing of the same logs."""
    from rovid.store.agreement import method_disagreement

    apart = method_disagreement(stored.entries_for(study.paths), estimate)
    return replace(estimate, warnings=(*estimate.warnings, *notes, *apart))


def put(
    stored: Parameters,
    claim: OutputSet,
    study: Study,
    estimate: Estimate,
    *options: str,
    seen: Mapping[str, float] | None = None,
    for_good: bool = True,
) -> Parameters:
    """Put an estimate into the parameter file, with what it comes of, and take out what no longer holds beside it.

    A model of all at once goes into the history too, if ``for_good``: of a day that goes on not each step does.
    ``seen`` is what of the effects looked for would have been seen.
    """
    from rovid.store.agreement import JOINT_METHODS
    from rovid.store.update import update_parameters

    def change(now: Parameters) -> Parameters:
        held, _ = standing_now(now, study)
        origin = study.provenance
        given = " ".join(filter(None, (origin.options, *options)))
        return held.with_estimate(estimate, replace(origin, options=given))

    is_kept = for_good and estimate.method in JOINT_METHODS
    return update_parameters(stored, claim, change, seen=(seen or {}) if is_kept else None)


def diagnosed(stored: Parameters, study: Study, report: Callable[[str], None]) -> Diagnosis:
    """The diagnosis, with what ``stored`` says of the same logs by other methods."""
    from rovid.store.agreement import method_disagreement

    stored, notes = standing_now(stored, study)
    diagnosis = study.diagnosis(report, drag=stored.independent_drag())
    diagnosis = replace(diagnosis, warnings=(*diagnosis.warnings, *notes))
    if (side := diagnosis.extended) is not None:
        apart = method_disagreement(stored.entries_for(study.paths), side.estimate)
        diagnosis = replace(diagnosis, warnings=(*diagnosis.warnings, *apart))
    return diagnosis


def read_ahead(
    logs: Sequence[Path] | None, parameters: Path | None, axis: str | None, *, force: bool
) -> PrefetchedReader:
    """Have a copy of this process read the logs, while this one loads what a diagnosis takes: a second's work."""
    from rovid.readers.campaign import PrefetchedReader

    def meanwhile() -> None:
        from rovid.diagnose.objectives import preload

        preload()

    def asked() -> tuple[Sequence[Path], Axis]:
        if logs and not _parameter_file(parameters, axis).exists():
            return logs, _axis_of(axis)
        stored = stored_at(parameters, axis, force=force)
        return logs or remembered(stored), stored.axis

    return PrefetchedReader(asked, meanwhile)


def opened(paths: Sequence[Path], cutoff: float | None, axis: Axis, reading: TrialReader | None = None) -> Study:
    """What the logs at ``paths`` hold, made ready; ``reading`` is what reads one, where another than usual does."""
    compile_beside()
    announce_compilation()
    from rovid.store.study import open_study

    return open_study(paths, cutoff=cutoff, axis=axis, reading=reading)


def drafted(paths: Sequence[Path], axis: Axis) -> list[str]:
    """Write a first rovid.toml for logs that have none, as `rovid init --axis` does; what has to be said of that.

    Raises
    ------
    ConfigError
        Not all of it is known.
    """
    from rovid.trial.config import NoConfigError, find_config

    try:
        find_config(paths)
    except NoConfigError:
        return _draft(paths, axis)
    return []


def _draft(paths: Sequence[Path], axis: Axis) -> list[str]:
    from rovid.preflight.config_writer import write_config
    from rovid.preflight.log_survey import SurveyOptions, survey

    surveyed, (config, *_) = write_config(survey(paths, SurveyOptions(axis=axis)), paths, force=False)
    if surveyed.unrecognised:
        raise ConfigError(
            f"no column was recognised as {' and '.join(surveyed.unrecognised)}.",
            where=config,
            mend="It was written from the logs just now: put in what is open.",
        )
    known = "" if surveyed.profile is None else f" The vehicle was taken for a {surveyed.profile.name}."
    return [f"There was no rovid.toml: {config} was written from the logs. Read it.{known}", *surveyed.warnings]


def compile_beside() -> bool:
    """Have a second process compile what is not compiled yet: at once, for imports alone take a second.

    Whether there is one.
    """
    from rovid.model.kernels import start_compiling

    return start_compiling()


def announce_compilation() -> None:
    """Say why the first run on a machine takes some seconds longer."""
    if not sys.stderr.isatty():
        return
    from rovid.model.kernels import is_compiled

    if not is_compiled():
        sys.stderr.write("Compiling the simulation for this machine, once …\n")


@contextmanager
def working(text: str) -> Iterator[Callable[[str], None]]:
    """As ``busy``, with a function that changes the text; line by line where ROVID_PROGRESS asks for that."""
    if os.environ.get("ROVID_PROGRESS") == "lines":
        _line(text)
        yield _line
        return
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rovid.core.console import SafeConsole

    screen = SafeConsole(stderr=True)
    with screen.status(text) as status:
        yield lambda words: status.update(screen.render_str(words))


def _line(text: str) -> None:
    sys.stderr.write(f"{text}\n")
    sys.stderr.flush()


@contextmanager
def busy(text: str) -> Iterator[None]:
    """Show a person that work goes on; nothing where nobody watches."""
    if not sys.stderr.isatty():
        yield
        return
    from rovid.core.console import SafeConsole

    with SafeConsole(stderr=True).status(text):
        yield


def stored_at(path: Path | None, axis: str | None, *, force: bool = False) -> Parameters:
    """The parameter file that is there, or an empty one; where forced, in place of anything else."""
    from rovid.core.signatures import PARAMETERS
    from rovid.store.parameter_file import Parameters

    where = _parameter_file(path, axis)
    if where.exists() and not (force and where.is_file() and not PARAMETERS.matches(where)):
        return known_at(where, axis)
    return Parameters(path=where, axis=_axis_of(axis))


def known_at(path: Path | None, axis: str | None = None) -> Parameters:
    """The parameter file, which has to be there and of this axis."""
    from rovid.store.load import read_parameters

    stored = read_parameters(_parameter_file(path, axis))
    if axis and stored.axis.name != axis:
        raise ConfigError(
            f"holds the parameters of {stored.axis.name}, and --axis says {axis}.",
            where=stored.path,
            mend="Give another file with -p.",
        )
    return stored


def _parameter_file(path: Path | None, axis: str | None) -> Path:
    return path or Path(completion.parameter_file(_axis_of(axis).name))


def _axis_of(name: str | None) -> Axis:
    from rovid.trial.axis import YAW, axis_named

    return axis_named(name) if name else YAW


def of_yaw(stored: Parameters) -> Parameters:
    """``stored``, which has to be of yaw."""
    from rovid.trial.axis import YAW

    if stored.axis is not YAW:
        raise ConfigError(
            f"holds the parameters of {stored.axis.name}; those of yaw were expected.",
            where=stored.path,
            mend="Give the file of yaw with -p.",
        )
    return stored


def remembered(stored: Parameters) -> list[Path]:
    """The logs that the parameter file remembers; it has to."""
    if not stored.logs:
        raise ConfigError(
            "remembers no logs."
            if stored.path.exists()
            else "there is no such parameter file, and no logs were given.",
            where=stored.path,
            mend="Give LOGS, or run `rovid fit-drag LOGS` first.",
        )
    return list(stored.logs)


def print_json(document: Any) -> None:
    """Print the one document that --json asks for."""
    from rovid.core.formatting import to_json

    typer.echo(to_json(document))


def guess_of(stored: Parameters, study: Study | None) -> Assumptions:
    """What is guessed of the vehicle that the parameters are of, and of that of the logs."""
    from rovid.trial.assumptions import Assumptions

    own = Assumptions() if stored.settings is None else stored.settings.assumptions
    if study is None:
        return own
    # Where the logs are those of the parameters, a guess that was confirmed since is none.
    return study.vehicle.assumptions if study.provenance.logs == stored.logs else own | study.vehicle.assumptions


def require_measured(stored: Parameters, guess: Assumptions, *, force: bool) -> None:
    """Refuse to hand on what hangs on a guess, unless that is asked for.

    Raises
    ------
    ConfigError
        It does.
    """
    if guess and not force:
        raise ConfigError(guess.refusal, where=stored.path, mend="Or give --force, and keep what comes of it apart.")


def console() -> Console:
    """What tables are printed on."""
    from rovid.core.console import SafeConsole

    # rich goes by COLUMNS, or by the terminal that any of the three is on; where there is neither, nothing gives way.
    told = "COLUMNS" in os.environ or any(map(os.isatty, range(3)))
    return SafeConsole(width=None if told else _WIDE)
