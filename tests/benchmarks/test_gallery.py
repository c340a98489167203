"""The gallery of real logs: how it judges, what it keeps, and that its page says what a rerun gives."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchmarks import real
from benchmarks.gallery import SETS
from benchmarks.gallery.ardusub import FLASH, TLOG
from benchmarks.gallery.base import RealSet
from benchmarks.gallery.esso_osaka import ESSO
from benchmarks.gallery.judge import (
    RIGHT,
    UNDECIDED,
    WRONG,
    Answer,
    Cause,
    Claim,
    commands_within,
    guesses,
    judge_cause,
    names,
    number,
    parameter,
    physical,
    ratio,
    refuses,
    size_of,
)
from benchmarks.gallery.kaxan import BENCH
from benchmarks.gallery.motors import CAR, LOOP, MOTOR
from benchmarks.gallery.page import Record, judged, named, page_of
from tests.conftest import ROOT, SAMPLES, Rovid, slow

PAGE = ROOT / "docs" / "real.md"
CAUSES = (
    Cause(effects=("thruster_lag", "command_delay"), acts=True, why="It acts."),
    Cause(effects=("tank_seiche",), acts=False, why="It does not."),
    Cause(effects=("wave_torque",), acts=None, why="Nobody knows."),
)


def answer(document: dict[str, Any] | None, code: int | None = 0, message: str = "") -> Answer:
    return Answer(words=("x",), seconds=1.0, processor_seconds=1.0, code=code, document=document, message=message)


def cause(effect: str, confidence: float | None = None, rivals: tuple[str, ...] = ()) -> dict[str, Any]:
    size = {"time_constant": {"value": 0.4, "standard_error": 0.1, "unit": "s"}}
    return {"effect": effect, "parameters": size, "confidence": confidence, "cannot_be_told_from": list(rivals)}


def diagnosis(*findings: dict[str, Any], suspects: tuple[dict[str, Any], ...] = (), verdict: str = "found") -> Answer:
    return answer({"verdict": verdict, "findings": list(findings), "suspects": list(suspects)})


@pytest.mark.parametrize(
    ("value", "error", "word"),
    [
        (2.50, 0.01, RIGHT),
        (2.40, 0.06, RIGHT),  # its interval reaches 2.52
        (2.40, 0.04, WRONG),
        (2.90, None, WRONG),
        (2.55, 1.0, UNDECIDED),  # two standard errors are as much as most of it
    ],
)
def test_a_number_is_held_against_what_is_known(value: float, error: float | None, word: str) -> None:
    judge = number(parameter("parameters", "inertia"), 2.5, 2.6, "kg m²")
    said = answer({"parameters": {"inertia": {"value": value, "standard_error": error, "unit": "kg m^2"}}})
    assert judge(said).word == word
    assert judge(answer({"parameters": {}})).word == UNDECIDED
    assert judge(answer(None, None)).said == "did not end within 1 s"


def test_the_error_of_a_ratio_is_that_of_both_numbers() -> None:
    read = ratio(parameter("above"), parameter("below"))
    found = read({"above": {"value": 6.0, "standard_error": 0.6}, "below": {"value": 3.0, "standard_error": 0.3}})
    assert found == pytest.approx((2.0, 2.0 * 0.02**0.5))
    assert read({"above": {"value": 6.0}, "below": {"value": 0.0}}) is None


@pytest.mark.parametrize(
    ("said", "word"),
    [
        (diagnosis(cause("thruster_lag", 0.99)), RIGHT),
        (diagnosis(cause("slew_limit", rivals=("thruster_lag",))), RIGHT),
        (diagnosis(suspects=(cause("thruster_lag", 0.3),), verdict="suspected"), RIGHT),  # the first of them
        (diagnosis(suspects=(cause("bias_torque", 0.6), cause("thruster_lag", 0.3))), UNDECIDED),
        (diagnosis(suspects=(cause("bias_torque", 0.9), cause("thruster_lag", 0.6))), RIGHT),
        (diagnosis(cause("bias_torque", 0.99)), WRONG),
        (diagnosis(verdict="nothing_found"), WRONG),
        (diagnosis(verdict="unexplained"), WRONG),
        (diagnosis(verdict="too_little_data"), UNDECIDED),
        (answer(None, None), UNDECIDED),
        (answer(None, 2, "rovid: no."), UNDECIDED),
    ],
)
def test_a_cause_that_is_plain_to_see_has_to_be_named(said: Answer, word: str) -> None:
    assert names("thruster_lag", "command_delay")(said).word == word


def test_a_class_is_not_a_name_where_that_is_wanted() -> None:
    judge = names("thruster_lag", by_name=True)
    of_a_class = cause("slew_limit", 0.97, rivals=("thruster_lag",))
    said = judge(diagnosis(of_a_class))
    assert (said.word, said.said) == (UNDECIDED, "`slew_limit` with confidence 0.97, of a class with it")
    assert judge(diagnosis(of_a_class, suspects=(cause("thruster_lag", 0.4),))).word == RIGHT


@pytest.mark.parametrize(
    ("found", "established", "word", "why"),
    [
        (cause("command_delay"), True, RIGHT, "It acts."),
        (cause("command_delay", 0.2), False, RIGHT, "It acts."),
        (
            cause("slew_limit", rivals=("thruster_lag",)),
            True,
            RIGHT,
            "The cause is named as a member of a class. It acts.",
        ),
        (cause("tank_seiche", 0.99), True, WRONG, "It does not."),
        (cause("tank_seiche", rivals=("thruster_lag",)), True, WRONG, "It does not."),
        (cause("tank_seiche", 0.6), False, WRONG, "It does not."),
        (cause("tank_seiche", 0.3), False, UNDECIDED, "It does not."),
        (cause("wave_torque", 0.99), True, UNDECIDED, "Nobody knows."),
        (cause("bias_torque", 0.99), True, UNDECIDED, "No independent evidence for or against the cause."),
    ],
)
def test_each_cause_that_is_named_is_judged(found: dict[str, Any], established: bool, word: str, why: str) -> None:
    judgement = judge_cause(found, established=established, causes=CAUSES)
    assert (judgement.word, judgement.said) == (word, why)


@pytest.mark.parametrize(
    ("said", "word"),
    [
        (answer(None, 2, "rovid: it hardly turns."), RIGHT),
        (answer(None, 2, "rovid: it hardly turns.\nAnd more."), WRONG),
        (diagnosis(verdict="too_little_data"), RIGHT),
        (diagnosis(verdict="unexplained"), WRONG),
        (answer({"parameters": {"drag": {"value": 3.0, "standard_error": 0.1, "unit": "1"}}}), WRONG),
        (answer(None, None), UNDECIDED),
    ],
)
def test_where_nothing_can_be_known_a_refusal_is_right(said: Answer, word: str) -> None:
    assert refuses(said).word == word


def test_guesses_are_held_against_what_the_log_says_of_itself() -> None:
    said = answer({
        "signals": {"bin": {"supply_voltage": {"source": "BAT.Instance"}}},
        "commands": {"bin": [{"source": "RCOU.C1"}, {"source": "RCOU.C9"}]},
    })  # fmt: skip
    assert guesses("supply_voltage", ["BAT.Volt"])(said).word == WRONG
    assert guesses("supply_voltage", ["BAT.Instance"])(said).word == RIGHT
    assert guesses("depth", ["BARO.Alt"])(said).word == UNDECIDED
    assert commands_within(["RCOU.C1"])(said).word == WRONG
    assert commands_within(["RCOU.C1", "RCOU.C9"])(said).word == RIGHT


def test_parameters_are_physical_or_not() -> None:
    def said(inertia: float, drag: float) -> Answer:
        values = {"inertia": inertia, "linear_drag": drag}
        return answer({
            "parameters": {name: {"value": value, "standard_error": 0.1, "unit": "1"} for name, value in values.items()}
        })  # fmt: skip

    assert physical("parameters")(said(1.0, 0.0)).word == RIGHT
    assert physical("parameters")(said(1.0, -0.1)).word == WRONG
    assert physical("parameters")(said(0.0, 0.1)).word == WRONG
    assert physical("extended", "parameters")(answer({"extended": None})).word == UNDECIDED


def test_a_traceback_is_wrong_and_a_step_that_was_left_out_undecided() -> None:
    claim = Claim(known="", step="x", judge=refuses)
    assert claim.judged(answer(None, 1, "Traceback")).word == WRONG
    assert claim.judged(None).word == UNDECIDED


def test_the_size_of_a_cause_is_read_from_suspects_too() -> None:
    document = diagnosis(suspects=(cause("thruster_lag", 0.4),)).document
    assert document is not None
    assert size_of("thruster_lag", "time_constant")(document) == (0.4, 0.1)
    assert size_of("command_delay", "delay")(document) is None


def test_the_judgement_of_a_set_follows_what_a_rerun_says() -> None:
    def record(said: Answer) -> Record:
        return Record(key="esso_osaka", answers={"diagnose": said}, config="", made_by="", cores=1)

    def words(said: Answer) -> list[str]:
        return [judgement.word for judgement in judged(ESSO, record(said))]

    assert words(diagnosis(cause("drag_asymmetry", 0.97)))[-1] == RIGHT
    assert words(diagnosis(cause("coulomb_resistance", 0.97)))[-1] == WRONG
    assert words(answer(None, None))[-1] == UNDECIDED
    said = diagnosis(cause("coulomb_resistance", 0.97), suspects=(cause("sideslip_moment", 0.8),))
    worth = [(kind, judgement.word) for kind, _, judgement in named(ESSO, record(said))]
    assert worth == [("established", WRONG), ("suspected", RIGHT)]


@pytest.mark.parametrize(
    ("said", "word"),
    [
        ({"seconds": 900.0, "processor_seconds": 7.9}, "yes"),  # others had the machine
        ({"seconds": 9.0, "processor_seconds": 15.0}, "**no**"),
        ({"seconds": 4.9, "processor_seconds": 9.0, "code": 2}, "yes"),
        ({"seconds": 6.0, "processor_seconds": 5.1, "code": 2}, "**no**"),
        ({"seconds": 600.0, "processor_seconds": 1.0, "code": None}, "**no**"),
    ],
)
def test_the_page_says_what_took_too_long(said: dict[str, Any], word: str) -> None:
    check = replace(answer({"logs": [{"duration": 90.0}, {"duration": 30.0}]}), words=("check",))
    slow = replace(answer(None), words=("diagnose",), **said)
    record = Record(key="kaxan", answers={"check": check, "diagnose": slow}, config="", made_by="", cores=2)
    page = page_of([(BENCH, record)], {"kaxan": []})
    row = next(line for line in page.splitlines() if line.startswith("| `diagnose` | "))
    assert row.endswith(f"| {word} |")
    assert "The logs last 2.0 minutes." in page


def test_every_claim_has_its_step() -> None:
    for one in SETS:
        steps = [step.name for step in one.steps]
        assert len(steps) == len(set(steps))
        assert {claim.step for claim in one.claims} <= set(steps)


def test_a_page_that_tells_where_the_logs_are_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "real.md"
    words = ["real", "--data", str(SAMPLES), "--state", str(tmp_path / "state"), "--page", str(page), "--only"]
    monkeypatch.setattr(real, "page_of", lambda *_: f"read from {SAMPLES}")
    monkeypatch.setattr("sys.argv", words)
    with pytest.raises(SystemExit, match="where the logs are"):
        real.main()
    assert not page.exists()


@pytest.mark.slow
def test_a_set_is_run_kept_and_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "docs" / "real.md"
    page.parent.mkdir()
    words = ["real", "--data", str(SAMPLES), "--state", str(tmp_path / "state"), "--page", str(page)]
    monkeypatch.setattr("sys.argv", [*words, "--only", "kaxan"])
    real.main()
    text = page.read_text(encoding="utf-8")
    assert "| The upper end of 540 | `fit-thruster` | 0.7333 V | right |  |" in text
    assert (page.parent / "pictures" / "real_kaxan.png").stat().st_size > 5000
    assert str(tmp_path) not in text
    kept = real.read_record(tmp_path / "state" / "kaxan.json")
    assert kept is not None
    assert set(kept.answers) == {"kaxan_520", "kaxan_540"}
    assert all(one.processor_seconds > 0.1 and 0.1 < one.seconds < 60.0 for one in kept.answers.values())
    # Asked for nothing, it writes the page of what it kept.
    monkeypatch.setattr(real, "ask", None)
    monkeypatch.setattr("sys.argv", [*words, "--only"])
    real.main()
    assert page.read_text(encoding="utf-8") == text


def test_a_command_that_takes_too_long_is_ended_and_said(tmp_path: Path) -> None:
    said = real.ask(TLOG.steps[0], tmp_path, timeout=0.05)
    assert (said.code, said.document) == (None, None)
    assert said.end.startswith("did not end within")


@pytest.mark.parametrize("one", [TLOG, FLASH], ids=lambda one: one.key)
def test_the_page_says_of_the_ardusub_samples_what_rovid_does(one: RealSet, rovid: Rovid) -> None:
    Path(one.key).mkdir()
    shutil.copy(SAMPLES / one.logs, one.key)
    page = PAGE.read_text(encoding="utf-8")
    for step in one.steps:
        words = step.words.split()
        done = rovid(*words, "--json")
        said = answer(done.document if done.code == 0 else None, done.code, done.err.strip())
        for claim in (claim for claim in one.claims if claim.step == step.name):
            judgement = claim.judged(said)
            row = f"| {claim.known} | `{words[0]}` | {judgement.said} | "
            assert row in page, f"run python -m benchmarks.real again: {row}"
            assert page.partition(row)[2].partition(" |")[0].strip("*") == judgement.word


@pytest.mark.parametrize("one", [CAR, LOOP, slow(MOTOR)], ids=lambda one: one.key)
def test_logs_of_other_fields_are_read_as_they_are_and_give_no_false_cause(one: RealSet, rovid: Rovid) -> None:
    """Every claim is judged as expected, and no cause is named that is known not to act."""
    # The motor's dead time is missing in the plain model: the error of its time constant is too large to decide.
    expected = UNDECIDED if one is MOTOR else RIGHT
    Path(one.key).mkdir()
    for log in SAMPLES.glob(one.logs):
        shutil.copy(log, one.key)
    for name, text in one.texts.items():
        Path(one.key, name).write_text(text, encoding="utf-8")
    for step in (step for step in one.steps if not step.needs):
        done = rovid(*step.words.split(), "--json")
        said = answer(done.document if done.code == 0 else None, done.code, done.err.strip())
        for claim in (claim for claim in one.claims if claim.step == step.name):
            judgement = claim.judged(said)
            assert (judgement.word, judgement.said) == (expected, judgement.said)
        if step.name == "diagnose" and said.document is not None:
            for found, established in (("findings", True), ("suspects", False)):
                for named_cause in said.document[found]:
                    word = judge_cause(named_cause, established=established, causes=one.causes).word
                    assert word != WRONG, named_cause["effect"]
            assert not said.document["faults"]
