"""A plan as a command file."""

from __future__ import annotations

import numpy as np

from rovid.design.candidate_runs import Planned
from rovid.design.expected_information import Worth
from rovid.design.experiment_design import Plan, command_text


def test_a_plan_starts_no_formula() -> None:
    run = Planned(name="", time=np.array([0.0, 1.0]), commands=np.zeros((2, 2)))
    worth = Worth(run=run, gain=1.0, rates=np.zeros((1, 2)))
    found = Plan(beliefs=(), narrow="", runs=(worth,), thrusters=("=1+1", "fore"), noise_rate=0.0)
    assert command_text(found).splitlines()[0] == '"time_s",\'=1+1,fore'
