"""What the water does, against closed forms and scipy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.tools.motions import free, hiding, move, moved, plain_drag, quiet, strong
from tools.simulate import MICRO
from tools.truth import ROSUB, FloatArray


@pytest.mark.parametrize(
    ("form", "law"), [("linear", lambda u, r: -900.0 * np.abs(u) * r), ("quadratic", lambda u, r: -900.0 * u**2 * r)]
)
def test_damping_grows_with_the_logged_speed(form: str, law: Callable[[FloatArray, FloatArray], FloatArray]) -> None:
    motion, left, at = moved(hiding(quiet(ROSUB), "speed_dependent_damping", form, **{form: 900.0}), 1.55)
    speed = motion.channels["surge_velocity"]
    np.testing.assert_allclose(left[at], law(speed, motion.rate)[at], atol=0.1)
    assert np.ptp(speed) > 0.5
    assert np.min(speed) < 0.0


@pytest.mark.parametrize(("form", "name"), [("drift", "coefficient"), ("munk", "munk")])
def test_sideslip_turns_with_the_logged_speeds(form: str, name: str) -> None:
    motion, left, at = moved(hiding(quiet(ROSUB), "sideslip_moment", form, **{name: 80.0}), 0.0)
    along = 1.0 if form == "drift" else motion.channels["surge_velocity"]
    np.testing.assert_allclose(left[at], (-80.0 * along * motion.channels["sway_velocity"])[at], atol=0.02)
    assert np.std(left) > 3.0


# (heading, rate, further states, thrusters' torque) -> (torque besides thrusters, slopes of the states).
Rest = Callable[[float, float, FloatArray, float], tuple[float, list[float]]]


def _square(r: float) -> float:
    return ROSUB.dynamics.quadratic_drag * abs(r) * r


def _acceleration(total: float) -> float:
    return total / ROSUB.dynamics.inertia


def _reference(form: str, p: Mapping[str, float]) -> Rest:
    dynamics = ROSUB.dynamics
    dq, inertia = dynamics.quadratic_drag, dynamics.inertia
    tau, w0, z = p.get("time_constant", 1.0), p.get("frequency", 1.0), p.get("damping", 0.0)

    def annulus(slip: float, swirl: float) -> float:
        # Wall friction and inertia from the two conditions that the form states.
        along = p["coupling"] * p["rate"]
        steady = plain_drag(p["rate"] - along)
        slope = 2.0 * dq * (p["rate"] - along) + dynamics.linear_drag
        mass = tau * (2.0 * steady / along + slope)
        return (plain_drag(slip) - steady * abs(swirl) * swirl / along**2) / mass

    def seiche(r: float, x: FloatArray, thrust: float, driven: bool) -> tuple[float, list[float]]:
        extra = -plain_drag(r) - p["gain"] * inertia * w0 * x[1]
        drive = thrust / inertia if driven else _acceleration(thrust + extra)
        return extra, [x[1], drive - 2.0 * z * w0 * x[1] - w0**2 * x[0]]

    laws: dict[str, Rest] = {
        "bias_torque/constant": lambda _h, r, _x, _t: (p["torque"] - plain_drag(r), []),
        "drag_curvature/cubic": lambda _h, r, _x, _t: (-plain_drag(r) - p["cubic"] * r**3, []),
        "drag_curvature/exponent": lambda _h, r, _x, _t: (
            -dq * p["rate"] ** 2 * abs(r / p["rate"]) ** p["exponent"] * np.sign(r) - dynamics.linear_drag * r,
            [],
        ),
        "drag_asymmetry/quadratic": lambda _h, r, _x, _t: (
            -plain_drag(r) - (r < 0) * (p["ratio"] - 1.0) * _square(r),
            [],
        ),
        "drag_asymmetry/whole": lambda _h, r, _x, _t: (-plain_drag(r) * (p["ratio"] if r < 0 else 1.0), []),
        "coulomb_resistance/smooth": lambda _h, r, _x, _t: (-plain_drag(r) - p["torque"] * np.tanh(r / p["rate"]), []),
        "coulomb_resistance/stiction": lambda _h, r, _x, _t: (
            -plain_drag(r) - p["torque"] * (1.0 + 0.5 * np.exp(-((r / p["rate"] / 5.0) ** 2))) * np.tanh(r / p["rate"]),
            [],
        ),
        "coulomb_resistance/unequal": lambda _h, r, _x, _t: (
            -plain_drag(r)
            - p["torque"]
            * (np.tanh(r / p["rate"]) if r > 0 else p["back"] * np.tanh(r / p["rate"]) + p["viscous"] * r),
            [],
        ),
        "added_mass_memory/trapped_water": lambda _h, r, x, _t: (
            -plain_drag(r) - p["inertia"] * (r - x[0]) / tau,
            [(r - x[0]) / tau],
        ),
        "added_mass_memory/cummins": lambda _h, r, x, _t: (
            -plain_drag(r) - x[0],
            [-x[0] / tau + p["inertia"] / tau**2 * r],
        ),
        "added_mass_memory/porous": lambda _h, r, x, _t: (
            -plain_drag(r) - p["inertia"] * (r - x[0]) * abs(r - x[0]) / (tau * p["rate"]),
            [(r - x[0]) * abs(r - x[0]) / (tau * p["rate"])],
        ),
        "entrained_swirl/first_order": lambda _h, r, x, _t: (-plain_drag(r - x[0]), [(p["coupling"] * r - x[0]) / tau]),
        "entrained_swirl/annulus": lambda _h, r, x, _t: (-plain_drag(r - x[0]), [annulus(r - x[0], x[0])]),
        "tether_torsion/linear": lambda h, r, _x, _t: (-plain_drag(r) - p["stiffness"] * h, []),
        "tether_torsion/stiffening": lambda h, r, _x, _t: (
            -plain_drag(r) - p["stiffness"] * h * (1.0 + (h / p["angle"]) ** 2),
            [],
        ),
        "tank_seiche/acceleration": lambda _h, r, x, t: seiche(r, x, t, driven=False),
        "tank_seiche/thrust": lambda _h, r, x, t: seiche(r, x, t, driven=True),
    }
    return laws[form]


WATER = [
    "bias_torque/constant",
    "drag_curvature/cubic",
    "drag_curvature/exponent",
    "drag_asymmetry/quadratic",
    "drag_asymmetry/whole",
    "coulomb_resistance/smooth",
    "coulomb_resistance/stiction",
    "coulomb_resistance/unequal",
    "added_mass_memory/trapped_water",
    "added_mass_memory/cummins",
    "added_mass_memory/porous",
    "entrained_swirl/first_order",
    "entrained_swirl/annulus",
    "tether_torsion/linear",
    "tether_torsion/stiffening",
    "tank_seiche/acceleration",
    "tank_seiche/thrust",
]


@pytest.mark.parametrize("form", WATER)
def test_water_against_scipy(form: str) -> None:
    (one,) = strong(ROSUB, *form.split("/")).hidden
    rest = _reference(form, one.parameters)
    truth = replace(quiet(ROSUB), hidden=(one,))
    levels = [(0.0, 1.8), (15.0, -2.2), (32.0, 0.0)]
    motion = move(truth, *levels, duration=50.0)

    def slope(_: float, y: FloatArray, thrust: float) -> list[float]:
        extra, states = rest(float(y[0]), float(y[1]), y[2:], thrust)
        return [float(y[1]), _acceleration(thrust + extra), *states]

    states = len(rest(0.0, 0.0, np.zeros(2), 0.0)[1])
    state = np.zeros(2 + states)
    for (begin, level), (end, _) in pairwise([*levels, (50.0, 0.0)]):
        inside = np.arange(round(begin * 20), round(end * 20) + 1) / 20.0
        solved = solve_ivp(
            slope, (begin, end), state, args=(ROSUB.yaw_torque(level),), t_eval=inside, rtol=1e-9, atol=1e-12
        )
        state = solved.y[:, -1]
        got = motion.heading[round(begin * 20) : round(end * 20) + 1] - motion.heading[0]
        # A hundredth of the heading's noise.
        np.testing.assert_allclose(np.degrees(got), np.degrees(solved.y[0]), rtol=0.0, atol=1e-4)


def test_swirl_and_torsion_come_to_their_steady_states() -> None:
    steady = ROSUB.middle_rate
    swirl = hiding(quiet(ROSUB), "entrained_swirl", "first_order", coupling=0.2, time_constant=20.0)
    assert move(swirl, (0.0, 1.55), duration=400.0).rate[-1] == pytest.approx(steady / 0.8)
    annulus = hiding(quiet(ROSUB), "entrained_swirl", "annulus", coupling=0.2, time_constant=20.0, rate=steady / 0.8)
    assert move(annulus, (0.0, 1.55), duration=400.0).rate[-1] == pytest.approx(steady / 0.8)
    torsion = hiding(quiet(ROSUB), "tether_torsion", "linear", stiffness=60.0)
    motion = move(torsion, (0.0, 1.55), duration=600.0)
    assert motion.heading[-1] - motion.heading[0] == pytest.approx(ROSUB.middle_torque / 60.0, rel=1e-4)


@pytest.mark.parametrize(("form", "law"), [("exponential", lambda s: np.exp(-s)), ("algebraic", lambda s: 1 / (1 + s))])
def test_drag_falls_with_the_angle_swept_since_the_reversal(form: str, law: Callable[[FloatArray], FloatArray]) -> None:
    truth = hiding(quiet(ROSUB), "oscillatory_drag", form, gain=0.6, angle=1.0)
    motion = move(truth, (0.0, 1.8), (30.0, -2.2), duration=60.0, substep=1_000)
    time, rate = motion.instant / MICRO, motion.rate
    reversal = int(np.argmax(rate < 0.0))
    for inside, command in ((slice(2, 595), 1.8), (slice(reversal + 2, -2), -2.2)):
        needed = ROSUB.yaw_torque(command) - 5057.0 * np.gradient(rate, time)[inside] - 132.0 * rate[inside]
        start = motion.heading[0] if command > 0.0 else np.max(motion.heading)
        swept = np.abs(motion.heading - start)[inside]
        wanted = 3532.0 * np.abs(rate[inside]) * rate[inside] * (1.0 + 0.6 * law(swept))
        # N m; a difference over two samples is no better where the torque has just jumped.
        np.testing.assert_allclose(needed, wanted, atol=0.1)


@pytest.mark.parametrize("form", ["one_cycle", "two_cycles", "current"])
def test_torque_depends_on_the_heading(form: str) -> None:
    motion = move(
        hiding(free(), "heading_dependent_torque", form, amplitude=15.0, phase=0.8), (0.0, 1.0), duration=60.0
    )
    psi = motion.heading
    got = 5057.0 * np.gradient(motion.rate, motion.instant / MICRO) - ROSUB.yaw_torque(1.0)
    wanted = {
        "one_cycle": np.sin(psi + 0.8),
        "two_cycles": np.sin(2.0 * psi + 0.8),
        "current": np.sin(psi + 0.8) + 0.6 * np.sin(2.0 * (psi + 0.8)),
    }[form]
    np.testing.assert_allclose(got[1:-1], 15.0 * wanted[1:-1], atol=0.05)


@pytest.mark.slow
def test_waves_have_their_size_and_period() -> None:
    sine = hiding(free(), "wave_torque", "sine", amplitude=20.0, frequency=1.25)
    band = hiding(free(), "wave_torque", "narrow_band", amplitude=20.0, frequency=1.25, damping=0.03)
    for form, truth in (("sine", sine), ("narrow_band", band)):
        motion = move(truth, (0.0, 0.0), duration=2000.0)
        got = 5057.0 * np.gradient(motion.rate, motion.instant / MICRO)
        # 2000 s are 25 correlation times of the narrow band.
        assert np.std(got) == pytest.approx(20.0 / np.sqrt(2.0), rel=0.01 if form == "sine" else 0.15)
        spectrum = np.abs(np.fft.rfft(got))
        peak = 2.0 * np.pi * np.argmax(spectrum) / 2000.0
        assert peak == pytest.approx(1.25, rel=0.002 if form == "sine" else 0.1)
        near = np.abs(2.0 * np.pi * np.arange(len(spectrum)) / 2000.0 - 1.25) < 0.2
        assert np.sum(spectrum[near] ** 2) > 0.75 * np.sum(spectrum**2)


def test_wandering_bias_has_the_bias_for_its_mean() -> None:
    truth = hiding(free(), "bias_torque", "wandering", torque=10.0, period=100.0)
    motion = move(truth, (0.0, 0.0), duration=200.0)
    got = 5057.0 * np.gradient(motion.rate, motion.instant / MICRO)
    assert np.mean(got) == pytest.approx(10.0, rel=0.01)
    assert np.ptp(got) == pytest.approx(5.0, rel=0.01)
