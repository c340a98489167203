"""A plan as a command file."""

from __future__ import annotations

import numpy as np

from rovid.design.candidate_runs import CandidateRun
from rovid.design.expected_information import ExpectedInformation
from rovid.design.experiment_design import ExperimentPlan, command_csv


def test_a_plan_starts_no_formula() -> None:
    run = CandidateRun(name="", time=np.array([0.0, 1.0]), commands=np.zeros((2, 2)))
    worth = ExpectedInformation(run=run, gain=1.0, rates=np.zeros((1, 2)))
    found = ExperimentPlan(models=(), parameter="", runs=(worth,), thrusters=("=1+1", "fore"), disturbance_rate=0.0)
    assert command_csv(found).splitlines()[0] == '"time_s",\'=1+1,fore'
