"""What is out of line with the fleet."""

from __future__ import annotations

import numpy as np

from rovid.fleet.page import fleet_page
from rovid.fleet.results import outliers
from rovid.fleet.shrinkage import shrink
from tests.fleet.conftest import Made, fleet_of


def test_one_in_ten_is_named_and_does_not_hide_itself(made: Made) -> None:
    values = [100.0, 101.0, 99.0, 100.5, 99.5, 100.2, 98.8, 101.3, 100.1, 150.0]
    fleet = fleet_of(*(made(f"{k}", {"inertia": (v, 1.0)}) for k, v in enumerate(values)))
    (found,) = outliers(fleet)
    assert (found.campaign, found.name, found.value.value) == ("9", "inertia", 150.0)
    assert found.distance > 10.0


def test_what_is_vague_is_not_out_of_line(made: Made) -> None:
    values = [(100.0, 1.0)] * 4 + [(101.0, 1.0)] * 4 + [(150.0, 40.0)]
    assert outliers(fleet_of(*(made(f"{k}", {"inertia": v}) for k, v in enumerate(values)))) == []


def test_of_four_none_is_told_from_the_rest(made: Made) -> None:
    values = [100.0, 100.0, 100.0, 1000.0]
    assert outliers(fleet_of(*(made(f"{k}", {"inertia": (v, 1.0)}) for k, v in enumerate(values)))) == []


def test_vehicles_that_are_no_sisters_are_compared_with_themselves(made: Made) -> None:
    large = [made(f"l{k}", {"inertia": (5000.0 + 10.0 * k, 50.0)}, vehicle="large") for k in range(9)]
    small = [made(f"s{k}", {"inertia": (v, 0.01)}, vehicle="small") for k, v in enumerate([0.5, 0.49, 0.51, 0.5, 0.8])]
    (found,) = outliers(fleet_of(*large, *small))
    assert (found.campaign, found.median) == ("s4", 0.5)


def test_of_normal_scatter_hardly_any_is(made: Made) -> None:
    rng = np.random.default_rng(3)
    count = 0
    for _ in range(50):
        values = 1000.0 * np.exp(0.05 * rng.normal(size=20))
        records = [made(f"{k:02}", {"inertia": (float(v), 0.03 * float(v))}) for k, v in enumerate(values)]
        count += len(outliers(fleet_of(*records)))
    assert count <= 10  # of 1000


def test_placeholders_are_compared_with_nothing(made: Made) -> None:
    real = [made(f"{k}", {"inertia": (100.0 + k, 1.0)}) for k in range(5)]
    fleet = fleet_of(*real, *(made(f"guess{k}", {"inertia": (1.0, 0.01)}, guessed=True) for k in range(6)))
    assert outliers(fleet) == []
    (mean,) = shrink(fleet)
    assert set(mean.values) == {f"{k}" for k in range(5)}
    assert mean.mean.value > 99.0
    assert "Arms or thrust curves are guesses in guess0, guess1, guess2, guess3, guess4 and 1 more:" in fleet_page(
        fleet, ()
    )
