"""The verdict on stability against integration to rest by this file's own step, on random models."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.export.body_equation import BodyEquation, Scheme, yaw_equation
from rovid.export.verification import judge_stability

# Number of random speeds in the envelope for the check.
STARTS = 40


def random_equation(random: np.random.Generator) -> tuple[BodyEquation, FloatArray]:
    """A vehicle between a small robot and a workboat, a scheme, and a step around the limit of stability."""
    size = 10.0 ** random.uniform(0.8, 3.5)
    length = (size / 300.0) ** (1.0 / 3.0) * random.uniform(1.5, 4.0)
    mass = size * np.diag([random.uniform(1.0, 1.3), random.uniform(1.3, 2.5), length**2 * random.uniform(0.06, 0.2)])
    mass[1, 2] = mass[2, 1] = random.uniform(-0.3, 0.3) * np.sqrt(mass[1, 1] * mass[2, 2])
    envelope = np.array([random.uniform(0.3, 2.0), random.uniform(0.1, 0.8), random.uniform(0.1, 0.8)])
    slowest = random.uniform(2.0, 20.0, 3)
    share = random.uniform(0.1, 1.0, 3)
    linear = np.diag(np.diag(mass) / slowest * share)
    quadratic = np.diag(mass) / slowest * (1.0 - share) / envelope
    absolute = np.zeros((3, 3, 3))
    for axis in range(3):
        absolute[axis, axis, axis] = quadratic[axis]
    scheme = Scheme(int(random.integers(0, 4)))
    lagged, weight = np.zeros((3, 3)), 1.0
    if scheme is Scheme.WORLD_EULER:
        weight = 0.3
        body = np.diag([mass[0, 0], mass[0, 0], mass[2, 2]]) * 10.0 ** random.uniform(-1.2, 0.0)
        mass, lagged = body, mass - body
    step = 10.0 ** random.uniform(-1.0, 1.5)
    equation = BodyEquation(
        mass=mass, linear=linear, absolute=absolute, lagged=lagged, filter_weight=weight, step=step, scheme=scheme
    )
    return equation, envelope


def comes_to_rest(equation: BodyEquation, envelope: FloatArray, step: float, seconds: float) -> bool:
    """Whether all speeds of the envelope decay to a sixth within ``seconds``, and stay so; plain numpy."""
    random = np.random.default_rng(1)
    nu = (envelope * random.uniform(-1.0, 1.0, (STARTS, 3))).T
    total = equation.mass + equation.lagged
    first = np.einsum("im,ij,jm->m", nu, total, nu)
    filtered = before = np.zeros((3, STARTS))
    inverse = np.linalg.inv(equation.mass)

    def damping(x: FloatArray) -> FloatArray:
        return np.asarray(equation.linear @ x + np.einsum("ijk,jm,km->im", equation.absolute, x, np.abs(x)))

    def acceleration(x: FloatArray, late: FloatArray) -> FloatArray:
        p = total @ x
        turning = np.array([-p[1] * x[2], p[0] * x[2], p[1] * x[0] - p[0] * x[1]])
        return np.asarray(inverse @ (-damping(x) - turning - equation.lagged @ late))

    with np.errstate(all="ignore"):
        for _ in range(max(round(seconds / step), 200)):
            filtered = (1.0 - equation.filter_weight) * filtered + equation.filter_weight * before
            if equation.scheme is Scheme.RUNGE_KUTTA:
                a = acceleration(nu, filtered)
                b = acceleration(nu + 0.5 * step * a, filtered)
                c = acceleration(nu + 0.5 * step * b, filtered)
                d = acceleration(nu + step * c, filtered)
                nu = nu + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
                continue
            change = acceleration(nu, filtered)
            if equation.scheme is Scheme.WORLD_IMPLICIT:
                diagonal = np.einsum("iii->i", equation.absolute)[:, None] * np.abs(nu)
                matrix = equation.mass + step * (equation.linear + 2.0 * np.eye(3) * diagonal.T[:, :, None])
                change = np.linalg.solve(matrix, (equation.mass @ change).T[:, :, None])[:, :, 0].T
            before = change
            if equation.scheme is Scheme.BODY_EULER:
                nu = nu + step * change
                continue
            # The velocity in axes of the world is integrated, then the body turns.
            u = nu[0] + step * (change[0] - nu[2] * nu[1])
            v = nu[1] + step * (change[1] + nu[2] * nu[0])
            r = nu[2] + step * change[2]
            turn = step * r
            nu = np.array([np.cos(turn) * u + np.sin(turn) * v, -np.sin(turn) * u + np.cos(turn) * v, r])
        energy = np.einsum("im,ij,jm->m", nu, total, nu)
    return bool(np.all(energy < first / 36.0))


@pytest.mark.parametrize("models", [6, pytest.param(50, marks=pytest.mark.slow)])
def test_the_verdict_is_that_of_integration_to_rest(models: int) -> None:
    random = np.random.default_rng(54)
    verdicts = []
    for _ in range(models):
        equation, envelope = random_equation(random)
        found = judge_stability(equation, tuple(envelope.tolist()))
        assert found.rest_time is not None  # damping along all axes, and none that feeds energy
        seconds = 2.0 * found.rest_time
        verdicts.append(found.stable)
        if found.largest_stable_step is None:
            # The loop through the acceleration of the step before: no step helps.
            assert not comes_to_rest(equation, envelope, 0.01 * equation.step, 3.0 * equation.step)
            continue
        assert found.stable == (equation.step <= found.largest_stable_step)
        assert comes_to_rest(equation, envelope, min(0.8 * found.largest_stable_step, equation.step), seconds)
        if equation.step > 1.3 * found.largest_stable_step:
            # Beyond the limit a step may be stable by chance, but not all steps near it.
            steps = equation.step * np.array([1.0, 0.85, 0.7])
            assert not all(comes_to_rest(equation, envelope, step, seconds) for step in steps)
    # Both answers occur often.
    assert 0.1 * models < sum(verdicts) < 0.9 * models


def yaw_slows(numbers: dict[str, float], scheme: Scheme, largest: float, step: float, seconds: float) -> bool:
    """Whether every rate up to ``largest`` decays to a sixth within ``seconds``, in plain steps."""
    linear, quadratic, cubic = numbers["linear"], numbers["quadratic"], numbers["cubic"]
    start = largest * np.linspace(-1.0, 1.0, 20)
    r, late, change = start, np.zeros(20), np.zeros(20)

    def slope(r: FloatArray) -> FloatArray:
        drag = (linear + quadratic * np.abs(r) + cubic * r * r) * r * np.where(r < 0.0, numbers["ratio"], 1.0)
        return np.asarray((-drag - numbers["added"] * late) / numbers["inertia"])

    with np.errstate(all="ignore"):
        for _ in range(max(round(seconds / step), 200)):
            late = 0.7 * late + 0.3 * change
            change = slope(r)
            if scheme is Scheme.RUNGE_KUTTA:
                b = slope(r + 0.5 * step * change)
                c = slope(r + 0.5 * step * b)
                change = (change + 2.0 * b + 2.0 * c + slope(r + step * c)) / 6.0
            r = r + step * change
    return bool(np.all(np.abs(r) < np.abs(start) / 6.0))


@pytest.mark.slow
def test_the_verdict_on_yaw_is_that_of_integration_to_rest() -> None:
    random = np.random.default_rng(57)
    verdicts = []
    for _ in range(50):
        total, largest, slow = 10.0 ** random.uniform(-0.5, 4.0), random.uniform(0.05, 1.5), random.uniform(1.0, 40.0)
        share, scheme = random.uniform(0.05, 1.0), Scheme(int(random.choice([0, 1, 3])))
        added = total * random.uniform(0.2, 0.95) if scheme is Scheme.WORLD_EULER else 0.0
        numbers = {
            "inertia": total - added,
            "added": added,
            "linear": share * total / slow,
            "quadratic": (1.0 - share) * total / slow / largest,
            # At the largest rate from minus twice the other drag to as much.
            "cubic": random.uniform(-2.0, 1.0) * total / slow / largest**2,
            "ratio": random.uniform(0.8, 1.3),
        }
        step = slow * 10.0 ** random.uniform(-2.0, 0.6)
        found = judge_stability(
            yaw_equation(**numbers, filter_weight=0.3, step=step, scheme=scheme), (0.0, 0.0, largest)
        )
        verdicts.append(found.stable)
        if found.rest_time is None:
            # Where the drag is negative, the exact equation does not come to rest either.
            assert not yaw_slows(numbers | {"inertia": total, "added": 0.0}, scheme, largest, 0.01 * slow, 20.0 * slow)
        elif found.largest_stable_step is None:
            assert not yaw_slows(numbers, scheme, largest, 0.01 * step, 3.0 * step)
        elif found.stable:
            assert yaw_slows(numbers, scheme, largest, step, 4.0 * found.rest_time)
        else:
            near = step * np.array([1.0, 0.85, 0.7])
            assert not all(yaw_slows(numbers, scheme, largest, one, 4.0 * found.rest_time) for one in near)
    # Both answers occur often.
    assert 10 < sum(verdicts) < 40


def test_a_known_limit_is_found() -> None:
    # Explicit Euler on linear damping alone: stable below 2 m / d, here 2 s in the fastest axis.
    equation = BodyEquation(
        mass=np.diag([10.0, 20.0, 5.0]),
        linear=np.diag([10.0, 5.0, 1.0]),
        absolute=np.zeros((3, 3, 3)),
        step=0.1,
        scheme=Scheme.BODY_EULER,
    )
    found = judge_stability(equation, (1.0, 0.0, 0.0))
    assert found.stable
    assert found.largest_stable_step == pytest.approx(2.0, rel=0.06)  # bisected to 3 %, two digits, rounded down
    assert found.rest_time == pytest.approx(np.log(10.0), rel=0.05)  # the tenth of the speed


@pytest.mark.slow
def test_added_mass_through_the_step_before_has_no_stable_step_beyond_its_ratio() -> None:
    # Filter of weight 0.3: 0.7 - 0.3 * ratio > -1, so a ratio of 17/3 is the limit.
    for ratio, stable in ((5.5, True), (5.8, False)):
        equation = BodyEquation(
            mass=np.eye(3),
            lagged=ratio * np.eye(3),
            filter_weight=0.3,
            linear=0.5 * np.eye(3),
            absolute=np.zeros((3, 3, 3)),
            step=0.002,
            scheme=Scheme.WORLD_EULER,
        )
        found = judge_stability(equation, (1.0, 0.5, 0.3))
        assert found.stable == stable
        assert (found.largest_stable_step is None) == (not stable)


def test_a_model_without_drag_is_not_called_stable() -> None:
    equation = BodyEquation(
        mass=np.diag([10.0, 20.0, 5.0]),
        linear=np.diag([10.0, 0.0, 1.0]),
        absolute=np.zeros((3, 3, 3)),
        step=0.001,
        scheme=Scheme.BODY_EULER,
    )
    found = judge_stability(equation, (1.0, 1.0, 0.3))
    assert not found.stable
    assert found.largest_stable_step is None
    assert "itself does not come to rest" in found.text


def test_a_model_whose_coupling_feeds_small_motions_is_not_called_stable() -> None:
    # An eigenvalue of the linear damping is -0.1: from large speeds the drag leads to a slow motion, not to rest.
    linear = np.array([[0.5, 0.0, 0.0], [0.0, 0.5, -0.6], [0.0, -0.6, 0.5]])
    absolute = np.zeros((3, 3, 3))
    for axis in range(3):
        absolute[axis, axis, axis] = 5.0
    equation = BodyEquation(mass=np.eye(3), linear=linear, absolute=absolute, step=0.001, scheme=Scheme.BODY_EULER)
    found = judge_stability(equation, (1.0, 1.0, 1.0))
    assert not found.stable
    assert found.largest_stable_step is None
    assert "itself does not come to rest" in found.text
