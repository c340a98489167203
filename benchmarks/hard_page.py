"""The page on hard water: tables of right and wrong, of odds and parameters, and every failure with its number."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.hard_scores import PARAMETERS, VISIBILITY, Odds, reliability, score

ROWS = [*[name for _, name in VISIBILITY], "nothing hidden"]


def write_page(records: list[dict[str, Any]], path: Path | None) -> str:
    """Text of the page; with ``path``, write the text there and the plot to pictures/."""
    scores = [score(record) for record in records]
    odds = [pair for one in scores for pair in one["odds"]]
    parts = [
        _head(records), _names(scores), _nothing(scores), _ranks(scores), _by_effect(scores),
        _odds(odds, path is not None), _parameters(scores), _failures(records, scores),
    ]  # fmt: skip
    text = "\n\n".join(part for part in parts if part) + "\n"
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        if odds:
            _plot(odds, path.parent / "pictures" / "hard_reliability.png")
    return text


def _table(head: list[str], rows: list[list[str]]) -> str:
    widths = [max(len(row[column]) for row in [head, *rows]) for column in range(len(head))]
    lines = []
    for row in [head, ["-" * width for width in widths], *rows]:
        cells = [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _share(count: int, of: int) -> str:
    return f"{count} ({100 * count / of:.0f} %)" if of else "-"


def _head(records: list[dict[str, Any]]) -> str:
    seeds = sorted({record["seed"] for record in records})
    r2 = [record["truth"]["plain_r2"] for record in records] or [np.nan]
    seconds = [record["diagnosis_seconds"] for record in records] or [np.nan]
    low, high = np.percentile(r2, [10, 90])
    return (
        f"# Hard water: the diagnosis in difficult conditions\n\n{len(records)} campaigns, seed "
        f"{', '.join(map(str, seeds))}. Five simulated vehicles move in surge, sway and yaw through waves, gusts "
        "and eddies. Rotors with their own dynamics drive them. The commands come from an autopilot, a zigzag, a "
        "programme or a pilot. A compass, a gyro and a DVL measure the motion with noise, rounding, jitter and "
        "gaps. A campaign has one to eight runs of 40 to 180 time constants. Two of three campaigns have a "
        "hidden cause. The form of this cause may differ from rovid's forms. The simulator shares no code with "
        "rovid. rovid reads only the files.\n\n*Visible* is a number: the relative reduction of the heading error of "
        "held-out blocks, half to eight time constants ahead, by a model with the exact cause. R² of "
        f"the plain model's yaw rate is {low:.2f} to {high:.2f} in eight campaigns of ten. The diagnosis time was "
        f"{np.median(seconds):.0f} s at the median, {np.max(seconds):.0f} s at most.\n\n"
        "A finding is right if its name is the hidden cause, a cause of the same class that such logs cannot "
        "separate, or a cause that rovid reports as indistinguishable from the hidden cause. Some causes always "
        "act. A finding of such a cause is right if the cause is visible. These causes are waves of at least a "
        "hundredth of the torque in use, and the rotors' own lag and advance loss with a size within three standard "
        "errors of the truth. Any "
        "other cause counts as visible if it reduces the heading error by a twentieth or more, alone or together "
        "with the others; the moment of sway is the most frequent. *Counted strictly*, a finding is right only "
        "if its own cause was hidden or reduces the heading error by that amount."
    )


def _names(scores: list[dict[str, Any]]) -> str:
    rows = []
    for name in ROWS[:-1]:
        some = [one for one in scores if one["visibility"] == name]
        if some:
            rows.append(_name_row(name, some))
    visible = [one for one in scores if one["visibility"] in ROWS[:2]]
    rows.append(_name_row("**a quarter or more**", visible))
    rows.append(_name_row("by a speed that is not logged", [one for one in visible if one["unlogged"]]))
    everything = [one for one in scores if one["hidden"]]
    rows.append(_name_row("**all**", everything))
    head = ["visible", "campaigns", "established, right", "established, wrong", "right, or first suspect", "no answer"]
    return "## Campaigns with a hidden cause\n\n" + _table(head, rows)


def _name_row(name: str, some: list[dict[str, Any]]) -> list[str]:
    count = len(some)
    return [
        name, str(count), _share(sum(one["established_right"] for one in some), count),
        _share(sum(one["established_wrong"] for one in some), count),
        _share(sum(one["established_right"] or one["first_right"] for one in some), count),
        str(sum(not one["answer"] for one in some)),
    ]  # fmt: skip


def _nothing(scores: list[dict[str, Any]]) -> str:
    nothing = [one for one in scores if one["hidden"] is None]
    wrong = sum(one["established_wrong"] for one in nothing)
    there = sum("there" in one["established"] and not one["established_wrong"] for one in nothing)
    suspected = sum(bool(one["suspected"]) for one in nothing)
    silent = sum(not one["answer"] for one in nothing)
    causes = [worth for one in scores for worth in one["established"]]
    right = sum(worth != "wrong" for worth in causes)
    strictly = [right for one in scores for right in one["strictly"]]
    return (
        "## Campaigns without a hidden cause\n\n"
        + _table(
            ["campaigns", "a false cause established", "a permanent cause established", "suspects", "no answer"],
            [[str(len(nothing)), _share(wrong, len(nothing)), str(there), str(suspected), str(silent)]],
        )
        + f"\n\nOf {len(causes)} causes established in all campaigns {_share(right, len(causes))} are right. "
        f"Counted strictly (see above), {_share(sum(strictly), len(causes))} are right."
    )


def _ranks(scores: list[dict[str, Any]]) -> str:
    rows = []
    for name in ROWS[:-1]:
        some = [one for one in scores if one["visibility"] == name]
        if some:
            ranks = [one["rank"] for one in some]
            later = sum(rank is not None and rank > 3 for rank in ranks)
            rows.append([name, *(str(ranks.count(place)) for place in (1, 2, 3)), str(later), str(ranks.count(None))])
    return "## Rank of the truth among findings and suspects\n\n" + _table(
        ["visible", "first", "second", "third", "later", "not named"], rows
    )


def _by_effect(scores: list[dict[str, Any]]) -> str:
    rows = []
    for effect in sorted({one["hidden"] for one in scores if one["hidden"]}):
        some = [one for one in scores if one["hidden"] == effect]
        seen = [one for one in some if one["visibility"] in ROWS[:2]]
        rows.append([
            effect, str(len(some)), str(len(seen)), str(sum("exact" in one["established"] for one in seen)),
            str(sum("class" in one["established"] and "exact" not in one["established"] for one in seen)),
            str(sum(one["established_right"] or one["first_right"] for one in seen)),
            str(sum(one["established_wrong"] for one in some)),
        ])  # fmt: skip
    head = ["hidden", "campaigns", "visible", "established", "its class", "or first suspect", "wrong, of all"]
    return "## By cause\n\nCampaigns with *visible* of a quarter or more.\n\n" + _table(head, rows) if rows else ""


def _odds(odds: Odds, with_picture: bool) -> str:
    if not odds:
        return "## Confidence\n\nNo finding or suspect had a confidence."
    table, brier = reliability(odds)
    rows = [
        [f"{index / 10:.1f} to {(index + 1) / 10:.1f}", str(number), *(f"{x:.2f}" if number else "-" for x in shares)]
        for index, (number, *shares) in enumerate(table)
    ]
    picture = "\n\n![Reliability diagram](pictures/hard_reliability.png)" if with_picture else ""
    return (
        "## Confidence\n\nConfidence of each finding and suspect, and whether the cause acts, by two criteria. The "
        "first criterion includes indistinguishable causes and the class, as the confidence does. The second "
        "criterion counts only the cause itself, if it was hidden or changes the heading error by a twentieth. "
        f"Brier score by the first criterion: {brier:.3f}, for {len(odds)} findings "
        "and suspects.\n\n"
        + _table(["confidence", "number", "mean", "cause or its class acts", "cause acts"], rows)
        + picture
    )


def _parameters(scores: list[dict[str, Any]]) -> str:
    groups = {
        "nothing hidden": [one for one in scores if one["hidden"] is None],
        "cause found": [one for one in scores if one["established_right"]],
        "visible, not found": [
            one for one in scores if one["visibility"] in ROWS[:3] and not one["established_right"]
        ],
        "absorbed by inertia or drag": [
            one for one in scores if one["visibility"] == ROWS[3] and not one["established_right"]
        ],
        "**all**": scores,
    }  # fmt: skip
    rows = []
    for group, members in groups.items():
        for name in PARAMETERS:
            some = [one["parameters"][name] for one in members if name in one["parameters"]]
            best = [abs(one["errors_from_best"]) for one in some if one["errors_from_best"] is not None]
            hull = [abs(one["errors_from_hull"]) for one in some if one["errors_from_hull"] is not None]
            if some:
                low, middle, high = np.percentile([one["ratio"] for one in some], [10, 50, 90])
                rows.append([
                    group, name, str(len(some)), f"{low:.2f}, {middle:.2f}, {high:.2f}",
                    _share(sum(value <= 2 for value in hull), len(hull)),
                    _share(sum(value <= 2 for value in best), len(best)),
                ])  # fmt: skip
    head = ["", "parameter", "campaigns", "over the hull's", "hull's within two", "best fit's within two"]
    return (
        "## Parameters\n\nParameters of the extended model, or of the plain model if nothing was found. The "
        "columns are: the ratio to the hull's true value (10th, 50th and 90th percentile of the campaigns); the "
        "share within two standard errors of the true value; the share within two standard errors of the best "
        "fit. The best fit is a fit to the heading with the true cause and the true waves, and with the true "
        "rotors if a lag or delay was named. Inertia and drag can absorb a cause that reduces the heading error "
        "by less than a tenth. Heading data do not reveal this bias, and the standard errors in these records do "
        "not include it.\n\n" + _table(head, rows)
    )


def _failures(records: list[dict[str, Any]], scores: list[dict[str, Any]]) -> str:
    rows = []
    for record, one in zip(records, scores, strict=True):
        missed = one["visibility"] in ROWS[:2] and not (one["established_right"] or one["first_right"])
        if one["established_wrong"] or missed or not one["answer"]:
            hidden = one["hidden"] or "nothing"
            named = ", ".join(one["names"]) or "-"
            suspected = ", ".join(one["suspected"]) or "-"
            said = " ".join(str(one["verdict"]).split())[:90].replace("|", "/")
            visible = f"{record['truth']['visible']:.2f}"
            where = [str(record["seed"]), str(one["number"]), one["vehicle"]]
            rows.append([*where, hidden, visible, said, named, suspected])
    if not rows:
        return "## Failures\n\nNone."
    return (
        "## Failures\n\nCampaigns with a false established cause, a missed visible cause, or no answer. "
        "`python -m benchmarks.hard --seed SEED --only NUMBER --keep FOLDER --state FILE` repeats a campaign.\n\n"
        + _table(["seed", "number", "vehicle", "hidden", "visible", "verdict", "established", "suspected"], rows)
    )


def _plot(odds: Odds, path: Path) -> None:
    from matplotlib.figure import Figure

    table, _ = reliability(odds)
    figure = Figure(figsize=(5.0, 4.2), layout="constrained")
    axes, counts = figure.subplots(2, 1, height_ratios=[3, 1], sharex=True)
    axes.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    numbers, means, *judged = np.array([row for row in table if row[0]]).T
    for shares, label in zip(judged, ("it or its class", "it alone"), strict=True):
        doubt = np.sqrt(np.maximum(shares * (1 - shares), 0.25 / numbers) / numbers)
        axes.errorbar(means, shares, yerr=doubt, fmt="o-", capsize=3, label=label)
    axes.legend(frameon=False)
    axes.set_ylabel("share that acts")
    axes.set_ylim(-0.03, 1.03)
    counts.bar(np.arange(10) / 10 + 0.05, [row[0] for row in table], width=0.09)
    counts.set_xlabel("confidence")
    counts.set_ylabel("number")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
