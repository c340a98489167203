"""Trials, and intervals of logs that are excluded."""

from __future__ import annotations

import pickle
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import ConfigError
from rovid.trial.axis import AXES
from rovid.trial.config import load_config
from rovid.trial.preprocessing import Exclusion, split
from rovid.trial.trial import Remark, merged_remarks
from tests.conftest import SAMPLES, Rovid
from tests.synthetic import assert_same_trial, clock, trial
from tests.trial.test_vehicle import CURVE

NOTED = Remark(kind="gap", count=2, text="It has gaps.")


def test_a_trial_whose_arrays_differ_in_length_is_a_mistake() -> None:
    time = clock(1.0)
    for heading, command in ((time[1:], time), (time, time[1:])):
        with pytest.raises(ValueError, match="log"):
            trial(time, command, heading)


def test_arrays_are_read_only() -> None:
    record = trial(clock(1.0), np.zeros(21))
    for array in (record.time, record.position, record.commands, CURVE.thrust):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_a_trial_from_another_process_is_as_it_was() -> None:
    record = replace(
        trial(clock(1.0), np.arange(21.0)),
        axis=AXES["surge"],
        extras={"way": np.ones(21)},
        remarks=(NOTED,),
        companion_files=(Path("b"),),
    )
    other = pickle.loads(pickle.dumps(record))  # noqa: S301 - of this process
    assert_same_trial(record, other)
    assert other.axis is record.axis
    for array in (other.time, other.commands, other.extras["way"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 2.0
    with pytest.raises(TypeError):
        other.extras["way"] = other.time


def test_what_was_noticed_in_many_trials_is_said_once() -> None:
    """The same but for numbers by themselves is the same; a column's own number is not."""
    texts = {
        "a": ("gap", 2, "The heading has gaps (2, of 3.5 s in all)."),
        "b": ("gap", 5, "The heading has gaps (5, of 9.0 s in all)."),
        "c": ("missing", 1, "pwm1 is missing in 1 samples."),
        "d": ("missing", 1, "pwm2 is missing in 1 samples."),
    }
    plain = trial(clock(1.0), np.zeros(21))
    trials = [
        replace(plain, name=name, remarks=(Remark(kind=kind, count=count, text=text),))
        for name, (kind, count, text) in texts.items()
    ]
    assert merged_remarks(trials) == [
        "b: The heading has gaps (5, of 9.0 s in all). Likewise in a (2).",
        "c: pwm1 is missing in 1 samples.",
        "d: pwm2 is missing in 1 samples.",
    ]
    many = [trials[0], *(replace(trials[1], name=name) for name in "tuvwxyz")]
    assert merged_remarks(many)[0].endswith("Likewise in u (5), v (5), w (5), x (5), y (5) and 2 more.")


def test_what_is_between_two_stretches_is_a_trial_by_itself() -> None:
    time = clock(60.0)
    whole = trial(time, np.zeros(len(time)), 0.01 * time)
    parts = split(whole, [Exclusion(log="*", begin=10.0, end=20.0, reason="tether"), Exclusion(log="*", begin=50.0)])
    assert [(round(part.campaign_time + 1e-9, 1), round(part.duration)) for part in parts] == [(0.0, 10), (20.1, 30)]
    assert {part.parent for part in parts} == {whole.name}
    said = [remark.text for part in parts for remark in part.remarks if remark.kind == "left out"]
    assert said == ["Left out, 10 to 20 s: tether.", "Left out, all from 50 s on, as rovid.toml says."]


def test_a_log_that_is_cut_at_its_ends_keeps_its_name() -> None:
    time = clock(60.0)
    whole = trial(time, np.zeros(len(time)), 0.01 * time)
    (part,) = split(whole, [Exclusion(log=whole.name, end=5.0)])
    assert part.name == whole.name
    assert split(whole, [Exclusion(log="other.csv")]) == [whole]
    assert split(whole, [Exclusion(log="*")]) == []


def day(folder: Path, text: str) -> Path:
    shutil.copytree(SAMPLES / "rosub_hidden", folder)
    with (folder / "rovid.toml").open("a", encoding="utf-8") as file:
        file.write(text)
    return folder


@pytest.mark.slow
def test_it_is_said_by_check_and_by_a_fit(tmp_path: Path, rovid: Rovid) -> None:
    block = '\n[[leave_out]]\nlog = "steps.csv"\nfrom = 40\nto = 90\nreason = "the tether caught"\n'
    day(tmp_path / "day", block)
    checked = rovid("check", "day", "--json").document
    names = [log["name"] for log in checked["logs"]]
    assert sum(name.startswith("steps.csv, ") for name in names) == 2
    assert any("the tether caught" in text for text in rovid("fit", "day", "--json").document["warnings"])
    # What was fitted without it does not hold with it.
    (tmp_path / "day" / "rovid.toml").write_text(
        (tmp_path / "day" / "rovid.toml").read_text(encoding="utf-8").replace("to = 90", "to = 95"), encoding="utf-8"
    )
    assert "left out of steps.csv" in rovid("simulate").err


def test_a_log_that_is_not_there_is_named(tmp_path: Path, rovid: Rovid) -> None:
    day(tmp_path / "day", '\n[[leave_out]]\nlog = "step.csv"\nfrom = 40\nto = 90\n')
    said = rovid("check", "day").out.replace("\n", " ")
    assert "'step.csv' was ignored: no log has this name. Nearest: 'steps.csv'" in said


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ("from = 3\n", "has no log"),
        ('log = "a.csv"\nfrom = 9\nto = 3\n', "ends at 3 s and begins at 9 s"),
        ('log = "a.csv"\nuntil = 3\n', "'until'"),
        ('log = "a.csv"\nto = "late"\n', "'late'"),
    ],
)
def test_a_wrong_block_is_refused(block: str, words: str, tmp_path: Path) -> None:
    folder = day(tmp_path / "day", f"\n[[leave_out]]\n{block}")
    with pytest.raises(ConfigError, match=r"rovid\.toml: \[\[leave_out\]\] number 1") as refused:
        load_config(folder / "rovid.toml")
    assert words in str(refused.value)
