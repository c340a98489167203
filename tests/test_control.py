"""The heading controller: its numbers, its margins, its closed loop, and its source in C and Python."""

from __future__ import annotations

import ctypes
import math
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from scipy import signal
from scipy.integrate import solve_ivp

from rovid.campaign.vehicle import ThrustCurve, Thruster, Vehicle
from rovid.control.allocation import allocate
from rovid.control.generate import c_source, python_source
from rovid.control.law import Law, holds, wrapped
from rovid.control.loop import Course, Plant, run_closed
from rovid.control.loop_design import choose_bandwidth, law_for, loop_of, run_manoeuvre, unaided
from rovid.control.measures import limit_cycle
from rovid.control.setting import Manoeuvre, Setting, manoeuvres, paper_runs
from rovid.control.tuning import Loop, actuators, damping_ratio, drawn, gains, linearised
from rovid.effects import Effect, effect_named, forms_for
from rovid.effects.base import Scales
from rovid.ground.arrays import FloatArray
from rovid.model.model import Model
from rovid.parameters.parameters import Entry, Parameters
from tests.conftest import SAMPLES, Rovid
from tests.synthetic import LOGGED

PAPER = Model(inertia=5057.0, quadratic_drag=3532.0, linear_drag=132.37)
VOLTS = np.round(np.linspace(-5.0, 5.0, 201), 2)
CURVE = ThrustCurve(
    command=VOLTS, thrust=np.where(VOLTS > 0.0, 92.0, -52.0) * np.maximum(np.abs(VOLTS) - 0.3, 0.0) ** 2
)
# One thruster turns the vehicle with forward, the other with reverse thrust.
VEHICLE = Vehicle(
    name="test",
    thrusters=(
        Thruster(name="fore", arm=0.43, curve=CURVE),
        Thruster(name="aft", arm=-0.43, curve=CURVE),
    ),
)
SCALES = Scales(command=2.0, torque=126.0, rate=0.17, race=11.0)
SETTING = Setting(torque_in_use=126.0, heading_noise=math.radians(0.01))


def law(kp: float = 100.0, kd: float = 710.0, **changes: Any) -> Law:
    return replace(Law(kp=kp, kd=kd, period=0.1, rate_filter=0.3, quadratic_drag=3532.0, linear_drag=132.37), **changes)


def with_effect(key: str, *values: float, model: Model = PAPER) -> Model:
    return replace(model, effects=(*model.effects, effect_named(key)), effect_values=(*model.effect_values, *values))


def closed(
    model: Model, controller: Law, *, seconds: float = 60.0, start: float = 90.0, wanted: float = 200.0
) -> Course:
    plant = Plant(model=model, vehicle=VEHICLE)
    goal = np.full(round(seconds / controller.period), math.radians(wanted))
    return run_closed(controller, allocate(VEHICLE, model), plant, goal, math.radians(start))


# The paper's numbers


def test_the_papers_gains_have_half_the_damping_with_the_inertia() -> None:
    assert damping_ratio(100.0, 710.0, 5057.0) == pytest.approx(0.499, abs=5e-4)
    assert damping_ratio(100.0, 710.0, 2604.0) == pytest.approx(0.696, abs=5e-4)  # its mass in kg


@pytest.mark.parametrize("damping", [0.3, 0.7, 1.4])
def test_gains_and_damping_ratio_are_each_others_inverse(damping: float) -> None:
    kp, kd = gains(5057.0, damping, 0.4)
    assert damping_ratio(kp, kd, 5057.0) == pytest.approx(damping, rel=1e-12)
    poles = np.roots([5057.0, kd, kp])
    assert np.abs(poles[0]) == pytest.approx(0.4, rel=1e-12) or damping > 1.0


def test_the_aided_loop_is_of_second_order() -> None:
    """With the drag cancelled and a fast clock the step is that of eq. 13: known in closed form."""
    controller = law(period=0.01, rate_filter=0.0)
    plant = Plant(model=PAPER, vehicle=LOGGED)
    course = run_closed(
        controller, allocate(LOGGED, PAPER), plant, np.full(4000, math.radians(200.0)), math.radians(90.0)
    )
    _, known = signal.step(([100.0], [5057.0, 710.0, 100.0]), T=course.time)
    found = (np.degrees(course.heading) - 90.0) / 110.0
    assert found == pytest.approx(known, abs=2e-3)  # the clock's lag of 0.01 s at 0.14 rad/s


# The closed loop


def test_the_closed_loop_is_that_of_an_independent_integration() -> None:
    controller = law()
    course = run_closed(
        controller,
        allocate(LOGGED, PAPER),
        Plant(model=PAPER, vehicle=LOGGED),
        np.full(600, math.radians(200.0)),
        math.radians(90.0),
    )
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


def example(effect: Effect) -> Model:
    values = [p.starts[0] * SCALES.of(p) for p in effect.parameters]
    return replace(PAPER, effects=(effect,), effect_values=tuple(values))


@pytest.mark.parametrize("effect", forms_for(VEHICLE), ids=lambda effect: effect.key)
def test_recorded_commands_drive_the_open_loop_to_the_same_heading(effect: Effect) -> None:
    """Whatever the loop made of its commands step by step, the model makes of all of them together."""
    model = example(effect)
    course = closed(model, law(900.0, 3000.0), seconds=90.0)
    drive = model.drive(VEHICLE, course.trial())
    differs = float(np.max(np.abs(drive.torque - course.drive.torque)[:-1]))
    # What an effect remembers from before the window of 20 s.
    assert differs <= 1e-4 * np.max(np.abs(drive.torque))
    # It starts at the rate that is logged first.
    rate, heading = model.simulate(replace(course.trial(), rate=np.zeros(len(course.time))), drive)
    # Steps of the integration, what is forgotten, and a true heading that is found from the instrument's by turns.
    reach = 1e-3 if effect.on_heading else 6e-6 + 0.01 * differs
    if effect.on_heading is None:
        assert rate == pytest.approx(course.rate, abs=reach)
    assert heading - heading[0] == pytest.approx(course.heading - course.heading[0], abs=reach)
    assert np.ptp(course.heading) > 1.0


def test_an_effect_that_remembers_more_than_the_window_is_given_all_of_it() -> None:
    model = with_effect("supply_sag", 3.0, 60.0)
    course = closed(model, law(900.0, 3000.0), seconds=200.0)
    whole = model.drive(VEHICLE, course.trial()).torque
    assert np.max(np.abs(whole - course.drive.torque)[:-1]) <= 1e-4 * np.max(np.abs(whole))


# Allocation


def test_the_inverse_of_the_bench_curve_gives_the_torque_back() -> None:
    allocation = allocate(VEHICLE, PAPER)
    wanted = np.linspace(0.99 * allocation.lowest, 0.99 * allocation.highest, 301)
    given = VEHICLE.thrust(allocation(wanted)) @ np.array([0.43, -0.43])
    assert given == pytest.approx(wanted, abs=0.02)  # of 500 points of a square law between bench points
    assert np.abs(allocation(np.array([1.0]))) == pytest.approx(0.4, abs=0.1)  # beyond the dead zone at once
    assert allocation(np.zeros(1)) == pytest.approx(np.zeros((1, 2)))


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("thruster_deadband", (0.2,)),
        ("thrust_asymmetry", (0.7,)),
        ("thrust_curve_shape", (1.2,)),
        ("supply_sag", (0.5, 5.0)),
    ],
)
def test_the_aid_undoes_what_diagnosis_found_of_the_thrust(key: str, values: tuple[float, ...]) -> None:
    model = with_effect(key, *values)
    bench, known = allocate(VEHICLE, PAPER), allocate(VEHICLE, model)
    torques = []
    for allocation in (bench, known):
        commands = np.repeat(allocation(np.array([100.0])), 2, axis=0)
        course = closed(PAPER, law(), seconds=1.0).trial()
        held = replace(course, time=course.time[:2], position=course.position[:2], commands=commands)
        torques.append(model.drive(VEHICLE, held).torque[0])
    assert torques[1] == pytest.approx(100.0, abs=0.1)
    assert abs(torques[0] - 100.0) > 2.0


# Margins


def frequency_response(controller: Law, delay: int, w: FloatArray) -> FloatArray:
    """The loop's transfer by scipy's own discretisation, with a delay of whole samples."""
    linear = PAPER.linear_drag
    matrix = np.array([[0.0, 1.0], [0.0, -linear / PAPER.inertia]])
    plant = signal.cont2discrete(
        (matrix, np.array([[0.0], [1.0 / PAPER.inertia]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))), controller.period
    )
    top, bottom = signal.ss2tf(*plant[:4])
    z = np.exp(1j * w * controller.period)
    blend = 1.0 - math.exp(-controller.period / controller.rate_filter)
    rate = blend / controller.period * (z - 1.0) / (z - 1.0 + blend)
    response = (controller.kp + (controller.kd - controller.linear_drag) * rate) * z**-delay
    return np.asarray(response * np.polyval(top[0], z) / np.polyval(bottom, z))


def loop(controller: Law, delay: float = 0.0, model: Model = PAPER) -> Loop:
    known = allocate(VEHICLE, model)
    response = actuators(model, VEHICLE, known, controller.period, 126.0)
    return Loop(law=controller, motion=linearised(model), actuators=response, delay=delay)


@pytest.mark.parametrize("samples", [0, 3])
@pytest.mark.parametrize("controller", [law(), law(3000.0, 5000.0), law(3000.0, 5000.0, linear_drag=0.0)])
def test_margins_are_those_of_an_independent_computation(controller: Law, samples: int) -> None:
    w = np.geomspace(1e-3, 0.999 * math.pi / 0.1, 400_000)
    response = frequency_response(controller, samples, w)
    found = loop(controller, 0.1 * samples).margins()
    unity = np.flatnonzero(np.diff(np.sign(np.abs(response) - 1.0)))
    phase = np.unwrap(np.angle(response))[unity[0]] + math.pi
    real = np.flatnonzero(np.diff(np.sign(np.unwrap(np.angle(response)) + math.pi)))
    # The grid of the margins has 240 points a decade.
    assert found.phase_deg == pytest.approx(math.degrees(phase), abs=0.05)
    assert found.delay_s == pytest.approx(phase / w[unity[0]], rel=2e-3)
    assert found.gain_db == pytest.approx(-20.0 * math.log10(np.abs(response[real[0]])), abs=0.05)
    lagged = response / (1.0 + 1j * w * found.lag_s)
    assert np.min(np.abs(1.0 + lagged)) < 2e-3  # it touches -1
    assert found.sensitivity_peak == pytest.approx(np.max(1.0 / np.abs(1.0 + response)), rel=1e-3)
    assert found.stable


def swing(model: Model, controller: Law, delay: float, allocation_of: Model) -> tuple[float, float]:
    """Of the heading in deg, over the middle and the end of a run after a small step."""
    plant = Plant(model=model, vehicle=VEHICLE, delay=delay)
    goal = np.full(2400, math.radians(0.5))
    course = run_closed(controller, allocate(VEHICLE, allocation_of), plant, goal, 0.0)
    middle, end = np.array_split(np.degrees(course.heading), 4)[1], np.array_split(np.degrees(course.heading), 4)[3]
    return float(np.ptp(middle)), float(np.ptp(end))


@pytest.mark.parametrize("key", ["", "thruster_lag", "command_delay"])
def test_the_loop_breaks_just_beyond_its_delay_margin(key: str) -> None:
    model = with_effect(key, 0.3) if key else PAPER
    controller = law(1200.0, 3500.0)
    margin = loop(controller, model=model).margins().delay_s
    middle, end = swing(model, controller, 0.85 * margin, model)
    assert end < 0.7 * middle
    middle, end = swing(model, controller, 1.15 * margin, model)
    # It grows from a step of half a degree until drag and thrust limit it.
    assert end > 2.0
    assert end > 0.99 * middle


@pytest.mark.parametrize("share", [0.85, 1.15])
def test_the_loop_breaks_at_its_lag_margin(share: float) -> None:
    controller = law(1200.0, 3500.0)
    late = with_effect("thruster_lag", share * loop(controller).margins().lag_s)
    assert loop(controller, model=late).margins().stable is (share < 1.0)
    middle, end = swing(late, controller, 0.0, late)
    assert (end < 0.7 * middle) if share < 1.0 else end > 2.0


@pytest.mark.parametrize("share", [0.85, 1.15])
def test_the_loop_breaks_at_its_gain_margin(share: float) -> None:
    controller = law(1200.0, 3500.0, linear_drag=0.0, quadratic_drag=0.0)
    factor = share * 10.0 ** (loop(controller, 0.5).margins().gain_db / 20.0)
    raised = replace(controller, kp=factor * controller.kp, kd=factor * controller.kd)
    assert loop(raised, 0.5).margins().stable is (share < 1.0)
    plant = Plant(model=PAPER, vehicle=LOGGED, delay=0.5)
    course = run_closed(raised, allocate(LOGGED, PAPER), plant, np.full(1200, 1e-3), 0.0)
    middle, end = (np.ptp(np.array_split(course.heading, 4)[at]) for at in (1, 3))
    assert bool(end < middle) is (share < 1.0)


def test_margins_over_the_uncertainty_follow_the_covariance() -> None:
    names = ("inertia", "quadratic_drag", "linear_drag")
    entries = {
        name: Entry(value=value, standard_error=0.1 * value, unit="", method="")
        for name, value in zip(names, (5057.0, 3532.0, 132.0), strict=True)
    }
    size = [0.1 * entry.value for entry in entries.values()]
    covariance = {(a, a): s**2 for a, s in zip(names, size, strict=True)}
    covariance["quadratic_drag", "linear_drag"] = -0.9 * size[1] * size[2]
    models = drawn(Parameters(path=Path("p"), entries=entries, covariance=covariance), 2000, seed=3)
    rows = np.array([(m.inertia, m.quadratic_drag, m.linear_drag) for m in models])
    assert np.std(rows, axis=0) == pytest.approx(np.array(size), rel=0.06)  # 2000 draws
    assert np.corrcoef(rows.T)[1, 2] == pytest.approx(-0.9, abs=0.02)
    assert abs(np.corrcoef(rows.T)[0, 1]) < 0.07


# Limit cycles


def test_a_dead_zone_and_a_lag_make_a_limit_cycle_that_is_seen() -> None:
    """Torque that is missing in the play of the drive, which the bench does not know, behind a lag."""
    model = with_effect("thruster_lag", 1.0, model=with_effect("command_hysteresis", 0.4))
    bench = allocate(VEHICLE, PAPER)
    controller = law(2000.0, 3000.0)
    shaken, _ = run_manoeuvre(controller, bench, Plant(model=model, vehicle=VEHICLE), paper_runs()[2])
    assert shaken.limit_cycle is not None
    assert shaken.limit_cycle.amplitude_deg > 0.2
    calm, _ = run_manoeuvre(controller, bench, Plant(model=PAPER, vehicle=VEHICLE), paper_runs()[2])
    assert calm.limit_cycle is None


def test_a_limit_cycle_is_measured_and_a_dying_swing_is_none() -> None:
    time = np.arange(0.0, 300.0, 0.1)
    found = limit_cycle(time, 120.0 + 0.5 * np.sin(time))
    assert found is not None
    assert (found.amplitude_deg, found.period_s) == pytest.approx((0.5, 2.0 * math.pi), rel=2e-2)
    assert limit_cycle(time, 120.0 + 20.0 * np.exp(-time / 40.0) * np.sin(time)) is None
    assert limit_cycle(time, np.full(len(time), 120.0)) is None


# What acts at rest


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("bias_torque", (8.0,)),
        ("tether_torsion", (2.0,)),
        ("tether_torsion:stiffening", (2.0, 6.0)),
        ("heading_dependent_torque:mixed", (6.0, 0.4, 3.0, -1.0)),
    ],
)
def test_torques_at_rest_are_held_against(key: str, values: tuple[float, ...]) -> None:
    model = with_effect(key, *values)
    known = law(900.0, 3000.0, hold=holds(model))
    unknown = law(900.0, 3000.0)
    errors = [
        abs(math.degrees(wrapped(c.wanted[-1] - c.heading[-1]))) for c in (closed(model, known), closed(model, unknown))
    ]
    assert errors[0] < 1e-3
    assert errors[1] > 0.05


# The generated source


@pytest.fixture(scope="module")
def generated(tmp_path_factory: pytest.TempPathFactory) -> tuple[Law, Any, Any]:
    controller = law(
        900.0, 3000.0, inertia=5057.0, hold=(1.5, -0.3, 0.01, 2.0, -1.0, 0.7, 0.2), lowest=-400.0, highest=500.0
    )
    folder = tmp_path_factory.mktemp("source")
    (folder / "c.c").write_text(c_source(controller))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, "-o", folder / "c.so", folder / "c.c", "-lm"], check=True)
    module: dict[str, Any] = {}
    exec(compile(python_source(controller), "controller.py", "exec"), module)  # noqa: S102 - what is under test
    return controller, ctypes.CDLL(str(folder / "c.so")), module


def test_generated_c_and_python_are_the_simulated_controller(generated: tuple[Law, Any, Any]) -> None:
    controller, library, module = generated
    library.rovid_control_step.restype = ctypes.c_double
    step_in_c = library.rovid_control_step
    step_in_c.argtypes = [ctypes.c_void_p, *[ctypes.c_double] * 4]
    library.rovid_control_start.argtypes = [ctypes.c_void_p, ctypes.c_double]
    rng = np.random.default_rng(5)
    headings = np.cumsum(rng.normal(0.0, 0.02, 3000)) + 3.0
    headings = np.where(rng.random(3000) < 0.5, headings, headings % (2.0 * math.pi))  # wrapped or not
    memory = (ctypes.c_double * 3)()
    library.rovid_control_start(memory, headings[0])
    state, plain = controller.start(headings[0]), module["Controller"](headings[0])
    torques = []
    for k, heading in enumerate(headings):
        wanted, rate, acceleration = math.sin(0.01 * k) * 3.0, 0.01 * math.cos(0.01 * k), 1e-3 * math.sin(0.02 * k)
        torque, state = controller.step(state, heading, wanted, rate, acceleration)
        in_c = step_in_c(memory, heading, wanted, rate, acceleration)
        in_python = plain.step(heading, wanted, rate, acceleration)
        # Sums in another order, of thousands of N m.
        assert in_c == pytest.approx(torque, abs=1e-9)
        assert in_python == pytest.approx(torque, abs=1e-9)
        torques.append(torque)
    assert min(torques) == -400.0
    assert max(torques) == 500.0
    assert np.ptp(torques) > 100.0


# Random vehicles


BY_AMPLITUDE = {"thruster_lag:rotor", "command_hysteresis", "command_hysteresis:schmitt", "slew_limit"}


def random_vehicle(seed: int) -> tuple[Model, Vehicle, Setting]:
    """An identified vehicle with one to three effects that diagnosis found, of sizes that trials show."""
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
            first = parameter.starts[0] * scales.of(parameter)
            null = parameter.null * scales.of(parameter)
            away = first if effect.id == "slew_limit" else null + share * (first - null)
            values.append(away)
    model = Model(
        inertia=inertia,
        quadratic_drag=quadratic,
        linear_drag=linear,
        effects=tuple(chosen.values()),
        effect_values=tuple(values),
    )
    return model, vehicle, Setting(torque_in_use=torque, heading_noise=math.radians(0.01))


@pytest.mark.parametrize("seed", [pytest.param(k, marks=[pytest.mark.slow] if k >= 4 else []) for k in range(20)])
def test_a_random_vehicle_keeps_its_heading_within_predicted_margins(seed: int) -> None:
    model, vehicle, setting = random_vehicle(seed)
    allocation = allocate(vehicle, model)
    bandwidth = choose_bandwidth(model, vehicle, allocation, setting, 0.7)
    controller = law_for(model, allocation, setting, *gains(model.inertia, 0.7, bandwidth))
    predicted = loop_of(controller, model, vehicle, allocation, setting).margins()
    plant = Plant(
        model=model,
        vehicle=vehicle,
        heading_noise=setting.heading_noise,
        disturbance=0.02 * setting.torque_in_use,
    )
    for manoeuvre in manoeuvres((), setting.torque_in_use)[:3]:
        found, _ = run_manoeuvre(controller, allocation, plant, manoeuvre, seed=seed)
        assert found.settling_time is not None
        assert found.steady_error_deg < 0.6
        # What a play or a dead zone leaves, if anything.
        assert found.limit_cycle is None or found.limit_cycle.amplitude_deg < 0.1
    # The predicted delay margin: stable with 15 % less, unstable with 15 % more; where the lag goes with the amplitude,
    # which is smaller here than the torque in use that the margins are of, with 40 %.
    swings = []
    reach = 0.4 if {effect.key for effect in model.effects} & BY_AMPLITUDE else 0.15
    for share in (1.0 - reach, 1.0 + reach):
        late = replace(plant.quiet(), delay=share * predicted.delay_s)
        goal = np.full(round(100.0 / bandwidth / controller.period), math.radians(101.0))
        course = run_closed(controller, allocation, late, goal, math.radians(100.0))
        swings.append([float(np.ptp(part)) for part in np.array_split(np.degrees(course.heading), 4)])
    assert swings[0][3] < swings[0][1]
    # From a step of one degree it has grown until drag and thrust limit it.
    assert swings[1][3] > 1.0
    assert swings[1][3] > 0.95 * swings[1][1]


# The command


def test_control_of_the_papers_tables(rovid: Rovid) -> None:
    assert rovid("fit-drag", SAMPLES / "rosub_paper").code == 0
    assert rovid("fit-inertia").code == 0
    document = rovid("control", "--kp", "100", "--kd", "710", "--json").document
    assert document["schema"] == "rovid-control/1"
    assert document["gains"] == {"kp": 100.0, "kd": 710.0}
    assert document["torque_limits"] == [None, None]
    assert set(document["margins"]) == {"gain_db", "phase_deg", "delay_s"}
    names = [run["name"] for run in document["runs"]]
    assert names[:2] == ["90 to 200 deg"] * 2
    assert {run["model_aid"] for run in document["runs"]} == {True, False}
    first = document["runs"][0]
    assert {
        *("name", "effects", "model_aid", "time_constant", "rise_time", "settling_time", "overshoot_deg"),
        *("steady_error_deg", "limit_cycle"),
    } <= set(first)
    assert first["effects"] == []
    assert first["time_constant"] == pytest.approx(11.5, abs=1.0)
    printed = rovid("control", "--kp", "100", "--kd", "710")
    assert printed.code == 0
    assert "without limit" in printed.out


def test_control_of_a_trial_day_writes_its_source(rovid: Rovid, csv_day: Path, tmp_path: Path) -> None:
    assert rovid("fit-drag", csv_day).code == 0
    assert rovid("fit-inertia").code == 0
    done = rovid("control", "--step", "350:10", "--c", "out.c", "--python", "out.py", "--json").document
    assert done["damping_ratio"] == pytest.approx(0.7)
    assert done["margins"]["phase_deg"] >= 45.0
    turn = next(run for run in done["runs"] if run["name"] == "350 to 10 deg")
    assert turn["steady_error_deg"] < 0.6
    assert turn["overshoot_deg"] < 5.0  # it goes through north, not around
    assert "rovid_control_step" in (tmp_path / "out.c").read_text()
    compile((tmp_path / "out.py").read_text(), "out.py", "exec")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--kp", "100"), "--kp: needs the other gain"),
        (("--kp", "-1", "--kd", "5"), "--kp: is -1"),
        (("--kp", "100", "--kd", "5", "--bandwidth", "1"), "--bandwidth"),
        (("--step", "20-120"), "--step"),
        (("--step", "0:inf"), "--step"),
        (("--period", "0"), "--period"),
        (("--delay", "nan"), "--delay"),
        (("--delay", "90"), "delayed too much"),
    ],
)
def test_bad_numbers_end_with_one_message(rovid: Rovid, arguments: tuple[str, ...], complaint: str) -> None:
    assert rovid("fit-drag", SAMPLES / "rosub_paper").code == 0
    assert rovid("fit-inertia").code == 0
    done = rovid("control", *arguments)
    assert done.code == 2
    assert complaint in done.err
    assert "Traceback" not in done.err


def test_control_without_parameters_says_what_to_run(rovid: Rovid) -> None:
    done = rovid("control")
    assert done.code == 2
    assert "fit-drag" in done.err


def test_pd_alone_has_no_aid() -> None:
    bare = unaided(law(hold=(1.0,) * 7, inertia=5.0))
    assert (bare.quadratic_drag, bare.linear_drag, bare.inertia, sum(bare.hold)) == (0.0, 0.0, 0.0, 0.0)
    assert bare.step(bare.start(0.0), 0.0, 0.1)[0] == pytest.approx(10.0)


def test_a_manoeuvre_against_a_current_has_the_error_of_its_stiffness() -> None:
    found, _ = run_manoeuvre(
        law(1000.0, 3500.0),
        allocate(LOGGED, PAPER),
        Plant(model=PAPER, vehicle=LOGGED),
        Manoeuvre(name="", start=120.0, wanted=120.0, current=10.0),
    )
    assert found.steady_error_deg == pytest.approx(math.degrees(10.0 / 1000.0), rel=1e-3)


# Against python-control


@pytest.mark.parametrize(("kp", "kd", "period", "rate_filter"), [(100.0, 710.0, 0.1, 0.3), (900.0, 2500.0, 0.5, 0.2)])
def test_margins_are_those_of_python_control(kp: float, kd: float, period: float, rate_filter: float) -> None:
    controller = law(kp, kd, period=period, rate_filter=rate_filter)
    found = Loop(
        law=controller, motion=linearised(PAPER), actuators=(np.array([0.1, 1.0]), np.ones(2, dtype=np.complex128))
    ).margins()
    motion = control.ss([[0.0, 1.0], [0.0, -132.37 / 5057.0]], [[0.0], [1.0 / 5057.0]], [[1.0, 0.0]], 0.0)
    blend = 1.0 - math.exp(-period / rate_filter)
    # The aid takes the linear drag off again.
    rate = control.tf([blend / period, -blend / period], [1.0, blend - 1.0], period)
    loop = (kp + (kd - 132.37) * rate) * control.ss2tf(control.sample_system(motion, period, "zoh"))
    # By frequencies: its polynomials say themselves that they are not accurate here.
    gain, phase, _, _, crossover, _ = control.stability_margins(loop, method="frd")
    assert found.gain_db == pytest.approx(20.0 * math.log10(gain), abs=0.02)
    assert found.phase_deg == pytest.approx(phase, abs=0.05)
    assert found.crossover == pytest.approx(crossover, rel=1e-3)


@pytest.mark.parametrize(("heading", "torque"), [(0.1, 50.0), (0.5, 120.0)])
def test_weights_on_heading_and_torque_ask_for_a_damping_ratio_of_half_the_root_of_two(
    heading: float, torque: float
) -> None:
    """Of the aided vehicle, a double integrator, the linear-quadratic gains are those of --damping 0.707."""
    motion = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0 / 5057.0]])
    optimal, _, _ = control.lqr(*motion, np.diag([1.0 / heading**2, 0.0]), np.array([[1.0 / torque**2]]))
    known = gains(5057.0, math.sqrt(0.5), math.sqrt(torque / heading / 5057.0))
    assert optimal.ravel() == pytest.approx(known, rel=1e-6)
