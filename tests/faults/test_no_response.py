"""A log with thrust and no motion."""

from __future__ import annotations

import pytest

from rovid.faults.base import RunsData, examine
from rovid.faults.no_response import FAULT
from rovid.trial.fault import FaultOverrides
from tests.faults.days import VEHICLES, day
from tests.synthetic import LOGGED


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["hold_2.csv", "sine_1.csv", "random.csv"])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_log_without_motion_is_named_and_set_aside(vehicle: str, name: str, seed: int) -> None:
    runs = day(vehicle, seed, still=name)
    data, (fault,) = examine([FAULT], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())
    assert (fault.logs, fault.remedy, fault.stops) == ((name,), "set_aside", False)
    assert "does not respond" in fault.text
    assert len(data.runs) == 9
    kept, (fault,) = examine([FAULT], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides(kept={FAULT.id: (name,)}))
    assert (fault.remedy, len(kept.runs)) == ("none", 10)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("disturbance", [0.002, 0.1])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_logs_that_move_give_nothing(vehicle: str, disturbance: float, seed: int) -> None:
    runs = day(vehicle, seed, disturbance=disturbance)
    assert not examine([FAULT], RunsData(runs=runs, vehicle=LOGGED), FaultOverrides())[1]
    assert not examine([FAULT], RunsData(runs=runs[:1], vehicle=LOGGED), FaultOverrides())[1]
