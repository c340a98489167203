"""The manual: what each command reads and writes, when to use it, and examples; set as plain text."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from typer.core import TyperCommand, TyperGroup

_EXIT = """\
Exit status:
  0  Done.
  2  The input cannot be used. One message says where, what was found, what
     was wanted and how to mend it."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """One command's page, but for what it does in a line, which is the docstring of its function.

    Attributes
    ----------
    text
        What it reads, what it writes, when to use it; paragraphs.
    examples
        (what for, command line); see ``tests/test_help.py``, which runs them.
    see
        Related commands and pages.
    """

    text: str
    examples: tuple[tuple[str, str], ...]
    see: tuple[str, ...]

    @property
    def epilog(self) -> str:
        """Examples, exit status and related commands, as they are to be printed."""
        examples = "\n\n".join(f"  # {what}\n  {line}" for what, line in self.examples)
        return f"Examples:\n{examples}\n\n{_EXIT}\n\nSee also:\n  {', '.join(self.see)}"


class ManualCommand(TyperCommand):
    """A command whose help looks like a page of a manual: `LOGS...` for names, the epilog printed as it stands."""

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: D102 - typer's
        # Some versions of typer put names that are required into braces.
        return [piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: D102 - typer's
        own: list[Any] = list(self.get_params(ctx))
        arguments = [(one.metavar or one.name, one.help or "") for one in own if _is_argument(one)]
        options = [one.get_help_record(ctx) for one in own if not _is_argument(one)]
        for heading, rows in (("Arguments", arguments), ("Options", options)):
            with formatter.section(heading):
                formatter.write_dl([row for row in rows if row])

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002, D102 - typer's
        formatter.write(f"\n{self.epilog}\n")


class ManualGroup(TyperGroup):
    """All commands; the epilog printed as it stands."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002, D102 - typer's
        formatter.write(f"\n{self.epilog}\n")


def _is_argument(parameter: Any) -> bool:
    # Some versions of typer bring a click of their own: its classes are not everybody's.
    return bool(parameter.param_type_name == "argument")


FIRST_SESSION = """\
A first session, with the sample logs of the source folder:
  rovid check sample_logs/rosub_tank
  rovid fit-drag sample_logs/rosub_tank
  rovid fit-inertia
  rovid diagnose
  rovid report

Your own logs begin with `rovid init LOGS`. `rovid COMMAND --help` explains a
command, with examples. `rovid --install-completion` makes the Tab key complete
commands, options, effects, axes and formats."""

MANUAL: Mapping[str, Page] = {
    "init": Page(
        text="""
        Reads the logs and guesses which column or topic is the heading, which are thruster commands, in what unit and
        of what sense. Writes rovid.toml beside the logs, each guess with its reason as a comment; where there is no
        thrust curve also thrust_guess.csv, whose scale is a guess.

        Use it first, on a new folder of logs. Then read rovid.toml: mass, length, width and the lever arms of the
        thrusters have to be yours before any number can be believed.
        """,
        examples=(
            ("A first my_logs/rovid.toml", "rovid init my_logs"),
            ("Once more, from one log alone, over the one that is there", "rovid init my_logs/hold_01.csv --force"),
        ),
        see=("rovid check", "docs/logs.md (formats)", "docs/axes.md (rovid.toml)"),
    ),
    "check": Page(
        text="""
        Reads rovid.toml and every log. Prints each log's length, sampling rate, noise, gaps, held commands and sines;
        what is wrong with it; whether an autopilot was on or a drive at its end; and which runs are missing for a
        fit. Writes nothing.

        Use it before a fit, best while the vehicle is still in the water. A log that cannot be used ends it with exit
        status 2, after all logs have been looked at.
        """,
        examples=(
            ("All logs of a folder", "rovid check sample_logs/rosub_tank"),
            ("For motion along surge instead of yaw", "rovid check sample_logs/surge_tank --axis surge"),
            ("One log, as JSON for a program", "rovid check sample_logs/rosub_tank/steps.mcap --json"),
        ),
        see=("rovid init", "rovid fit-drag", "rovid plan"),
    ),
    "convert": Page(
        text="""
        Reads one log as rovid.toml beside it says and writes it as CSV, MCAP or Parquet, by the suffix of the output.
        Angles, rates and times are converted to the units that the new names say; commands keep theirs. Prints the
        lines of rovid.toml that read the new file.

        Use it to look at a log with other tools, or to pass a trial on without its recorder's format.
        """,
        examples=(
            ("An ArduPilot log as CSV", "rovid convert sample_logs/bluerov2_dataflash/dive.BIN -o dive.csv"),
            ("An MCAP recording as CSV", "rovid convert sample_logs/rosub_tank/steps.mcap -o steps.csv"),
            ("A CSV log as MCAP, for Foxglove", "rovid convert sample_logs/rosub_tank/hold_01.csv -o hold_01.mcap"),
        ),
        see=("rovid init", "rovid simulate --mcap", "docs/logs.md"),
    ),
    "fit-drag": Page(
        text="""
        Reads logs with held commands, or a table of steady turns with the columns command, yaw_rate_rad_s and
        torque_Nm. Fits T = DQ |r| r + DL r and writes quadratic_drag (N m s^2/rad^2) and linear_drag (N m s/rad), with
        standard errors, to the parameter file, which from then on remembers the logs: later commands need no LOGS.

        Use it first of the fits. It wants four levels or more, both ways, each held for five time constants and a
        minute. Roll and pitch have no steady turns; there it finds inertia and drag together.
        """,
        examples=(
            ("Drag in yaw, into parameters.toml", "rovid fit-drag sample_logs/rosub_tank"),
            (
                "From a table of steady turns, into another file",
                "rovid fit-drag sample_logs/rosub_paper/table3.csv -p paper.toml",
            ),
            ("Drag in surge, into parameters_surge.toml", "rovid fit-drag sample_logs/surge_tank --axis surge"),
        ),
        see=("rovid check", "rovid fit-inertia", "rovid fit"),
    ),
    "fit-inertia": Page(
        text="""
        Reads logs with sines, or with any changing command, or a table of sine trials with the columns period_s,
        torque_amplitude_Nm and peak_yaw_rate_rad_s; and the drag of the parameter file, if it is there. Prints the
        inertia by the orbit integral, harmonic balance, regression and the peak method side by side, says which one
        it took, and writes that to the parameter file (kg m^2, or kg along surge, sway and heave), with added inertia
        printed beside it.

        Use it after fit-drag. Where the methods differ by more than their errors, the model misses something: run
        diagnose.
        """,
        examples=(
            ("With the logs that fit-drag remembered", "rovid fit-inertia"),
            (
                "From a table of sine trials, with the drag in paper.toml",
                "rovid fit-inertia sample_logs/rosub_paper/sine_trials.csv -p paper.toml",
            ),
            ("With a filter of 1 Hz in place of the one chosen", "rovid fit-inertia --cutoff 1"),
        ),
        see=("rovid fit-drag", "rovid fit", "rovid simulate"),
    ),
    "fit": Page(
        text="""
        Reads logs of any kind and fits inertia, drag, the disturbance and the noise at once by maximum likelihood of
        the Kalman filter's innovations. Writes all parameters, with their covariance, to the parameter file. --effect
        puts a physical effect into the model and fits its parameters with the rest; without it, effects that the file
        held are dropped.

        Use it for the sharpest numbers, and always where an autopilot was on: under feedback the simple methods are
        biased. To find out which effect is missing use diagnose.
        """,
        examples=(
            ("Everything from the logs that fit-drag remembered", "rovid fit"),
            ("With an effect in the model", "rovid fit --effect thruster_lag"),
            (
                "With one form of an effect, and one more effect",
                "rovid fit --effect thruster_lag:rotor --effect bias_torque",
            ),
            ("A real dive with its autopilot on", "rovid fit sample_logs/bluerov2_pier59/dive.csv -p dive.toml"),
        ),
        see=("rovid diagnose", "rovid simulate", "docs/effects (all effects)"),
    ),
    "diagnose": Page(
        text="""
        Reads the logs, fits the plain model, and tries every effect of the catalogue on what it misses. Prints what
        the simulation gets wrong; the cause by name, with its parameters, the evidence and its rivals; by how much
        runs that were not fitted are predicted better; what is left unexplained; what the data cannot determine; and
        which run to do next. Writes the model that it ends with to the parameter file.

        Use it after fit-drag and fit-inertia, or at once. It is the slowest command: ten seconds to minutes, by the
        length of the logs. Four trials or more let it test on whole trials.
        """,
        examples=(
            ("What the model misses, with the logs that fit-drag remembered", "rovid diagnose"),
            ("At once, on a folder of logs, into another file", "rovid diagnose sample_logs/rosub_tank -p tank.toml"),
            ("Along surge", "rovid diagnose sample_logs/surge_tank --axis surge"),
            ("What the published tables contradict", "rovid diagnose sample_logs/rosub_paper -p paper.toml"),
        ),
        see=("rovid fit --effect", "rovid plan", "rovid report", "docs/confusion.md"),
    ),
    "fit-thruster": Page(
        text="""
        Reads a CSV of bench readings: a column of command and one of thrust, found by their names, or the first two
        where there is no header. Fits a curve that only rises and keeps its dead zone, and writes it with the columns
        command,thrust_N, ready for rovid.toml. The command keeps its unit.

        Use it where the bench gave scattered readings rather than a curve.
        """,
        examples=(
            (
                "Readings without a header, in newtons",
                "rovid fit-thruster sample_logs/thruster_bench/kaxan_540.csv --unit N",
            ),
            (
                "A maker's table, into a named file",
                "rovid fit-thruster sample_logs/bluerov2_pier59/t200_16V_bench.csv -o t200.csv",
            ),
        ),
        see=("rovid init", "rovid check"),
    ),
    "simulate": Page(
        text="""
        Reads the parameter file and the logs. Simulates each run freely from its first sample, by the logged commands
        alone, and prints R^2, fit % and root mean square error of the rate, and the error of the heading after 10 s
        and 60 s. --mcap writes measurement, simulation and what is left over as recordings.

        Use it to judge a model: a free simulation hides nothing. Give LOGS that the fit never saw for an honest test.
        """,
        examples=(
            ("Against the logs that the parameters came from", "rovid simulate"),
            (
                "Against one log, with a recording of it",
                "rovid simulate sample_logs/rosub_tank/steps.mcap --mcap simulated.mcap",
            ),
            ("With recordings of all runs, in a folder", "rovid simulate --mcap simulated"),
        ),
        see=("rovid diagnose", "rovid report", "docs/logs.md"),
    ),
    "plan": Page(
        text="""
        Reads the parameter file and the logs, fits them, and ranks runs that a crew can play by what each is expected
        to tell for a minute in the water. Writes the best as a command file (time_s and a column for each thruster;
        each row holds until the next) and, beside it, a picture of what each cause predicts.

        Use --between where diagnose left two causes open; otherwise the run makes a parameter surer. Does not write
        the parameter file.
        """,
        examples=(
            ("Which run tells a lag from a delay?", "rovid plan --between thruster_lag --between command_delay"),
            (
                "A run for one parameter, 5 minutes and 2 turns at most",
                "rovid plan --narrow linear_drag --minutes 5 --turns 2",
            ),
            ("At 60 % of the commands, no faster than 10 deg/s", "rovid plan --share 0.6 --max-rate 10 -o next.csv"),
        ),
        see=("rovid diagnose", "rovid check", "docs/plan.md"),
    ),
    "control": Page(
        text="""
        Reads the parameter file, and the logs if they are there for noise and the torque in use. Designs a model-aided
        PD controller of heading: drag and inertia from the model, PD on heading and yaw rate. Prints gains, margins
        with the spread that the parameters' uncertainty leaves, and closed-loop runs with and without every effect
        that the file holds. --c and --python write the controller as source.

        Use it for gains, or to judge your own. The damping ratio is that of the identified yaw inertia. Yaw alone.
        """,
        examples=(
            ("Gains, margins and runs for the identified vehicle", "rovid control"),
            ("Judge gains of your own, with a step from 0 to 45 deg", "rovid control --kp 100 --kd 710 --step 0:45"),
            ("For a controller at 5 Hz behind 0.3 s of delay", "rovid control --period 0.2 --delay 0.3"),
            ("As source", "rovid control --c heading.c --python heading.py"),
        ),
        see=("rovid fit", "rovid export", "docs/control.md"),
    ),
    "export": Page(
        text="""
        Reads the parameter file and writes the model in a simulator's own format. Then it puts the numbers of the file
        into that simulator's equation, with its signs and time step, runs it beside rovid's model, and prints the
        largest difference of the yaw rate in percent of its range. What the format cannot hold is listed with its
        size. Yaw alone.

        Thrusters and the largest rate come from the logs that the parameter file remembers, where they are there.
        """,
        examples=(
            ("For Gazebo", "rovid export gz-sim -o model.sdf"),
            ("For uuv_simulator, as YAML", "rovid export uuv -o uuv.yaml"),
            ("As JSON, from another parameter file", "rovid export json -p paper.toml -o paper.json"),
        ),
        see=("rovid fit", "rovid control", "docs/export.md"),
    ),
    "report": Page(
        text="""
        Reads the logs and the parameter file; drag and inertia that the file does not hold yet are fitted and written
        to it. Writes a folder with index.html, which needs no other file and no network, and the plots as PNG and SVG:
        verdict, parameters, every trial to zoom in, diagnosis, controller and exports. Prints where the page is.

        Use it last, or at once on a new folder of logs. The diagnosis takes most of the time; unlike that of rovid
        diagnose, it leaves the parameter file as it is.
        """,
        examples=(
            ("With the logs that fit-drag remembered, into report/", "rovid report"),
            ("At once, on a folder of logs", "rovid report sample_logs/rosub_tank -p tank.toml -o tank_report"),
            ("Quickly: fits and simulation alone", "rovid report --no-diagnosis --no-control --no-export"),
        ),
        see=("rovid diagnose", "rovid control", "rovid export"),
    ),
}
