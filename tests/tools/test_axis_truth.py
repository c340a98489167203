"""The simulator in surge, heave and pitch, against closed forms; the days it writes; the two that are shipped."""

from __future__ import annotations

import math
import sys
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from rovid.trial.axis import AXES
from rovid.trial.config import load_config
from tests.conftest import SAMPLES
from tools.axis_day import course, main, measured, meter_of, with_hidden, write_axis_day
from tools.axis_programme import axis_campaign, commanded
from tools.axis_truth import (
    AXIS_EFFECTS,
    AXIS_VEHICLES,
    METERS,
    SMALL_HEAVE,
    SMALL_PITCH,
    SMALL_SURGE,
    WORK_HEAVE,
    WORK_PITCH,
    WORK_SURGE,
    Vehicle,
    axis_cases,
)
from tools.cases import hide
from tools.hidden import FORMS, Hidden
from tools.programme import LEAD, Hold, Piece, Run, Sine
from tools.simulate import MICRO, Held, Motion
from tools.truth import Axis, Disturbance, Dynamics, FloatArray, Truth

# A simulator of the tests changes rarely, and none of rovid's code is tested here.
pytestmark = pytest.mark.slow

TRUTHS = list(AXIS_VEHICLES.values())
STRAIGHT = [truth for truth in TRUTHS if truth.axis != "pitch"]
PITCHING = [truth for truth in TRUTHS if truth.axis == "pitch"]
# A command is logged to 0.1 mV: a share of the thrust that it gives, which is next to nothing at 1 V and below.
COMMAND = 2e-4
COAST = Run(name="coast", pieces=(Hold(1.0, 12.0), Hold(0.0, 4.0)))
# Named in the READMEs of the shipped days.
SHIPPED: dict[str, tuple[Axis, tuple[str, ...]]] = {
    "surge_tank": ("surge", ("thruster_lag:0.35", "thrust_asymmetry:0.88")),
    "pitch_tank": ("pitch", ("thruster_deadband:0.15",)),
}


def named(truth: Truth) -> str:
    return truth.name


def quiet(truth: Truth) -> Truth:
    """``truth`` without disturbance, and with commands as fine as they are asked for."""
    return replace(
        truth, disturbance=Disturbance(standard_deviation=0.0), instruments=replace(truth.instruments, command_bits=40)
    )


def move(truth: Truth, *pieces: Piece, only: str | None = None) -> tuple[FloatArray, Motion]:
    """Time in s since the lead ended, and the motion, under ``pieces`` of shares of the middling thrust."""
    run = Run(name="run", pieces=pieces, only=only)
    _, motion = course(run, truth, meter_of(truth.axis), np.random.default_rng(5))
    return motion.instant / MICRO - LEAD, motion


def steady(truth: Truth, share: float, only: str | None = None) -> float:
    """Velocity at the end of a long hold at ``share``."""
    return float(move(truth, Hold(share, 120.0), only=only)[1].rate[-1])


def root(balance: Callable[[float], float], low: float = -10.0, high: float = 10.0) -> float:
    return float(brentq(balance, low, high, xtol=1e-14))


def pushed(truth: Truth, commands: Mapping[str, Held]) -> FloatArray:
    """Force in N, or torque in N m, of ``commands`` from each sample to the next."""
    thrust = [t.arm * t.curve.thrust(commands[t.name].value) for t in truth.thrusters]
    return np.asarray(np.sum(thrust, axis=0))


# ---- the plain equations


@pytest.mark.parametrize("truth", STRAIGHT, ids=named)
@pytest.mark.parametrize("share", [-1.4, -0.35, 0.65, 1.0])
def test_steady_velocity_balances_drag_thrust_and_weight(truth: Truth, share: float) -> None:
    # Thrust one way and the other is the same share, whatever the curve.
    force = share * truth.middle_torque + truth.dynamics.net_force
    assert steady(quiet(truth), share) == pytest.approx(truth.dynamics.steady_rate(force), rel=COMMAND)


@pytest.mark.parametrize("truth", [WORK_HEAVE, SMALL_HEAVE], ids=named)
def test_a_light_vehicle_rises_by_itself(truth: Truth) -> None:
    _, motion = move(quiet(truth), Hold(0.0, 200.0))
    assert motion.rate[-1] == pytest.approx(truth.dynamics.steady_rate(truth.dynamics.net_force), rel=1e-9)
    assert motion.heading[-1] < motion.heading[0]


@pytest.mark.parametrize("truth", PITCHING, ids=named)
@pytest.mark.parametrize("share", [-1.4, 0.35, 1.0])
def test_static_tilt_balances_thrust(truth: Truth, share: float) -> None:
    _, motion = move(quiet(truth), Hold(share, 400.0))
    tilt = math.asin(share * truth.middle_torque / truth.dynamics.restoring)
    assert motion.heading[-1] - truth.dynamics.level == pytest.approx(tilt, rel=COMMAND)
    assert 3.0 < abs(math.degrees(tilt)) < 20.0


def test_a_coast_is_the_closed_form() -> None:
    truth = quiet(WORK_SURGE)
    time, motion = move(truth, Hold(1.4, 60.0), Hold(0.0, 60.0))
    start = int(np.argmax(time >= 60.0))
    speed, d = float(motion.rate[start]), truth.dynamics
    fades = np.exp(-d.linear_drag / d.inertia * (time[start:] - 60.0))
    exact = d.linear_drag * speed * fades / (d.linear_drag + d.quadratic_drag * speed * (1.0 - fades))
    np.testing.assert_allclose(motion.rate[start:], exact, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize(("form", "power", "size"), [("cubic", 2, 3.0), ("quintic", 4, 30.0)])
def test_a_bent_restoring_torque_against_scipy(form: str, power: int, size: float) -> None:
    one = Hidden(effect="restoring_curve", form=form, parameters={form: size})
    d = WORK_PITCH.dynamics
    time, motion = move(replace(quiet(WORK_PITCH), start=d.level + 0.4, hidden=(one,)), Hold(0.0, 30.0))

    def slope(_: float, y: FloatArray) -> list[float]:
        restoring = d.restoring * (1.0 + size * y[0] ** power) * math.sin(y[0])
        return [y[1], -(restoring + (d.quadratic_drag * abs(y[1]) + d.linear_drag) * y[1]) / d.inertia]

    solved = solve_ivp(slope, (0.0, 34.0), [0.4, 0.0], t_eval=time + LEAD, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(motion.heading - d.level, solved.y[0], rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("truth", PITCHING, ids=named)
def test_without_drag_a_tilted_vehicle_swings_for_ever(truth: Truth) -> None:
    d = replace(truth.dynamics, quadratic_drag=0.0, linear_drag=0.0)
    free = replace(quiet(truth), dynamics=d)
    time, motion = move(replace(free, start=d.level + 0.01), Hold(0.0, 100.0))
    frequency = math.sqrt(d.restoring / d.inertia)
    exact = 0.01 * np.cos(frequency * (time + LEAD))
    # The sine is flatter than its tangent: by amplitude^2/16 of the frequency.
    np.testing.assert_allclose(motion.heading - d.level, exact, rtol=0.0, atol=0.01 * frequency * 104.0 * 0.01**2 / 16)
    _, motion = move(replace(free, start=d.level + 0.5), Hold(0.0, 100.0))
    energy = d.inertia * motion.rate**2 / 2.0 + d.restoring * (1.0 - np.cos(motion.heading - d.level))
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)


def test_a_small_release_decays_as_a_linear_one() -> None:
    d = replace(WORK_PITCH.dynamics, quadratic_drag=0.0)
    time, motion = move(replace(quiet(WORK_PITCH), dynamics=d, start=d.level + 1e-4), Hold(0.0, 30.0))
    decay, full = d.linear_drag / (2.0 * d.inertia), d.restoring / d.inertia
    frequency, t = math.sqrt(full - decay**2), time + LEAD
    exact = 1e-4 * np.exp(-decay * t) * (np.cos(frequency * t) + decay / frequency * np.sin(frequency * t))
    np.testing.assert_allclose(motion.heading - d.level, exact, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("truth", TRUTHS, ids=named)
def test_what_the_thrusters_give_is_kept_or_spent(truth: Truth) -> None:
    """Work of thrust and weight = kinetic energy + what the restoring torque stores + what drag takes."""
    truth, d = quiet(truth), truth.dynamics
    fast = replace(meter_of(truth.axis), rate=200.0)
    run = Run(name="run", pieces=(Hold(1.2, 5.0), Hold(-0.8, 5.0), Hold(0.0, 2.0)))
    commands, motion = course(run, truth, fast, np.random.default_rng(5))
    v, x = motion.rate, motion.heading
    work = np.sum((pushed(truth, commands)[:-1] + d.net_force) * np.diff(x))
    power = d.quadratic_drag * np.abs(v) ** 3 + d.linear_drag * v**2
    taken = np.sum((power[:-1] + power[1:]) / 2.0) / 200.0
    kept = d.inertia * v[-1] ** 2 / 2.0
    stored = d.restoring * (math.cos(x[0] - d.level) - math.cos(x[-1] - d.level))
    assert work == pytest.approx(taken + kept + stored, rel=COMMAND)


@pytest.mark.parametrize("truth", [WORK_PITCH, SMALL_PITCH], ids=named)
def test_pitch_near_resonance_against_scipy(truth: Truth) -> None:
    truth, d = quiet(truth), truth.dynamics
    commands, motion = course(
        Run(name="run", pieces=(Sine(0.5, 0.4, 7.5, 4),)), truth, meter_of("pitch"), np.random.default_rng(5)
    )
    torque = pushed(truth, commands)
    state, found = np.array([d.level, 0.0]), [d.level]
    for begin, end, push in zip(motion.instant[:-1] / MICRO, motion.instant[1:] / MICRO, torque, strict=False):

        def slope(_: float, y: FloatArray, push: float = float(push)) -> list[float]:
            drag = (d.quadratic_drag * abs(y[1]) + d.linear_drag) * y[1]
            return [float(y[1]), float(push - drag - d.restoring * math.sin(y[0] - d.level)) / d.inertia]

        state = solve_ivp(slope, (begin, end), state, rtol=1e-9, atol=1e-12).y[:, -1]
        found.append(float(state[0]))
    # A ten-thousandth of the noise.
    np.testing.assert_allclose(np.degrees(motion.heading), np.degrees(found), rtol=0.0, atol=1e-6)


# ---- what is hidden


def _hold(text: str, truth: Truth = WORK_SURGE) -> tuple[float, float]:
    """Steady velocity at the middling thrust ahead, or down, and astern with ``text`` hidden."""
    hiding = with_hidden(quiet(truth), [text])
    return steady(hiding, 1.0), steady(hiding, -1.0)


def test_hidden_thrust_is_in_the_steady_balance() -> None:
    d, full = WORK_SURGE.dynamics, WORK_SURGE.middle_torque
    assert _hold("thrust_asymmetry:0.88")[0] == pytest.approx(d.steady_rate(full), rel=COMMAND)
    assert _hold("thrust_asymmetry:0.88")[1] == pytest.approx(d.steady_rate(-0.88 * full), rel=COMMAND)
    assert _hold("thruster_imbalance@starboard:0.7")[0] == pytest.approx(d.steady_rate(0.85 * full), rel=COMMAND)
    curve = WORK_SURGE.thrusters[0].curve
    late = 2.0 * float(curve.thrust(np.array([WORK_SURGE.middle - 0.15]))[0])
    assert _hold("thruster_deadband:0.15")[0] == pytest.approx(d.steady_rate(late), rel=COMMAND)
    # What is lost of a thruster at an angle is by the speed along its own axis.
    s = SMALL_SURGE
    thrust, arm, d = s.middle_thrust, 0.7071, s.dynamics
    slow = root(
        lambda u: 4.0 * arm * (thrust - 0.5 * math.sqrt(thrust) * arm * u) - (d.quadratic_drag * u + d.linear_drag) * u,
        0.0,
    )
    assert _hold("advance_speed_loss:0.5", s)[0] == pytest.approx(slow, rel=COMMAND)


def test_hidden_water_is_in_the_steady_balance() -> None:
    d, full = WORK_SURGE.dynamics, WORK_SURGE.middle_torque
    ahead = d.steady_rate(full)
    assert _hold("bias_torque:60")[0] == pytest.approx(d.steady_rate(full + 60.0), rel=COMMAND)
    assert _hold("bias_torque:60")[1] == pytest.approx(d.steady_rate(-full + 60.0), rel=COMMAND)
    assert _hold("coulomb_resistance:40")[0] == pytest.approx(d.steady_rate(full - 40.0), rel=COMMAND)
    for truth in (WORK_SURGE, WORK_HEAVE):
        heavier = replace(truth.dynamics, quadratic_drag=1.3 * truth.dynamics.quadratic_drag)
        force = -truth.middle_torque + truth.dynamics.net_force
        down, up = _hold("drag_asymmetry:1.3", truth)
        assert up == pytest.approx(heavier.steady_rate(force), rel=COMMAND)
        assert down == pytest.approx(
            truth.dynamics.steady_rate(truth.middle_torque + truth.dynamics.net_force), rel=COMMAND
        )
    cubic = root(lambda u: d.quadratic_drag * u * u + d.linear_drag * u + 300.0 * u**3 - full, 0.0)
    assert _hold("drag_curvature:300")[0] == pytest.approx(cubic, rel=COMMAND)
    # Water that follows is carried along in the end, and adds no drag.
    assert _hold("added_mass_memory:1000")[0] == pytest.approx(ahead, rel=COMMAND)


@pytest.mark.parametrize("form", ["first_order", "quadratic"])
def test_a_lagged_step_loses_the_lag_s_impulse(form: str) -> None:
    hiding = with_hidden(quiet(WORK_SURGE), [f"thruster_lag/{form}:0.4"])
    free = replace(hiding, dynamics=Dynamics(inertia=4100.0, quadratic_drag=0.0, linear_drag=0.0))
    time, motion = move(free, Hold(1.0, 10.0))
    t = np.maximum(time, 0.0)
    # n = tanh(t/2 tau) from rest at the reference thrust; the integral of its square.
    missing = 0.4 * -np.expm1(-t / 0.4) if form == "first_order" else 0.8 * np.tanh(t / 0.8)
    np.testing.assert_allclose(motion.rate, free.middle_torque / 4100.0 * (t - missing), rtol=COMMAND, atol=1e-9)


def test_a_delay_shifts_the_motion() -> None:
    _, now = move(quiet(WORK_PITCH), Hold(1.0, 20.0))
    _, late = move(with_hidden(quiet(WORK_PITCH), ["command_delay:0.2"]), Hold(1.0, 20.0))
    np.testing.assert_allclose(late.heading[4:], now.heading[:-4], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("truth", TRUTHS, ids=named)
def test_every_strong_case_of_an_axis_is_seen(truth: Truth) -> None:
    cases = axis_cases(truth)
    assert {case.expected_effect for case in cases} - {None} == AXIS_EFFECTS[truth.axis]
    meter = meter_of(truth.axis)
    pieces = (Hold(1.2, 6.0), Hold(-1.0, 9.0), Sine(0.8, 0.8, 6.0, 1), Hold(0.5, 4.0), Hold(0.0, 4.0))
    still = quiet(truth)

    def seen(one: Truth) -> FloatArray:
        _, motion = move(one, *pieces)
        return (motion.rate if meter.of_velocity else motion.heading) * meter.scale

    plain = seen(still)
    for case in cases:
        if case.name.endswith("strong"):
            assert np.max(np.abs(seen(case.of(still)) - plain)) > 1.5 * meter.noise, case.name


def test_hiding_by_text() -> None:
    one = hide(WORK_SURGE, "thruster_lag/quadratic:0.4")
    assert (one.form, dict(one.parameters)) == ("quadratic", {"time_constant": 0.4, "thrust": WORK_SURGE.middle_thrust})
    assert hide(SMALL_SURGE, "thruster_imbalance:0.8").thruster == "fore_port"
    assert hide(SMALL_SURGE, "thruster_imbalance@aft_port:0.8").thruster == "aft_port"
    assert hide(WORK_SURGE, "drag_curvature:300").form == next(iter(FORMS["drag_curvature"])) == "cubic"


@pytest.mark.parametrize("text", ["thruster_lag", "tyre_wear:1", "thruster_lag/tyre:0.3", "thruster_lag:fast"])
def test_hiding_what_is_not_known_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"wanted EFFECT|could not convert"):
        hide(WORK_SURGE, text)


@pytest.mark.parametrize(
    ("truth", "text"),
    [(WORK_HEAVE, "bias_torque:20"), (WORK_PITCH, "drag_asymmetry:1.2"), (WORK_SURGE, "heading_deviation:0.02")],
)
def test_hiding_what_cannot_act_on_an_axis_is_refused(truth: Truth, text: str) -> None:
    with pytest.raises(ValueError, match="cannot be hidden"):
        with_hidden(truth, [text])


# ---- disturbance, noise, programme


@pytest.mark.parametrize("truth", TRUTHS, ids=named)
def test_the_disturbance_is_2_percent_of_the_middling_thrust_for_4_s(truth: Truth) -> None:
    assert truth.disturbance.standard_deviation == pytest.approx(0.02 * truth.middle_torque, rel=0.02)
    assert truth.disturbance.correlation_time == 4.0


@pytest.mark.parametrize(("axis", "variant"), [(axis, variant) for axis in METERS for variant in METERS[axis]])
def test_noise_and_rounding_are_what_the_meter_says(axis: Axis, variant: str) -> None:
    meter = meter_of(axis, variant)
    n = 40_000
    true = np.linspace(-0.3, 0.3, n)
    still = np.zeros(n)
    motion = Motion(
        instant=np.arange(n),
        heading=still if meter.of_velocity else true,
        rate=true if meter.of_velocity else still,
        roll=still,
        pitch=still,
    )
    read = measured(motion, meter, np.random.default_rng(3))
    off = read - true * meter.scale
    assert np.std(off) == pytest.approx(math.hypot(meter.noise, 10.0**-meter.decimals / math.sqrt(12.0)), rel=0.02)
    assert abs(np.mean(off)) < 5.0 * meter.noise / math.sqrt(n)
    assert abs(np.corrcoef(off[1:], off[:-1])[0, 1]) < 0.02
    np.testing.assert_array_equal(read, np.round(read, meter.decimals))


def test_two_meters_of_one_motion_agree() -> None:
    read = {}
    for variant in METERS["surge"]:
        meter = meter_of("surge", variant)
        _, motion = course(COAST, quiet(WORK_SURGE), meter, np.random.default_rng(1))
        read[variant] = measured(motion, meter, np.random.default_rng(2))
        assert np.diff(motion.instant) == pytest.approx(MICRO / meter.rate)
    moved = np.trapezoid(read["velocity"], dx=1.0 / meter_of("surge", "velocity").rate)
    assert moved == pytest.approx(read["position"][-1] - read["position"][0], abs=0.03)
    assert moved > 5.0


@pytest.mark.parametrize("truth", TRUTHS, ids=named)
def test_the_programme_suits_the_vehicle(truth: Truth) -> None:
    runs = axis_campaign(truth)
    assert len({run.name for run in runs}) == len(runs)
    assert 12 <= len(runs) <= 17
    assert 25.0 < sum(run.duration for run in runs) / 60.0 < 45.0
    assert {run.only for run in runs} == {None, *(thruster.name for thruster in truth.thrusters)}


@pytest.mark.parametrize("truth", PITCHING, ids=named)
def test_one_sine_is_next_to_the_resonance(truth: Truth) -> None:
    natural = 2.0 * math.pi * math.sqrt(truth.dynamics.inertia / truth.dynamics.restoring)
    periods = [piece.period for run in axis_campaign(truth) for piece in run.pieces if isinstance(piece, Sine)]
    assert min(abs(period / natural - 1.0) for period in periods) < 0.2
    assert min(periods) < 0.75 * natural
    assert max(periods) > 4.0 * natural


@pytest.mark.parametrize("truth", TRUTHS, ids=named)
def test_shares_are_pushed_both_ways_by_every_thruster(truth: Truth) -> None:
    run = Run(name="run", pieces=(Hold(1.0, 1.0), Hold(-0.5, 1.0), Sine(0.8, 0.6, 4.0, 1)))
    at = LEAD + np.array([0.5, 1.5, 3.0, 5.0])
    for thruster in truth.thrusters:
        offset = commanded(run, thruster, truth).command(at)
        thrust = thruster.curve.thrust(offset + thruster.curve.neutral) / truth.middle_thrust
        assert thrust * math.copysign(1.0, thruster.arm) == pytest.approx([1.0, -0.5, 0.8, -0.6])


# ---- folders


@pytest.mark.parametrize(("vehicle", "axis"), list(AXIS_VEHICLES))
def test_a_day_is_a_campaign_folder_of_what_a_vehicle_can_do(vehicle: Vehicle, axis: Axis, tmp_path: Path) -> None:
    truth = write_axis_day(tmp_path, vehicle, axis, seed=2)
    configuration: dict[str, Any] = tomllib.loads((tmp_path / "rovid.toml").read_text(encoding="utf-8"))
    assert set(configuration) == {"vehicle", "thrusters", "signals"}
    body = load_config(tmp_path / "rovid.toml", AXES[axis]).vehicle.rigid_body_inertia
    assert body is not None
    assert 0.4 * truth.dynamics.inertia < body < 0.8 * truth.dynamics.inertia
    key = "pitch_arm" if axis == "pitch" else axis
    assert [one[key] for one in configuration["thrusters"]] == [one.arm for one in truth.thrusters]
    meter = meter_of(axis)
    assert configuration["signals"] == {
        "time": {"csv": "time_s"},
        meter.signal: {"csv": meter.column, "unit": meter.unit},
    }
    curve = pd.read_csv(tmp_path / configuration["thrusters"][0]["curve"])
    np.testing.assert_allclose(
        curve["thrust_N"], truth.thrusters[0].curve.thrust(curve["command"].to_numpy()), atol=1e-4
    )
    runs = axis_campaign(truth)
    assert {path.stem for path in tmp_path.glob("*.csv")} == {"thrust_curve", *(run.name for run in runs)}
    columns = {"time_s", meter.column, *(one["command"]["csv"] for one in configuration["thrusters"])}
    for run in runs:
        log = pd.read_csv(tmp_path / f"{run.name}.csv")
        assert set(log.columns) == columns
        assert log["time_s"].iloc[-1] == pytest.approx(run.duration, abs=0.5 / meter.rate + 0.01)
        assert not log.isna().to_numpy().any()
        low, high = log[meter.column].min(), log[meter.column].max()
        assert axis != "heave" or low > 2.0
        assert axis != "pitch" or max(-low, high) < 35.0
        for thruster, one in zip(truth.thrusters, configuration["thrusters"], strict=True):
            offset = np.abs(log[one["command"]["csv"]] - thruster.curve.neutral)
            assert offset.max() < 0.8 * thruster.curve.limit  # the table of the curve goes on
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) < 2_500_000


def test_same_seed_same_bytes_and_a_new_seed_differs(tmp_path: Path) -> None:
    for name, seed in (("one", 7), ("again", 7), ("other", 8)):
        write_axis_day(tmp_path / name, "small", "pitch", ["command_delay:0.1"], seed=seed, campaign=[COAST])
    for path in sorted((tmp_path / "one").iterdir()):
        assert path.read_bytes() == (tmp_path / "again" / path.name).read_bytes(), path.name
        fixed = path.name in {"rovid.toml", "thrust_curve.csv"}
        assert (path.read_bytes() == (tmp_path / "other" / path.name).read_bytes()) == fixed, path.name


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_day_is_regenerated_byte_for_byte(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    axis, hidden = SHIPPED[name]
    hiding = [word for one in hidden for word in ("--hide", one)]
    said = ["axis_day", str(tmp_path), "--axis", axis, "--vehicle", "work", *hiding, "--seed", "1"]
    monkeypatch.setattr(sys, "argv", said)
    main()
    assert {path.name for path in (SAMPLES / name).iterdir()} - {"README.md"} == {p.name for p in tmp_path.iterdir()}
    for path in sorted(tmp_path.iterdir()):
        assert path.read_bytes() == (SAMPLES / name / path.name).read_bytes(), path.name


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_day_s_readme_says_what_is_true(name: str) -> None:
    axis, hidden = SHIPPED[name]
    truth, text = AXIS_VEHICLES["work", axis], (SAMPLES / name / "README.md").read_text(encoding="utf-8")
    d = truth.dynamics
    for value in (d.inertia, d.quadratic_drag, d.linear_drag):
        assert f" {value:g} " in text
    for one in hidden:
        assert f"--hide {one}" in text
        assert f"| `{one.partition(':')[0]}` |" in text
    runs = axis_campaign(truth)
    assert f"{len(runs)} runs, {sum(run.duration for run in runs) / 60.0:.0f} minutes" in text
    rows = dict(
        line.strip("| ").split(" | ")[::2] for line in text.splitlines() if line.startswith("| `") and ".csv" in line
    )
    assert rows == {f"`{run.name}.csv`": f"{run.duration:g}" for run in runs}


def test_an_unknown_variant_is_refused_by_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["axis_day", "--variant", "sonar", str(tmp_path / "none")])
    with pytest.raises(SystemExit):
        main()
    assert "surge has no variant sonar, but velocity, position" in capsys.readouterr().err
    assert not (tmp_path / "none").exists()
