"""PD gains, and stability margins of the loop."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from scipy import signal

from rovid.control.actuators import allocate
from rovid.control.closed_loop import Plant
from rovid.control.control_law import ControlLaw
from rovid.control.tuning import OpenLoop, damping_ratio, linearise, pd_gains, sample_models
from rovid.core.array_types import FloatArray
from rovid.store.parameter_file import Entry, Parameters
from tests.control.loops import PAPER, law, loop, run_one, swing, with_effect
from tests.synthetic import LOGGED


def test_the_papers_gains_have_half_the_damping_with_the_inertia() -> None:
    assert damping_ratio(100.0, 710.0, 5057.0) == pytest.approx(0.499, abs=5e-4)
    assert damping_ratio(100.0, 710.0, 2604.0) == pytest.approx(0.696, abs=5e-4)  # its mass in kg


@pytest.mark.parametrize("damping", [0.3, 0.7, 1.4])
def test_the_damping_ratio_of_the_gains_is_the_wanted_one(damping: float) -> None:
    kp, kd = pd_gains(5057.0, damping, 0.4)
    assert damping_ratio(kp, kd, 5057.0) == pytest.approx(damping, rel=1e-12)
    poles = np.roots([5057.0, kd, kp])
    assert np.abs(poles[0]) == pytest.approx(0.4, rel=1e-12) or damping > 1.0


def frequency_response(controller: ControlLaw, delay: int, w: FloatArray) -> FloatArray:
    """Open loop by scipy's discretisation, with a delay of whole samples."""
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


@pytest.mark.parametrize("samples", [0, 3])
@pytest.mark.parametrize("controller", [law(), law(3000.0, 5000.0), law(3000.0, 5000.0, linear_drag=0.0)])
def test_margins_equal_an_independent_computation(controller: ControlLaw, samples: int) -> None:
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


@pytest.mark.parametrize("key", ["", "thruster_lag", "command_delay"])
@pytest.mark.slow
def test_the_loop_is_unstable_beyond_its_delay_margin(key: str) -> None:
    model = with_effect(key, 0.3) if key else PAPER
    controller = law(1200.0, 3500.0)
    margin = loop(controller, model=model).margins().delay_s
    middle, end = swing(model, controller, 0.85 * margin, model)
    assert end < 0.7 * middle
    middle, end = swing(model, controller, 1.15 * margin, model)
    # It grows from a step of half a degree until drag and thrust limit it.
    assert end > 2.0
    assert end > 0.99 * middle


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.85, 1.15])
def test_the_loop_is_unstable_beyond_its_lag_margin(share: float) -> None:
    controller = law(1200.0, 3500.0)
    late = with_effect("thruster_lag", share * loop(controller).margins().lag_s)
    assert loop(controller, model=late).margins().stable is (share < 1.0)
    middle, end = swing(late, controller, 0.0, late)
    assert (end < 0.7 * middle) if share < 1.0 else end > 2.0


@pytest.mark.parametrize("share", [0.85, 1.15])
def test_the_loop_is_unstable_beyond_its_gain_margin(share: float) -> None:
    controller = law(1200.0, 3500.0, linear_drag=0.0, quadratic_drag=0.0)
    factor = share * 10.0 ** (loop(controller, 0.5).margins().gain_db / 20.0)
    raised = replace(controller, kp=factor * controller.kp, kd=factor * controller.kd)
    assert loop(raised, 0.5).margins().stable is (share < 1.0)
    plant = Plant(model=PAPER, vehicle=LOGGED, delay=0.5)
    course = run_one(raised, allocate(LOGGED, PAPER), plant, np.full(1200, 1e-3), 0.0)
    middle, end = (np.ptp(np.array_split(course.heading, 4)[at]) for at in (1, 3))
    assert bool(end < middle) is (share < 1.0)


def test_sampled_models_follow_the_covariance() -> None:
    names = ("inertia", "quadratic_drag", "linear_drag")
    entries = {
        name: Entry(value=value, standard_error=0.1 * value, unit="", method="")
        for name, value in zip(names, (5057.0, 3532.0, 132.0), strict=True)
    }
    size = [0.1 * entry.value for entry in entries.values()]
    covariance = {(a, a): s**2 for a, s in zip(names, size, strict=True)}
    covariance["quadratic_drag", "linear_drag"] = -0.9 * size[1] * size[2]
    models = sample_models(Parameters(path=Path("p"), entries=entries, covariance=covariance), 2000, seed=3)
    rows = np.array([(m.inertia, m.quadratic_drag, m.linear_drag) for m in models])
    assert np.std(rows, axis=0) == pytest.approx(np.array(size), rel=0.06)  # 2000 draws
    assert np.corrcoef(rows.T)[1, 2] == pytest.approx(-0.9, abs=0.02)
    assert abs(np.corrcoef(rows.T)[0, 1]) < 0.07


def test_a_sampled_time_constant_stays_positive() -> None:
    """At zero the motion of the water has no rate of change."""
    values = {"inertia": 5057.0, "quadratic_drag": 3532.0, "linear_drag": 132.0}
    values |= {"entrained_swirl.coupling": 0.3, "entrained_swirl.time_constant": 20.0}
    entries = {name: Entry(value=value, standard_error=0.0, unit="", method="") for name, value in values.items()}
    covariance = {("entrained_swirl.time_constant", "entrained_swirl.time_constant"): 1e8}
    models = sample_models(Parameters(path=Path("p"), entries=entries, covariance=covariance), 20, seed=3)
    times = [model.effect_values[1] for model in models]
    assert min(times) == pytest.approx(4.0)
    assert max(times) > 1e3


@pytest.mark.parametrize(("kp", "kd", "period", "rate_filter"), [(100.0, 710.0, 0.1, 0.3), (900.0, 2500.0, 0.5, 0.2)])
def test_margins_equal_those_of_python_control(kp: float, kd: float, period: float, rate_filter: float) -> None:
    controller = law(kp, kd, period=period, rate_filter=rate_filter)
    found = OpenLoop(
        law=controller, motion=linearise(PAPER), actuators=(np.array([0.1, 1.0]), np.ones(2, dtype=np.complex128))
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


def test_friction_damps_by_its_describing_function_at_the_largest_amplitude() -> None:
    torque, fastest = 12.0, 0.15
    rubbing = with_effect("coulomb_resistance", torque, 1e-3)
    at_rest, swinging = (-PAPER.inertia * linearise(rubbing, rate)[0][1, 1] for rate in (0.0, fastest))
    # Its slope at rest, and the describing function of a torque that turns its sign (Gelb and Vander Velde 1968).
    assert at_rest == pytest.approx(PAPER.linear_drag + torque / 1e-3, rel=0.01)
    assert swinging == pytest.approx(PAPER.linear_drag + 4.0 * torque / (math.pi * fastest), rel=0.01)


@pytest.mark.parametrize(("heading", "torque"), [(0.1, 50.0), (0.5, 120.0)])
def test_linear_quadratic_gains_have_a_damping_ratio_of_half_the_root_of_two(heading: float, torque: float) -> None:
    """The aided vehicle is a double integrator, for which they are the gains of --damping 0.707."""
    motion = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0 / 5057.0]])
    optimal, _, _ = control.lqr(*motion, np.diag([1.0 / heading**2, 0.0]), np.array([[1.0 / torque**2]]))
    known = pd_gains(5057.0, math.sqrt(0.5), math.sqrt(torque / heading / 5057.0))
    assert optimal.ravel() == pytest.approx(known, rel=1e-6)
