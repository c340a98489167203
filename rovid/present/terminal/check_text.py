"""What `rovid check` says: whether to go, what to do first, what each log holds."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from rich.console import Console

from rovid.core.console import labelled_text
from rovid.preflight.advice import shortened_list
from rovid.preflight.check import LogCheck
from rovid.present.terminal.result_tables import print_text, show_warnings, table_number
from rovid.present.terminal.table import table
from rovid.trial.trial import merged_remarks

_FIRST = 3
VERDICTS = {
    "go": ("Go:", "These logs have what a fit wants.", "bold green"),
    "care": ("Go with care:", "These logs can be fitted; mind this first.", "bold yellow"),
    "no_go": ("No go:", "A fit would fail, or be wrong. First of all:", "bold red"),
}


def show_check(console: Console, checked: LogCheck) -> None:
    """Print the verdict, the first three things to do, the logs, and whatever else there is to say."""
    print_text(console, labelled_text(*VERDICTS[checked.verdict]))
    tasks = list(check_tasks(checked))
    _show_tasks(console, tasks[:_FIRST], 1)
    console.print()
    if checked.rows:
        _show_logs(console, checked)
        _show_pushes(console, checked)
    if len(reasons := _reasons(checked.problems)) > 1:
        show_warnings(console, [_problem(names, reason) for reason, names in reasons.items()])
    _show_tasks(console, tasks[_FIRST:], _FIRST + 1)
    show_warnings(console, check_notes(checked))


def check_notes(checked: LogCheck) -> list[str]:
    """What else there is to say."""
    asides = [one.text for one in checked.advice if one.weight == "aside"]
    noticed = merged_remarks([trial for trial, _ in checked.rows])
    return [*asides, *noticed, *(remark.text for remark in checked.remarks)]


def check_tasks(checked: LogCheck) -> Iterator[str]:
    """What to do, the gravest first."""
    reasons, bad = _reasons(checked.problems), len(checked.problems)
    several = f"{bad} of {bad + len(checked.rows)} logs cannot be used"
    if len(reasons) == 1:
        ((reason, names),) = reasons.items()
        yield f"{several}. {_problem(names, reason)}" if bad > 1 else _problem(names, reason)
    elif reasons:
        yield f"{several}, for the reasons below: {shortened_list(list(checked.problems))}."
    yield from (one.text for one in checked.advice if one.weight != "aside")


def _reasons(problems: Mapping[str, str]) -> dict[str, list[str]]:
    """Why logs cannot be used -> those logs."""
    reasons: dict[str, list[str]] = {}
    for name, problem in problems.items():
        _, _, reason = problem.rpartition(f"{name}: ")
        reasons.setdefault(reason, []).append(name)
    return reasons


def _problem(names: Sequence[str], reason: str) -> str:
    # The log, and where in it, may stand in the reason itself.
    return reason if any(name in reason for name in names) else f"{shortened_list(names)}: {reason}"


def _show_tasks(console: Console, tasks: Sequence[str], first: int) -> None:
    for number_, task in enumerate(tasks, first):
        lead = f"{number_}. "
        print_text(console, lead + task, len(lead))


def _show_pushes(console: Console, checked: LogCheck) -> None:
    """What the logs tell of each thruster by themselves, where they tell anything of one."""
    if not any(push.observed.direction for push in checked.thrusters):
        return
    axis = checked.rows[0][0].axis
    ways = {1: "as rovid.toml says", -1: "the other way", 0: "not told"}
    rows = table("Thrusters, by these logs alone", "thruster", axis.motion_verb, "standard errors", "share %", left=2)
    for push in checked.thrusters:
        sense = push.observed
        rows.add_row(
            push.name,
            ways[sense.direction],
            f"{abs(sense.t_statistic):.0f}",
            f"{100.0 * max(sense.explained_share, 0.0):.0f}",
        )
    console.print(rows)


def _show_logs(console: Console, checked: LogCheck) -> None:
    first, _ = checked.rows[0]
    axis = first.axis
    _, unit, factor = axis.measured_quantity(integrated=first.rate_only)
    way, far = axis.display_unit
    went = f"{'turned' if axis.angular else 'went'} {way}"
    rows = table("Logs", "log", "s", "held", "sines", "Hz", f"noise {unit}", went, "samples", "remarks", prose=True)
    for trial, facts in checked.rows:
        rows.add_row(
            trial.name,
            f"{trial.duration:.0f}",
            str(facts["held_commands"]),
            str(facts["sine_runs"]),
            table_number(1.0 / trial.sampling_interval),
            table_number(factor * facts["noise"], 2),
            f"{far * facts['travel']:.0f}",
            str(facts["samples"]),
            ", ".join(f"{remark.count} {remark.kind}" for remark in trial.remarks) or "none",
        )
    console.print(rows)
