"""What rovid makes of made-up folders is scored as it should be, and rovid says what it does not find in them."""

from __future__ import annotations

import json
import secrets
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from benchmarks import folders
from tests.conftest import run_rovid
from tools.folders import Folder, write_folder

TRUTH = Folder(
    format="csv",
    heading="cap_rad",
    heading_unit="rad",
    turned_round=False,
    thrusters={"babord": 1, "tribord": -1, "vertical": 0},
    decoys={"phares": "lights"},
    time="temps",
    time_unit="s",
    kind="%",
    neutral=0.0,
)
HEADING = 'heading = { csv = "cap_rad", unit = "rad" }'


def thruster(column: str, arm: float) -> str:
    return f'[[thrusters]]\nyaw_arm = {arm}\ncommand = {{ csv = "{column}" }}\n'


SCREWS = thruster("babord", 1.0) + thruster("tribord", -0.3)


@pytest.mark.parametrize(
    ("blocks", "heading", "said", "verdict"),
    [
        (SCREWS, HEADING, [], "right"),
        (SCREWS, HEADING.replace('"rad"', '"deg"'), [], "wrong"),
        (SCREWS, HEADING.replace("cap_rad", "consigne_cap"), [], "wrong"),
        (SCREWS, "", [], "wrong"),
        ("", "", ["heading"], "open"),
        (thruster("babord", 1.0), HEADING, [], "wrong"),
        (thruster("babord", 1.0), HEADING, ["whether tribord turns the vehicle"], "open"),
        (thruster("babord", 1.0) + thruster("tribord", 1.0), HEADING, ["heading"], "wrong"),
        (SCREWS + thruster("vertical", 1.0), HEADING, [], "wrong"),
        (SCREWS + thruster("phares", 1.0), HEADING, [], "wrong"),
        (thruster("babord", -1.0) + thruster("tribord", 1.0), HEADING.replace(" }", ", sign = -1 }"), [], "right"),
    ],
)
def test_a_score(
    blocks: str, heading: str, said: list[str], verdict: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def answered(folder: Path) -> CompletedProcess[str]:
        (folder / "rovid.toml").write_text(f'{blocks}\n[signals]\ntime = "temps"\n{heading}\n')
        return CompletedProcess([], 0, json.dumps({"open": said, "warnings": []}), "")

    monkeypatch.setattr(folders, "init", answered)
    assert folders.scored(tmp_path, TRUTH).verdict == verdict


def in_process(folder: Path) -> CompletedProcess[str]:
    done = run_rovid("init", folder, "--json", "--force")
    return CompletedProcess([], done.code, done.out, done.err)


@pytest.mark.parametrize(
    ("code", "message", "verdict"),
    [(2, "rovid: a.csv: holds no heading.", "open"), (2, "rovid: no.", "wrong"), (1, "Traceback heading", "wrong")],
)
def test_a_refusal(code: int, message: str, verdict: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(folders, "init", lambda _: CompletedProcess([], code, "", message))
    assert folders.scored(tmp_path, TRUTH).verdict == verdict


@pytest.mark.slow
def test_what_is_not_found_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # In this process, for a start of Python at every folder would take most of the time.
    monkeypatch.setattr(folders, "init", in_process)
    seed, wrong = secrets.randbelow(10**6), []
    for index in (0, 3, 8, 13, 18, 26):
        truth = write_folder(tmp_path / str(index), seed=seed, index=index)
        score = folders.scored(tmp_path / str(index), truth)
        if score.verdict == "wrong":
            wrong.append((index, truth.about, score.faults))
    # Of 40 of a further seed none was wrong; a word that nobody thought of may come up.
    assert len(wrong) <= 1, f"seed {seed}: {wrong}"
