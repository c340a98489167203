"""``rovid check``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rovid.cli.context import announce_compilation, console, print_json
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Json, Logs
from rovid.core.errors import DataError

if TYPE_CHECKING:
    from rovid.preflight.check import LogCheck

PAGE = Page(
    text="""
    Reads rovid.toml and every log. Says first whether to go: go, go with care, no go; then the three things to do
    first, what each log holds, and whatever else there is to say: runs that are missing for a fit, feedback by an
    autopilot or a hand, clocks that differ, a drive at its end, gaps. Writes nothing.

    Use it before a fit, best while the vehicle is still in the water. A log that cannot be used ends it with exit
    status 2, after all logs have been looked at.
    """,
    examples=(
        ("All logs of a folder", "rovid check my_logs"),
        ("For motion along surge instead of yaw", "rovid check surge_logs --axis surge"),
        ("One log, as JSON for a program", "rovid check my_logs/steps.mcap --json"),
    ),
    see=("rovid init", "rovid fit-drag", "rovid plan"),
)


def check(logs: Logs, *, axis: AxisName = None, json: Json = False) -> None:
    """Say what is in the logs, and what is wrong."""
    from rovid.preflight.check import check_logs
    from rovid.present.console import show_caution
    from rovid.present.documents.results import check_document
    from rovid.present.terminal.check import show_check
    from rovid.trial.axis import YAW, axis_named
    from rovid.trial.config import find_config, load_config

    announce_compilation()
    config = load_config(find_config(logs), axis_named(axis) if axis else YAW)
    checked = check_logs(logs, config)
    if json:
        print_json(check_document(checked, config.vehicle))
    else:
        show_caution(console(), config.vehicle.assumptions)
        show_check(console(), checked)
    if checked.problems:
        raise DataError(_first_problem(checked))


def _first_problem(checked: LogCheck) -> str:
    name, problem = next(iter(checked.problems.items()))
    if name not in problem:
        return f"{name}: {problem}"
    bad = len(checked.problems)
    return f"{bad} of {bad + len(checked.rows)} logs cannot be used. {problem}"
