"""Section on wide campaigns of docs/confusion.md, and one campaign in a line of the terminal."""

from __future__ import annotations

import statistics
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.wide_scores import OUTCOMES, OUTCOMES_NOTHING, score
from tools.wide.causes import ALL, FORMS

Record = dict[str, Any]
BEGIN, END = "<!-- wide: begin -->", "<!-- wide: end -->"
EVIDENCE = 20.0  # nats, from which a cause counts as detectable
# Words in front of the shares that benchmarks/sweep.py repeats.
EVIDENT_NAMED = "evident causes, exact or of a class that is said"
EVIDENT_WRONG = "evident causes, a wrong name or an extra one"
FALSE = "nothing hidden, a false cause"
_GOOD = frozenset({"exact", "class", "clean"})


def cause_of(truth: Record) -> str:
    """Hidden effect and form in a word."""
    return f"{truth['effect']}, {truth['form']}" if truth["effect"] else "nothing"


def line_of(record: Record) -> str:
    """One campaign in a line of the terminal."""
    result, truth, said = score(record), record["truth"], record["said"]["diagnose"]
    worst = max((abs(z) for z in result["z"].values()), default=float("nan"))
    return (
        f"{record['index']:4d} {cause_of(truth):<38} visible {truth['visibility']:5.2f} "
        f"evidence {truth['evidence']:8.0f} "
        f"{said['seconds']:5.0f} s {result['outcome']:<13} z {worst:5.1f}  {'; '.join(result['findings']) or '-'} "
        f"[{'; '.join(result['suspects'][:3])}] {said.get('verdict')} {said['failure'][:80]}"
    )


def aligned_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[k]) for row in [head, *rows]) for k in range(len(head))]

    def line(cells: Sequence[str]) -> str:
        padded = [c.rjust(w) if k else c.ljust(w) for k, (c, w) in enumerate(zip(cells, widths, strict=True))]
        return f"| {' | '.join(padded)} |"

    rule = ["-" * w if k == 0 else "-" * (w - 1) + ":" for k, w in enumerate(widths)]
    return "\n".join([line(head), line(rule), *(line(row) for row in rows)])


def _counts(name: str, some: Sequence[Record], outcomes: Sequence[str]) -> list[str]:
    found = [score(record)["outcome"] for record in some]
    cells = [found.count(outcome) for outcome in outcomes]
    return [name, str(len(some)), *(f"{n} ({100 * n / len(some):.0f} %)" if n else "0" for n in cells)]


def _grouped(records: Sequence[Record], key: Callable[[Record], str]) -> list[list[str]]:
    names = list(dict.fromkeys(sorted(key(record) for record in records)))
    return [_counts(name, [one for one in records if key(one) == name], OUTCOMES) for name in names]


def _size(record: Record) -> str:
    shown = record["truth"]["visibility"]
    return "3 to 10 %" if shown < 0.1 else "10 to 30 %" if shown < 0.3 else "30 % or more"


def _errors(records: Sequence[Record]) -> list[list[str]]:
    groups = {
        "`fit`, nothing hidden": [score(r)["fit_z"] for r in records if r["truth"]["effect"] is None],
        "`fit` with the hidden effect": [score(r)["fit_z"] for r in records if r["truth"]["visible"]],
        "`diagnose`, nothing hidden": [score(r)["z"] for r in records if r["truth"]["effect"] is None],
        "`diagnose`, exact": [score(r)["z"] for r in records if score(r)["outcome"] == "exact"],
        "`diagnose`, other outcomes": [
            score(r)["z"] for r in records if r["truth"]["effect"] and score(r)["outcome"] != "exact"
        ],
        "parameters of the effect": [score(r)["effect_z"] for r in records if r["truth"]["visible"]],
    }
    rows = []
    for name, errors in groups.items():
        for parameter in ALL if not name.startswith("parameters") else ("all",):
            values = [abs(z) for one in errors for key, z in one.items() if parameter in {key, "all"}]
            if values:
                rows.append([
                    f"{name}: {parameter.replace('_', ' ')}", str(len(values)), f"{statistics.median(values):.2f}",
                    *(f"{sum(z <= limit for z in values)} ({100 * sum(z <= limit for z in values) / len(values):.0f} %)"
                      for limit in (1.96, 4.0)),
                    f"{max(values):.1f}",
                ])  # fmt: skip
    return rows


def _failures(records: Sequence[Record]) -> list[str]:
    lines = []
    for record in records:
        result, truth, said = score(record), record["truth"], record["said"]["diagnose"]
        worst = max(result["z"].values(), key=abs, default=0.0)
        bad = result["outcome"] not in _GOOD and (truth["visible"] or truth["effect"] is None or result["false"])
        if not bad:
            continue
        words = "; ".join(result["findings"]) or said.get("failure", "").partition("\n")[0] or "nothing established"
        suspects = f"; suspects {', '.join(result['suspects'][:2])}" if result["suspects"] else ""
        lines.append(
            f"* `{record['seed']} {record['index']}` {cause_of(truth)} (visible {truth['visibility']:.2f}, evidence "
            f"{truth['evidence']:.0f} nats, time constant {truth['time_constant']:.2g} s, {len(truth['runs'])} runs): "
            f"{result['outcome']}. {words}{suspects}; largest error of inertia and drags {abs(worst):.1f} standard "
            "errors."
        )
    return lines


def _share(words: str, some: Sequence[Record], *outcomes: str) -> str:
    """Share of records with one of the outcomes, with its 95 % interval (Clopper and Pearson 1934)."""
    from scipy.stats import binomtest

    count = sum(score(record)["outcome"] in outcomes for record in some)
    interval = binomtest(count, len(some)).proportion_ci()
    low, high = (100.0 * share for share in interval)
    return f"- {words}: {count} of {len(some)} (95 % interval {low:.0f} to {high:.0f} %)"


def section(records: Sequence[Record], revision: str = "") -> str:
    """Text of the section; ``revision`` of rovid that was measured."""
    visible = [r for r in records if r["truth"]["effect"] and r["truth"]["visible"]]
    nothing = [r for r in records if r["truth"]["effect"] is None]
    invisible = len(records) - len(visible) - len(nothing)
    seeds = ", ".join(str(seed) for seed in sorted({r["seed"] for r in records}))
    seconds = [r["said"]["diagnose"]["seconds"] for r in records] or [0.0]
    clearly = [r for r in visible if r["truth"]["evidence"] >= EVIDENCE]
    rows = [_counts("visible causes", visible, OUTCOMES)] if visible else []
    rows += [_counts("evident causes", clearly, OUTCOMES)] if clearly else []
    for size in ("3 to 10 %", "10 to 30 %", "30 % or more"):
        some = [r for r in visible if _size(r) == size]
        rows += [_counts(f"changes the rate by {size}", some, OUTCOMES)] if some else []
    head = ["campaigns", "number", *OUTCOMES]
    starts = {"rest": "at rest", "step": "at a step", "under_way": "under way"}
    by_start = _grouped(
        visible, lambda r: f"begin {' and '.join(sorted({starts[run['start']] for run in r['truth']['runs']}))}"
    )
    by_format = _grouped(visible, lambda r: r["truth"]["format"])
    by_tau = _grouped(
        visible,
        lambda r: "time constant 0.1 to 1 s" if r["truth"]["time_constant"] < 1.0
        else "time constant 1 to 10 s" if r["truth"]["time_constant"] < 10.0 else "time constant 10 to 60 s",
    )  # fmt: skip
    failures = _failures(records)
    absent = sorted(set(FORMS) - {r["truth"]["effect"] for r in visible})
    shares = [_share("visible causes, exact or of a class that is said", visible, "exact", "class")] if visible else []
    if clearly:
        shares += [_share(EVIDENT_NAMED, clearly, "exact", "class"), _share(EVIDENT_WRONG, clearly, "wrong", "extra")]
    shares += [_share(FALSE, nothing, "false")] if nothing else []
    of_revision = f" with revision {revision}" if revision else ""
    introduction = (
        f"{len(records)} campaigns{of_revision}, seed {seeds}, drawn by `python -m benchmarks.wide`: "
        f"{len(visible)} with a visible cause, {invisible} with a cause that is not visible, "
        f"{len(nothing)} without a cause. The vehicles have "
        "inertias of 0.01 to 10⁶ kg m², time constants of 0.1 to 60 s and 1 to 6 thrusters with commands in V, %, µs, "
        "rpm or −1 to 1. Headings have 1 to 100 Hz, commands are slower or faster, in the same table, in a second file "
        "or in MCAP. A campaign has 2 to 12 runs, which begin at rest, at a step, or under way. Each of 24 effects has "
        "one to five laws. A cause is *visible* if it changes the yaw rate by 3 % or more (root mean square, same "
        "commands, same disturbance). *Evidence* is the average gain in log-likelihood of the true cause over the "
        "plain model with fitted inertia and drags, computed from the true disturbance and noise. A cause with less "
        f"than {EVIDENCE:.0f} nats is lost in them, and one with more is *evident*. "
        "The simulator shares no code with rovid. Its laws and sizes "
        "do not follow the bounds and thresholds of the diagnosis. A diagnosis took "
        f"{statistics.median(seconds):.0f} s at the median and {max(seconds):.0f} s at "
        "most, on a machine with other work."
    )
    legend = (
        "- exact: the hidden cause was established alone, and no rival was left open;\n"
        "- class: the hidden cause is among the established names, or an effect that describes its law equally well "
        "(two lags in series: delay; smooth dead band, or sag that follows the load: shape of the thrust curve; tether "
        "with a fixed slack heading: torque that depends on heading);\n"
        "- suspect first: nothing was established, and the hidden cause is the first suspect;\n"
        "- extra, wrong: a false cause was established, with or without the hidden one.\n\n"
        "A delay in joined files (`csv_pair`, mcap) cannot be distinguished from an offset between the clocks. It is "
        "reported as a suspect together with this fault, and counts as a class."
    )
    parts = [
        "## Wide campaigns",
        introduction,
        aligned_table(head, rows),
        "\n".join(shares),
        legend,
        aligned_table(["no cause", "number", *OUTCOMES_NOTHING], [_counts("nothing hidden", nothing, OUTCOMES_NOTHING)])
        if nothing else "",
        "### Wide campaigns by cause and kind of log",
        aligned_table(head, [*_grouped(visible, lambda r: r["truth"]["effect"]), *by_tau, *by_start, *by_format]),
        f"No visible cause among: {', '.join(absent)}." if absent else "",
        "### Errors in wide campaigns",
        "Errors in standard errors, where the law leaves the true value defined.",
        aligned_table(["parameter", "number", "median", "within 1.96", "within 4", "largest"], _errors(records)),
        "### Failures in wide campaigns",
        "Seed and index of each; `python -m tools.wide FOLDER --seed S --start N` writes the campaign.",
        "\n".join(failures) or "None.",
    ]  # fmt: skip
    return "\n\n".join(wrapped(part) for part in parts if part)


def wrapped(part: str) -> str:
    """A paragraph or list with lines of 116 characters; tables and headings as they are."""
    if part.startswith(("|", "#")):
        return part
    lines = part.split("\n")
    return "\n".join(
        textwrap.fill(
            line, 116, subsequent_indent="  " if line[:2] in {"- ", "* "} else "", break_long_words=False,
            break_on_hyphens=False,
        )
        for line in lines
    )  # fmt: skip


def marked_section(path: Path) -> str:
    """The section in a page with its markers, what follows, and an empty line in front; empty where there is none."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    _, marker, rest = text.partition(BEGIN)
    return f"\n{marker}{rest}" if marker else ""


def write_section(path: Path, records: Sequence[Record], revision: str = "") -> None:
    """Replace the section between its markers, or add it at the end of the page."""
    text = path.read_text(encoding="utf-8")
    whole = f"{BEGIN}\n\n{section(records, revision)}\n\n{END}\n"
    if BEGIN in text:
        before, _, rest = text.partition(BEGIN)
        whole = before + whole + rest.partition(END)[2].lstrip("\n")
    else:
        whole = f"{text.rstrip()}\n\n{whole}"
    path.write_text(whole, encoding="utf-8")
