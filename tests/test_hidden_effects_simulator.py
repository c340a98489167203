"""What the simulator hides, against closed forms and scipy; the catalogue of cases; effects in a real log."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader
from scipy.integrate import cumulative_trapezoid, solve_ivp

from rovid.effects import CATALOGUE
from tools.cases import CONTRACT_FORMS, SIZES, Case, all_cases, groups, truth_of
from tools.channels import EXTRA, column
from tools.hidden import DRIVERS, EFFECTS, FORMS, OUTSIDE, Hidden
from tools.inject import INJECTABLE, Source, inject, linear_curve
from tools.paths import Path as CommandPath
from tools.paths import acting_path
from tools.programme import Hold, Run, Sine, campaign_for
from tools.simulate import MICRO, SUBSTEP, Held, Motion, simulate
from tools.trial_day import deviated, record, write_trial_day
from tools.truth import (
    ROSUB,
    SMALL,
    VEHICLES,
    Attitude,
    Disturbance,
    Dynamics,
    FloatArray,
    Instruments,
    IntArray,
    Truth,
)

SAMPLES = Path(__file__).resolve().parents[1] / "sample_logs"
DIVE = Source(folder=SAMPLES / "bluerov2_pier59")
# What brings a vehicle back is nothing that there is in yaw.
LAWS = [(effect, form) for effect, forms in FORMS.items() if effect != "restoring_curve" for form in forms]
STRONG = {vehicle.name: {c.name: c for c in all_cases(vehicle)} for vehicle in VEHICLES}


def strong(vehicle: Truth, effect: str, form: str) -> Case:
    return STRONG[vehicle.name][f"{effect}-{form}-strong"]


def quiet(truth: Truth) -> Truth:
    """``truth`` without disturbance, roll, pitch and heading noise."""
    return replace(
        truth,
        disturbance=Disturbance(standard_deviation=0.0),
        attitude=Attitude(roll=0.0, pitch=0.0, wander=0.0),
        instruments=replace(truth.instruments, angle_noise=0.0),
    )


def free(truth: Truth = ROSUB) -> Truth:
    """A quiet ``truth`` without drag: its rate is the integral of its torque over its inertia."""
    inertia = truth.dynamics.inertia
    return replace(quiet(truth), dynamics=Dynamics(inertia=inertia, quadratic_drag=0.0, linear_drag=0.0))


def hiding(truth: Truth, effect: str, form: str, **parameters: float) -> Truth:
    one = Hidden(effect=effect, form=form, parameters=parameters)
    return replace(truth, hidden=(*truth.hidden, one))


def ticks(duration: float, offset: int = 0) -> IntArray:
    return np.arange(0, round(duration * MICRO) + 1, 50_000) + offset


def move(
    truth: Truth,
    *levels: tuple[float, float],
    duration: float = 20.0,
    only: str | None = None,
    sample: IntArray | None = None,
    substep: int = SUBSTEP,
) -> Motion:
    """Motion under ``levels``: (time in s, command from neutral), each held to the next."""
    instant = np.array([round(time * MICRO) for time, _ in levels])
    value = np.array([level for _, level in levels])
    commands = [
        Held(
            instant=instant,
            value=thruster.curve.neutral + value * (only in {None, thruster.name}),
            neutral=thruster.curve.neutral,
        )
        for thruster in truth.thrusters
    ]
    wanted = ticks(duration) if sample is None else sample
    return simulate(truth, commands, wanted, np.random.default_rng(5), substep=substep)


def torque(truth: Truth, *, command: float, only: str | None = None) -> float:
    """Mean torque in N m over a second at ``command`` from neutral, of a vehicle without drag."""
    return truth.dynamics.inertia * float(move(truth, (0.0, command), duration=1.0, only=only).rate[-1])


def excitation(truth: Truth) -> list[tuple[float, float]]:
    """Both ways, a stop, and steps that come faster than the vehicle follows."""
    middle, pace = truth.middle, truth.pace or 1.0
    shares = (
        (0.0, 1.0),
        (8.0, -1.3),
        (16.0, 0.0),
        (22.0, 1.2),
        (23.013, -1.1),
        (24.5, 0.7),
        (28.0, 0.0),
        (30.0, 0.5),
        (33.0, 0.0),
    )
    return [(time * pace, share * middle) for time, share in shares]


def excited(truth: Truth, *, substep: int = SUBSTEP) -> Motion:
    return move(truth, *excitation(truth), duration=36.0 * (truth.pace or 1.0), substep=substep)


# ---- null, size, convergence


@pytest.mark.parametrize(("effect", "form"), LAWS)
def test_null_size_changes_nothing_at_all(effect: str, form: str) -> None:
    (one,) = strong(SMALL, effect, form).hidden
    plain, nulled = excited(SMALL), excited(replace(SMALL, hidden=(one.nulled(),)))
    assert (plain.heading == nulled.heading).all()
    assert (plain.roll == nulled.roll).all()


@pytest.mark.parametrize(("effect", "form"), LAWS)
def test_what_is_hidden_goes_to_nothing_with_its_size_and_is_seen_when_strong(effect: str, form: str) -> None:
    truth = quiet(SMALL)
    case = strong(truth, effect, form)
    (one,) = case.hidden
    law, size = one.law, one.parameters[one.law.size]
    small = size * 1e3 if np.isinf(law.null) else law.null + 1e-3 * (size - law.null)
    # Torque by pitch needs pitch.
    leaning = replace(truth, attitude=Attitude())
    full = case.of(leaning)
    tiny = replace(leaning, hidden=(replace(one, parameters={**one.parameters, law.size: small}),))
    base = excited(leaning).heading
    seen, little = (
        float(np.max(np.abs(np.degrees(deviated(excited(truth).heading, truth) - base)))) for truth in (full, tiny)
    )
    assert seen > 0.1  # ten times the heading's noise
    assert little < 0.01 * seen


@pytest.mark.parametrize(("effect", "form"), LAWS)
def test_integration_has_converged(effect: str, form: str) -> None:
    truth = strong(SMALL, effect, form).of(replace(SMALL, disturbance=Disturbance(standard_deviation=0.0)))
    coarse, fine = excited(truth), excited(truth, substep=SUBSTEP // 2)
    # A tenth of the heading's noise; dead zones and reversals have kinks inside steps.
    np.testing.assert_allclose(np.degrees(coarse.heading), np.degrees(fine.heading), rtol=0.0, atol=1e-3)


# ---- actuators


def test_a_delay_of_no_whole_number_of_samples_shifts_the_motion() -> None:
    levels = excitation(ROSUB)
    now = move(quiet(ROSUB), *levels)
    late = move(
        hiding(quiet(ROSUB), "command_delay", "constant", delay=0.2371), *levels, sample=ticks(20.0, offset=237_100)
    )
    np.testing.assert_allclose(late.heading, now.heading, rtol=0.0, atol=1e-8)


def _path(values: list[float], *, every: float = 1.0, **hidden: Hidden) -> CommandPath:
    instant = (np.arange(len(values)) * every * MICRO).astype(np.int64)
    return acting_path(instant, np.array(values), 0.3, hidden)


def test_polled_commands_act_at_the_next_reading() -> None:
    polled = Hidden(effect="command_delay", form="polled", parameters={"delay": 0.6})
    path = _path([1.0, 2.0, 3.0, 4.0], command_delay=polled)
    assert path.instant.tolist() == [0, 1_200_000, 2_400_000, 3_600_000]
    assert path.value.tolist() == [1.0, 2.0, 3.0, 4.0]
    # Of two commands between readings the later one is read.
    assert _path([1.0, 2.0, 3.0, 4.0], every=0.5, command_delay=polled).value.tolist() == [1.0, 3.0, 4.0]


def test_play_follows_half_its_width_behind() -> None:
    play = Hidden(effect="command_hysteresis", form="play", parameters={"width": 0.4})
    path = _path([0.1, 1.0, 1.5, 1.3, 0.9, 1.2, 1.4], command_hysteresis=play)
    assert path.value == pytest.approx([0.0, 0.8, 1.3, 1.3, 1.1, 1.1, 1.2])


def test_schmitt_starts_late_and_stops_at_the_dead_zone() -> None:
    schmitt = Hidden(effect="command_hysteresis", form="schmitt", parameters={"width": 0.5})
    path = _path([0.7, 0.9, 0.4, 0.2, -0.6, -0.9, -0.5, 0.5], command_hysteresis=schmitt)
    assert path.value == pytest.approx([0.0, 0.9, 0.4, 0.0, 0.0, -0.9, -0.5, 0.5])


def _values(path: CommandPath, *times: float) -> FloatArray:
    begin = np.array([round(time * MICRO) for time in times])
    return path.over(begin, np.zeros(len(begin)))


def test_slew_limit_ramps_through_samples_and_meets_a_new_target() -> None:
    hard = Hidden(effect="slew_limit", form="hard", parameters={"rate": 0.8})
    path = _path([1.0, 2.0, -1.0], slew_limit=hard)
    # 0.8 after a second, on to 1.6 when the target turns round, at it after another 3.25 s.
    assert _values(path, 0.5, 1.0, 2.0, 3.0, 5.25, 6.0) == pytest.approx([0.4, 0.8, 1.6, 0.8, -1.0, -1.0])
    assert _values(_path([0.4, 0.4], slew_limit=hard), 0.25, 0.5, 0.7, 1.5) == pytest.approx([0.2, 0.4, 0.4, 0.4])


def test_soft_start_lets_go_at_once() -> None:
    soft = Hidden(effect="slew_limit", form="soft_start", parameters={"rate": 0.5})
    path = _path([1.0, 0.2, -1.0, 0.0], slew_limit=soft)
    assert _values(path, 0.5, 0.999, 1.0, 2.0, 2.5, 3.0) == pytest.approx([0.25, 0.4995, 0.2, 0.0, -0.25, 0.0])


def test_slewed_thrust_gives_the_integral_of_its_ramp() -> None:
    rate, end = 0.7, 1.55
    truth = hiding(free(), "slew_limit", "hard", rate=rate)
    time = np.linspace(0.0, 5.0, 500_001)
    thrust = ROSUB.thrusters[0].curve.thrust(np.minimum(rate * time, end))
    exact = cumulative_trapezoid(0.86 * thrust / 5057.0, time, initial=0)
    motion = move(truth, (0.0, end), duration=5.0)
    np.testing.assert_allclose(motion.rate, np.interp(motion.instant / MICRO, time, exact), rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("form", ["first_order", "quadratic"])
def test_lagged_step_is_the_closed_form(form: str) -> None:
    lag = 0.6
    parameters = {"time_constant": lag} | ({"thrust": ROSUB.middle_thrust} if form == "quadratic" else {})
    one = Hidden(effect="thruster_lag", form=form, parameters=parameters)
    motion = move(replace(free(), hidden=(one,)), (0.0, ROSUB.middle), duration=5.0)
    time = motion.instant / MICRO
    # n = tanh(t/2 tau) from rest at the reference thrust; the integral of its square.
    missing = lag * -np.expm1(-time / lag) if form == "first_order" else 2.0 * lag * np.tanh(time / (2.0 * lag))
    np.testing.assert_allclose(motion.rate, ROSUB.middle_torque / 5057.0 * (time - missing), rtol=1e-7, atol=1e-12)


def test_lag_before_the_curve_spends_time_in_the_dead_zone() -> None:
    lag, command = 0.5, 1.5
    motion = move(hiding(free(), "thruster_lag", "command", time_constant=lag), (0.0, command), duration=3.0)
    time = np.linspace(0.0, 3.0, 300_001)
    thrust = ROSUB.thrusters[0].curve.thrust(command * -np.expm1(-time / lag))
    exact = cumulative_trapezoid(0.86 * thrust / 5057.0, time, initial=0)
    np.testing.assert_allclose(motion.rate, np.interp(motion.instant / MICRO, time, exact), rtol=0.0, atol=1e-8)
    starts = -lag * np.log(1.0 - 0.3 / command)
    assert (motion.rate[motion.instant / MICRO < starts] == 0.0).all()


def test_dead_zones_give_no_thrust_and_then_what_they_should() -> None:
    shift = hiding(free(), "thruster_deadband", "shift", deadband=0.15)
    jump = hiding(free(), "thruster_deadband", "jump", deadband=0.15)
    for truth in (shift, jump):
        assert torque(truth, command=0.44) == torque(truth, command=-0.44) == 0.0
    assert torque(shift, command=1.5) == pytest.approx(ROSUB.yaw_torque(1.35))
    assert torque(shift, command=-1.5) == pytest.approx(ROSUB.yaw_torque(-1.35))
    assert torque(jump, command=0.46) == pytest.approx(ROSUB.yaw_torque(0.46))


def test_static_thrust_errors() -> None:
    middle = ROSUB.middle_thrust
    forward, reverse = ROSUB.yaw_torque(1.55), ROSUB.yaw_torque(-1.55)
    weak = hiding(free(), "thrust_asymmetry", "gain", reverse_gain=0.8)
    assert torque(weak, command=1.55) == pytest.approx(forward)
    assert torque(weak, command=-1.55) == pytest.approx(0.8 * reverse)
    growing = hiding(free(), "thrust_asymmetry", "growing", reverse_gain=0.8, thrust=middle)
    assert torque(growing, command=-1.55) == pytest.approx(reverse * (1.0 + 0.2 * reverse / forward))
    power = hiding(free(), "thrust_curve_shape", "power", exponent=0.8, thrust=middle)
    assert torque(power, command=-1.55) == pytest.approx(forward * -((-reverse / forward) ** 0.8))
    soft = hiding(free(), "thrust_curve_shape", "saturating", loss=0.3, thrust=middle)
    assert torque(soft, command=1.55) == pytest.approx(forward)
    assert torque(soft, command=0.8) > ROSUB.yaw_torque(0.8)


def test_one_thruster_is_weak_alone_or_only_beside_the_other() -> None:
    half = ROSUB.middle_torque / 2.0
    for form, alone in (("gain", 0.7), ("interaction", 1.0)):
        one = Hidden(effect="thruster_imbalance", form=form, thruster="aft", parameters={"gain": 0.7})
        truth = replace(free(), hidden=(one,))
        assert torque(truth, command=1.55) == pytest.approx(1.7 * half)
        assert torque(truth, command=1.55, only="aft") == pytest.approx(alone * half)
        assert torque(truth, command=1.55, only="fore") == pytest.approx(half)


def test_sag_with_load_settles_and_with_time_goes_on() -> None:
    total = 2.0 * ROSUB.middle_thrust
    load = hiding(free(), "supply_sag", "load", sag=0.15, time_constant=0.5, thrust=total)
    elapsed = hiding(free(), "supply_sag", "elapsed", drift=0.9)
    full = ROSUB.middle_torque / 5057.0
    motion = move(load, (0.0, 1.55), duration=10.0)
    time = motion.instant / MICRO
    np.testing.assert_allclose(motion.rate, full * (time - 0.15 * (time + 0.5 * np.expm1(-time / 0.5))), atol=1e-9)
    exact = full * (time - 0.9 / 3600.0 * time**2 / 2.0)
    np.testing.assert_allclose(move(elapsed, (0.0, 1.55), duration=10.0).rate, exact, atol=1e-9)


def test_thrust_follows_the_logged_voltage() -> None:
    truth = hiding(free(), "supply_sag", "voltage", exponent=1.1, wander=4.0)
    motion = move(truth, (0.0, 1.55), duration=60.0)
    share = 1.0 + np.asarray(motion.supply) / truth.instruments.supply
    slope = np.gradient(motion.rate, motion.instant / MICRO)[1:-1]
    np.testing.assert_allclose(slope, ROSUB.middle_torque / 5057.0 * share[1:-1] ** 1.1, rtol=1e-4)
    assert np.ptp(share) > 0.02


@pytest.mark.parametrize("form", ["bilinear", "open_water"])
def test_loss_by_advance_speed_is_in_the_steady_balance(form: str) -> None:
    k, arm, thrust = 25.0, 0.43, ROSUB.middle_thrust
    rate = move(hiding(quiet(ROSUB), "advance_speed_loss", form, coefficient=k), (0.0, 1.55), duration=120.0).rate[-1]
    j = k * arm * rate / np.sqrt(thrust)
    minerva = 1.0 + (-0.25 * j - 0.66 * j**2 + 0.50 * j**3) / 0.24
    share = 1.0 - j if form == "bilinear" else minerva
    assert 3532.0 * rate**2 + 132.0 * rate == pytest.approx(2.0 * arm * thrust * share, rel=1e-9)
    assert 0.7 < share < 0.95


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_curve_bent_in_the_command_is_the_same_law_both_ways(way: float) -> None:
    bent = hiding(free(), "thrust_curve_shape", "command", exponent=1.2)
    full = ROSUB.thrusters[0].curve.limit - 0.3
    for share in (0.1, 0.3, 1.0):
        told, acts = 0.3 + share * full, 0.3 + share**1.2 * full
        assert torque(bent, command=way * told) == pytest.approx(ROSUB.yaw_torque(way * acts))
    assert torque(bent, command=way * 0.29) == 0.0


def moved(truth: Truth, command: float) -> tuple[Motion, FloatArray, slice]:
    """The motion under a held ``command``, what inertia and drag need beside its torque, and where that is known."""
    motion = move(truth, (0.0, command), duration=300.0)
    left = 5057.0 * np.gradient(motion.rate, motion.instant / MICRO) + np.array([_plain(r) for r in motion.rate])
    return motion, left - ROSUB.yaw_torque(command), slice(2, -2)


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


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_thrust_is_lost_to_the_logged_speed(way: float) -> None:
    motion, left, at = moved(hiding(quiet(ROSUB), "advance_speed_loss", "measured", coefficient=2.0), way * 1.55)
    root = np.sqrt(abs(ROSUB.yaw_torque(way * 1.55)) / 0.86)
    np.testing.assert_allclose(left[at], -0.86 * 2.0 * root * motion.channels["surge_velocity"][at], atol=0.1)


# ---- water, against scipy with equations written anew

Rest = Callable[[float, float, FloatArray, float], tuple[float, list[float]]]
"""(heading, rate, further states, thrusters' torque) -> (torque besides thrusters, slopes of the states)."""


def _plain(r: float) -> float:
    d = ROSUB.dynamics
    return (d.quadratic_drag * abs(r) + d.linear_drag) * r


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
        steady = _plain(p["rate"] - along)
        slope = 2.0 * dq * (p["rate"] - along) + dynamics.linear_drag
        mass = tau * (2.0 * steady / along + slope)
        return (_plain(slip) - steady * abs(swirl) * swirl / along**2) / mass

    def seiche(r: float, x: FloatArray, thrust: float, driven: bool) -> tuple[float, list[float]]:
        extra = -_plain(r) - p["gain"] * inertia * w0 * x[1]
        drive = thrust / inertia if driven else _acceleration(thrust + extra)
        return extra, [x[1], drive - 2.0 * z * w0 * x[1] - w0**2 * x[0]]

    laws: dict[str, Rest] = {
        "bias_torque/constant": lambda _h, r, _x, _t: (p["torque"] - _plain(r), []),
        "drag_curvature/cubic": lambda _h, r, _x, _t: (-_plain(r) - p["cubic"] * r**3, []),
        "drag_curvature/exponent": lambda _h, r, _x, _t: (
            -dq * p["rate"] ** 2 * abs(r / p["rate"]) ** p["exponent"] * np.sign(r) - dynamics.linear_drag * r,
            [],
        ),
        "drag_asymmetry/quadratic": lambda _h, r, _x, _t: (
            -_plain(r) - (r < 0) * (p["ratio"] - 1.0) * _square(r),
            [],
        ),
        "drag_asymmetry/whole": lambda _h, r, _x, _t: (-_plain(r) * (p["ratio"] if r < 0 else 1.0), []),
        "coulomb_resistance/smooth": lambda _h, r, _x, _t: (-_plain(r) - p["torque"] * np.tanh(r / p["rate"]), []),
        "coulomb_resistance/stiction": lambda _h, r, _x, _t: (
            -_plain(r) - p["torque"] * (1.0 + 0.5 * np.exp(-((r / p["rate"] / 5.0) ** 2))) * np.tanh(r / p["rate"]),
            [],
        ),
        "coulomb_resistance/unequal": lambda _h, r, _x, _t: (
            -_plain(r)
            - p["torque"]
            * (np.tanh(r / p["rate"]) if r > 0 else p["back"] * np.tanh(r / p["rate"]) + p["viscous"] * r),
            [],
        ),
        "added_mass_memory/trapped_water": lambda _h, r, x, _t: (
            -_plain(r) - p["inertia"] * (r - x[0]) / tau,
            [(r - x[0]) / tau],
        ),
        "added_mass_memory/cummins": lambda _h, r, x, _t: (
            -_plain(r) - x[0],
            [-x[0] / tau + p["inertia"] / tau**2 * r],
        ),
        "added_mass_memory/porous": lambda _h, r, x, _t: (
            -_plain(r) - p["inertia"] * (r - x[0]) * abs(r - x[0]) / (tau * p["rate"]),
            [(r - x[0]) * abs(r - x[0]) / (tau * p["rate"])],
        ),
        "entrained_swirl/first_order": lambda _h, r, x, _t: (-_plain(r - x[0]), [(p["coupling"] * r - x[0]) / tau]),
        "entrained_swirl/annulus": lambda _h, r, x, _t: (-_plain(r - x[0]), [annulus(r - x[0], x[0])]),
        "tether_torsion/linear": lambda h, r, _x, _t: (-_plain(r) - p["stiffness"] * h, []),
        "tether_torsion/stiffening": lambda h, r, _x, _t: (
            -_plain(r) - p["stiffness"] * h * (1.0 + (h / p["angle"]) ** 2),
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


def test_heading_deviation_is_added_to_the_log_alone() -> None:
    psi = np.linspace(-7.0, 7.0, 500)
    for form, wanted in {
        "one_cycle": np.sin(psi + 0.8),
        "two_cycles": np.sin(2.0 * psi + 0.8),
        "mixed": np.sin(psi + 0.8) + 0.5 * np.sin(2.0 * psi - 0.8),
    }.items():
        truth = hiding(quiet(ROSUB), "heading_deviation", form, amplitude=0.05, phase=0.8)
        np.testing.assert_allclose(deviated(psi, truth) - psi, 0.05 * wanted, atol=1e-12)
        run = Run(name="hold", pieces=(Hold(1.55, 60.0),))
        plain, shown = (record(run, t, "csv", 1, 0).heading for t in (quiet(ROSUB), truth))
        true = np.radians(plain)
        seen = (shown - np.degrees(deviated(true, truth)) + 180.0) % 360.0 - 180.0
        np.testing.assert_allclose(seen, 0.0, atol=0.0016)  # both rounded to 0.001 deg


# ---- outside causes


@pytest.mark.parametrize("form", ["manipulator", "tension", "surge", "pitch"])
def test_outside_torque_is_that_of_the_logged_signal(form: str) -> None:
    truth = replace(strong(ROSUB, OUTSIDE, form).of(free()), attitude=Attitude(roll=0.0, pitch=0.0))
    (one,) = truth.hidden
    motion = move(truth, (0.0, 0.0), duration=200.0)
    signal = motion.pitch if form == "pitch" else motion.channels[DRIVERS[form]]
    deviation = {"manipulator": np.radians(signal), "tension": signal - 120.0}.get(form, signal)
    got = 5057.0 * np.gradient(motion.rate, motion.instant / MICRO)
    error = got - one.parameters[one.law.size] * deviation
    assert np.quantile(np.abs(error), 0.97) < 0.01 * np.std(got)  # the manipulator starts and stops inside samples
    assert np.std(got) > 5.0


@pytest.mark.parametrize("form", ["depth_drag", "supply_drag"])
def test_outside_drag_follows_the_logged_signal(form: str) -> None:
    truth = strong(ROSUB, OUTSIDE, form).of(quiet(ROSUB))
    gain = truth.hidden[0].parameters["gain"]
    motion = move(truth, (0.0, 1.55), duration=300.0)
    deviation = motion.channels["depth"] - 4.0 if form == "depth_drag" else np.asarray(motion.supply)
    late = slice(400, -2)
    inertia = 5057.0 * np.gradient(motion.rate, motion.instant / MICRO)
    plain = np.array([_plain(rate) for rate in motion.rate])
    balance = (ROSUB.middle_torque - inertia)[late] / plain[late]
    np.testing.assert_allclose(balance, 1.0 + gain * deviation[late], atol=1e-3)
    assert np.ptp(balance) > 0.2


def test_a_decoy_channel_changes_no_other_signal() -> None:
    case = strong(ROSUB, OUTSIDE, "surge")
    alone, beside = (excited(replace(ROSUB, hidden=case.hidden, channels=names)) for names in ((), EXTRA))
    assert set(alone.channels) == {"surge_speed"}
    assert set(beside.channels) == set(EXTRA)
    assert (alone.heading == beside.heading).all()


# ---- what may be hidden


def test_mistakes_in_what_is_hidden_are_refused() -> None:
    with pytest.raises(ValueError, match="not known"):
        Hidden(effect="thruster_lag", form="cubic")
    with pytest.raises(ValueError, match="wanted"):
        Hidden(effect="thruster_lag", form="quadratic", parameters={"time_constant": 1.0})
    with pytest.raises(ValueError, match="thruster is named"):
        Hidden(effect="thruster_imbalance", form="gain", parameters={"gain": 0.9})
    truth = hiding(ROSUB, "bias_torque", "constant", torque=1.0)
    with pytest.raises(ValueError, match="twice"):
        excited(hiding(truth, "bias_torque", "constant", torque=2.0))


# ---- the catalogue of cases


def test_the_names_are_the_contracts() -> None:
    assert set(EFFECTS) <= {effect.id for effect in CATALOGUE}
    assert all(len(FORMS[effect]) >= 2 for effect in EFFECTS)
    assert all(set(forms) <= set(FORMS[effect]) for effect, forms in CONTRACT_FORMS.items())
    assert set(DRIVERS) == set(FORMS[OUTSIDE])


@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda vehicle: vehicle.command_unit)
def test_every_form_is_a_case_at_both_sizes(vehicle: Truth) -> None:
    cases = {case.name: case for case in all_cases(vehicle)}
    wanted = {f"{effect}-{form}-{size}" for effect, form in LAWS for size in SIZES}
    assert set(cases) == {"nothing", *wanted}
    for effect, form in LAWS:
        weak, full = (cases[f"{effect}-{form}-{size}"] for size in SIZES)
        assert weak.expected_effect == full.expected_effect == (None if effect == OUTSIDE else effect)
        law = FORMS[effect][form]
        sizes = [abs(1 / c.hidden[0].parameters[law.size] - 1 / law.null) if np.isinf(law.null)
                 else abs(c.hidden[0].parameters[law.size] - law.null) for c in (weak, full)]  # fmt: skip
        assert 0.0 < sizes[0] < sizes[1]
    assert cases["thruster_lag-first_order-weak"].expected_parameters is not None
    assert cases["thruster_lag-quadratic-weak"].expected_parameters is None


def test_groups_hold_no_near_twins_and_are_drawn_by_their_seed() -> None:
    triples = groups(SMALL, together=3, count=20, seed=4)
    assert triples == groups(SMALL, together=3, count=20, seed=4)
    for group in triples:
        names = {case.expected_effect for case in group}
        assert len(names) == 3
        assert not {"thruster_lag", "command_delay"} <= names
        assert len(truth_of(SMALL, group).hidden) == 3
    excited(truth_of(SMALL, triples[0]))


# ---- files


@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda vehicle: vehicle.command_unit)
def test_programme_suits_the_vehicle(vehicle: Truth) -> None:
    runs = campaign_for(vehicle)
    assert len({run.name for run in runs}) == len(runs) == 18
    largest = max(
        abs(level)
        for run in runs
        for piece in run.pieces
        for level in ([piece.volts] if isinstance(piece, Hold) else [piece.positive, piece.negative])
    )
    curve = vehicle.thrusters[0].curve
    assert vehicle.middle < largest < curve.limit
    (hold,) = (run for run in runs if run.name == "hold_01")
    assert isinstance(hold.pieces[0], Hold)
    assert hold.pieces[0].volts == pytest.approx(vehicle.middle)
    # Ten time constants and more, so that a hold is steady at its end.
    assert hold.pieces[0].duration > 10.0 * vehicle.time_constant


SHORT = (
    Run(name="hold", pieces=(Hold(1.0, 6.0),)),
    Run(name="sine", pieces=(Sine(1.0, 1.2, 4.0, 2),), format="json", command_rate=10.0),
    Run(name="aft", pieces=(Hold(1.0, 6.0),), format="ros2", only="aft", command_rate=None),
)


@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda vehicle: vehicle.command_unit)
def test_files_decode_and_the_configuration_finds_everything_in_them(vehicle: Truth, tmp_path: Path) -> None:
    def scaled(piece: Hold | Sine) -> Hold | Sine:
        if isinstance(piece, Hold):
            return Hold(piece.volts * vehicle.middle, piece.duration)
        return Sine(piece.positive * vehicle.middle, piece.negative * vehicle.middle, piece.period, piece.cycles)

    campaign = [replace(run, pieces=tuple(scaled(piece) for piece in run.pieces)) for run in SHORT]
    truth = strong(vehicle, OUTSIDE, "depth_drag").of(strong(vehicle, "thruster_lag", "quadratic").of(vehicle))
    write_trial_day(tmp_path, seed=3, truth=truth, campaign=campaign)
    configuration = tomllib.loads((tmp_path / "rovid.toml").read_text())
    signals = [*configuration["signals"].values(), *(t["command"] for t in configuration["thrusters"])]
    assert set(EXTRA) <= set(configuration["signals"])
    table = pd.read_csv(tmp_path / "hold.csv")
    assert {signal["csv"] for signal in signals} == set(table.columns)
    for name in ("sine", "aft"):
        with (tmp_path / f"{name}.mcap").open("rb") as stream:
            topics = {channel.topic for _, channel, _ in make_reader(stream).iter_messages()}
        assert {signal["mcap"].removesuffix(".data") for signal in signals if "mcap" in signal} <= topics
    neutral = vehicle.thrusters[0].curve.neutral
    fore = table[configuration["thrusters"][0]["command"]["csv"]]
    assert fore.iloc[0] == neutral
    assert fore.iloc[-2] == pytest.approx(neutral + vehicle.middle, rel=0.01)
    curve = pd.read_csv(tmp_path / configuration["thrusters"][0]["curve"])
    exact = vehicle.thrusters[0].curve.thrust(curve["command"].to_numpy())
    np.testing.assert_allclose(curve["thrust_N"], exact, atol=1e-4)
    assert table[column("depth")].between(1.0, 7.0).all()


def test_same_seed_same_files_with_something_hidden(tmp_path: Path) -> None:
    truth = strong(SMALL, "wave_torque", "narrow_band").of(SMALL)
    run = campaign_for(SMALL)[:1]
    for name in "ab":
        write_trial_day(tmp_path / name, seed=8, truth=truth, campaign=run, formats="csv")
    assert (tmp_path / "a" / "hold_01.csv").read_bytes() == (tmp_path / "b" / "hold_01.csv").read_bytes()


# ---- a real log


def _table(folder: Path) -> pd.DataFrame:
    return pd.read_csv(folder / "dive.csv")


def _curve(folder: Path, number: int = 0) -> pd.DataFrame:
    configuration = tomllib.loads((folder / "rovid.toml").read_text(encoding="utf-8"))
    return pd.read_csv(folder / configuration["thrusters"][number]["curve"])


def test_nothing_injected_is_the_log_itself(tmp_path: Path) -> None:
    inject(DIVE, tmp_path, ())
    for path in tmp_path.iterdir():
        assert path.read_bytes() == (DIVE.folder / path.name).read_bytes()


def test_commands_are_logged_earlier(tmp_path: Path) -> None:
    delay = Hidden(effect="command_delay", form="constant", parameters={"delay": 0.25})
    inject(DIVE, tmp_path, [delay])
    told, true = _table(tmp_path), _table(DIVE.folder)
    assert 0 < len(true) - len(told) < 10
    wanted = np.interp(told["t_s"] + 0.25, true["t_s"], true["pwm2_us"])
    np.testing.assert_allclose(told["pwm2_us"], wanted, atol=1e-5)
    pd.testing.assert_series_equal(told["heading_deg"], true["heading_deg"].loc[: len(told) - 1], check_exact=False)


def test_heading_deviates(tmp_path: Path) -> None:
    one = Hidden(effect="heading_deviation", form="two_cycles", parameters={"amplitude": 0.05, "phase": 0.3})
    inject(DIVE, tmp_path, [one])
    told, true = _table(tmp_path)["heading_deg"], _table(DIVE.folder)["heading_deg"]
    wanted = np.degrees(0.05) * np.sin(2.0 * np.radians(true) + 0.3)
    np.testing.assert_allclose((told - true + 180.0) % 360.0 - 180.0, wanted, atol=1e-5)


def test_curves_are_told_without_what_is_hidden(tmp_path: Path) -> None:
    true = _curve(DIVE.folder)
    offset = true["command"].to_numpy(np.float64) - 1500.0
    hidden = {
        "zone": Hidden(effect="thruster_deadband", form="shift", parameters={"deadband": 12.0}),
        "gain": Hidden(effect="thrust_asymmetry", form="gain", parameters={"reverse_gain": 0.8}),
        "shape": Hidden(effect="thrust_curve_shape", form="power", parameters={"exponent": 0.8, "thrust": 5.0}),
        "weak": Hidden(effect="thruster_imbalance", form="gain", thruster="thruster_3", parameters={"gain": 0.75}),
    }
    for name, one in hidden.items():
        inject(DIVE, tmp_path / name, [one])
    zone = _curve(tmp_path / "zone")["thrust_N"].to_numpy()
    back = np.sign(offset) * np.maximum(np.abs(offset) - 12.0, 0.0)
    inside = np.abs(offset) < 380.0  # beyond the table's end its last value holds
    again = np.interp(back, offset, zone)
    np.testing.assert_allclose(again[inside], true["thrust_N"][inside], atol=0.05)
    assert (zone[np.abs(offset) > 17.0] != 0.0).all()
    reverse = _curve(tmp_path / "gain")["thrust_N"] * np.where(offset < 0.0, 0.8, 1.0)
    np.testing.assert_allclose(reverse, true["thrust_N"], rtol=1e-6)
    shape = _curve(tmp_path / "shape")["thrust_N"]
    np.testing.assert_allclose(np.sign(shape) * 5.0 * (np.abs(shape) / 5.0) ** 0.8, true["thrust_N"], rtol=1e-6)
    np.testing.assert_allclose(0.75 * _curve(tmp_path / "weak", 2)["thrust_N"], true["thrust_N"], rtol=1e-6)
    np.testing.assert_allclose(_curve(tmp_path / "weak", 0)["thrust_N"], true["thrust_N"])


def test_linear_curve_and_what_cannot_be_injected(tmp_path: Path) -> None:
    linear_curve(DIVE, tmp_path)
    curve = _curve(tmp_path)
    assert np.ptp(np.diff(curve["thrust_N"]) / np.diff(curve["command"])) < 1e-5
    assert np.interp(1500.0, curve["command"], curve["thrust_N"]) == pytest.approx(0.0, abs=1e-6)
    assert all(form in FORMS[effect] for effect, form in INJECTABLE)
    bias = Hidden(effect="bias_torque", form="constant", parameters={"torque": 1.0})
    with pytest.raises(ValueError, match="acts through the motion"):
        inject(DIVE, tmp_path, [bias])


def test_instruments_count_commands_from_neutral() -> None:
    instruments = Instruments(supply=16.0, supply_drop=0.002, supply_noise=0.0, command_span=4096.0)
    truth = replace(quiet(SMALL), instruments=instruments)
    supply = record(Run(name="hold", pieces=(Hold(100.0, 2.0),)), truth, "csv", 1, 0).supply
    assert supply[0] == 16.0
    assert supply[-2] == pytest.approx(16.0 - 2 * 100.0 * 0.002)
