"""Thrust curves from bench readings, and the common scale of thrust."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import DataError, LogError
from rovid.estimate.thrust_curve import (
    ThrustScale,
    bench_readings,
    fit_thrust_curve,
    scale_from_lifts,
    scale_from_pulls,
    scale_from_step,
)
from rovid.trial.tables import read_table
from tests.conftest import SAMPLES
from tests.tables import table


def true_thrust(command: np.ndarray) -> np.ndarray:
    excess = np.clip(np.abs(command) - 0.4, 0.0, None)
    return np.asarray(np.where(command > 0, 9.0, -5.0) * excess**2)


def test_noisy_bench_readings_give_a_rising_curve_with_its_dead_zone() -> None:
    rng = np.random.default_rng()
    command = np.tile(np.linspace(-5.0, 5.0, 101), 3)
    fit = fit_thrust_curve(command, true_thrust(command) + rng.normal(0.0, 0.3, len(command)))
    assert (np.diff(fit.curve.thrust) >= 0.0).all()
    assert fit.dead_zone is not None
    # Noise of 0.17 N (three repeats) hides thrust of up to 1.2 N, and the curve starts flat: 0.5 V at 5 N/V^2.
    assert fit.dead_zone[0] == pytest.approx(-0.4, abs=0.5)
    assert fit.dead_zone[1] == pytest.approx(0.4, abs=0.5)
    inside = (fit.curve.command >= fit.dead_zone[0]) & (fit.curve.command <= fit.dead_zone[1])
    assert (fit.curve.thrust[inside] == 0.0).all()
    assert np.abs(fit.curve(command) - true_thrust(command)).max() < 1.5  # what the noise can hide
    assert fit.rms == pytest.approx(0.3, rel=0.25)


def test_the_dead_zone_of_noisy_readings_lies_about_neutral() -> None:
    rng = np.random.default_rng()
    command = np.linspace(1100.0, 1900.0, 80)
    beside = 0
    for _ in range(20):
        fit = fit_thrust_curve(command, true_thrust((command - 1493.0) / 80.0) + rng.normal(0.0, 1.0, len(command)))
        beside += fit.dead_zone is None or not fit.dead_zone[0] < 1493.0 < fit.dead_zone[1]
    assert beside <= 1  # a third of the draws where one reading decides


def test_exact_readings_stay_as_they_are() -> None:
    command = np.arange(1100.0, 1901.0, 4.0)
    thrust = true_thrust((command - 1500.0) / 80.0)
    fit = fit_thrust_curve(command[::-1], thrust[::-1])
    assert fit.curve.thrust == pytest.approx(thrust, abs=0.001 * np.abs(thrust).max())
    assert fit.dead_zone is not None
    # Thrust below a thousandth of the largest counts as none: 0.2 V beyond the true dead zone of 0.4 V.
    assert fit.dead_zone[0] == pytest.approx(1500 - 0.4 * 80, abs=0.2 * 80)
    assert fit.dead_zone[1] == pytest.approx(1500 + 0.4 * 80, abs=0.2 * 80)


def test_readings_that_fall_with_the_command_give_a_falling_curve() -> None:
    command = np.linspace(-5.0, 5.0, 41)
    fit = fit_thrust_curve(command, -true_thrust(command))
    assert (np.diff(fit.curve.thrust) <= 0.0).all()
    assert fit.curve(np.array([5.0]))[0] < 0.0


@pytest.mark.parametrize("name", ["kaxan_520.csv", "kaxan_540.csv"])
def test_real_headerless_bench(name: str) -> None:
    readings = read_table(SAMPLES / "thruster_bench" / name, headerless=("command", "thrust_N"))
    fit = fit_thrust_curve(*bench_readings(readings, command=None, thrust=None, unit=None))
    assert (np.diff(fit.curve.thrust) >= 0.0).all()
    assert fit.dead_zone is not None
    assert -1.3 < fit.dead_zone[0] < fit.dead_zone[1] < 1.3
    assert np.abs(fit.residuals).max() < 0.7  # N, of 100


def test_vendor_sheet_with_units_in_its_header() -> None:
    readings = read_table(SAMPLES / "bluerov2_pier59" / "t200_16V_bench.csv")
    fit = fit_thrust_curve(*bench_readings(readings, command=None, thrust=None, unit=None))
    assert fit.dead_zone == (1472.0, 1528.0)
    assert fit.curve.thrust.max() == pytest.approx(5.245 * 9.80665, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n2,3\n3,4\n", "column is ambiguous"),
        ("command,thrust\n1,2\n2,3\n3,4\n", "has no known unit"),
        ("command,thrust_N\n1,2\n2,x\n3,4\n", "table.csv:3: thrust_N is 'x'"),
        ("command,thrust_N\n", "no rows"),
    ],
)
def test_a_bad_bench_table_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=message):
        bench_readings(table(text, tmp_path), command=None, thrust=None, unit=None)


def test_two_commands_are_too_few() -> None:
    with pytest.raises(DataError, match="three commands"):
        fit_thrust_curve(np.array([0.0, 1.0]), np.array([0.0, 1.0]))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_dead_zone_that_was_not_read_to_its_end_ends_where_the_curve_begins(side: float) -> None:
    command = side * np.array([-3.0, -2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 2.0, 2.5, 3.0])
    thrust = np.where(np.abs(command) > 1.2, side * np.sign(command) * 4.0 * (np.abs(command) - 1.2), 0.0) * side
    fit = fit_thrust_curve(command, thrust)
    assert fit.dead_zone is not None
    far = fit.dead_zone[1] if side > 0.0 else fit.dead_zone[0]
    assert far == pytest.approx(side * 1.2)
    assert fit.curve(np.array([side * 1.1])) == pytest.approx([0.0])
    assert fit.curve(np.array([side * 1.6])) == pytest.approx([side * 1.6])


TRUE, REFERENCE = 1.13, 0.01
Made = Callable[[np.random.Generator], ThrustScale]


def pull(draw: np.random.Generator) -> ThrustScale:
    """Five levels, 4 N of scatter, and a balance that is off by 1 %."""
    curve = np.array([40.0, 80.0, 120.0, 160.0, 200.0])
    balance = 1.0 + REFERENCE * draw.standard_normal()
    return scale_from_pulls(curve, balance * (TRUE * curve + draw.normal(0.0, 4.0, 5)), REFERENCE)


def three_pulls(draw: np.random.Generator) -> ThrustScale:
    """Three levels, each within 1 %, and a balance that is off by 1 %."""
    curve = np.array([80.0, 100.0, 120.0])
    measured = TRUE * curve * (1.0 + 0.01 * draw.standard_normal(3)) * (1.0 + REFERENCE * draw.standard_normal())
    return scale_from_pulls(curve, measured, REFERENCE)


def proportional_pull(draw: np.random.Generator) -> ThrustScale:
    """Three to twelve levels, whose scatter is 4 % of each force."""
    curve = draw.uniform(50.0, 500.0, int(draw.integers(3, 13)))
    balance = 1.0 + REFERENCE * draw.standard_normal()
    measured = TRUE * curve * (1.0 + 0.04 * draw.standard_normal(len(curve)))
    return scale_from_pulls(curve, balance * measured, REFERENCE)


def lift(draw: np.random.Generator) -> ThrustScale:
    """Four hovers of each of two weights, whose commands scatter by 3 N."""
    stated = np.repeat([100.0, 150.0], 4)
    weight = stated * (1.0 + REFERENCE * draw.standard_normal())
    return scale_from_lifts(weight / TRUE + draw.normal(0.0, 3.0, 8), stated, REFERENCE)


def step(draw: np.random.Generator) -> ThrustScale:
    """400 kg m^2 added to 5000, fitted within 8."""
    before, after = (
        draw.normal(true / TRUE, 8.0) for true in (5000.0, 5000.0 + 400.0 * (1.0 + REFERENCE * draw.standard_normal()))
    )
    return scale_from_step((before, 8.0), (after, 8.0), 400.0, REFERENCE)


@pytest.mark.parametrize("made", [pull, three_pulls, proportional_pull, lift, step])
def test_intervals_hold_and_the_scale_is_unbiased(made: Made) -> None:
    draw = np.random.default_rng(57)
    scales = [made(draw) for _ in range(1000)]
    held = np.mean([low < TRUE < high for low, high in (scale.interval() for scale in scales)])
    assert 0.93 <= held <= 0.97  # the promise; 1000 draws give 0.95 within 0.007
    edges = [scale.value * np.exp(1.96 * scale.error_for_fits / scale.value) for scale in scales]
    assert edges == pytest.approx([scale.interval()[1] for scale in scales], rel=1e-4)
    values = np.array([scale.value for scale in scales])
    errors = np.array([scale.standard_error for scale in scales])
    assert abs(values.mean() - TRUE) < 4.0 * values.std() / np.sqrt(len(values)) + 0.001 * TRUE  # of second order
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(
        values.std(), rel=0.1
    )  # the error of a deviation of 1000 is 2 %


def test_tests_that_decide_nothing_are_refused() -> None:
    with pytest.raises(DataError, match="2 readings with a force; at least 3"):
        scale_from_pulls(np.ones(2), np.ones(2), 0.0)
    with pytest.raises(DataError, match="does not act in the sense"):
        scale_from_pulls(np.ones(3), -np.ones(3), 0.0)
    with pytest.raises(DataError, match="0 readings with a force"):
        scale_from_lifts(np.zeros(3), np.zeros(3), 0.0)
    with pytest.raises(DataError, match=r"grew by 10 ± 14"):
        scale_from_step((5000.0, 10.0), (5010.0, 10.0), 400.0, 0.0)
