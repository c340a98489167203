"""Controller design: limit cycles, predicted margins, and manoeuvres."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rovid.control.actuators import allocate
from rovid.control.closed_loop import Plant
from rovid.control.control_law import HeadingManoeuvre, LoopConditions, paper_runs, standard_manoeuvres
from rovid.control.design import (
    choose_bandwidth,
    control_law,
    noisy_and_noise_free,
    open_loop,
    simulate_pairs,
    without_model_aid,
)
from rovid.control.tuning import pd_gains
from rovid.effects import Effect, forms_for
from rovid.model.model import Model
from rovid.trial.vehicle import Vehicle
from tests.control.loops import CURVE, PAPER, SCALES, VEHICLE, law, run_one, with_effect
from tests.synthetic import LOGGED


def test_a_dead_zone_and_a_lag_cause_a_limit_cycle() -> None:
    """The play of the drive, unknown to the bench curve, acts behind a lag."""
    model = with_effect("thruster_lag", 1.0, model=with_effect("command_hysteresis", 0.4))
    bench = allocate(VEHICLE, PAPER)
    controller = law(2000.0, 3000.0)
    found = []
    for acting in (model, PAPER):
        plant = Plant(model=acting, vehicle=VEHICLE)
        ((metrics, _),) = simulate_pairs(noisy_and_noise_free(controller, bench, plant, paper_runs()[2:3]))
        found.append(metrics.limit_cycle)
    shaken, calm = found
    assert shaken is not None
    assert shaken.amplitude_deg > 0.2
    assert calm is None


def random_vehicle(seed: int) -> tuple[Model, Vehicle, LoopConditions]:
    """An identified vehicle with one to three effects of realistic sizes."""
    rng = np.random.default_rng([2026, seed])
    size, speed = rng.uniform(0.5, 2.0), rng.uniform(0.7, 1.4)
    inertia, quadratic, linear = 5057.0 * size, 3532.0 * size * rng.uniform(0.5, 2.0), 132.0 * size * speed
    rate = 0.17 * speed
    torque = (quadratic * rate + linear) * rate
    scales = replace(SCALES, torque=torque, rate=rate)
    curve = replace(CURVE, thrust=CURVE.thrust * torque / 126.0)
    vehicle = replace(VEHICLE, thrusters=tuple(replace(thruster, curve=curve) for thruster in VEHICLE.thrusters))
    forms = forms_for(vehicle)
    chosen: dict[str, Effect] = {}
    for at in rng.permutation(len(forms))[: rng.integers(1, 4)]:
        chosen.setdefault(forms[at].id, forms[at])
    values = []
    for effect in chosen.values():
        for k, parameter in enumerate(effect.parameters):
            share = rng.uniform(0.3, 2.0) if k == 0 else 1.0
            first = parameter.initial_values[0] * scales.unit_size(parameter)
            null = parameter.neutral * scales.unit_size(parameter)
            away = first if effect.id == "slew_limit" else null + share * (first - null)
            values.append(away)
    plain = Model(inertia=inertia, quadratic_drag=quadratic, linear_drag=linear)
    model = replace(plain, effects=tuple(chosen.values()), effect_values=tuple(values))
    return model, vehicle, LoopConditions(torque_in_use=torque, heading_noise=math.radians(0.01))


@pytest.mark.parametrize("seed", [pytest.param(k, marks=[pytest.mark.slow] if k >= 1 else []) for k in range(20)])
def test_predicted_margins_hold_for_random_vehicles(seed: int) -> None:
    model, vehicle, setting = random_vehicle(seed)
    allocation = allocate(vehicle, model)
    bandwidth = choose_bandwidth(model, vehicle, allocation, setting, 0.7)
    controller = control_law(model, allocation, setting, *pd_gains(model.inertia, 0.7, bandwidth))
    predicted = open_loop(controller, model, vehicle, allocation, setting).margins()
    noise, disturbance = setting.heading_noise, 0.02 * setting.torque_in_use
    plant = Plant(model=model, vehicle=vehicle, heading_noise=noise, disturbance=disturbance)
    wanted = standard_manoeuvres((), setting.torque_in_use)[:3]
    for found, _ in simulate_pairs(noisy_and_noise_free(controller, allocation, plant, wanted, seed=seed)):
        assert found.settling_time is not None
        assert found.steady_error_deg < 0.6
        # What a play or a dead zone leaves, if anything.
        assert found.limit_cycle is None or found.limit_cycle.amplitude_deg < 0.1
    # The predicted delay margin: stable with 15 % less, unstable with 15 % more; from a step that asks for torque and
    # rates such as those in use, which the margins are of where lag or damping go with the amplitude.
    swings = []
    for share in (0.85, 1.15):
        late = replace(plant.noise_free(), delay=share * predicted.delay_s)
        goal = np.full(round(100.0 / bandwidth / controller.period), math.radians(110.0))
        course = run_one(controller, allocation, late, goal, math.radians(100.0))
        swings.append([float(np.ptp(part)) for part in np.array_split(np.degrees(course.heading), 4)])
    assert swings[0][3] < swings[0][1]
    # It goes on as far as drag and thrust let it.
    assert swings[1][3] > 1.0
    assert swings[1][3] > 0.95 * swings[1][1]


def test_without_model_aid_only_pd_remains() -> None:
    bare = without_model_aid(law(static_terms=(1.0,) * 7, inertia=5.0))
    assert (bare.quadratic_drag, bare.linear_drag, bare.inertia, sum(bare.static_terms)) == (0.0, 0.0, 0.0, 0.0)
    assert bare.step(bare.initial_state(0.0), 0.0, 0.1)[0] == pytest.approx(10.0)


def test_the_error_in_a_current_is_torque_over_stiffness() -> None:
    hold, plant = HeadingManoeuvre(name="", start=120.0, target=120.0, current=10.0), Plant(model=PAPER, vehicle=LOGGED)
    ((found, _),) = simulate_pairs(noisy_and_noise_free(law(1000.0, 3500.0), allocate(LOGGED, PAPER), plant, [hold]))
    assert found.steady_error_deg == pytest.approx(math.degrees(10.0 / 1000.0), rel=1e-3)
