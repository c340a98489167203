"""The command line: parse, call, print. Everything heavy is imported inside the commands."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from rovid import __version__
from rovid.commands import completion
from rovid.commands.help import FIRST_SESSION, MANUAL, ManualCommand, ManualGroup
from rovid.ground.errors import LINE_LENGTH, ConfigError, DataError, RovidError, shown

if TYPE_CHECKING:
    from rich.console import Console

    from rovid.campaign.axis import Axis
    from rovid.ground.files import Claim, Output
    from rovid.identify.estimate import Estimate
    from rovid.parameters.parameters import Parameters
    from rovid.study import Study

app = typer.Typer(
    cls=ManualGroup,
    help="From an underwater vehicle's trial logs to a dynamic model its owner can defend.",
    epilog=FIRST_SESSION,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # boxes leave no room for words at 80 columns
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)

Logs = Annotated[
    list[Path], typer.Argument(metavar="LOGS", help="A folder of logs, or logs one by one.", show_default=False)
]
OptionalLogs = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="LOGS",
        help="A folder of logs, or logs one by one; those that the parameter file remembers if not given.",
        show_default=False,
    ),
]
ParameterFile = Annotated[
    Path | None,
    typer.Option(
        "--parameters",
        "-p",
        metavar="FILE",
        help="Parameter file; parameters.toml if not given, parameters_AXIS.toml for another axis than yaw.",
        show_default=False,
    ),
]
AxisName = Annotated[
    str | None,
    typer.Option(
        "--axis",
        metavar="AXIS",
        help="Degree of freedom: yaw, surge, sway, heave, roll or pitch; yaw if neither this nor -p says another.",
        autocompletion=completion.axes,
        show_default=False,
    ),
]
Cutoff = Annotated[
    float | None,
    typer.Option(
        metavar="HZ",
        min=1e-3,
        help="Cut-off of the low pass that rates come from, in Hz; chosen from the data if not given.",
        show_default=False,
    ),
]
Force = Annotated[
    bool,
    typer.Option("--force", help="Write over files that rovid did not write; never over what it reads here."),
]
Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON document on standard output, and nothing else there.")
]


def main() -> None:
    """Entry point: run the command; the user's mistakes end with one message and exit status 2."""
    if "_ROVID_COMPLETE" in os.environ:
        # typer folds the help that zsh and fish show beside a value; a shell takes each line for a value.
        os.environ["COLUMNS"] = "1000"
    try:
        app(prog_name="rovid")
    except RovidError as error:
        sys.stderr.write(f"rovid: {error}\n")
        raise SystemExit(2) from None
    except BrokenPipeError:
        # The reader of our output went away, as `| head` does.
        sys.stderr.close()
        raise SystemExit(1) from None
    except OSError as error:
        if error.errno != errno.ENAMETOOLONG:
            raise
        where = shown(str(error.filename))
        sys.stderr.write(
            f"rovid: {where}: there is no such file or folder: no file's name is as long. Give a shorter one.\n"
        )
        raise SystemExit(2) from None


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"rovid {__version__}")
        raise typer.Exit


def _command(function: Callable[..., None]) -> Callable[..., None]:
    """Make it a command; its docstring says in a line what it does, the manual says the rest."""
    name = function.__name__.replace("_", "-")
    page = MANUAL[name]
    register = app.command(name, cls=ManualCommand, help=f"{function.__doc__}\n{page.text}", epilog=page.epilog)
    return register(function)


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_version, is_eager=True)
    ] = False,
) -> None:
    pass


@_command
def init(
    logs: Logs,
    *,
    force: Annotated[
        bool, typer.Option("--force", help="Write over a rovid.toml that is there; without it that is an error.")
    ] = False,
    json: Json = False,
) -> None:
    """Write a first rovid.toml for your logs."""
    from rovid.ground.files import Claim
    from rovid.inspect.first_config import files_of, outputs_beside, survey
    from rovid.show.documents import survey_document
    from rovid.show.terminal import show_survey

    # A guessed curve that is there may be a bench curve by now, but it may not be needed either.
    config, _ = outputs_beside(logs)
    claim = Claim([config], force=force)
    found = survey(logs)
    files = files_of(found)
    claim.write(files)
    written = [output.path for output in files]
    if json:
        _print_json(survey_document(found, written))
    else:
        show_survey(_console(), found, written)


@_command
def check(logs: Logs, *, axis: AxisName = None, json: Json = False) -> None:
    """Say what is in the logs, and what is wrong."""
    from rovid.campaign.axis import YAW, axis_named
    from rovid.campaign.config import find_config, load_config
    from rovid.inspect.check import check_logs
    from rovid.show.documents import check_document
    from rovid.show.terminal import show_advice, show_check, show_warnings

    _announce_compilation()
    config = load_config(find_config(logs), axis_named(axis) if axis else YAW)
    found = check_logs(logs, config)
    if json:
        _print_json(check_document(config.axis, found.rows, found.problems, found.remarks, found.advice))
    else:
        show_check(_console(), found.rows, found.problems)
        show_warnings(_console(), [remark.text for remark in found.remarks])
        if found.rows:
            show_advice(_console(), found.advice)
    if found.problems:
        name, problem = next(iter(found.problems.items()))
        raise DataError(
            f"{len(found.problems)} of {len(found.problems) + len(found.rows)} logs cannot be used. {problem}"
            if name in problem
            else f"{name}: {problem}"
        )


@_command
def convert(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="A log of any format that rovid reads; see docs/logs.md.")],
    *,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="Where it goes: a .csv, .mcap or .parquet file.")
    ],
    axis: AxisName = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write a log in another format."""
    from rovid.campaign.axis import YAW, axis_named
    from rovid.campaign.config import find_config, load_config
    from rovid.readers.convert import convert as make
    from rovid.readers.convert import output_at

    target = output_at(output, log)
    config = load_config(find_config([log]), axis_named(axis) if axis else YAW)
    claim = _claim([target], [config.path.parent, log], force=force)
    made = make(log, config, output)
    claim.write({target: made.content})
    remarks = [remark.text for remark in made.trial.remarks]
    if json:
        _print_json(
            {"schema": "rovid-convert/1", "file": str(output), "configuration": made.mapping, "warnings": remarks}
        )
    else:
        typer.echo(made.mapping, nl=False)
        sys.stderr.writelines(f"Note: {shown(text, LINE_LENGTH)}\n" for text in remarks)


@_command
def fit_drag(
    logs: Logs,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find drag from steady turns."""
    from rovid.show.documents import drag_document
    from rovid.show.terminal import show_drag, show_fit

    stored = _stored(parameters, axis, force=force)
    claim = _claim([stored.output], logs, force=force)
    study = _open(logs, cutoff, stored.axis)
    if stored.axis.rights:
        # No constant torque turns what rights itself steadily: drag comes with the inertia.
        _fit_inertia(study, stored, claim, new_logs=True, json=json)
        return
    with _busy("Fitting drag …"):
        result = study.drag()
    result = replace(result, estimate=_compared(stored, study, result.estimate))
    stored = _put(stored, claim, study, result.estimate, new_logs=True)
    if json:
        _print_json(drag_document(result, study))
    else:
        show_fit(_console(), result, show_drag, study, stored)


@_command
def fit_inertia(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find inertia from sines, by four methods."""
    stored = _stored(parameters, axis, force=force)
    paths = logs or _remembered(stored)
    claim = _claim([stored.output], paths, force=force)
    study = _open(paths, cutoff, stored.axis)
    _fit_inertia(study, stored, claim, new_logs=bool(logs), json=json)


@_command
def fit(
    logs: OptionalLogs = None,
    *,
    effect: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID",
            help="Put this effect into the model, as thruster_lag; may be given again.",
            autocompletion=completion.effects,
            show_default=False,
        ),
    ] = None,
    gyro: Annotated[
        bool, typer.Option("--gyro", help="Fit logged rates too, where an instrument of their own measured them.")
    ] = False,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Fit all parameters by maximum likelihood."""
    from rovid.effects import effect_named
    from rovid.show.documents import likelihood_document
    from rovid.show.terminal import show_fit, show_likelihood

    effects = tuple(effect_named(name) for name in dict.fromkeys(effect or ()))
    stored = _stored(parameters, axis, force=force)
    paths = logs or _remembered(stored)
    claim = _claim([stored.output], paths, force=force)
    study = _open(paths, cutoff, stored.axis)
    with _busy("Maximising the likelihood …"):
        result = study.likelihood(effects, gyro=gyro)
    result = replace(result, estimate=_compared(stored, study, result.estimate))
    stored = _put(stored, claim, study, result.estimate, new_logs=bool(logs))
    if json:
        _print_json(likelihood_document(result, study))
    else:
        show_fit(_console(), result, show_likelihood, study, stored)


@_command
def diagnose(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Say what the simulation gets wrong, and why."""
    from rovid.parameters.agreement import disagreement
    from rovid.show.account import show_diagnosis
    from rovid.show.documents import diagnosis_document
    from rovid.show.terminal import show_warnings

    stored = _stored(parameters, axis, force=force)
    paths = logs or _remembered(stored)
    claim = _claim([stored.output], paths, force=force)
    study = _open(paths, cutoff, stored.axis)
    with _working("Diagnosing …") as report:
        diagnosis = study.diagnosis(report, drag=stored.drag())
    if (side := diagnosis.extended) is not None:
        apart = disagreement(stored.entries_of(study.paths), side.estimate)
        diagnosis = replace(diagnosis, warnings=(*diagnosis.warnings, *apart))
        _put(stored, claim, study, side.estimate, new_logs=bool(logs))
    if json:
        _print_json(diagnosis_document(diagnosis, study))
    else:
        show_diagnosis(_console(), diagnosis, study.vehicle)
        show_warnings(_console(), [*study.remarks(), *diagnosis.warnings])


@_command
def fit_thruster(
    bench: Annotated[Path, typer.Argument(metavar="BENCH", help="A CSV file with readings of command and thrust.")],
    *,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Where the curve goes; BENCH_curve.csv in the working folder if not given.",
            show_default=False,
        ),
    ] = None,
    command: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="Column of the command; found by its name if not given.", show_default=False
        ),
    ] = None,
    thrust: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN", help="Column of the thrust; found by its name if not given.", show_default=False
        ),
    ] = None,
    unit: Annotated[
        str | None,
        typer.Option(
            metavar="UNIT",
            help=f"Unit of the thrust: {', '.join(completion.THRUST_UNITS)}; that in the column's name if not given.",
            autocompletion=completion.thrust_units,
            show_default=False,
        ),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Make a thrust curve from bench readings."""
    from rovid.campaign.tables import CURVE_COLUMNS, curve_text, read_table
    from rovid.ground.files import Claim, Output
    from rovid.ground.files.form import CURVE
    from rovid.identify.bench import THRUST_UNITS, bench_readings, fit_bench
    from rovid.show.documents import bench_document
    from rovid.show.terminal import show_bench

    if unit is not None and unit not in THRUST_UNITS:
        raise ConfigError(f"is {unit!r}; one of {', '.join(THRUST_UNITS)} was expected.", where="--unit")
    target = output or Path(f"{bench.stem}_curve.csv")
    curve = Output(target, CURVE)
    claim = Claim([curve], force=force, protected=[bench])
    readings = bench_readings(read_table(bench, headerless=CURVE_COLUMNS), command=command, thrust=thrust, unit=unit)
    result = fit_bench(*readings)
    claim.write({curve: curve_text(result.curve.command, result.curve.thrust)})
    if json:
        _print_json(bench_document(result, str(target)))
    else:
        show_bench(_console(), result, target)


@_command
def simulate(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    cutoff: Cutoff = None,
    mcap: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT",
            help="Write measurement, simulation and what is left over as MCAP: a file for one run, else a folder.",
            show_default=False,
        ),
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Simulate the runs and compare with the logs."""
    from rovid.model.simulation import simulate_runs
    from rovid.report.recordings import recording_outputs, write_recordings
    from rovid.show.documents import simulation_document
    from rovid.show.terminal import show_simulation, show_warnings

    stored = _known(parameters, axis)
    model = stored.model()
    study = _open(logs or _remembered(stored), cutoff, stored.axis)
    if study.campaign is None or study.runs is None:
        raise DataError("are tables; only logs can be simulated.", where="LOGS", mend="Give LOGS.")
    study.require(model.effects)
    outputs = recording_outputs(mcap, [run.trial for run in study.runs.items]) if mcap else []
    claim = _claim(outputs, study.paths, stored.path, force=force)
    with _busy("Simulating …"):
        simulations = simulate_runs(study.runs.items, model, study.vehicle)
        if outputs:
            write_recordings(claim, outputs, simulations, study.runs, model, study.vehicle)
    recordings = [output.path for output in outputs]
    warnings = [*study.remarks(), *stored.changed_sources(study.campaign)]
    if json:
        _print_json(simulation_document(stored, simulations, warnings) | {"recordings": list(map(str, recordings))})
    else:
        show_simulation(_console(), simulations)
        show_warnings(_console(), warnings)


@_command
def plan(
    logs: OptionalLogs = None,
    *,
    between: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ID",
            help="Tell the effect with this id from another; to be given twice.",
            autocompletion=completion.effects,
            show_default=False,
        ),
    ] = None,
    narrow: Annotated[
        str | None,
        typer.Option(
            metavar="PARAMETER",
            help="Make this parameter surer, as linear_drag; the least sure one if not given.",
            autocompletion=completion.parameters,
            show_default=False,
        ),
    ] = None,
    share: Annotated[
        float,
        typer.Option(
            metavar="SHARE", min=0.05, max=1.0, help="Largest command, as a share of the largest in the logs."
        ),
    ] = 1.0,
    minutes: Annotated[float, typer.Option(metavar="MINUTES", min=0.1, help="Longest run, in minutes.")] = 10.0,
    max_rate: Annotated[
        float | None,
        typer.Option(
            metavar="RATE",
            help="Fastest turn, in deg/s; fastest motion, in m/s, along surge, sway and heave. No limit if not given.",
            show_default=False,
        ),
    ] = None,
    turns: Annotated[
        float | None,
        typer.Option(
            metavar="TURNS",
            help="Farthest around, in turns; farthest away, in m, along surge, sway and heave. No limit if not given.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="Where the command file goes.")] = Path(
        "plan.csv"
    ),
    axis: AxisName = None,
    parameters: ParameterFile = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Design the run to make next."""
    import math

    from rovid.effects import effect_named
    from rovid.ground.files import Output
    from rovid.ground.files.form import PLAN, png_form
    from rovid.plan.design import command_text
    from rovid.plan.programme import Limits
    from rovid.report.plots.planned import picture
    from rovid.show.documents import plan_document
    from rovid.show.terminal import show_plan

    rivals = tuple(effect_named(name) for name in between or ())
    if len({rival.id for rival in rivals}) not in {0, 2} or len(rivals) > 2:
        raise ConfigError(f"names {len(rivals)} causes; two different ones were expected.", where="--between")
    stored = _stored(parameters, axis)
    paths = logs or _remembered(stored)
    drawn = output.with_suffix(".png")
    commands, drawing = Output(output, PLAN), Output(drawn, png_form("plan"))
    claim = _claim([commands, drawing], paths, stored.path, force=force)
    study = _open(paths, None, stored.axis)
    factor = math.pi / 180.0 if stored.axis.angular else 1.0
    limits = Limits(
        share=share,
        seconds=60.0 * minutes,
        rate=math.inf if max_rate is None else factor * max_rate,
        travel=math.inf if turns is None else turns,
    )
    with _busy("Fitting, and trying runs …"):
        found = study.plan(tuple(effect_named(name) for name in stored.effects), rivals, limits, narrow or "")
    claim.write({commands: command_text(found), drawing: picture(found, stored.axis)})
    if json:
        _print_json(plan_document(found, stored.axis, str(output), str(drawn)))
    else:
        show_plan(_console(), found, [output, drawn])


@_command
def control(
    logs: OptionalLogs = None,
    *,
    kp: Annotated[
        float | None,
        typer.Option(metavar="GAIN", help="Gain on heading, in N m/rad; together with --kd.", show_default=False),
    ] = None,
    kd: Annotated[
        float | None,
        typer.Option(metavar="GAIN", help="Gain on yaw rate, in N m s/rad; together with --kp.", show_default=False),
    ] = None,
    damping: Annotated[
        float, typer.Option(metavar="RATIO", help="Damping ratio of the gains, where --kp and --kd do not say them.")
    ] = 0.7,
    bandwidth: Annotated[
        float | None,
        typer.Option(
            metavar="RAD/S",
            help="Natural frequency of the gains, in rad/s. If not given the largest with a phase margin of 45 deg, a "
            "sensitivity peak of 1.6 and room for twice the delay there is, that noise and actuators allow.",
            show_default=False,
        ),
    ] = None,
    period: Annotated[
        float, typer.Option(metavar="S", help="Time from one command of the controller to the next, in s.")
    ] = 0.1,
    delay: Annotated[
        float, typer.Option(metavar="S", help="Time from a heading to the command that it leads to, in s.")
    ] = 0.0,
    rate_filter: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Time constant of the low pass of the rate, in s; chosen if not given.",
            show_default=False,
        ),
    ] = None,
    step: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FROM:TO", help="A further run, headings in deg, as 350:40; may be given again.", show_default=False
        ),
    ] = None,
    c: Annotated[
        Path | None,
        typer.Option("--c", metavar="FILE", help="Write the controller as C into this file.", show_default=False),
    ] = None,
    python: Annotated[
        Path | None,
        typer.Option("--python", metavar="FILE", help="Write it as Python into this file.", show_default=False),
    ] = None,
    parameters: ParameterFile = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Design a heading controller."""
    from rovid.control.design import Options, control_of, setting_of
    from rovid.control.generate import c_source, python_source
    from rovid.ground.files import Output
    from rovid.ground.files.form import C_SOURCE, PYTHON_SOURCE
    from rovid.show.account import show_control
    from rovid.show.documents import control_document
    from rovid.show.terminal import show_warnings

    options = Options(
        kp=kp,
        kd=kd,
        damping=damping,
        bandwidth=bandwidth,
        period=period,
        delay=delay,
        rate_filter=rate_filter,
        steps=tuple(step or ()),
    )
    stored = _of_yaw(_known(parameters))
    model = stored.model()
    paths = logs or _remembered(stored)
    makers = {
        Output(path, form): source
        for path, form, source in ((c, C_SOURCE, c_source), (python, PYTHON_SOURCE, python_source))
        if path is not None
    }
    claim = _claim(list(makers), paths, stored.path, force=force)
    study = _open(paths, None, stored.axis)
    study.require(model.effects)
    setting = setting_of(options, model, study.position_noise(), study.torque_in_use())
    with _busy("Closing the loop …"):
        result = control_of(stored, study.vehicle, setting, options)
    if makers:
        claim.write({output: source(result.law) for output, source in makers.items()})
    warnings = [*study.remarks(), *(stored.changed_sources(study.campaign) if study.campaign else ())]
    if json:
        _print_json(control_document(result, warnings))
    else:
        show_control(_console(), result)
        show_warnings(_console(), warnings)


@_command
def export(
    format: Annotated[  # noqa: A002 - the word that the help shows
        str,
        typer.Argument(
            metavar="FORMAT",
            help=f"One of {', '.join(completion.FORMATS)}.",
            autocompletion=completion.formats,
        ),
    ],
    *,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Where it goes; gz_sim.sdf and the like if not given. uuv writes .xacro or .yaml.",
            show_default=False,
        ),
    ] = None,
    parameters: ParameterFile = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write the model in the format of a simulator."""
    from rovid.export import export as make
    from rovid.export import exporter, subject_of
    from rovid.show.documents import export_document
    from rovid.show.terminal import show_export

    function, target = exporter(format, output)
    stored = _of_yaw(_known(parameters))
    stored.model()
    claim = _claim([target], stored.logs, stored.path, force=force)
    there = bool(stored.logs) and all(path.exists() for path in stored.logs)
    study = _open(stored.logs, None, stored.axis) if there else None
    with _busy("Simulating …"):
        made = make(function, subject_of(stored, study))
    claim.write({target: made.content})
    if json:
        _print_json(export_document(format, str(target.path), made))
    else:
        show_export(_console(), target.path, made)


@_command
def report(
    logs: OptionalLogs = None,
    *,
    axis: AxisName = None,
    parameters: ParameterFile = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FOLDER",
            help="Where page and plots go; report if not given, report_AXIS for another axis than yaw.",
            show_default=False,
        ),
    ] = None,
    diagnosis: Annotated[
        bool, typer.Option("--diagnosis/--no-diagnosis", help="With or without what the simulation misses, and why.")
    ] = True,
    control: Annotated[
        bool, typer.Option("--control/--no-control", help="With or without a heading controller.")
    ] = True,
    export: Annotated[
        bool, typer.Option("--export/--no-export", help="With or without what each simulator's format holds.")
    ] = True,
    cutoff: Cutoff = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Write everything on one page."""
    from rovid.campaign.axis import YAW
    from rovid.report.build import build_report
    from rovid.show.documents import axis_document

    stored = _stored(parameters, axis, force=force)
    study = _open(logs or _remembered(stored), cutoff, stored.axis)
    folder = output or Path("report" if stored.axis is YAW else f"report_{stored.axis.name}")
    with _working("Fitting drag and inertia …") as report_progress:
        page = build_report(
            stored,
            study,
            folder,
            diagnosed=diagnosis,
            controlled=control,
            exported=export,
            force=force,
            report=report_progress,
        )
    if json:
        _print_json(
            {
                "schema": "rovid-report/1",
                **axis_document(stored.axis),
                "page": str(page),
                "parameters": str(stored.path),
            }
        )
    else:
        _console().print(str(page), highlight=False, soft_wrap=True)


def _claim(outputs: Sequence[Output], logs: Sequence[Path], *read: Path, force: bool) -> Claim:
    """Leave to write ``outputs``, but never over ``read`` or what is where the logs are."""
    from rovid.ground.files import Claim
    from rovid.study import files_at_hand

    return Claim(outputs, force=force, protected=[*files_at_hand(logs), *read])


def _compared(stored: Parameters, study: Study, estimate: Estimate) -> Estimate:
    """``estimate``, with a warning where another method said another thing of the same logs."""
    from rovid.parameters.agreement import disagreement

    apart = disagreement(stored.entries_of(study.paths), estimate)
    return replace(estimate, warnings=(*estimate.warnings, *apart))


def _put(stored: Parameters, claim: Claim, study: Study, estimate: Estimate, *, new_logs: bool) -> Parameters:
    """Put an estimate into the parameter file, and the logs that it is of where they are new to the file."""

    def change(now: Parameters) -> Parameters:
        if new_logs:
            now = now.with_logs(study.paths, study.vehicle.name, study.campaign)
        return now.with_estimate(estimate)

    return stored.update(claim, change)


def _fit_inertia(study: Study, stored: Parameters, claim: Claim, *, new_logs: bool, json: bool) -> None:
    from rovid.show.documents import inertia_document
    from rovid.show.terminal import show_fit, show_inertia

    with _busy("Fitting inertia …"):
        result = study.inertia(stored.drag())
    result = replace(result, estimate=_compared(stored, study, result.estimate))
    stored = _put(stored, claim, study, result.estimate, new_logs=new_logs)
    if json:
        _print_json(inertia_document(result, study))
    else:
        show_fit(_console(), result, show_inertia, study, stored)


def _open(paths: Sequence[Path], cutoff: float | None, axis: Axis) -> Study:
    from rovid.study import open_study

    _announce_compilation()
    return open_study(paths, cutoff=cutoff, axis=axis)


@contextmanager
def _working(text: str) -> Iterator[Callable[[str], None]]:
    """As ``_busy``, with a function that changes the text."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rovid.ground.screen import Screen

    screen = Screen(stderr=True)
    with screen.status(text) as status:
        yield lambda words: status.update(screen.render_str(words))


@contextmanager
def _busy(text: str) -> Iterator[None]:
    """Show a person that work goes on; nothing where nobody watches."""
    if not sys.stderr.isatty():
        yield
        return
    from rovid.ground.screen import Screen

    with Screen(stderr=True).status(text):
        yield


def _stored(path: Path | None, axis: str | None, *, force: bool = False) -> Parameters:
    """The parameter file that is there, or an empty one; where forced, in place of anything else."""
    from rovid.campaign.axis import YAW, axis_named
    from rovid.ground.files.form import PARAMETERS
    from rovid.parameters.parameters import Parameters

    where = _parameter_file(path, axis)
    if where.exists() and not (force and where.is_file() and not PARAMETERS.marks(where)):
        return _known(where, axis)
    return Parameters(path=where, axis=axis_named(axis) if axis else YAW)


def _known(path: Path | None, axis: str | None = None) -> Parameters:
    """The parameter file, which has to be there and of this axis."""
    from rovid.parameters.parameters import read_parameters

    stored = read_parameters(_parameter_file(path, axis))
    if axis and stored.axis.name != axis:
        raise ConfigError(
            f"holds the parameters of {stored.axis.name}, and --axis says {axis}.",
            where=stored.path,
            mend="Give another file with -p.",
        )
    return stored


def _parameter_file(path: Path | None, axis: str | None) -> Path:
    from rovid.campaign.axis import YAW, axis_named

    known = axis_named(axis) if axis else YAW
    return path or Path(completion.parameter_file(known.name))


def _of_yaw(stored: Parameters) -> Parameters:
    from rovid.campaign.axis import YAW

    if stored.axis is not YAW:
        raise ConfigError(
            f"holds the parameters of {stored.axis.name}; those of yaw were expected.",
            where=stored.path,
            mend="Give the file of yaw with -p.",
        )
    return stored


def _remembered(stored: Parameters) -> list[Path]:
    if not stored.logs:
        raise ConfigError(
            "remembers no logs."
            if stored.path.exists()
            else "there is no such parameter file, and no logs were given.",
            where=stored.path,
            mend="Give LOGS, or run `rovid fit-drag LOGS` first.",
        )
    return list(stored.logs)


def _announce_compilation() -> None:
    """Say why the first run on a machine takes some seconds longer."""
    if not sys.stderr.isatty():
        return
    from rovid.model.kernels import is_compiled

    if not is_compiled():
        sys.stderr.write("Compiling the simulation for this machine, once …\n")


def _print_json(document: Any) -> None:
    from rovid.ground.numbers import to_json

    typer.echo(to_json(document))


def _console() -> Console:
    from rovid.ground.screen import Screen

    # A pipe has no width; rich would fold tables at 80 columns.
    return Screen(width=None if sys.stdout.isatty() else 160)
