"""``rovid check``."""

from __future__ import annotations

from rovid.cli.context import announce_compilation, console, named_axis, print_json
from rovid.cli.help_format import Page
from rovid.cli.options import AxisName, Json, Logs
from rovid.core.errors import DataError

PAGE = Page(
    text="""
    Reads rovid.toml and every log. Prints the verdict first (go, go with care, no go), then the three most important
    actions, the content of each log, and further remarks: runs that a fit still needs, feedback by an autopilot or a
    pilot, clock offsets, saturated thrusters, gaps. Writes nothing.

    Use it before a fit, best while the vehicle is still in the water. If a log cannot be used, the command checks all
    other logs and ends with exit status 2.
    """,
    examples=(
        ("All logs of a folder", "rovid check my_logs"),
        ("Motion along surge instead of yaw", "rovid check surge_logs --axis surge"),
        ("One log, as JSON for a program", "rovid check my_logs/steps.mcap --json"),
    ),
    see=("rovid init", "rovid fit-drag", "rovid plan"),
)


def check(logs: Logs, *, axis: AxisName = None, json: Json = False) -> None:
    """Check the logs and list their content and problems."""
    from rovid.preflight.check import check_logs
    from rovid.present.console import show_caution
    from rovid.present.documents.results import check_document
    from rovid.present.terminal.check import show_check
    from rovid.trial.config import find_config, load_config

    announce_compilation()
    config = load_config(find_config(logs), named_axis(axis))
    checked = check_logs(logs, config)
    if json:
        print_json(check_document(checked, config.vehicle))
    else:
        show_caution(console(), config.vehicle.assumptions)
        show_check(console(), checked)
    if checked.problems:
        name, problem = next(iter(checked.problems.items()))
        bad = len(checked.problems)
        lead = f"{bad} of {bad + len(checked.rows)} logs cannot be used. " if name in problem else f"{name}: "
        raise DataError(f"{lead}{problem}")
