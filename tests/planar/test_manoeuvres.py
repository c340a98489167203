"""Measures of manoeuvres on motions whose measures are known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.planar.manoeuvres import (
    ManoeuvreMeasure,
    Measures,
    Track,
    nomoto,
    recognise,
    turning_circle,
    with_errors,
    zigzag,
)

STEP = 0.05  # s


def track(time: FloatArray, heading: FloatArray, steering: FloatArray, **columns: FloatArray) -> Track:
    missing = np.full(len(time), np.nan)
    values = dict.fromkeys(("north", "east", "surge", "sway"), missing) | columns
    rate = values.pop("yaw_rate", np.gradient(heading, time))
    return Track(time=time, heading=heading, yaw_rate=rate, steering=steering, **values)


def circle(radius: float, rate: float, drift: float, course: float) -> Track:
    """A turn of constant radius from the first sample: the centre lies abeam of the velocity."""
    time = np.arange(0.0, 2.5 * np.pi / abs(rate), STEP)
    speed = radius * abs(rate)
    heading = course + rate * time
    side = np.sign(rate)
    surge, sway = speed * np.cos(drift), -side * speed * np.sin(drift)
    bearing = heading + np.arctan2(sway, surge)
    start = course + np.arctan2(sway, surge)
    north = speed / rate * (np.sin(bearing) - np.sin(start))
    east = -speed / rate * (np.cos(bearing) - np.cos(start))
    full = np.ones(len(time))
    return track(time, heading, 0.6 * side * full, north=north, east=east, surge=surge * full, sway=sway * full)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_circle_of_known_radius_has_its_diameter(side: float) -> None:
    found = turning_circle(circle(radius=12.0, rate=0.1 * side, drift=0.2, course=1.3))
    # After 90 and 180 deg on a circle whose velocity points 0.2 rad out of the turn.
    assert found["advance"].value == pytest.approx(12.0 * (np.cos(0.2) + np.sin(0.2)), rel=1e-3)
    assert found["transfer"].value == pytest.approx(12.0 * (np.cos(0.2) - np.sin(0.2)), rel=1e-3)
    assert found["tactical_diameter"].value == pytest.approx(24.0 * np.cos(0.2), rel=1e-3)
    assert found["steady_diameter"].value == pytest.approx(24.0, rel=1e-9)
    assert found["steady_yaw_rate"].value == pytest.approx(0.1 * side, rel=1e-9)
    assert found["steady_drift_angle"].value == pytest.approx(0.2, rel=1e-9)
    assert found["time_to_90_deg"].value == pytest.approx(5.0 * np.pi, rel=1e-9)


def test_a_turn_that_ends_early_has_no_tactical_diameter() -> None:
    whole = circle(radius=12.0, rate=0.1, drift=0.0, course=0.0)
    short = whole.part(0, int(0.6 * np.pi / 0.1 / STEP))
    assert {"advance", "transfer"} <= turning_circle(short).keys()
    assert "tactical_diameter" not in turning_circle(short)
    assert "steady_diameter" not in turning_circle(short)


def test_a_simulated_turn_that_diverges_has_no_measures() -> None:
    whole = circle(radius=12.0, rate=0.1, drift=0.0, course=0.0)
    heading = np.where(whole.time < 0.6 * np.pi / 0.1, whole.heading, np.nan)
    assert turning_circle(replace(whole, heading=heading)) == {}


def nomoto_zigzag(gain: float, constant: float, order: float, threshold: float) -> Track:
    """Zigzag of T*rdot + r = K*steering, integrated exactly; the approach is 10 s long."""
    heading = rate = 0.0
    steering, rows = 0.0, []
    fade = np.exp(-STEP / constant)
    for k in range(round(120.0 / STEP)):
        time = k * STEP
        if time == 10.0:
            steering = order
        if steering and heading * np.sign(steering) >= threshold:
            steering = -steering
        rows.append((time, heading, rate, steering))
        goal = gain * steering
        heading += goal * STEP + (rate - goal) * constant * (1.0 - fade)
        rate = goal + (rate - goal) * fade
    time, heading, rate, steering = np.array(rows).T
    return track(time, heading, steering, yaw_rate=rate)


def nomoto_overshoot(gain: float, constant: float, order: float, rate: float) -> float:
    """Further change of heading from ``rate`` after the reversal, in closed form."""
    goal = gain * order
    seconds = constant * np.log((rate + goal) / goal)
    return float(-goal * seconds + (rate + goal) * constant * (1.0 - np.exp(-seconds / constant)))


def test_a_zigzag_of_nomotos_model_is_recognised_and_measured() -> None:
    gain, constant, order, threshold = 0.25, 4.0, np.radians(20.0), np.radians(20.0)
    run = nomoto_zigzag(gain, constant, order, threshold)
    (found,) = recognise(run)
    assert found.kind == "zigzag"
    assert found.steering == pytest.approx(order)
    part = run.part(found.first, found.last)
    # The order is given at the first sample beyond the threshold.
    reversed_at = int(np.flatnonzero(np.diff(part.steering))[0]) + 1
    assert part.heading[reversed_at] - part.heading[0] == pytest.approx(threshold, abs=STEP * gain * order)
    measures = zigzag(part)
    reversals = np.flatnonzero(np.diff(part.steering)) + 1
    for index, name in enumerate(("first_overshoot", "second_overshoot")):
        rate = abs(float(part.yaw_rate[reversals[index]]))
        expected = nomoto_overshoot(gain, constant, order, rate)
        assert measures[name].value == pytest.approx(expected, rel=1e-3)  # parabola through samples
    assert measures["period"].value == pytest.approx(STEP * (reversals[2] - reversals[0]))


@pytest.mark.parametrize("shares", [[0.6], [-0.5, 0.0, 0.5]])
def test_a_zigzag_with_a_slow_rudder_is_recognised_and_counts_from_the_order(shares: list[float]) -> None:
    run = nomoto_zigzag(0.25, 4.0, np.radians(20.0), np.radians(20.0))
    steering = run.steering.copy()
    for row in np.flatnonzero(np.diff(np.sign(run.steering))) + 1:
        before, after = run.steering[[row - 1, row]]
        way = np.repeat([0.5 * (before + after) + 0.5 * share * (after - before) for share in shares], 4)
        steering[row : row + len(way)] = way  # the rudder on its way, by readings that are held
    (found,), (whole,) = recognise(replace(run, steering=steering)), recognise(run)
    assert (found.kind, found.first, found.last) == ("zigzag", whole.first, whole.last)
    measures = zigzag(replace(run, steering=steering).part(found.first, found.last))
    for name, one in zigzag(run.part(whole.first, whole.last)).items():
        assert measures[name].value == pytest.approx(one.value), name


def test_nomotos_gain_and_time_constant_are_recovered_within_their_errors() -> None:
    gain, constant = 0.25, 4.0
    run = nomoto_zigzag(gain, constant, np.radians(20.0), np.radians(20.0))
    exact = nomoto(run)
    assert exact["K"].value == pytest.approx(gain, rel=1e-4)
    assert exact["T"].value == pytest.approx(constant, rel=1e-4)
    random = np.random.default_rng(5)
    scores = []
    for _ in range(60):
        noise = random.normal(0.0, 0.01, len(run.time))
        noisy = nomoto(track(run.time, run.heading, run.steering, yaw_rate=run.yaw_rate + noise))
        for name, truth in (("K", gain), ("T", constant)):
            error = noisy[name].standard_error
            assert error is not None
            scores.append((noisy[name].value - truth) / error)
    # Root mean square of 120 normal scores: 1 +- 0.065 (one sigma); K and T of one run are correlated.
    assert 0.75 < float(np.sqrt(np.mean(np.square(scores)))) < 1.25


def test_circles_are_recognised_and_straight_runs_are_not() -> None:
    turn = circle(radius=12.0, rate=-0.1, drift=0.1, course=0.0)
    # The turn itself begins at its full rate.
    assert recognise(turn) == []
    straight = np.arange(-20.0, 0.0, STEP)
    approach = track(straight, 0.0 * straight, 0.0 * straight, surge=1.2 + 0.0 * straight)
    joined = {name: np.concatenate((getattr(approach, name), value)) for name, value in vars(turn).items()}
    joined["yaw_rate"] = -0.1 * (1.0 - np.exp(-np.maximum(joined["time"], 0.0)))
    (found,) = recognise(Track(**joined))
    assert found.first == len(straight)
    assert found.kind == "turning_circle"
    assert found.steering == pytest.approx(-0.6)
    # A slow rudder: the turn counts from the order.
    rows = np.arange(len(joined["time"])) - len(straight)
    joined["steering"] = np.clip((rows + 1) / 8.0, 0.0, 1.0) * joined["steering"][-1]
    assert [one.first for one in recognise(Track(**joined))] == [len(straight)]
    time = np.arange(0.0, 60.0, STEP)
    assert recognise(track(time, 0.01 * time, np.full(len(time), 0.3))) == []
    assert recognise(track(time, 0.0 * time, 0.0 * time)) == []


def test_errors_follow_the_covariance_of_the_parameters() -> None:
    def measure(values: FloatArray) -> Measures:
        return {"product": ManoeuvreMeasure(value=float(values[0] * values[1]), unit="1")}

    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    found = with_errors(measure, np.array([2.0, 3.0]), covariance)["product"]
    slope = np.array([3.0, 2.0])
    assert found.standard_error == pytest.approx(np.sqrt(slope @ covariance @ slope), rel=1e-9)


def test_a_zigzag_that_never_reaches_its_first_reversal_has_no_measures() -> None:
    one = np.zeros(50)
    still = Track(time=np.arange(50.0), heading=one, yaw_rate=one, steering=one + 0.3, north=one, east=one, surge=one,
                  sway=one)  # fmt: skip
    assert zigzag(still) == {}
