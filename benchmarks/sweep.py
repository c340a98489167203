"""Does the diagnosis name what is hidden? Simulated campaigns, of which `rovid diagnose` sees the files and no more.

Run ``python -m benchmarks.sweep --seed N --jobs 2``. Every campaign's answer goes to ``--results`` as soon as it is
there; ``--resume`` takes a sweep up where it ended; ``--page-only`` scores what there is, of all seeds, and writes the
page.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import secrets
import statistics
import subprocess
import sys
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, fields, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.wide_page import EVIDENT_NAMED, EVIDENT_WRONG, FALSE, marked_section
from rovid.effects.base import REFERENCE_RATE
from tools.cases import Case, all_cases, groups, truth_of
from tools.channels import EXTRA
from tools.hidden import EFFECTS
from tools.programme import CAMPAIGN
from tools.trial_day import write_trial_day
from tools.truth import VEHICLES, Truth

DOCS = Path(__file__).parent.parent / "docs"
Kind = Literal["effect", "pair", "triple", "outside", "nothing"]
Document = dict[str, Any]

NAMED: Mapping[str, Truth] = dict(zip(("rosub", "observation", "small"), VEHICLES, strict=True))
TOGETHER: Mapping[Kind, int] = {"pair": 2, "triple": 3}
SCHEMA = "rovid-diagnosis/1"
VERDICTS = ("found", "suspected", "nothing_found", "unexplained", "too_little_data")
# Of the answer, what is kept; the next experiment may hold a whole command file.
KEPT = ("verdict", "base", "findings", "extended", "held_out_gain", "unexplained", "not_identifiable", "warnings")
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
NO_ANSWER = "no answer"
# From good to bad.
OUTCOMES: Mapping[Kind, tuple[str, ...]] = {
    "effect": ("exact", "class", "extra", "wrong", "unexplained", "missed", NO_ANSWER),
    "pair": ("exact", "class", "partial", "extra", "wrong", "unexplained", "missed", NO_ANSWER),
    "triple": ("exact", "class", "partial", "extra", "wrong", "unexplained", "missed", NO_ANSWER),
    "outside": ("right", "listed", "other driver", "named", "missed", NO_ANSWER),
    "nothing": ("clean", "unexplained", "false finding", NO_ANSWER),
}


# What is hidden


@dataclass(frozen=True, kw_only=True)
class Job:
    """One campaign to come; ``decoys``: all extra channels are logged though nothing depends on them."""

    vehicle: str
    name: str
    kind: Kind
    size: str
    cases: tuple[Case, ...] = ()
    decoys: bool = False

    def truth(self) -> Truth:
        vehicle = NAMED[self.vehicle]
        return truth_of(replace(vehicle, channels=EXTRA) if self.decoys else vehicle, self.cases)

    def parameters(self) -> dict[str, float]:
        """True value of each parameter that the contract defines, as ``effect.name`` or ``effect:thruster.name``."""
        return {
            f"{hidden.effect}{f':{hidden.thruster}' if hidden.thruster else ''}.{name}": value
            for case in self.cases
            for hidden in case.hidden
            for name, value in (case.expected_parameters or {}).items()
        }


def seed_of(*parts: object) -> int:
    """Seed of a campaign, independent of the other campaigns in the sweep."""
    return zlib.crc32("/".join(map(str, parts)).encode())


def planned(arguments: argparse.Namespace) -> list[Job]:
    """Requested campaigns in random order: an interrupted sweep is then a fair sample."""
    vehicles = list(NAMED) if arguments.vehicle == "all" else [arguments.vehicle]
    counts = {"pair": arguments.pairs, "triple": arguments.triples}
    jobs: list[Job] = []
    for vehicle in vehicles:
        jobs += single_jobs(vehicle, arguments.cases)
        jobs += nothing_jobs(vehicle, arguments.nothing)
        for kind, together in TOGETHER.items():
            jobs += group_jobs(vehicle, kind, together, counts[kind], arguments.seed)
    order = np.random.default_rng(arguments.seed).permutation(len(jobs))
    return [jobs[k] for k in order]


def single_jobs(vehicle: str, wanted: Sequence[str] | None) -> Iterator[Job]:
    for case in all_cases(NAMED[vehicle]):
        if case.hidden and (wanted is None or any(part in case.name for part in wanted)):
            kind: Kind = "outside" if case.driver else "effect"
            size = case.name.rpartition("-")[2]
            yield Job(vehicle=vehicle, name=case.name, kind=kind, size=size, cases=(case,))


def nothing_jobs(vehicle: str, count: int) -> Iterator[Job]:
    for number in range(1, count + 1):
        decoys = number % 2 == 0
        name = f"nothing-{number}{'-decoys' if decoys else ''}"
        yield Job(vehicle=vehicle, name=name, kind="nothing", size="", decoys=decoys)


def group_jobs(vehicle: str, kind: Kind, together: int, count: int, seed: int) -> Iterator[Job]:
    drawn = groups(NAMED[vehicle], together=together, count=count, seed=seed_of(seed, vehicle, kind))
    by_name = {" + ".join(case.name for case in group): group for group in drawn}  # a group may be drawn twice
    for name, group in by_name.items():
        yield Job(vehicle=vehicle, name=name, kind=kind, size="strong", cases=group)


# Answers and their evaluation


@dataclass(frozen=True, kw_only=True)
class Result:
    """A campaign, its hidden effects and rovid's answer; without an answer, ``error`` has the reason.

    Attributes
    ----------
    seed, campaign_seed
        Seeds of the sweep, and of this campaign's disturbance and noise.
    expected
        Effects by their names in the contract.
    plain
        Whether they are in the contract's forms.
    parameters, dynamics
        True values, the drag in rovid's terms.
    seconds
        Duration of the diagnosis.
    """

    seed: int
    campaign_seed: int
    vehicle: str
    name: str
    kind: Kind
    size: str
    expected: tuple[str, ...]
    driver: str | None
    plain: bool
    parameters: Mapping[str, float]
    dynamics: Mapping[str, float]
    seconds: float
    answer: Document | None
    error: str | None

    @property
    def key(self) -> tuple[int, str, str]:
        return self.seed, self.vehicle, self.name


def run(job: Job, seed: int, rovid: Path, limit: float) -> Result:
    """Write the campaign into a scratch folder and have it diagnosed there."""
    campaign_seed = seed_of(seed, job.vehicle, job.name)
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        truth = write_trial_day(scratch / "logs", seed=campaign_seed, truth=job.truth())
        begun = time.perf_counter()
        answer, error = diagnosed(scratch, rovid, limit)
        seconds = time.perf_counter() - begun
    return Result(
        seed=seed,
        campaign_seed=campaign_seed,
        vehicle=job.vehicle,
        name=job.name,
        kind=job.kind,
        size=job.size,
        expected=tuple(case.expected_effect for case in job.cases if case.expected_effect is not None),
        driver=next((case.driver for case in job.cases), None),
        plain=all(case.expected_parameters is not None for case in job.cases),
        parameters=job.parameters(),
        dynamics=asdict(truth.dynamics) | restated_drag(truth),
        seconds=round(seconds, 2),
        answer=answer,
        error=error,
    )


def restated_drag(truth: Truth) -> dict[str, float]:
    """Drag in rovid's terms, where the hidden form shares it out in another way."""
    drag = {}
    for hidden in truth.hidden:
        p = hidden.parameters
        if (hidden.effect, hidden.form) == ("added_mass_memory", "cummins"):
            # At a steady rate the memory brakes as a linear drag does.
            drag["linear_drag"] = truth.dynamics.linear_drag + p["inertia"] / p["time_constant"]
        elif (hidden.effect, hidden.form) == ("drag_curvature", "exponent"):
            ratio = (REFERENCE_RATE / p["rate"]) ** (p["exponent"] - 2.0)
            drag["quadratic_drag"] = truth.dynamics.quadratic_drag * ratio
    return drag


def diagnosed(scratch: Path, rovid: Path, limit: float) -> tuple[Document | None, str | None]:
    """(answer, None), or (None, error message)."""
    command = [str(rovid), "diagnose", "logs", "--json", "-p", "parameters.toml"]
    try:
        done = subprocess.run(
            command,
            cwd=scratch,
            env=os.environ | ONE_THREAD,
            capture_output=True,
            text=True,
            timeout=limit,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return None, f"took more than {limit:.0f} s"
    if done.returncode:
        return None, f"exit status {done.returncode}: {done.stderr.strip()[-2000:]}"
    try:
        return checked(json.loads(done.stdout)), None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        return None, f"not the document of the contract: {error!r}"


def checked(document: Document) -> Document:
    """What is kept of ``document``, once everything that is scored can be read from it."""
    if document["schema"] != SCHEMA or document["verdict"] not in VERDICTS:
        msg = f"schema {document['schema']}, verdict {document['verdict']}"
        raise ValueError(msg)
    kept = {name: document[name] for name in KEPT if name in document}
    if unknown := {name for finding in findings(kept) for name in finding.names} - set(EFFECTS):
        msg = f"effects {sorted(unknown)}"
        raise ValueError(msg)
    drivers(kept)
    stated(kept)
    return kept


@dataclass(frozen=True)
class Finding:
    """A named effect, and the rivals from which it ``cannot`` be distinguished."""

    effect: str
    cannot: frozenset[str]

    @property
    def names(self) -> frozenset[str]:
        return self.cannot | {self.effect}

    def __str__(self) -> str:
        return " or ".join((self.effect, *sorted(self.cannot)))


def findings(answer: Document) -> list[Finding]:
    return [
        Finding(plain_name(each["effect"]), frozenset(plain_name(name) for name in each["cannot_be_told_from"]))
        for each in answer["findings"]
    ]


def plain_name(key: str) -> str:
    """Effect of a key that may say its form or its thruster as well."""
    return key.partition(":")[0]


def drivers(answer: Document) -> list[str]:
    """Signals on which what is left depends, the first one first."""
    return [str(name) for name in (answer.get("unexplained") or {}).get("depends_on") or ()]


def stated(answer: Document) -> dict[str, tuple[float, float]]:
    """(value, standard error) of the last model's parameters: the extended one's, the base's where there is none.

    The names have the form or the thruster of the effect, where its finding says one.
    """
    model = answer.get("extended") or answer.get("base") or {}
    forms = {each["effect"]: each.get("form") for each in answer["findings"]}
    found = {}
    for name, each in (model.get("parameters") or {}).items():
        key, _, parameter = name.rpartition(".")
        full = f"{key}:{forms[key]}.{parameter}" if forms.get(key) else name
        found[full] = number(each["value"]), number(each.get("standard_error"))
    return found


def number(value: float | None) -> float:
    return math.nan if value is None else float(value)


# Whether it is right


def outcome(result: Result) -> str:
    """One of OUTCOMES."""
    answer = result.answer
    if answer is None or answer["verdict"] == "too_little_data":
        return NO_ANSWER
    said, unexplained = findings(answer), answer["verdict"] == "unexplained"
    if result.kind == "nothing":
        return "false finding" if said else "unexplained" if unexplained else "clean"
    if result.kind == "outside":
        return "named" if said else of_driver(result.driver, drivers(answer)) if unexplained else "missed"
    if not said:
        return "unexplained" if unexplained else "missed"
    return of_names(frozenset(result.expected), said)


def of_names(expected: frozenset[str], said: Sequence[Finding]) -> str:
    covered = expected <= frozenset().union(*(finding.names for finding in said))
    if unrelated(expected, said):
        return "extra" if covered else "wrong"
    if not covered:
        return "partial"
    named = {finding.effect for finding in said}
    return "exact" if named == expected and not any(finding.cannot for finding in said) else "class"


def unrelated(expected: frozenset[str], said: Sequence[Finding]) -> list[Finding]:
    """Names stated with confidence that are wrong: nothing that is hidden is among what they might be."""
    return [finding for finding in said if not finding.names & expected]


def of_driver(driver: str | None, said: Sequence[str]) -> str:
    if driver not in said:
        return "other driver"
    return "right" if said[0] == driver else "listed"


@dataclass(frozen=True)
class Reading:
    """A parameter as it was stated against its ``truth``; not a number where it was not stated."""

    name: str
    truth: float
    value: float
    error: float

    @property
    def relative(self) -> float:
        return abs(self.value - self.truth) / abs(self.truth)

    @property
    def deviation(self) -> float:
        """In standard errors, without sign."""
        return abs(self.value - self.truth) / self.error if self.error > 0.0 else math.nan

    @property
    def good(self) -> bool:
        return self.relative <= 0.02 or self.deviation <= 2.0

    @property
    def there(self) -> bool:
        return math.isfinite(self.value)


def readings(result: Result, truth: Mapping[str, float]) -> list[Reading]:
    """What was stated of each parameter in ``truth``."""
    said = stated(result.answer) if result.answer else {}
    return [Reading(plain_name(name) + suffix(name), value, *looked_up(said, name)) for name, value in truth.items()]


def suffix(name: str) -> str:
    """``.name`` of a parameter behind its effect's form or thruster, if it is there."""
    return f".{name.rpartition('.')[2]}" if ":" in name else ""


def looked_up(said: Mapping[str, tuple[float, float]], name: str) -> tuple[float, float]:
    """(value, standard error) of ``name``, whatever the form that was said; but not of another thruster."""
    key, _, parameter = name.rpartition(".")
    effect, _, thruster = key.partition(":")
    for other, value in said.items():
        said_key, _, said_parameter = other.rpartition(".")
        said_effect, _, form = said_key.partition(":")
        if (said_effect, said_parameter) == (effect, parameter) and (not (thruster and form) or thruster == form):
            return value
    return math.nan, math.nan


# The page


def page(results: Sequence[Result], today: str) -> str:
    effects = [result for result in results if result.kind == "effect"]
    parts = [
        score_card(results),
        introduction(results, today),
        "## One hidden effect\n",
        totals(effects, "effect", lambda r: r.size),
        FORM_WORDS,
        totals(effects, "effect", lambda r: "plain" if r.plain else "other", by="form"),
        WORDS,
        "## Confusion matrix\n",
        confusion(results),
        "## Two and three hidden effects\n",
        *(several(results, kind) for kind in TOGETHER),
        "## Causes outside the catalogue\n",
        OUTSIDE_WORDS,
        totals(of_kind(results, "outside"), "outside", lambda r: r.size),
        "## No hidden cause\n",
        NOTHING_WORDS,
        totals(
            of_kind(results, "nothing"), "nothing", lambda r: "decoys" if "decoys" in r.name else "usual", by="logged"
        ),
        "## Parameters\n",
        PARAMETER_WORDS,
        dynamics_table(results),
        effect_parameters_table(results),
        "## Every case\n",
        case_table([r for r in results if r.kind in {"effect", "outside", "nothing"}]),
        *(group_table(of_kind(results, kind)) for kind in TOGETHER),
    ]
    return "\n".join(part for part in parts if part)


def introduction(results: Sequence[Result], today: str) -> str:
    numbers = sorted({result.seed for result in results})
    seeds = f"seed{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}"
    vehicles = "\n".join(
        f"- {name}: {truth.name}, {truth.dynamics.inertia:g} kg m², time constant {truth.time_constant:.2g} s;"
        for name, truth in NAMED.items()
        if any(result.vehicle == name for result in results)
    )
    return f"""\
## How it was measured

{len(results)} campaigns, {seeds}, {today}. Each is a day of {len(CAMPAIGN)} runs (holds, sines, steps, coasting,
each thruster alone) of a simulated vehicle with hidden causes, a random disturbance torque of about 2 % of the
average torque, and the noise and rounding of real instruments. The simulator shares no code with rovid. `rovid
diagnose` had the logs and the thrust curves, and its JSON was scored against the hidden causes. The vehicles:

{vehicles}

A "weak" cause is a few times the detection limit given by the disturbance, a "strong" cause is clearly visible.
"""


def score_card(results: Sequence[Result]) -> str:
    """How often right, how often a wrong name: in this sweep, and on the pages on hard water and on real logs."""
    head = ["test", "of", "right", "wrong", "neither"]
    rows = [*in_short(results), *in_wide_campaigns(), *in_hard_water(), *of_real_logs()]
    return f"""\
# Hit rates and errors of the diagnosis

{table(head, rows)}
Calm water follows the model equation exactly, and each campaign has a complete programme of runs. This is the
easiest case. [Hard water](hard.md) has waves, an autopilot or a pilot, and few runs; [real logs](real.md) have
their own difficulties. For your own logs, expect hit rates like those of hard water and real logs.
"""


def in_short(results: Sequence[Result]) -> Iterator[list[str]]:
    """A row for each kind of campaign."""
    labels: Mapping[Kind, str] = {
        "effect": "calm water, simulated: one hidden cause",
        "pair": "two hidden causes",
        "triple": "three hidden causes",
        "outside": "a cause outside the catalogue: its signal, no name",
        "nothing": "no hidden cause: nothing found",
    }
    right, wrong = ("exact", "right", "clean"), ("extra", "wrong", "named", "false finding")
    for kind, label in labels.items():
        counts = Counter(outcome(result) for result in of_kind(results, kind))
        whole = counts.total()
        good, bad = (sum(counts[each] for each in names) for names in (right, wrong))
        if whole:
            yield [label, str(whole), *(share(each, whole) for each in (good, bad, whole - good - bad))]


def in_wide_campaigns() -> Iterator[list[str]]:
    """Rows from the section on wide campaigns, if the section exists."""
    text = marked_section(DOCS / "confusion.md")
    named, wrong, false = (
        re.search(f"{re.escape(words)}: (\\d+) of (\\d+)", text) for words in (EVIDENT_NAMED, EVIDENT_WRONG, FALSE)
    )
    if named and wrong:
        good, bad, whole = int(named[1]), int(wrong[1]), int(named[2])
        rest = whole - good - bad
        yield ["wide campaigns, simulated: evident causes", str(whole), *(share(n, whole) for n in (good, bad, rest))]
    if false:
        bad, whole = int(false[1]), int(false[2])
        yield ["no hidden cause: no false cause", str(whole), share(whole - bad, whole), share(bad, whole), "0"]


def in_hard_water() -> Iterator[list[str]]:
    """Rows from the page on hard water."""
    # The targets come before the results.
    _, _, text = " ".join((DOCS / "hard.md").read_text(encoding="utf-8").split()).partition(" Results: ")
    causes = re.search(r"(\d+) of (\d+) established causes are right", text)
    visible = re.search(r"(\d+) of (\d+) visible causes are", text)
    false = re.search(r"(\d+) of (\d+) campaigns without a hidden cause have", text)
    if causes is None or visible is None or false is None:
        raise SystemExit(f"{DOCS / 'hard.md'} does not say how many were right.")
    good, whole = int(causes[1]), int(causes[2])
    yield ["hard water, simulated: established causes", str(whole), share(good, whole), share(whole - good, whole), "0"]
    good, whole = int(visible[1]), int(visible[2])
    yield [
        "visible causes: established, or the first suspect",
        str(whole),
        share(good, whole),
        "",
        share(whole - good, whole),
    ]
    bad, whole = int(false[1]), int(false[2])
    yield ["no hidden cause: no false cause", str(whole), share(whole - bad, whole), share(bad, whole), "0"]


def of_real_logs() -> Iterator[list[str]]:
    """Totals of all sets on the page on real logs."""
    text = (DOCS / "real.md").read_text(encoding="utf-8")
    rows = [line.split("|")[2:8] for line in text.splitlines() if line.startswith("| [")]
    sums = [sum(int(row[column]) for row in rows) for column in range(6)]
    for label, counts in (("real logs: known facts", sums[:3]), ("real logs: established causes", sums[3:])):
        whole = sum(counts)
        yield [label, str(whole), *(share(each, whole) for each in counts)]


FORM_WORDS = """\
Results by the hidden form: "plain" is the default equation of the effect; "other" is the same physical effect
with another law.
"""
WORDS = """\
- exact: all hidden causes were named, no others, and no rival was left open;
- class: the hidden cause is among the names, but a rival is indistinguishable from it or was named first;
- extra: the hidden cause was named, and also a cause that does not act;
- wrong: a false cause was named, without the correct one among its rivals, and a hidden cause was not named;
- partial: some of several hidden causes were named, some were not;
- unexplained: an error was detected but not named; missed: no error was detected;
- no answer: an error, or too little data.
"""
OUTSIDE_WORDS = """\
A torque or a drag depends on a logged signal in a way that no effect of the catalogue has. Unrelated signals
are also logged. Right: reported as unexplained, with the true driver first. Listed: the driver is among the
listed signals, but not first. Other driver: unexplained, without the true signal. Named: an effect of the
catalogue was named, which is wrong.
"""
NOTHING_WORDS = """\
Clean: nothing was found. Unexplained: no effect was named, but a model error was reported. Every second
campaign also logs unrelated signals, as decoys.
"""
PARAMETER_WORDS = """\
Parameters of the final model compared with the truth. Good: within 2 % or within 2 standard errors. With
correct standard errors 68 % of the truths are within one and 95 % within two. Two hidden forms divide the drag
differently from rovid's equations. Their truth is converted: the steady damping of Cummins's memory term counts
as linear drag, and the quadratic drag of a power law is evaluated at 0.3 rad/s. A bent thrust curve, or a
thrust that follows the supply voltage, leaves the scale of all thrust undetermined; the standard errors of
inertia and drag include this uncertainty.
"""


def of_kind(results: Iterable[Result], kind: Kind) -> list[Result]:
    return [result for result in results if result.kind == kind]


def totals(results: Sequence[Result], kind: Kind, group: Callable[[Result], str], *, by: str = "size") -> str:
    """How often each outcome, for each vehicle and group, and for all vehicles together."""
    labels = sorted({group(result) for result in results}, reverse=True)
    vehicles = [name for name in NAMED if any(result.vehicle == name for result in results)]
    rows = [
        [vehicle, label, *counted(chosen, kind)]
        for vehicle in (*vehicles, *(["all"] if len(vehicles) > 1 else []))
        for label in labels
        if (chosen := [r for r in results if vehicle in {r.vehicle, "all"} and group(r) == label])
    ]
    if len(labels) > 1:
        rows.append(["all", "all", *counted(results, kind)])
    return table(["vehicle", by, "campaigns", *OUTCOMES[kind]], rows, left=2)


def counted(results: Sequence[Result], kind: Kind) -> list[str]:
    counts = Counter(outcome(result) for result in results)
    return [str(len(results)), *(share(counts[each], len(results)) for each in OUTCOMES[kind])]


def share(count: int, whole: int) -> str:
    """Count with its share of ``whole``, short enough for a column."""
    # An incomplete share is never rounded to 100 %, nor a share above zero to 0 %.
    percent = 100.0 if count == whole else min(max(round(100.0 * count / whole), 1), 99)
    return f"{count} ({percent:.0f} %)" if count else "0"


def several(results: Sequence[Result], kind: Kind) -> str:
    """Totals of the pairs or triples, and how many of all effects hidden in them were named."""
    chosen = of_kind(results, kind)
    if not chosen:
        return ""
    hidden = sum(len(result.expected) for result in chosen)
    named = sum(len(frozenset(result.expected) & named_by(result)) for result in chosen)
    intro = (
        f"{kind.capitalize()}s: of {hidden} hidden effects, {share(named, hidden)} were named or among the rivals.\n"
    )
    return f"{intro}\n{totals(chosen, kind, lambda r: r.size)}"


def named_by(result: Result) -> frozenset[str]:
    """Every name in the answer, rivals included."""
    said = findings(result.answer) if result.answer else []
    return frozenset().union(*(finding.names for finding in said))


def confusion(results: Sequence[Result]) -> str:
    """Rows: hidden; columns: named, by the numbers of the rows."""
    numbered = [(f"{k} {effect}", effect) for k, effect in enumerate(EFFECTS, 1)]
    last = ("class", "nothing", "unexplained", NO_ANSWER)
    rows = []
    for label, hidden in (*numbered, ("outside cause", "outside"), ("nothing", "nothing")):
        chosen = [r for r in results if r.expected == (hidden,) or r.kind == hidden]
        if chosen:
            counts = Counter(name for result in chosen for name in columns_of(result))
            rows.append([label, str(len(chosen)), *(str(counts[each] or "·") for each in (*EFFECTS, *last))])
    text = (
        "Campaigns with one hidden effect, a cause outside the catalogue, or no hidden cause. Column numbers "
        "refer to the rows.\n"
        "Class: the correct cause is among several indistinguishable ones. A campaign with two named effects counts\n"
        "in two columns.\n\n"
    )
    return text + table(["hidden", "campaigns", *(str(k) for k in range(1, len(EFFECTS) + 1)), *last], rows)


def columns_of(result: Result) -> list[str]:
    """Columns of the confusion matrix in which ``result`` counts."""
    answer = result.answer
    if answer is None or answer["verdict"] == "too_little_data":
        return [NO_ANSWER]
    expected = frozenset(result.expected)
    said = ["class" if finding.cannot and finding.names & expected else finding.effect for finding in findings(answer)]
    return list(dict.fromkeys(said)) or ["unexplained" if answer["verdict"] == "unexplained" else "nothing"]


def dynamics_table(results: Sequence[Result]) -> str:
    """Inertia and drags, by how the diagnosis went."""
    kinds: Mapping[str, Callable[[Result], bool]] = {
        "nothing hidden": lambda r: r.kind == "nothing",
        "named exactly, plain form": lambda r: outcome(r) == "exact" and r.plain,
        "named exactly, other form": lambda r: outcome(r) == "exact" and not r.plain,
        "otherwise": lambda r: r.kind != "nothing" and outcome(r) != "exact",
    }
    rows = [
        [label, *summary(name, [one for r in results if wanted(r) for one in readings(r, r.dynamics)])]
        for label, wanted in kinds.items()
        for name in ("inertia", "quadratic_drag", "linear_drag")
    ]
    return table(["diagnosis", *SUMMARY], [row for row in rows if row[2] != "0"], left=2)


def effect_parameters_table(results: Sequence[Result]) -> str:
    """The hidden effects' own parameters, in every campaign that hides them in the contract's form."""
    found = [one for result in results for one in readings(result, result.parameters)]
    rows = [summary(name, found) for name in sorted({one.name for one in found})]
    return table([*SUMMARY], rows)


SUMMARY = ("parameter", "campaigns", "stated", "within 1 se", "within 2 se", "within 2 %", "good", "median error")


def summary(name: str, found: Sequence[Reading]) -> list[str]:
    """A row of SUMMARY; the shares are of those that were stated."""
    chosen = [one for one in found if one.name == name]
    there = [one for one in chosen if one.there]
    if not there:
        return [name, str(len(chosen)), "0", *["-"] * (len(SUMMARY) - 3)]
    tests = (
        [one.deviation <= 1.0 for one in there],
        [one.deviation <= 2.0 for one in there],
        [one.relative <= 0.02 for one in there],
        [one.good for one in there],
    )
    shares = (f"{100 * sum(test) / len(there):.0f} %" for test in tests)
    median = statistics.median(one.relative for one in there)
    return [name, str(len(chosen)), str(len(there)), *shares, f"{100 * median:.2g} %"]


def case_table(results: Sequence[Result]) -> str:
    """What was said of each case, a column a vehicle."""
    names = [case.name for case in all_cases(VEHICLES[0])]
    order = sorted({r.name for r in results}, key=lambda name: (names.index(name) if name in names else -1, name))
    by_key: dict[tuple[str, str], list[str]] = {}
    for result in results:
        by_key.setdefault((result.vehicle, result.name), []).append(answer_in_words(result))
    vehicles = [name for name in NAMED if any(result.vehicle == name for result in results)]
    rows = [[name, *("; ".join(dict.fromkeys(by_key.get((one, name), []))) for one in vehicles)] for name in order]
    return table(["hidden", *vehicles], rows, left=1 + len(vehicles))


def group_table(results: Sequence[Result]) -> str:
    rows = [[result.vehicle, result.name, answer_in_words(result)] for result in results]
    return table(["vehicle", "hidden", "result"], sorted(rows), left=3)


def answer_in_words(result: Result) -> str:
    """Outcome, and what was said where the outcome alone does not tell."""
    said = outcome(result)
    if result.answer is None or said in {"exact", "right", "clean", "missed", NO_ANSWER}:
        return said
    names = [str(finding) for finding in findings(result.answer)] or drivers(result.answer)
    return f"{said}: {', '.join(names)}" if names else said


def table(header: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> str:
    """Markdown with aligned columns, the first ``left`` of them to the left; empty without rows."""
    if not rows:
        return ""
    widths = [max(3, *(len(row[k]) for row in (header, *rows))) for k in range(len(header))]
    pads = [str.ljust if k < left else str.rjust for k in range(len(header))]
    rule = ["-" * width if k < left else "-" * (width - 1) + ":" for k, width in enumerate(widths)]
    lines = (
        " | ".join(pad(cell, width) for pad, cell, width in zip(pads, row, widths, strict=True))
        for row in (header, rule, *rows)
    )
    return "\n".join(f"| {line} |" for line in lines) + "\n"


# The sweep


def read_results(path: Path) -> list[Result]:
    """The last result of each campaign in ``path``; a line that was cut short is left out."""
    found: dict[tuple[int, str, str], Result] = {}
    for number_, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        try:
            row = json.loads(line)
        except json.JSONDecodeError:
            print(f"{path}:{number_} was cut short and is left out", file=sys.stderr)
            continue
        values = {field.name: row[field.name] for field in fields(Result)}
        result = Result(**values | {"expected": tuple(values["expected"])})
        found[result.key] = result
    return list(found.values())


def append(path: Path, result: Result) -> None:
    """Add ``result`` with its score as one line, on disk at once."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(asdict(result) | {"outcome": outcome(result)}) + "\n")


def end_line(path: Path) -> None:
    """End the last line of ``path`` if it was cut short, so that the next one stands alone."""
    if path.exists() and path.stat().st_size and not path.read_bytes().endswith(b"\n"):
        with path.open("a", encoding="utf-8") as file:
            file.write("\n")


def sweep(jobs: Sequence[Job], arguments: argparse.Namespace) -> Iterator[Result]:
    """Results as they come, each written down before the next."""
    begun = time.perf_counter()
    end_line(arguments.results)
    with ThreadPoolExecutor(arguments.jobs) as pool:
        futures = [pool.submit(run, job, arguments.seed, arguments.rovid, arguments.limit) for job in jobs]
        try:
            for done, future in enumerate(as_completed(futures), 1):
                result = future.result()
                append(arguments.results, result)
                left = (time.perf_counter() - begun) / done * (len(jobs) - done) / 60.0
                print(f"[{done}/{len(jobs)}, {left:.0f} min left] {progress(result)}", file=sys.stderr)
                yield result
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def progress(result: Result) -> str:
    line = f"{result.vehicle} {result.name}: {answer_in_words(result)} ({result.seconds:.1f} s)"
    return f"{line}\n    {result.error.splitlines()[-1]}" if result.error else line


def parsed() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, help="of the sweep; that of the file to resume, or random, if not given")
    parser.add_argument("--jobs", type=int, default=2, help="campaigns at a time")
    parser.add_argument("--vehicle", choices=(*NAMED, "all"), default="all")
    parser.add_argument(
        "--cases", nargs="+", metavar="SUBSTRING", help="only single cases with one of these in their names"
    )
    for name, default in (("pairs", 10), ("triples", 5), ("nothing", 6)):
        text = f"campaigns for each vehicle; {default}, or none with --cases"
        parser.add_argument(f"--{name}", type=int, metavar="K", help=text)
        parser.set_defaults(**{f"{name}_default": default})
    parser.add_argument("--out", type=Path, default=Path("docs/confusion.md"), help="the page")
    parser.add_argument("--results", type=Path, metavar="FILE.jsonl", help="default: sweep-SEED.jsonl")
    parser.add_argument("--resume", type=Path, metavar="FILE.jsonl", help="leave out what is done there")
    parser.add_argument("--page-only", action="store_true", help="run nothing: the page of --resume")
    parser.add_argument("--limit", type=float, default=1800.0, metavar="S", help="for one diagnosis")
    parser.add_argument(
        "--rovid", type=Path, default=Path(sys.executable).with_name("rovid"), help="the command that is tried"
    )
    arguments = parser.parse_args()
    if arguments.page_only and not arguments.resume:
        parser.error("--page-only needs --resume")
    for name in ("pairs", "triples", "nothing"):
        if getattr(arguments, name) is None:
            setattr(arguments, name, 0 if arguments.cases else getattr(arguments, f"{name}_default"))
    # It is run from a scratch folder.
    arguments.rovid = arguments.rovid.absolute()
    return arguments


def main() -> None:
    arguments = parsed()
    earlier = read_results(arguments.resume) if arguments.resume else []
    if arguments.seed is None:
        arguments.seed = earlier[-1].seed if earlier else secrets.randbelow(10**6)
    arguments.results = arguments.results or arguments.resume or Path(f"sweep-{arguments.seed}.jsonl")
    print(f"seed {arguments.seed}, results in {arguments.results}", file=sys.stderr)
    results = {result.key: result for result in earlier if arguments.page_only or result.seed == arguments.seed}
    # What gave no answer is tried again.
    done = {key for key, result in results.items() if result.answer is not None}
    jobs = [] if arguments.page_only else planned(arguments)
    todo = [job for job in jobs if (arguments.seed, job.vehicle, job.name) not in done]
    try:
        for result in sweep(todo, arguments):
            results[result.key] = result
    except KeyboardInterrupt:
        print(f"stopped; go on with --resume {arguments.results}", file=sys.stderr)
        raise SystemExit(130) from None
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    today = datetime.now(UTC).date().isoformat()
    wide = marked_section(arguments.out)
    arguments.out.write_text(page(list(results.values()), today) + wide, encoding="utf-8", newline="\n")
    print(arguments.out)


if __name__ == "__main__":
    main()
