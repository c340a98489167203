"""A fleet by vehicle, in the order of time."""

from __future__ import annotations

from rovid.fleet.campaign_record import CampaignRecord
from rovid.fleet.results import causes, verdict
from tests.fleet.conftest import Made, fleet_of

LOST = CampaignRecord(campaign="z", folder="", digest="", error="no logs", failure="input")


def test_vehicles_have_their_campaigns_in_the_order_of_time_undated_ones_last(made: Made) -> None:
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


def test_what_failed_has_neither_verdict_nor_causes(made: Made) -> None:
    assert (verdict(LOST), causes(LOST, "findings")) == (None, [])
    found = made("a", {}, causes=("thruster_lag",))
    assert (verdict(found), causes(found, "findings"), causes(found, "suspects")) == ("found", ["thruster_lag"], [])


def test_vehicles_are_in_the_order_of_their_names_and_numbers(made: Made) -> None:
    names = ["rov 10", "rov 2", "", "Älpha", "rov 2b"]
    fleet = fleet_of(*(made(f"{k}", {}, vehicle=name) for k, name in enumerate(names)))
    assert list(fleet.vehicles) == ["", "rov 2", "rov 2b", "rov 10", "Älpha"]
