"""The compiled filter and simulation against plain numpy, and against an integrator of scipy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from rovid.core.array_types import FloatArray
from rovid.effects import PLANAR_FORMS, effect_named
from rovid.model.bound_effects import BoundEffect
from rovid.planar import equations, kernels
from rovid.planar.coordinates import from_log_cholesky, log_cholesky
from rovid.planar.dataset import PlanarData
from rovid.planar.model import SENSORS, PlanarModel, RudderModel
from rovid.planar.optimum import PlanarOptimum

BASE = np.array([30.0, 45.0, 3.0, 2.0, 10.0, 20.0, 2.0, 15.0, 40.0, 4.0])
SPEEDS = np.array([0.5, 0.3, 0.4])
# Parameters of each coupling that are large enough to matter.
VALUES = {
    "current": (0.15, 2.0),
    "current:wandering": (0.15, 2.0, 0.05, 40.0),
    "sway_yaw_damping": (3.0, 2.0),
    "sway_yaw_damping:lift": (-4.0, 5.0),
    "cross_flow_drag": (30.0, 1.2),
    "cross_flow_drag:off_centre": (30.0, 1.2, 0.3),
    "cross_flow_drag:ship": (30.0, 1.2),
    "speed_dependent_damping:planar": (3.0, 10.0),
    "speed_dependent_damping:planar_quadratic": (3.0, 10.0),
    "bias_torque:planar": (1.0, -2.0, 0.3),
    "sensor_place": (0.4, -0.3),
    "sensor_place:antenna": (0.4, -0.3),
}


def planar_model(*keys: str, rudders: tuple[RudderModel, ...] = ()) -> PlanarModel:
    effects = tuple(BoundEffect(effect_named(key), np.array(VALUES[key])) for key in keys)
    return PlanarModel(base=BASE, effects=effects, rudders=rudders)


def held_inputs(count: int, columns: int, seed: int = 1) -> FloatArray:
    rng = np.random.default_rng(seed)
    sizes = np.array([20.0, 15.0, 4.0, *[0.4, 15.0] * ((columns - 3) // 2)])
    levels = rng.uniform(-1.0, 1.0, (count // 40 + 1, columns)) * sizes
    # Always ahead: where the speed ahead changes sign, forces in |u| have a kink at which a linearisation is arbitrary.
    levels[:, [0, *range(4, columns, 2)]] = np.abs(levels[:, [0, *range(4, columns, 2)]])
    levels[:, 0] += 10.0
    return np.repeat(levels, 40, axis=0)[:count]


CASES = [*VALUES, "rudder"]


def case_model(case: str) -> tuple[PlanarModel, int]:
    if case == "rudder":
        rudder = RudderModel(name="r", position=(-0.7, 0.1), lift=30.0, slipstream=0.02)
        return planar_model(rudders=(replace(rudder, resistance=0.7, straightening=0.6, asymmetry=0.3),)), 5
    return planar_model(case), 3


def test_every_planar_form_is_tested() -> None:
    assert set(VALUES) == {form.key for form in PLANAR_FORMS}


@pytest.mark.parametrize("case", CASES)
def test_free_run_agrees_with_scipy(case: str) -> None:
    model, columns = case_model(case)
    time, inputs = np.arange(400) * 0.1, held_inputs(400, columns)
    start = np.array([0.3, 0.6, -0.05, 0.02, 1.0, 2.0])
    states = np.zeros((400, equations.STATES))
    equations.simulate_runs(np.array([0, 400]), time, inputs, start[None], SPEEDS, False, model.coefficients, states)
    current = np.array(model.current)
    rotated = np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]]) @ current

    def slope(t: float, x: FloatArray) -> FloatArray:
        held = inputs[min(int(t / 0.1 + 1e-9), 399)]
        cosine, sine = np.cos(x[0]), np.sin(x[0])
        over_ground = np.array([x[1] * cosine - x[2] * sine, x[1] * sine + x[2] * cosine]) + current
        return np.concatenate(([x[3]], equations.accelerations(model, x[1:4], held, np.zeros(3)), over_ground))

    state = start.copy()
    state[1:3] -= rotated
    worst = np.zeros(6)
    for k in range(0, 399, 40):
        # Between two steps of the inputs.
        span = time[k], time[min(k + 40, 399)]
        state = solve_ivp(slope, span, state, rtol=1e-9, atol=1e-9, max_step=0.5, first_step=1e-3).y[:, -1]
        here = states[min(k + 40, 399)][[0, 1, 2, 3, 9, 10]]
        worst = np.maximum(worst, np.abs(here - state))
    # Forces have a kink where the sway changes sign. There one step of 0.1 s is wrong by 1e-4 m/s at most; heading and
    # position add such errors up over 40 s.
    assert (worst < [1e-3, 1e-4, 1e-4, 1e-4, 2e-3, 2e-3]).all()


@pytest.mark.parametrize("measured", [SENSORS, SENSORS[:4]])
@pytest.mark.parametrize("case", CASES)
def test_filter_agrees_with_the_reference(case: str, measured: tuple[str, ...]) -> None:
    """With positions, and without them, where the filter leaves out states."""
    model, columns = case_model(case)
    count = 60
    rng = np.random.default_rng(2)
    time, inputs = np.cumsum(rng.uniform(0.02, 0.1, count)), held_inputs(count, columns)
    start, start_std = np.array([0.3, 0.6, -0.05, 0.02, 1.0, 2.0]), np.full(3, 0.1)
    truth = equations.simulate(model, time, inputs, start)
    motion = dict(zip(SENSORS, (truth[:, [0, 3, 1, 2, 4, 5]]).T, strict=True))
    noise = dict(zip(SENSORS, (0.01, 0.02, 0.02, 0.03, 0.2, 0.3), strict=True))
    events: list[list[tuple[str, float]]] = []
    for k in range(count):
        seen = [name for name in measured if rng.uniform() < 0.4]
        events.append([(name, motion[name][k] + noise[name] * rng.normal()) for name in seen])
    disturbance = np.array([[2.0, 1.0, 0.3], [3.0, 2.0, 5.0]])
    expected = equations.filter_innovations(
        model, time, inputs, events, start, start_std, disturbance, noise, substeps=8
    )
    numbers = np.concatenate((*disturbance, list(noise.values()), np.zeros(len(noise))))
    offsets = np.cumsum([0, *map(len, events)])
    sensors = np.array([SENSORS.index(name) for each in events for name, _ in each])
    values = np.array([value for each in events for _, value in each])
    error, variance = np.zeros((2, len(values)))
    states = np.zeros((0, equations.STATES))
    stds = np.array([0.0, *start_std, 0.0, 0.0])
    grid = np.array([0, count]), time, inputs, offsets, sensors, values, start[None], stds[None], SPEEDS, False
    kernels.filter_runs(*grid, model.coefficients, numbers, error, variance, states)
    # Both linearise at the middle of a step; the steps of the reference are several times shorter.
    deviation = np.sqrt(expected[:, 1])
    np.testing.assert_allclose(error / deviation, expected[:, 0] / deviation, atol=0.01)
    np.testing.assert_allclose(variance, expected[:, 1], rtol=0.01)


def test_a_filter_without_positions_has_the_innovations_of_one_with_them(
    small: tuple[PlanarData, PlanarOptimum],
) -> None:
    likelihood, x = small[1].likelihood, small[1].x
    assert not {"north", "east"} & {*small[0].sensors}
    (plain, _), (with_position, states) = likelihood.filtered(x), likelihood.filtered(x, keep=True)
    assert states[-1, equations.NORTH] != 0.0
    np.testing.assert_allclose(plain.error, with_position.error, rtol=0.0, atol=1e-12)  # rounding
    np.testing.assert_allclose(plain.variance, with_position.variance, rtol=1e-9)  # rounding


def test_log_cholesky_returns() -> None:
    mass = planar_model().mass_matrix
    scale = np.array([10.0, 20.0, 1.0])
    np.testing.assert_allclose(from_log_cholesky(log_cholesky(mass, scale), scale), BASE[:4], rtol=1e-12)
