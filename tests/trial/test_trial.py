"""Trials: arrays of one length, that nobody changes."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.trial.axis import AXES
from rovid.trial.trial import Remark, merged_remarks
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
    three = [trials[0], *(replace(trials[1], name=name) for name in "xy")]
    assert merged_remarks(three, limit=1)[0].endswith("Likewise in y (5) and 1 more.")
