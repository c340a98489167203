"""A foreign log as a rival of causes with another size in each trial."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.diagnose import log_rivals
from rovid.diagnose.log_rivals import diagnose_majority, few_logs
from rovid.diagnose.result import Diagnosis
from rovid.effects import bias_torque, supply_sag
from rovid.signals.preprocessing import PreparedRuns
from tests.diagnose.findings import finding
from tests.faults.days import day
from tests.synthetic import VEHICLE

NAMES = tuple(run.trial.name for run in day("small", 0))


@pytest.mark.parametrize("module", [supply_sag, bias_torque])
@pytest.mark.parametrize("logs", [(2,), (0, 5), (4, 5)])
def test_one_or_two_logs_with_a_size_of_their_own_are_named(module: object, logs: tuple[int, ...]) -> None:
    assert module in (supply_sag, bias_torque)
    names = NAMES[:6]
    sizes = np.full(6, 1.0)
    sizes[list(logs)] = 0.6
    sizes += 1.0 - sizes.mean()
    effect = supply_sag.for_trials(names) if module is supply_sag else bias_torque.for_trials(names)
    assert few_logs(finding(effect, sizes.tolist()), 6) == tuple(names[at] for at in logs)


def test_sizes_that_vary_over_all_logs_are_a_cause() -> None:
    effect = supply_sag.for_trials(NAMES[:6])
    assert few_logs(finding(effect, [0.8, 0.88, 0.96, 1.04, 1.12, 1.2]), 6) == ()
    assert few_logs(finding(supply_sag.for_trials(NAMES[1:2]), [0.8]), 6) == NAMES[1:2]
    assert few_logs(finding(supply_sag.FORMS[0], [0.1, 0.1]), 6) == ()


@pytest.mark.parametrize("found_by_others", [False, True])
def test_what_the_other_logs_do_not_show_is_not_established(
    found_by_others: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = PreparedRuns(items=tuple(day("small", 0)), cutoff=1.0, chosen=True, remarks=())
    cause = finding(supply_sag.for_trials(NAMES[1:2]), [0.8])
    every = Diagnosis(verdict="found", findings=(cause,))
    others = Diagnosis(verdict="nothing_found")
    if found_by_others:
        others = replace(every, findings=(finding(supply_sag.for_trials(NAMES[2:3]), [0.8]),))

    def diagnosed(prepared: PreparedRuns, *_: object) -> Diagnosis:
        return every if len(prepared.items) == len(NAMES) else others

    monkeypatch.setattr(log_rivals, "diagnose", diagnosed)
    result = diagnose_majority(runs, VEHICLE, lambda _: None)
    if found_by_others:
        assert result is every
        return
    (suspect,), (fault,) = result.suspects, result.faults
    assert not result.findings
    assert (result.verdict, suspect.effect, suspect.probability) == ("suspected", cause.effect, 0.5 * 0.99)
    assert (fault.fault, fault.logs, fault.remedy) == ("foreign_log", NAMES[1:2], "set_aside")
    assert f"{NAMES[1]} does not belong to the other logs" in fault.text
