"""Results of a fleet by vehicle, and outliers."""

from __future__ import annotations

import numpy as np

from rovid.fleet.campaigns import CampaignRecord
from rovid.fleet.page import fleet_page
from rovid.fleet.results import causes, outliers, shrink, verdict
from tests.fleet.conftest import Made, fleet_of

LOST = CampaignRecord(campaign="z", folder="", digest="", error="no logs", failure="input")


def test_campaigns_are_in_order_of_time_undated_ones_last(made: Made) -> None:
    records = [made("c", {}, start=1.0), made("a", {}), made("b", {}, start=2.0), made("d", {}, vehicle="", start=0.5)]
    fleet = fleet_of(*records, LOST)
    assert {name: [one.campaign for one in those] for name, those in fleet.vehicles.items()} == {
        "": ["d"],
        "one": ["c", "b", "a"],
    }
    assert fleet.failed == (LOST,)


def test_parameters_of_the_plain_model_come_first(made: Made) -> None:
    known = {"thruster_lag.time_constant": (0.5, 0.1), "linear_drag": (3.0, 1.0), "inertia": (2.0, 1.0)}
    fleet = fleet_of(made("a", {"bias_torque.torque": (1.0, 1.0)}), made("b", known), LOST)
    assert fleet.parameters == ("inertia", "linear_drag", "bias_torque.torque", "thruster_lag.time_constant")
    assert "inertia" not in fleet.values["a"]
    assert not fleet.values["z"]


def test_a_failed_campaign_has_neither_verdict_nor_causes(made: Made) -> None:
    assert (verdict(LOST), causes(LOST, "findings")) == (None, [])
    found = made("a", {}, causes=("thruster_lag",))
    assert (verdict(found), causes(found, "findings"), causes(found, "suspects")) == ("found", ["thruster_lag"], [])


def test_vehicles_are_in_natural_order(made: Made) -> None:
    names = ["rov 10", "rov 2", "", "Älpha", "rov 2b"]
    fleet = fleet_of(*(made(f"{k}", {}, vehicle=name) for k, name in enumerate(names)))
    assert list(fleet.vehicles) == ["", "rov 2", "rov 2b", "rov 10", "Älpha"]


def test_one_outlier_in_ten_is_named(made: Made) -> None:
    values = [100.0, 101.0, 99.0, 100.5, 99.5, 100.2, 98.8, 101.3, 100.1, 150.0]
    fleet = fleet_of(*(made(f"{k}", {"inertia": (v, 1.0)}) for k, v in enumerate(values)))
    (found,) = outliers(fleet)
    assert (found.campaign, found.name, found.value.value) == ("9", "inertia", 150.0)
    assert found.distance > 10.0


def test_an_imprecise_value_is_no_outlier(made: Made) -> None:
    values = [(100.0, 1.0)] * 4 + [(101.0, 1.0)] * 4 + [(150.0, 40.0)]
    assert outliers(fleet_of(*(made(f"{k}", {"inertia": v}) for k, v in enumerate(values)))) == []


def test_four_campaigns_are_too_few(made: Made) -> None:
    values = [100.0, 100.0, 100.0, 1000.0]
    assert outliers(fleet_of(*(made(f"{k}", {"inertia": (v, 1.0)}) for k, v in enumerate(values)))) == []


def test_dissimilar_vehicles_are_compared_with_themselves(made: Made) -> None:
    large = [made(f"l{k}", {"inertia": (5000.0 + 10.0 * k, 50.0)}, vehicle="large") for k in range(9)]
    small = [made(f"s{k}", {"inertia": (v, 0.01)}, vehicle="small") for k, v in enumerate([0.5, 0.49, 0.51, 0.5, 0.8])]
    (found,) = outliers(fleet_of(*large, *small))
    assert (found.campaign, found.median) == ("s4", 0.5)


def test_normal_scatter_has_few_outliers(made: Made) -> None:
    rng = np.random.default_rng(3)
    count = 0
    for _ in range(50):
        values = 1000.0 * np.exp(0.05 * rng.normal(size=20))
        records = [made(f"{k:02}", {"inertia": (float(v), 0.03 * float(v))}) for k, v in enumerate(values)]
        count += len(outliers(fleet_of(*records)))
    assert count <= 10  # of 1000


def test_placeholders_are_not_compared(made: Made) -> None:
    real = [made(f"{k}", {"inertia": (100.0 + k, 1.0)}) for k in range(5)]
    fleet = fleet_of(*real, *(made(f"guess{k}", {"inertia": (1.0, 0.01)}, guessed=True) for k in range(6)))
    assert outliers(fleet) == []
    (mean,) = shrink(fleet)
    assert set(mean.values) == {f"{k}" for k in range(5)}
    assert mean.mean.value > 99.0
    assert "Arms or thrust curves are guesses in guess0, guess1, guess2, guess3, guess4 and 1 more:" in fleet_page(
        fleet, ()
    )
