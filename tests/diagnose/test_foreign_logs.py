"""Logs that the plain model calls foreign: those that a cause explains return, those of another vehicle do not."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from rovid.core.budget import Budget
from rovid.diagnose.foreign_logs import returning_logs, with_returned_logs
from rovid.diagnose.result import Diagnosis
from rovid.effects import Effect, effect_named
from rovid.effects.actuator_inputs import SPEEDS
from rovid.faults.base import RunsData, examine
from rovid.faults.foreign_log import DETECTORS
from rovid.present.documents.diagnosis import all_faults
from rovid.trial.fault import Fault, FaultOverrides
from rovid.trial.preprocessing import PreparedRuns, Run
from tests.diagnose.findings import finding
from tests.faults.days import SMALL, day, scaled
from tests.synthetic import LOGGED, gauss_markov, run

LOG = "sine_1.csv"
# N s; moment of a sway that follows the rate in LOG, at 1 m/s for 1 rad/s: more than all drag there.
MOMENT = 2.0
SWAY = effect_named("sideslip_moment")


@cache
def campaign(seed: int, factor: float = 1.0) -> tuple[tuple[Run, ...], tuple[Run, ...]]:
    """The runs of a day but LOG, in which alone there is much sideslip, and LOG.

    ``factor``: inertia and drag of LOG, in units of those of the other logs.
    """
    rng, runs = np.random.default_rng(seed), list[Run]()
    for one in day("small", seed, disturbance=0.01):
        time, body, extent = one.trial.time, SMALL, one.rates.kernel.cutoff
        sway = 0.05 * np.sin(time / rng.uniform(2.0, 6.0))
        if one.trial.name == LOG:
            body = scaled(SMALL, factor, factor)
            # The motion of a hull that drifts as it turns is that with more linear drag.
            drifting = replace(body, linear_drag=body.linear_drag + MOMENT)
            sway = np.gradient(run(time, one.torque, drifting, cutoff=extent).trial.position, time)
        noise = rng.normal(0.0, 1e-3, len(time))
        disturbance = gauss_markov(len(time), float(time[1]), 0.01, 1.0, rng) - MOMENT * sway
        made = run(time, one.torque, body, cutoff=extent, disturbance=disturbance, noise=noise)
        trial = replace(
            made.trial, name=one.trial.name, campaign_time=one.trial.campaign_time, extras={SPEEDS[1]: sway}
        )
        runs.append(replace(made, trial=trial))
    return tuple(each for each in runs if each.trial.name != LOG), tuple(
        each for each in runs if each.trial.name == LOG
    )


def diagnosed(*effects: Effect) -> Diagnosis:
    """A diagnosis that found ``effects`` of the true size."""
    model = replace(SMALL, effects=effects, effect_values=(MOMENT,) * len(effects))
    found = tuple(finding(effect, [MOMENT]) for effect in effects)
    return Diagnosis(verdict="found", findings=found, extended=cast("Any", SimpleNamespace(model=model)))


@pytest.mark.parametrize("seed", range(3))
def test_a_log_that_a_cause_explains_returns(seed: int) -> None:
    kept, aside = campaign(seed)
    assert returning_logs(diagnosed(SWAY), kept, aside, LOGGED) == (LOG,)
    assert returning_logs(diagnosed(effect_named("bias_torque")), kept, aside, LOGGED) == ()
    assert returning_logs(diagnosed(), kept, aside, LOGGED) == ()


def test_the_plain_model_calls_the_log_foreign() -> None:
    kept, aside = campaign(0)
    runs = RunsData(runs=[*kept, *aside], vehicle=LOGGED)
    (fault,) = examine(DETECTORS["runs"], runs, FaultOverrides())[1]
    assert (fault.logs, fault.remedy, fault.may_be_explained) == ((LOG,), "set_aside", True)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_log_of_another_vehicle_stays_out_next_to_a_cause(seed: int, factor: float) -> None:
    kept, aside = campaign(seed, factor)
    assert returning_logs(diagnosed(SWAY), kept, aside, LOGGED) == ()


@pytest.mark.parametrize("still_found", [True, False])
def test_a_returned_log_has_to_belong_by_the_second_diagnosis_too(still_found: bool) -> None:
    kept, aside = campaign(0)
    prepared = PreparedRuns(items=kept, cutoff=1.0, chosen=True, remarks=(), set_aside=aside)
    second = diagnosed(SWAY) if still_found else Diagnosis(verdict="nothing_found")
    seen = list[int]()

    def diagnose(runs: PreparedRuns) -> Diagnosis:
        seen.append(len(runs.items))
        return second if len(seen) > 1 else diagnosed(SWAY)

    used, result, faults = with_returned_logs(prepared, LOGGED, diagnose, lambda _: None, Budget())
    assert seen == [len(kept), len(kept) + 1]
    assert len(used.items) == len(kept) + still_found
    assert (result is second) == still_found
    assert [(fault.logs, fault.remedy) for fault in faults] == [((LOG,), "none")] * still_found
    assert all("It was put back" in fault.text for fault in faults)


def test_a_fault_that_is_taken_back_replaces_the_one_of_the_logs() -> None:
    told = [Fault(fault="foreign_log", logs=(log,), text="", remedy="set_aside") for log in (LOG, "hold_1.csv")]
    back = replace(told[0], remedy="none")
    study = cast("Any", SimpleNamespace(faults=tuple(told)))
    assert all_faults(Diagnosis(verdict="found", faults=(back,)), study) == [told[1], back]
    assert all_faults(Diagnosis(verdict="found"), study) == told
