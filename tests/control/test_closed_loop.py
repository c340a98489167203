"""Closed-loop simulation against closed forms, independent integration and open-loop simulation."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

from rovid.control.actuators import allocate
from rovid.control.closed_loop import ClosedLoop, Plant, simulate_loops
from rovid.control.design import without_model_aid
from rovid.core.array_types import FloatArray
from rovid.effects import Effect, forms_for
from rovid.model.model import Model
from rovid.trial.trial import Trial
from tests.control.loops import PAPER, SCALES, VEHICLE, closed, law, run_one, whole_drive, with_effect
from tests.synthetic import LOGGED


def test_the_aided_loop_is_of_second_order() -> None:
    """With cancelled drag and fast sampling the step response is that of eq. 13."""
    controller = law(period=0.01, rate_filter=0.0)
    plant = Plant(model=PAPER, vehicle=LOGGED)
    course = run_one(controller, allocate(LOGGED, PAPER), plant, np.full(4000, math.radians(200.0)), math.radians(90.0))
    _, known = signal.step(([100.0], [5057.0, 710.0, 100.0]), T=course.time)
    found = (np.degrees(course.heading) - 90.0) / 110.0
    assert found == pytest.approx(known, abs=2e-3)  # the clock's lag of 0.01 s at 0.14 rad/s


def test_the_closed_loop_equals_an_independent_integration() -> None:
    controller = law()
    plant = Plant(model=PAPER, vehicle=LOGGED)
    course = run_one(controller, allocate(LOGGED, PAPER), plant, np.full(600, math.radians(200.0)), math.radians(90.0))
    heading, rate, read, filtered = math.radians(90.0), 0.0, math.radians(90.0), 0.0
    blend = 1.0 - math.exp(-0.1 / 0.3)
    expected = [heading]
    for _ in range(600):
        filtered += blend * ((heading - read) / 0.1 - filtered)
        read = heading
        torque = 3532.0 * abs(filtered) * filtered + 132.37 * filtered
        torque += 100.0 * (math.radians(200.0) - heading) - 710.0 * filtered

        def motion(_: float, y: FloatArray, torque: float = torque) -> list[float]:
            return [y[1], (torque - 3532.0 * abs(y[1]) * y[1] - 132.37 * y[1]) / 5057.0]

        heading, rate = solve_ivp(motion, (0.0, 0.1), [heading, rate], rtol=1e-10, atol=1e-12).y[:, -1]
        expected.append(heading)
    assert course.heading == pytest.approx(np.array(expected), abs=1e-8)


def test_the_thrusters_are_idle_before_the_step() -> None:
    """A lag delays the whole response; with the first command held before it the response would begin at once."""
    plain, lagging = (closed(model, law(900.0, 3000.0)) for model in (PAPER, with_effect("thruster_lag", 1.0)))
    begins = [float(one.time[np.argmax(np.degrees(one.heading) > 91.0)]) for one in (plain, lagging)]
    assert begins[1] > begins[0] + 0.3
    exerted = min(lagging.torque[0], allocate(VEHICLE, PAPER).highest)
    assert lagging.drive.torque[0] == pytest.approx((1.0 - (1.0 - math.exp(-0.1)) / 0.1) * exerted, rel=1e-3)


def example(effect: Effect) -> Model:
    values = [p.initial_values[0] * SCALES.unit_size(p) for p in effect.parameters]
    return replace(PAPER, effects=(effect,), effect_values=tuple(values))


@pytest.mark.slow
@pytest.mark.parametrize("effect", forms_for(VEHICLE), ids=lambda effect: effect.key)
def test_recorded_commands_reproduce_the_heading_in_open_loop(effect: Effect) -> None:
    """The torque step by step equals that of all commands together."""
    model = example(effect)
    course = closed(model, law(900.0, 3000.0), seconds=90.0)
    drive = whole_drive(model, course)
    differs = float(np.max(np.abs(drive.torque - course.drive.torque)[:-1]))
    # What an effect remembers from before the window of 20 s.
    assert differs <= 1e-4 * np.max(np.abs(drive.torque))
    # It starts at the rate that is logged first.
    trial = replace(Trial.from_commands(course.time, course.commands), position=course.heading)
    rate, heading = model.simulate(trial, drive)
    # Steps of the integration, what is forgotten, and a true heading that is found from the instrument's by turns.
    reach = 1e-3 if model.heading_sensor.deviates else 6e-6 + 0.01 * differs
    if not model.heading_sensor.deviates:
        assert rate == pytest.approx(course.rate, abs=reach)
    assert heading - heading[0] == pytest.approx(course.heading - course.heading[0], abs=reach)
    assert np.ptp(course.heading) > 1.0


SWIRLED = with_effect("heading_deviation", 0.05, 0.3, model=with_effect("entrained_swirl", 0.3, 20.0))


@pytest.mark.parametrize("period", [0.1, 0.35])
@pytest.mark.parametrize("model", [PAPER, with_effect("thruster_lag", 1.0), SWIRLED], ids=["plain", "lag", "swirl"])
def test_parallel_loops_equal_separate_ones(model: Model, period: float) -> None:
    """Loops with different gains, initial headings, noise, delays and allocations."""
    plant = Plant(model=model, vehicle=VEHICLE, heading_noise=1e-3, disturbance=2.0)
    known, bench = allocate(VEHICLE, model), allocate(VEHICLE, PAPER)
    loops = [
        ClosedLoop(
            law=controller, allocation=inverse, plant=each, setpoint=np.full(200, 2.0), initial_heading=start, seed=7
        )
        for controller, inverse, each, start in (
            (law(900.0, 3000.0, period=period), known, plant, 1.0),
            (law(500.0, 2000.0, period=period, lowest=-40.0, highest=40.0), bench, replace(plant, delay=0.5), 1.5),
            (without_model_aid(law(900.0, 3000.0, period=period)), known, plant.noise_free(), 2.5),
        )
    ]
    for together, loop in zip(simulate_loops(loops), loops, strict=True):
        (alone,) = simulate_loops([loop])
        for name in ("heading", "rate", "torque", "commands", "external_torque"):
            assert getattr(together, name) == pytest.approx(getattr(alone, name), rel=1e-9, abs=1e-9), name
        drive = whole_drive(model, together)
        for name in ("torque", "timing_moment", "effect_inputs"):
            found, by_itself, whole = (getattr(one, name) for one in (together.drive, alone.drive, drive))
            assert found == pytest.approx(by_itself, rel=1e-9, abs=1e-9), name
            # What an effect remembers from before the window.
            reach = 1e-4 * float(np.max(np.abs(whole))) + 1e-9
            assert found[:-1] == pytest.approx(whole[:-1], abs=reach), name


def test_a_long_memory_extends_the_window() -> None:
    model = with_effect("supply_sag", 3.0, 60.0)
    course = closed(model, law(900.0, 3000.0), seconds=200.0)
    whole = whole_drive(model, course).torque
    assert np.max(np.abs(whole - course.drive.torque)[:-1]) <= 1e-4 * np.max(np.abs(whole))
