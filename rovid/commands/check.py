"""``rovid check``."""

from __future__ import annotations

from rovid.commands.manual import Page
from rovid.commands.options import AxisName, Json, Logs
from rovid.commands.session import announce_compilation, console, print_json
from rovid.ground.errors import DataError

PAGE = Page(
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
)


def check(logs: Logs, *, axis: AxisName = None, json: Json = False) -> None:
    """Say what is in the logs, and what is wrong."""
    from rovid.campaign.axis import YAW, axis_named
    from rovid.campaign.config import find_config, load_config
    from rovid.inspect.check import check_logs
    from rovid.show.documents import check_document
    from rovid.show.terminal import show_advice, show_check, show_warnings

    announce_compilation()
    config = load_config(find_config(logs), axis_named(axis) if axis else YAW)
    checked = check_logs(logs, config)
    if json:
        print_json(check_document(config.axis, checked.rows, checked.problems, checked.remarks, checked.advice))
    else:
        show_check(console(), checked.rows, checked.problems)
        show_warnings(console(), [remark.text for remark in checked.remarks])
        if checked.rows:
            show_advice(console(), checked.advice)
    if checked.problems:
        name, problem = next(iter(checked.problems.items()))
        raise DataError(
            f"{len(checked.problems)} of {len(checked.problems) + len(checked.rows)} logs cannot be used. {problem}"
            if name in problem
            else f"{name}: {problem}"
        )
