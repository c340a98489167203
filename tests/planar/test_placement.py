"""A velocity log away from the origin, without its place in rovid.toml."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rovid.effects import Effect, effect_named
from rovid.model.bound_effects import BoundEffect
from rovid.planar import effect_fits
from rovid.planar.coordinates import PlanarCoordinates
from rovid.planar.dataset import PlanarData
from rovid.planar.effect_fits import (
    _new_starts,
    _predicted_gain,
    _with_lift,
    add_effect,
    place_entries,
    planar_candidates,
    proposed_places,
    with_hull_lift,
)
from rovid.planar.fit import fit_base
from rovid.planar.free_runs import FreeRuns, simulate_planar
from rovid.planar.likelihood import PlanarLikelihood
from rovid.planar.model import PlanarModel
from rovid.planar.optimum import PlanarOptimum
from rovid.planar.regression import regression
from rovid.planar.start_values import planar_grid, planar_sizes, start_values
from tests.planar.vehicles import box_rov, campaign, torpedo

PLACE = effect_named("sensor_place")


def test_a_place_that_is_not_given_is_found_and_proposed() -> None:
    truth = box_rov(3, place=(0.3, -0.15))
    data = campaign(truth, runs=2, levels=6, hold=4.0, seed=2)
    base = fit_base(data)
    placed = base.with_effect(PLACE)
    assert base.value - placed.value > 100.0
    estimate = placed.effect_estimate(PLACE)
    for name, true in zip(estimate.names, truth.place, strict=True):
        assert abs(estimate.value(name) - true) < 4.0 * estimate.standard_error(name)  # 4 sigma, fixed seed
    (text,) = proposed_places(base, data)
    assert "at surge_velocity and sway_velocity in [signals]" in text
    assert "rovid diagnose" in text
    (entry,) = place_entries(estimate, (PLACE,))
    assert "write position = [0.2994, -0.1518] at" in entry
    assert not list(proposed_places(placed, data))
    # With a place in rovid.toml it is no candidate.
    given = replace(data, placed=frozenset({"surge_velocity", "sway_velocity"}))
    assert PLACE in planar_candidates(data)
    assert PLACE not in planar_candidates(given)
    assert not list(proposed_places(base, given))


def test_a_sound_fit_gets_no_proposal(small: tuple[PlanarData, PlanarOptimum]) -> None:
    data, base = small
    assert not list(proposed_places(base, data))


@pytest.mark.parametrize(("predicted", "count"), [(90.0, 0), (110.0, 1)])
def test_a_place_is_fitted_next_to_lift_where_a_score_test_promises_a_gain(
    predicted: float, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = campaign(torpedo(3), runs=1, levels=4, hold=8.0, seed=3)
    start = start_values(data, with_current=False)[0]
    sizes = planar_sizes(data, start)
    coordinates = PlanarCoordinates.of(start.model, sizes, data.sensors, yaw_only=False)
    likelihood = PlanarLikelihood(planar_grid(data, sizes, yaw_only=False, interval=1.0), coordinates)
    best, fitted = PlanarOptimum(likelihood, coordinates.initial(start.model, ()), 0.0), list[str]()

    def add(optimum: PlanarOptimum, effect: Effect, _: PlanarData) -> PlanarOptimum:
        fitted.append(effect.key)
        return optimum

    monkeypatch.setattr(effect_fits, "add_effect", add)
    monkeypatch.setattr(effect_fits, "_predicted_gain", lambda *_: predicted)
    monkeypatch.setattr(effect_fits, "_fitted", lambda likelihood, _, x: PlanarOptimum(likelihood, x, -1000.0))
    monkeypatch.setattr(effect_fits, "_as_ship", lambda lifted, _: lifted)
    assert _with_lift(best, data).value == -1000.0
    assert len(fitted) == count


def test_a_score_test_promises_nothing_where_the_place_is_right(small: tuple[PlanarData, PlanarOptimum]) -> None:
    # Twice the gain is distributed as chi squared with two degrees of freedom: 1e-4 of them are above 18.4.
    assert 0.0 <= _predicted_gain(small[1], PLACE) < 9.2


def test_a_simulation_begins_where_the_sensors_read(small: tuple[PlanarData, PlanarOptimum]) -> None:
    """The start of a simulation is a reading at the place of the sensor."""
    data, base = small
    model = replace(base.model, effects=(BoundEffect(PLACE, np.array([0.4, -0.2])),))
    start = np.array([0.3, 0.5, 0.1, 0.4, 0.0, 0.0])
    moved = simulate_planar(model, data.runs[0], start)
    assert (moved.surge_velocity[0], moved.sway_velocity[0]) == (0.5, 0.1)
    # The origin moves by the rate times the place less.
    np.testing.assert_allclose(moved.through_water[0], [0.5 - 0.2 * 0.4, 0.1 - 0.4 * 0.4, 0.4], atol=1e-12)


def test_speeds_from_positions_are_those_of_the_antenna() -> None:
    """Without a velocity log a simulation has the smoothed speeds of the antenna, which moves with the turns."""
    noise = {"heading": (1e-4, 0.05), "north": (1e-4, 0.2), "east": (1e-4, 0.2)}
    truth = box_rov(3, noise=noise, place=(0.5, -0.2), disturbance=(0.0, 0.0, 0.0))
    data = campaign(truth, runs=1, levels=8, hold=4.0, seed=2)
    antenna = BoundEffect(effect_named("sensor_place:antenna"), np.array(truth.place))
    model = PlanarModel(base=np.array(truth.base), effects=(antenna,))
    assert model.places(data.sensors) == (0.5, -0.2, 0.5, -0.2)
    assert model.places(("surge_velocity", "north", "east")) == (0.5, 0.0, 0.5, -0.2)
    runs = FreeRuns.of(data, planar_sizes(data, start_values(data, with_current=False)[0]))
    assert runs is not None
    errors = runs.errors(model).error.reshape(-1, 3) / runs.usual
    # Speeds of the origin in their place are off by more than the usual speed.
    assert np.sqrt(np.mean(errors**2, axis=0)).max() < 0.1


def test_a_regression_begins_near_the_place() -> None:
    """A log ahead of the origin of a torpedo, whose sway and turn go together."""
    truth = torpedo(3, place=(0.6, 0.0))
    data = campaign(truth, runs=1, levels=10, hold=6.0, seed=3)
    start = min(start_values(data, with_current=False, with_place=True), key=lambda one: one.residual)
    # Places of the search are a factor of 2 apart.
    assert 0.3 < start.place < 1.2
    still = min(start_values(data, with_current=False), key=lambda one: one.residual)
    assert start.residual < 0.3 * still.residual
    assert still.place == 0.0


def test_a_place_next_to_a_current_takes_the_current_of_the_model(monkeypatch: pytest.MonkeyPatch) -> None:
    """All currents for each place took 8 s of the 21 s of a tanker's fit."""
    truth = box_rov(3, place=(0.3, 0.0), current=(0.2, -0.1))
    data = campaign(truth, runs=2, levels=6, hold=4.0, seed=2)
    taken = list[Any]()

    def counted(*args: Any) -> Any:
        taken.append(args)
        return regression(*args)

    monkeypatch.setattr("rovid.planar.start_values.regression", counted)
    starts = start_values(data, with_current=False, with_place=True, known=truth.current)
    best = min(starts, key=lambda one: one.residual)
    assert best.current == truth.current
    assert best.place == pytest.approx(0.3, rel=0.5)  # The grid of places has steps of 2.
    assert len(taken) <= 20 * len(starts)


def test_a_place_has_starts_next_to_the_rudder_of_a_ship() -> None:
    """A regression has no flow straightening and no stall angle; the starts keep those of the model."""
    data = campaign(torpedo(3), runs=1, levels=4, hold=8.0, seed=3)
    start = min(start_values(data, with_current=False), key=lambda one: one.residual)
    sizes = planar_sizes(data, start)
    coordinates = PlanarCoordinates.of(start.model, sizes, data.sensors, yaw_only=False)
    coordinates, x = coordinates.straightened(coordinates.initial(start.model, ()))
    coordinates, x, _ = coordinates.stalling(x, [0])
    likelihood = PlanarLikelihood(planar_grid(data, sizes, yaw_only=False, interval=1.0), coordinates)
    for effect in (PLACE, effect_named("current")):
        found = _new_starts(PlanarOptimum(likelihood, x, 0.0), effect, data)
        rudders = [coordinates.with_effect(effect).model(one).rudders[0] for one in found]
        (usual,) = coordinates.model(x).rudders
        assert {(one.straightening, one.stall) for one in rudders} == {(usual.straightening, usual.stall)}


@pytest.mark.slow
def test_a_place_is_not_taken_for_the_lift_of_a_hull() -> None:
    truth = torpedo(3, place=(0.6, 0.0))
    data = campaign(truth, runs=1, levels=12, hold=5.0, seed=3)
    base = with_hull_lift(fit_base(data), data)
    assert not base.effects
    estimate = add_effect(base, PLACE, data).effect_estimate(PLACE)
    assert abs(estimate.value("sensor_place.x") - 0.6) < 4.0 * estimate.standard_error("sensor_place.x")  # fixed seed
