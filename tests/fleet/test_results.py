"""Results of all campaigns, outliers and means of sister vehicles."""

from __future__ import annotations

import numpy as np
import pytest

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


@pytest.mark.slow
def test_shrunk_values_are_closer_to_the_truth_with_valid_errors(made: Made) -> None:
    rng = np.random.default_rng(4)
    before, after, inside, mean_inside = [], [], [], []
    for _ in range(15):
        # Ten vehicles with two campaigns each; scatters of 2 % and 1 %, errors of 4 %.
        own = np.repeat(rng.normal(0.0, 0.02, 10), 2) + rng.normal(0.0, 0.01, 20)
        truth = 5000.0 * np.exp(own)
        measured = truth * np.exp(0.04 * rng.normal(size=20))
        records = [
            made(f"{k:02}", {"inertia": (float(value), 0.04 * float(value))}, vehicle=f"{k // 2}")
            for k, value in enumerate(measured)
        ]
        (found,) = shrink(fleet_of(*records))
        assert found.logarithmic
        values = np.array([found.values[f"{k:02}"].value for k in range(20)])
        errors = np.array([found.values[f"{k:02}"].error for k in range(20)])
        before.append(np.mean((measured - truth) ** 2))
        after.append(np.mean((values - truth) ** 2))
        inside.append(np.mean(np.abs(values - truth) < 1.96 * errors))
        mean_inside.append(abs(np.log(found.mean.value / 5000.0)) < 1.96 * found.mean.error / found.mean.value)
    assert np.mean(after) < 0.5 * np.mean(before)
    assert 0.92 < np.mean(inside) < 0.99
    assert np.mean(mean_inside) > 0.8


def test_very_different_vehicles_are_not_shrunk(made: Made) -> None:
    values = [100.0, 101.0, 1000.0, 1010.0, 10000.0, 10100.0]
    records = [made(f"{k}", {"inertia": (v, 0.01 * v)}, vehicle=f"{k // 2}") for k, v in enumerate(values)]
    (found,) = shrink(fleet_of(*records))
    for k, value in enumerate(values):
        assert found.values[f"{k}"].value == pytest.approx(value, rel=0.01)
        assert found.values[f"{k}"].error <= 0.0105 * value


def test_the_scatter_is_separated_from_the_estimation_error(made: Made) -> None:
    rng = np.random.default_rng(8)
    truth = np.repeat(rng.normal(10.0, 3.0, 40), 3) + rng.normal(0.0, 1.0, 120)
    measured = truth + 0.5 * rng.normal(size=120)
    # Negative or imprecise values: no logarithms.
    records = [
        made(f"{k:03}", {"bias_torque.torque": (float(v), 0.5)}, vehicle=f"{k // 3}") for k, v in enumerate(measured)
    ]
    (found,) = shrink(fleet_of(*records))
    assert not found.logarithmic
    assert found.between == pytest.approx(3.0, rel=0.3)
    assert found.within == pytest.approx(1.0, rel=0.3)


def test_few_campaigns_or_unknown_errors_are_not_shrunk(made: Made) -> None:
    few = [made(f"{k}", {"inertia": (5.0 + k, 1.0)}, vehicle=f"{k}") for k in range(3)]
    assert shrink(fleet_of(*few)) == ()
    assert shrink(fleet_of(*few, made("3", {"inertia": (5.0, float("nan"))}))) == ()


def test_equal_values_stay_equal(made: Made) -> None:
    records = [made(f"{k}", {"inertia": (5.0, 1.0)}, vehicle=f"{k}") for k in range(6)]
    (found,) = shrink(fleet_of(*records))
    assert all(one.value == pytest.approx(5.0) and one.error < 1.0 for one in found.values.values())
