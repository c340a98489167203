"""The page of the gallery: what is known of each set, what rovid said, and the judgement that this earns."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from benchmarks.gallery.base import RealSet
from benchmarks.gallery.judge import (
    LIKELY,
    REFUSED,
    RIGHT,
    UNDECIDED,
    WRONG,
    Answer,
    Document,
    Judgement,
    confidence_of,
    judge_cause,
    sizes,
)
from rovid.core.formatting import plus_minus

WORDS = (RIGHT, WRONG, UNDECIDED)
SECONDS_A_MINUTE, SECONDS_AT_LEAST = 4.0, 5.0
_COLUMNS = 116
_MADE = "<!-- Made by `python -m benchmarks.real`. Edit benchmarks/gallery and run it again. -->"


@dataclass(frozen=True, kw_only=True)
class Record:
    """Results of the steps of one set.

    Attributes
    ----------
    config
        rovid.toml as the commands found it, or as `init` wrote it.
    made_by
        Fingerprint of the program.
    cores
        Number of cores available to the program.
    """

    key: str
    answers: dict[str, Answer]
    config: str
    made_by: str
    cores: int

    @property
    def minutes(self) -> float | None:
        """Duration of the logs by `check`; None without a result of `check`."""
        check = self.answers.get("check")
        if check is None or check.document is None:
            return None
        return sum(float(log["duration"]) for log in check.document["logs"]) / 60.0


Done = tuple[RealSet, Record]


def line_of(key: str, answer: Answer) -> str:
    """One answer in a line of the terminal."""
    return f"{key:<18} {' '.join(answer.words)[:64]:<64} {answer.seconds:6.1f} s  {_end(answer)}"


def page_of(done: Sequence[Done], drawn: Mapping[str, Sequence[str]]) -> str:
    """Text of the page; ``drawn`` has the names of each set's pictures."""
    sections = [_section(real, record, drawn[real.key]) for real, record in done]
    return "\n\n".join([_head(done), _summary(done), *sections]) + "\n"


def judged(real: RealSet, record: Record) -> list[Judgement]:
    """Of each claim, in their order."""
    return [claim.judged(record.answers.get(claim.step)) for claim in real.claims]


def named(real: RealSet, record: Record) -> Iterator[tuple[str, Document, Judgement]]:
    """Every cause that a diagnosis named, how ("established" or "suspected"), and what that is worth."""
    document = _diagnosis(record)
    for kind, key in (("established", "findings"), ("suspected", "suspects")):
        for cause in document.get(key, []):
            yield kind, cause, judge_cause(cause, established=kind == "established", causes=real.causes)


def _diagnosis(record: Record) -> Document:
    answer = record.answers.get("diagnose")
    return (answer.document if answer is not None else None) or {}


def _head(done: Sequence[Done]) -> str:
    cores = max((record.cores for _, record in done), default=0)
    return f"""{_MADE}

# Real logs: known facts, rovid's results, right or wrong

Most other results in these pages come from simulated data. This page uses real logs: a dive, model ships, and files
recorded for other purposes. For each set the page lists the facts known without rovid, the commands, rovid's
results, and a judgement. Failures are listed next to successes. The facts and their sources are written by hand.
Verdicts, numbers and the three words below are filled in by `benchmarks/real.py` from rovid's JSON.

* **right**: a number agrees with the fact within two standard errors; a named cause is known to act, alone or as a
  member of a class; or rovid refuses, and there is nothing to find.
* **wrong**: a number does not agree; a cause known not to act is established or has a confidence of {LIKELY:g} or more;
  a completed diagnosis omits a cause that clearly acts; or rovid gives a result although none is possible.
* **undecided**: the truth is unknown; the result is too imprecise (a cause that clearly acts is not established,
  not the first suspect, and has a confidence below {LIKELY:g}); or the command did not end in time.

The tables list elapsed time and processor time on {cores} cores shared with other processes. The smaller of the
two times is an upper limit for an idle machine. A command is in time if this value is at most {SECONDS_A_MINUTE:g} s
for each minute of logs, or at most {SECONDS_AT_LEAST:g} s for short logs and refusals."""


def _summary(done: Sequence[Done]) -> str:
    rows = []
    for real, record in done:
        words = [judgement.word for judgement in judged(real, record)]
        causes = [(kind, judgement.word) for kind, _, judgement in named(real, record)]
        established = [word for kind, word in causes if kind == "established"]
        slowest = max(record.answers.values(), key=lambda answer: answer.quiet_seconds)
        rows.append([
            f"[{real.title}](#{_anchor(real.title)})", *(str(words.count(word)) for word in WORDS),
            *(str(established.count(word)) for word in WORDS), str(len(causes) - len(established)),
            f"`{slowest.words[0]}` {slowest.quiet_seconds:.0f} s", _pace(slowest, record),
        ])  # fmt: skip
    kinds = ["right", "wrong", "undecided"]
    head = ["set", *kinds, *(f"causes {kind}" for kind in kinds), "suspects", "slowest", "s a minute"]
    return (
        "## In short\n\nThe first three columns count the facts of each set, the next three columns the causes "
        "that rovid established.\n\n" + _table(head, rows)
    )


def _anchor(title: str) -> str:
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def _section(real: RealSet, record: Record, drawn: Sequence[str]) -> str:
    pictures = [
        f"![{picture.caption}](pictures/{picture.name})\n\n{_prose(picture.caption)}"
        for picture in real.pictures
        if picture.name in drawn
    ]
    parts = [
        f"## {real.title}", _prose(real.about), _prose(f"Source: {real.source}"), *pictures, _asked(record),
        _claims(real, record), _causes(real, record), _said(_diagnosis(record)),
        _prose(f"**Our judgement.** {real.ours}"),
    ]  # fmt: skip
    return "\n\n".join(part for part in parts if part)


def _prose(text: str) -> str:
    return textwrap.fill(text, _COLUMNS, break_long_words=False, break_on_hyphens=False)


def _asked(record: Record) -> str:
    answers = list(record.answers.values())
    commands = "\n".join(f"rovid {' '.join(answer.words)}" for answer in answers)
    rows = [
        [
            f"`{answer.words[0]}`", _end(answer), f"{answer.seconds:.1f}", f"{answer.processor_seconds:.1f}",
            _pace(answer, record), "yes" if _in_time(answer, record) else "**no**",
        ]
        for answer in answers
    ]  # fmt: skip
    refusals = [_prose(answer.message) for answer in answers if answer.code == REFUSED]
    minutes = "" if record.minutes is None else f" The logs last {record.minutes:.1f} minutes."
    parts = [
        "### Commands",
        _config(record),
        "<!-- test: not run; benchmarks/real.py runs it, on logs that are not all here -->\n```sh\n"
        + commands
        + "\n```",
        f"Each command also had `--json`.{minutes}",
        _table(["command", "end", "s", "s of processor", "s a minute of logs", "in time"], rows),
        "Error messages of the refusals:\n\n```text\n" + "\n\n".join(refusals) + "\n```" if refusals else "",
    ]
    return "\n\n".join(part for part in parts if part)


def _end(answer: Answer) -> str:
    verdict = (answer.document or {}).get("verdict")
    return answer.end or (f"`{verdict}`" if verdict else "done")


def _in_time(answer: Answer, record: Record) -> bool:
    if answer.code is None:
        return False
    allowed = SECONDS_A_MINUTE * (record.minutes or 0.0) if answer.code == 0 else 0.0
    return answer.quiet_seconds <= max(SECONDS_AT_LEAST, allowed)


def _pace(answer: Answer, record: Record) -> str:
    return "–" if not record.minutes else f"{answer.quiet_seconds / record.minutes:.1f}"


def _config(record: Record) -> str:
    """rovid.toml, or what `init` guessed where it wrote that."""
    init = record.answers.get("init")
    if init is None:
        return f"Configuration, `rovid.toml`:\n\n```toml\n{record.config.strip()}\n```" if record.config else ""
    if init.document is None:
        return ""
    rows = [
        [signal, f"`{guess['source']}`", guess["why"]]
        for guesses in init.document["signals"].values()
        for signal, guess in guesses.items()
    ]
    commands = [command for guesses in init.document["commands"].values() for command in guesses]
    rows += [["command", f"`{command['source']}`", command["why"]] for command in commands]
    return "Guesses of `init`, written to `rovid.toml`:\n\n" + _table(["signal", "taken from", "why"], rows)


def _claims(real: RealSet, record: Record) -> str:
    rows = []
    for claim, judgement in zip(real.claims, judged(real, record), strict=True):
        asked = next(step.words.split()[0] for step in real.steps if step.name == claim.step)
        remark = claim.remarks.get(judgement.word, "")
        rows.append([claim.known, f"`{asked}`", judgement.said, _word(judgement.word), remark])
    return "### Facts and results\n\n" + _table(
        ["known without rovid", "command", "result of rovid", "", "remark"], rows
    )


def _causes(real: RealSet, record: Record) -> str:
    document = _diagnosis(record)
    if not document or document["verdict"] == "too_little_data":
        return ""
    rows = [
        [f"`{_key(cause)}`", kind, confidence_of(cause), sizes(cause), _word(judgement.word), judgement.said]
        for kind, cause, judgement in named(real, record)
    ]
    if not rows:
        return "### Named causes\n\nNone."
    return "### Named causes\n\n" + _table(["cause", "as", "confidence", "size", "", "what is known of it"], rows)


def _key(cause: Document) -> str:
    """As `rovid fit --effect` takes it."""
    return f"{cause['effect']}:{cause['form']}" if cause.get("form") else str(cause["effect"])


def _word(word: str) -> str:
    return f"**{word}**" if word == WRONG else word


def _said(document: Document) -> str:
    """The rest of what a diagnosis said: how much better, what is left, and its warnings."""
    if not document:
        return ""
    parts = [f"### The diagnosis\n\nVerdict `{document['verdict']}`."]
    if document.get("missing"):
        parts.append(_prose(f"Missing: {document['missing']}"))
    if document.get("base"):
        parts += [_parameters(document), _better(document), _horizons(document)]
        left = document["unexplained"]
        if left["share_of_torque_variance"] is not None:
            follows = ", ".join(f"`{name}`" for name in left["depends_on"])
            parts.append(
                f"Unexplained: {100 * left['share_of_torque_variance']:.2g} % of the torque's variance"
                + (f", which follows {follows}." if follows else ".")
            )
    # What is wrong with a log is told by `check` already, and begins with its name.
    parts.append("\n".join(f"* {note}" for note in document["warnings"] if not re.match(r"\S+\.\w+:? ", note)))
    return "\n\n".join(part for part in parts if part)


def _parameters(document: Document) -> str:
    base, extended = document["base"]["parameters"], (document.get("extended") or {}).get("parameters", {})
    rows = []
    for name in {**base, **extended}:
        unit = (base.get(name) or extended[name])["unit"]
        rows.append([f"`{name}`", *(_value(side.get(name)) for side in (base, extended)), unit])
    return _table(["parameter", "plain model", "extended model", "unit"], rows)


def _value(reading: Document | None) -> str:
    if reading is None:
        return "–"
    error = reading["standard_error"]
    return plus_minus(reading["value"], math.nan if error is None else error)


def _better(document: Document) -> str:
    rows = []
    for name, gain in (document.get("held_out_gain") or {}).items():
        sides = [gain["base"], gain["extended"], gain.get("noise_floor")]
        if sides[0] is not None:
            shown = ["–" if side is None else f"{side:.3g}" for side in sides]
            rows.append([f"`{name}`", *shown, "" if gain["unit"] == "1" else gain["unit"]])
    head = ["held-out error", "plain model", "extended model", "noise floor", "unit"]
    return _table(head, rows) if rows else ""


def _horizons(document: Document) -> str:
    sides = ("base_deg", "extended_deg")
    rows = [
        [f"{one['seconds']:.3g} s", *("–" if one[side] is None else f"{one[side]:.3g}" for side in sides)]
        for one in document.get("horizons", [])
    ]
    return _table(["prediction horizon", "plain model, deg", "extended model, deg"], rows) if rows else ""


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    # A bar would end the cell.
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
