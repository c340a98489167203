"""Expected information of runs, and the plan as a command file."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rovid.core.errors import DataError
from rovid.effects import effect_named
from rovid.estimate.candidate_runs import CandidateRun, RunLimits, RunScales, candidate_runs
from rovid.estimate.experiment_design import (
    CandidateModel,
    ExpectedInformation,
    ExperimentPlan,
    command_csv,
    plan_experiment,
    rank_runs,
    with_visible_size,
)
from rovid.model.model import Model
from tests import synthetic
from tests.synthetic import ROSUB, VEHICLE, clock

TIME = clock(200.0, rate=5.0)
STEP = CandidateRun(name="step", time=TIME, commands=np.where(TIME < 100.0, 2.0, -2.0)[:, None])
NUDGE = CandidateRun(name="nudge", time=TIME, commands=0.002 * STEP.commands)


def model_with(model: Model = ROSUB, error: float = 0.1) -> CandidateModel:
    """Model whose parameters have the relative standard ``error``."""
    values = np.array([model.inertia, model.quadratic_drag, model.linear_drag])
    return CandidateModel(
        name="a",
        model=model,
        covariance=np.diag((error * values) ** 2),
        disturbance=2.0,
        memory=5.0,
        noise=math.radians(0.01),
    )


def test_a_large_step_improves_the_inertia_more_than_a_small_one() -> None:
    step, nudge = rank_runs([NUDGE, STEP], [model_with()], VEHICLE, RunLimits(), parameter="inertia")
    assert (step.run, nudge.run) == (STEP, NUDGE)
    assert step.gain > 1.0
    assert nudge.gain < 0.05
    assert step.gain_per_minute == pytest.approx(step.gain * 60.0 / 200.0)


def test_no_run_reduces_what_the_model_lacks() -> None:
    """Of an error that is half of a missing torque, an endless run leaves that half."""
    sure = model_with()
    unsure = replace(sure, covariance=2.0 * sure.covariance, lasting=sure.covariance)
    (alone,), (beside,) = (
        rank_runs([STEP], [one], VEHICLE, RunLimits(), parameter="inertia") for one in (sure, unsure)
    )
    assert beside.gain == pytest.approx(math.log(2.0 / (1.0 + math.exp(-alone.gain))))
    assert beside.gain < math.log(2.0) < alone.gain


def test_a_run_at_rest_has_no_information() -> None:
    rest = CandidateRun(name="rest", time=TIME, commands=0.0 * STEP.commands)
    (found,) = rank_runs([rest], [model_with()], VEHICLE, RunLimits(), parameter="inertia")
    assert found.gain == pytest.approx(0.0, abs=1e-6)


def test_different_models_are_distinguishable_and_equal_ones_are_not() -> None:
    sure = model_with(error=1e-3)
    other = model_with(replace(ROSUB, inertia=1.2 * ROSUB.inertia), error=1e-3)
    (apart,) = rank_runs([STEP], [sure, other], VEHICLE, RunLimits())
    (same,) = rank_runs([STEP], [sure, sure], VEHICLE, RunLimits())
    assert apart.gain > 10.0
    assert same.gain < 1e-3  # rounding of the filter
    assert apart.rates.shape == (2, len(TIME))


def test_causes_that_logs_do_not_show_are_compared_at_the_size_that_these_leave_open() -> None:
    """A lag of 0 +- 0.2 s and a slew limit of 1/(0 +- 0.001) predict the same, and no run would tell them apart."""
    hidden = []
    for name, value, error in (("thruster_lag", 0.0, 0.2), ("slew_limit", 1e5, 1e-3 * 1e10)):
        bare = model_with()
        model = replace(ROSUB, effects=(effect_named(name),), effect_values=(value,))
        covariance = np.diag([*np.diag(bare.covariance), error**2])
        hidden.append(replace(bare, name=name, model=model, covariance=covariance))
    shown = list(map(with_visible_size, hidden))
    assert [one.is_assumed for one in shown] == [True, True]
    assert [one.model.effect_values[0] for one in shown] == pytest.approx([0.6, 1.0 / 0.003])
    # Of the inverse of the slew limit the error is as before.
    assert math.sqrt(shown[1].covariance[-1, -1]) * 0.003**2 == pytest.approx(1e-3)
    (before,), (after,) = (rank_runs([STEP], models, VEHICLE, RunLimits()) for models in (hidden, shown))
    assert before.gain < 1e-3
    assert after.gain > 1.0
    large = replace(shown[0], is_assumed=False, covariance=0.5 * shown[0].covariance)
    assert with_visible_size(large) is large


@pytest.mark.parametrize("limits", [RunLimits(seconds=100.0), RunLimits(rate=0.01), RunLimits(travel=0.1)])
def test_limits_that_exclude_every_run_are_an_error(limits: RunLimits) -> None:
    with pytest.raises(DataError, match="no run stays within these limits"):
        rank_runs([STEP], [model_with()], VEHICLE, limits, parameter="inertia")


def test_a_command_file_contains_no_formula() -> None:
    run = CandidateRun(name="", time=np.array([0.0, 1.0]), commands=np.zeros((2, 2)))
    worth = ExpectedInformation(run=run, gain=1.0, rates=np.zeros((1, 2)))
    found = ExperimentPlan(models=(), parameter="", runs=(worth,), thrusters=("=1+1", "fore"), disturbance_rate=0.0)
    assert command_csv(found).splitlines()[0] == '"time_s",\'=1+1,fore'


def test_a_fit_that_ran_off_is_refused_by_its_time_constant() -> None:
    """No array grows with the time constant: this one would take 1e12 samples."""
    runaway = CandidateModel(
        name="runaway",
        model=Model(inertia=1e12, quadratic_drag=0.0, linear_drag=1e3),
        covariance=np.eye(3),
        disturbance=1.0,
        memory=1.0,
        noise=1e-4,
        integrated=False,
    )
    time = synthetic.clock(60.0)
    log = synthetic.trial(time, np.where(time < 30.0, 5.0, -5.0))
    with pytest.raises(DataError, match=r"time constant of 1e\+09 s is longer than all logs together \(60 s\)"):
        plan_experiment([runaway], synthetic.VEHICLE, [log], RunLimits())


def test_a_plan_says_why_it_chose_its_parameter_or_its_causes() -> None:
    time = synthetic.clock(60.0, rate=5.0)
    log, limits = synthetic.trial(time, np.where(time < 30.0, 2.0, -2.0)), RunLimits(seconds=60.0)
    model = model_with()
    unsure = replace(model, covariance=model.covariance * np.diag([1.0, 0.25, 4.0]))
    plan = plan_experiment([unsure], VEHICLE, [log], limits)
    assert plan.parameter == "linear_drag"
    assert plan.reason == "the standard error of linear_drag is 20 % of its value, the largest of all"
    asked = plan_experiment([unsure], VEHICLE, [log], limits, "quadratic_drag")
    assert asked.reason == "the standard error of quadratic_drag is 5.0 % of its value"
    pair = plan_experiment([model, replace(model, name="b")], VEHICLE, [log], limits)
    assert (pair.parameter, pair.reason) == ("", "it gives the most evidence a minute between a and b")


def test_runs_beyond_the_limit_are_not_sampled() -> None:
    time = synthetic.clock(60.0)
    log = synthetic.trial(time, np.where(time < 30.0, 5.0, -5.0))
    slow = Model(inertia=1e9, quadratic_drag=0.0, linear_drag=1.0)
    scales = RunScales.from_trials(slow, synthetic.VEHICLE, [log], 1.0)
    assert max(run.seconds for run in candidate_runs(scales, ("a", "b"), 600.0)) <= 600.0


@pytest.mark.slow
def test_a_designed_run_is_worth_more_than_the_list_within_the_same_limits() -> None:
    time = synthetic.clock(60.0, rate=5.0)
    log = synthetic.trial(time, np.where(time < 30.0, 2.0, -2.0))
    limits = RunLimits(seconds=120.0, travel=1.0)
    listed, designed = (
        plan_experiment([model_with()], VEHICLE, [log], replace(limits, design=design), "inertia").best
        for design in (False, True)
    )
    assert designed.run.name.startswith("designed: ")
    # Of the list, no run is as regular and as fast.
    assert designed.information_per_minute > 2.0 * listed.information_per_minute
    assert np.abs(designed.run.commands).max() <= 2.0 + 1e-9
    angle = np.cumsum(designed.rates[0]) * 0.2
    assert np.ptp(angle) <= 2.0 * math.pi
