"""The result of `rovid check` on a terminal: the verdict, what to do first, and what each log holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rich.console import Console

from rovid.preflight.advice import shortened_list
from rovid.preflight.check import LogCheck
from rovid.present.console import print_labelled, print_text, show_warnings
from rovid.present.number_format import format_number
from rovid.present.tables.table import ResultTable, mixed_number_column, text_column
from rovid.trial.trial import merged_remarks

# Number of tasks before the tables.
_FIRST_TASKS = 3
VERDICTS = {
    "go": ("Go:", "These logs have what a fit needs.", "bold green"),
    "care": ("Go with care:", "These logs can be fitted; read this first.", "bold yellow"),
    "no_go": ("No go:", "A fit would fail, or be wrong. First of all:", "bold red"),
}
_DIRECTIONS = {1: "as rovid.toml says", -1: "the other way", 0: "not determined"}


def show_check(console: Console, checked: LogCheck) -> None:
    """Print the verdict, the first tasks, the logs, and then all other tasks and notes."""
    print_labelled(console, *VERDICTS[checked.verdict])
    tasks = list(check_tasks(checked))
    _show_tasks(console, tasks[:_FIRST_TASKS], 1)
    console.print()
    if checked.rows:
        console.print(_logs_table(checked))
        if any(thruster.observed.direction for thruster in checked.thrusters):
            console.print(_thrusters_table(checked))
    reasons = _names_by_reason(checked.problems)
    if len(reasons) > 1:
        show_warnings(console, [_problem(names, reason) for reason, names in reasons.items()])
    _show_tasks(console, tasks[_FIRST_TASKS:], _FIRST_TASKS + 1)
    show_warnings(console, check_notes(checked))


def check_notes(checked: LogCheck) -> list[str]:
    """Advice that asks for no action, and the remarks of the readers."""
    asides = [advice.text for advice in checked.advice if advice.weight == "aside"]
    noticed = merged_remarks([trial for trial, _ in checked.rows])
    return [*asides, *noticed, *(remark.text for remark in checked.remarks)]


def check_tasks(checked: LogCheck) -> Iterator[str]:
    """Tasks before a fit, the most serious first."""
    reasons, bad = _names_by_reason(checked.problems), len(checked.problems)
    count = f"{bad} of {bad + len(checked.rows)} logs cannot be used"
    if len(reasons) == 1:
        ((reason, names),) = reasons.items()
        problem = _problem(names, reason)
        yield f"{count}. {problem}" if bad > 1 else problem
    elif reasons:
        yield f"{count}, for the reasons below: {shortened_list(list(checked.problems))}."
    yield from (advice.text for advice in checked.advice if advice.weight != "aside")


def _names_by_reason(problems: Mapping[str, str]) -> dict[str, list[str]]:
    """Reason why logs cannot be used -> names of these logs."""
    names: dict[str, list[str]] = {}
    for name, problem in problems.items():
        names.setdefault(problem.rpartition(f"{name}: ")[2], []).append(name)
    return names


def _problem(names: Sequence[str], reason: str) -> str:
    # The reason itself may name the log and the line.
    return reason if any(name in reason for name in names) else f"{shortened_list(names)}: {reason}"


def _show_tasks(console: Console, tasks: Sequence[str], first: int) -> None:
    for number, task in enumerate(tasks, first):
        print_text(console, f"{number}. {task}", len(f"{number}. "))


def _thrusters_table(checked: LogCheck) -> ResultTable:
    """Direction of each thruster as the logs show it."""
    verb = checked.rows[0][0].axis.motion_verb
    columns = mixed_number_column("standard errors"), mixed_number_column("share %")
    table = ResultTable("Thrusters, by these logs alone", text_column("thruster"), text_column(verb), *columns)
    for thruster in checked.thrusters:
        observed = thruster.observed
        share = 100.0 * max(observed.explained_share, 0.0)
        direction = _DIRECTIONS[observed.direction]
        table.add_row(thruster.name, direction, f"{abs(observed.t_statistic):.0f}", f"{share:.0f}")
    return table


def _logs_table(checked: LogCheck) -> ResultTable:
    """Length, motion, noise and remarks of each log."""
    first, _ = checked.rows[0]
    _, unit, factor = first.axis.measured_quantity(integrated=first.rate_only)
    shown_unit, shown_factor = first.axis.display_unit
    travel = f"{'turned' if first.axis.angular else 'went'} {shown_unit}"
    titles = ("s", "held", "sines", "Hz", f"noise {unit}", travel, "samples")
    table = ResultTable("Logs", text_column("log"), *map(mixed_number_column, titles), text_column("remarks"))
    for trial, facts in checked.rows:
        table.add_row(
            trial.name,
            f"{trial.duration:.0f}",
            str(facts["held_commands"]),
            str(facts["sine_runs"]),
            format_number(1.0 / trial.sampling_interval),
            format_number(factor * facts["noise"], 2),
            f"{shown_factor * facts['travel']:.0f}",
            str(facts["samples"]),
            ", ".join(f"{remark.count} {remark.kind}" for remark in trial.remarks) or "none",
        )
    return table
