"""Whether what rovid says of a real log is right, wrong or cannot be known: held against what is known without it."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

from rovid.core.formatting import plus_minus

RIGHT, WRONG, UNDECIDED = "right", "wrong", "undecided"
# A suspect of this confidence is more likely there than not: it counts as said.
LIKELY = 0.5
REFUSED = 2

Document = dict[str, Any]
Reading = tuple[float, float | None]
Reader = Callable[[Document], Reading | None]


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Result of one command.

    Attributes
    ----------
    words
        The command, without ``rovid`` and ``--json``.
    seconds, processor_seconds
        Wall-clock time, and processor time of all cores.
    code
        Exit status; None if the time limit ended the command.
    document
        The printed document, if the command succeeded.
    message
        The text on standard error.
    """

    words: tuple[str, ...]
    seconds: float
    processor_seconds: float
    code: int | None
    document: Document | None
    message: str = ""

    @property
    def quiet_seconds(self) -> float:
        """Upper bound of the time on an idle machine: other processes do not count as processor time."""
        return min(self.seconds, self.processor_seconds)

    @property
    def end(self) -> str:
        """Words for a failure; "" if the command printed a document."""
        if self.document is not None:
            return ""
        if self.code is None:
            return f"did not end within {self.seconds:.0f} s"
        return "refused" if self.code == REFUSED else f"broke down with status {self.code}"


@dataclass(frozen=True)
class Judgement:
    """One of the three words, and what rovid said that earns it."""

    word: str
    said: str


Judge = Callable[[Answer], Judgement]


@dataclass(frozen=True, kw_only=True)
class Claim:
    """Something that is known without rovid, and the step whose answer is held against it.

    Attributes
    ----------
    known
        What, and from where; in the page's words.
    remarks
        Word of the judgement -> what is to be said beside it; shown with that judgement alone.
    """

    known: str
    step: str
    judge: Judge
    remarks: dict[str, str] = field(default_factory=dict)

    def judged(self, answer: Answer | None) -> Judgement:
        """By the answer of its step; None where that was left out."""
        if answer is None:
            return Judgement(UNDECIDED, "not run, because its input is missing")
        if answer.code not in {0, None, REFUSED}:
            return Judgement(WRONG, answer.end)
        return self.judge(answer)


@dataclass(frozen=True, kw_only=True)
class Cause:
    """What is known without rovid about one cause, or about a class that such logs cannot tell apart.

    Attributes
    ----------
    acts
        Whether one of the effects acts; None where nobody can know.
    why
        How that is known, or why it cannot be; in the page's words.
    """

    effects: tuple[str, ...]
    acts: bool | None
    why: str


def number(read: Reader, low: float, high: float, unit: str = "", *, sharp: float = 0.5) -> Judge:
    """Right where the number, give or take two standard errors, meets ``low`` to ``high``.

    Undecided where there is none, or where two standard errors are more than the share ``sharp`` of what it could be.
    """

    def judge(answer: Answer) -> Judgement:
        reading = read(answer.document) if answer.document is not None else None
        if reading is None:
            return Judgement(UNDECIDED, answer.end or "no such number")
        value, error = reading
        said = f"{plus_minus(value, error or math.nan)} {unit}".strip()
        reach = 2.0 * (error or 0.0)
        if reach > sharp * max(abs(value), abs(low), abs(high)):
            return Judgement(UNDECIDED, f"{said}: too imprecise to decide")
        meets = value - reach <= high and value + reach >= low
        return Judgement(RIGHT if meets else WRONG, said)

    return judge


def parameter(*path: str) -> Reader:
    """Reads value and standard error at the end of ``path`` through the document."""

    def read(document: Document) -> Reading | None:
        found: Any = document
        for key in path:
            found = found.get(key) if isinstance(found, dict) else None
        if not isinstance(found, dict) or found.get("value") is None:
            return None
        return float(found["value"]), found.get("standard_error")

    return read


def ratio(above: Reader, below: Reader) -> Reader:
    """Reads one number over another, its error as if the two were independent."""

    def read(document: Document) -> Reading | None:
        first, second = above(document), below(document)
        if first is None or second is None or second[0] == 0.0:
            return None
        value = first[0] / second[0]
        shares = [(error or 0.0) / number for number, error in (first, second) if number]
        return value, abs(value) * math.hypot(*shares)

    return read


def size_of(effect: str, name: str) -> Reader:
    """Reads a parameter of a cause that was named, established or suspected."""

    def read(document: Document) -> Reading | None:
        for named in [*document["findings"], *document.get("suspects", [])]:
            if named["effect"] == effect:
                return parameter("parameters", name)(named)
        return None

    return read


def refuses(answer: Answer) -> Judgement:
    """Right where the command says in one message that it cannot, or that there is too little data."""
    if answer.code == REFUSED:
        plain = len(answer.message.splitlines()) == 1 and answer.message.startswith("rovid: ")
        return Judgement(RIGHT if plain else WRONG, "refused" if plain else "refused, in more than one message")
    if answer.document is None:
        return Judgement(UNDECIDED, answer.end)
    if answer.document.get("verdict") == "too_little_data":
        return Judgement(RIGHT, "`too_little_data`")
    if "verdict" in answer.document:
        return Judgement(WRONG, f"`{answer.document['verdict']}`")
    return Judgement(WRONG, sizes(answer.document))


def physical(*path: str) -> Judge:
    """Right where, of the parameters at the end of ``path``, the inertia is positive and no drag negative."""

    def judge(answer: Answer) -> Judgement:
        found: Any = answer.document
        for key in path:
            found = (found or {}).get(key)
        if not found:
            return Judgement(UNDECIDED, answer.end or "no such numbers")
        known = [name for name in ("inertia", "quadratic_drag", "linear_drag") if name in found]
        said = ", ".join(_reading(name, found[name]) for name in known)
        sane = all(found[name]["value"] >= 0.0 for name in known) and found["inertia"]["value"] > 0.0
        return Judgement(RIGHT if sane else WRONG, said)

    return judge


def guesses(signal: str, sources: Collection[str]) -> Judge:
    """Right where `init` takes the signal from one of the ``sources``; undecided where it leaves it out."""

    def judge(answer: Answer) -> Judgement:
        if answer.document is None:
            return Judgement(UNDECIDED, answer.end)
        taken = [found[signal]["source"] for found in answer.document["signals"].values() if signal in found]
        if not taken:
            return Judgement(UNDECIDED, f"`{signal}` is not guessed")
        return Judgement(RIGHT if set(taken) <= set(sources) else WRONG, f"`{signal}` from `{', '.join(taken)}`")

    return judge


def commands_within(sources: Collection[str]) -> Judge:
    """Right where `init` takes nothing but ``sources`` for commands of thrusters."""

    def judge(answer: Answer) -> Judgement:
        if answer.document is None:
            return Judgement(UNDECIDED, answer.end)
        taken = [command["source"] for found in answer.document["commands"].values() for command in found]
        false = [source for source in taken if source not in sources]
        said = f"{len(taken)} commands" + (f", among them `{'`, `'.join(false)}`" if false else "")
        return Judgement(WRONG if false else RIGHT, said)

    return judge


def names(*effects: str, by_name: bool = False) -> Judge:
    """Right where a diagnosis establishes one of ``effects``, or has it for its first suspect or for likely.

    So it is where another is named that it cannot tell from one of them, unless that is wanted ``by_name``.
    """

    def worth(named: Document, *, likely: bool) -> Judgement:
        own = named["effect"] in effects
        said = f"`{named['effect']}` {_odds(named)}".strip()
        said += "" if own else ", of a class with it"
        return Judgement(RIGHT if likely and (own or not by_name) else UNDECIDED, said)

    def judge(answer: Answer) -> Judgement:
        if answer.document is None or answer.document["verdict"] == "too_little_data":
            return Judgement(UNDECIDED, answer.end or "`too_little_data`")
        ranked = [(found, True) for found in answer.document["findings"]]
        for place, suspect in enumerate(answer.document.get("suspects", [])):
            ranked.append((suspect, place == 0 or _confidence(suspect) >= LIKELY))
        meant = [worth(named, likely=likely) for named, likely in ranked if _meant(named) & set(effects)]
        right = next((one for one in meant if one.word == RIGHT), None)
        missed = Judgement(WRONG, f"not named; `{answer.document['verdict']}`")
        return right or (meant[0] if meant else missed)

    return judge


def judge_cause(named: Document, *, established: bool, causes: Sequence[Cause]) -> Judgement:
    """What naming one cause is worth; the saying is why."""
    own = next((cause for cause in causes if named["effect"] in cause.effects), None)
    if own is not None and own.acts:
        return Judgement(RIGHT, own.why)
    if own is not None and own.acts is False:
        said = established or _confidence(named) >= LIKELY
        return Judgement(WRONG if said else UNDECIDED, own.why)
    rival = next((cause for cause in causes if cause.acts and _meant(named) & set(cause.effects)), None)
    if rival is not None:
        return Judgement(RIGHT, f"The cause is named as a member of a class. {rival.why}")
    return Judgement(UNDECIDED, own.why if own is not None else "No independent evidence for or against the cause.")


def sizes(named: Document) -> str:
    """Parameters of a cause with their uncertainty."""
    return ", ".join(_reading(name, reading) for name, reading in named["parameters"].items())


def confidence_of(named: Document) -> str:
    """Two decimals, or a dash where the diagnosis gives none."""
    given = named.get("confidence")
    return "–" if given is None else f"{math.floor(100 * given) / 100:.2f}"


def _confidence(named: Document) -> float:
    given = named.get("confidence")
    return 0.0 if given is None else float(given)


def _odds(named: Document) -> str:
    return "" if named.get("confidence") is None else f"with confidence {confidence_of(named)}"


def _meant(named: Document) -> set[str]:
    """The effect and its indistinguishable rivals."""
    rivals = named.get("cannot_be_told_from") or []
    return {named["effect"], *(rival if isinstance(rival, str) else rival["effect"] for rival in rivals)}


def _reading(name: str, reading: Document) -> str:
    error = reading.get("standard_error")
    unit = "" if reading["unit"] == "1" else f" {reading['unit']}"
    return f"{name} {plus_minus(reading['value'], math.nan if error is None else error)}{unit}"
