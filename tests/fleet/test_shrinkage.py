"""Sister vehicles: the hierarchical mean against the simulated truth."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.fleet.results import shrink
from tests.fleet.conftest import Made, fleet_of


def test_shrunk_values_are_closer_to_the_truth_with_valid_errors(made: Made) -> None:
    rng = np.random.default_rng(4)
    before, after, inside, mean_inside = [], [], [], []
    for _ in range(25):
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
