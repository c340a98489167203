"""Bench curves, tables of sine trials, estimates and printed numbers."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from rovid.campaign.tables import Table, read_table
from rovid.ground.errors import DataError, LogError
from rovid.ground.numbers import plus_minus
from rovid.identify.bench import bench_readings, fit_bench
from rovid.identify.estimate import Estimate
from rovid.identify.inertia_table import fit_inertia_table
from tests.conftest import SAMPLES

PAPER_SINES = SAMPLES / "rosub_paper" / "sine_trials.csv"


def table(text: str, folder: Path, **options: tuple[str, ...]) -> Table:
    path = folder / "table.csv"
    path.write_text(text)
    return read_table(path, **options)


def test_paper_sines_by_peak_and_by_harmonic_balance() -> None:
    fit = fit_inertia_table(read_table(PAPER_SINES), drag=None, rigid_body=2348.9)
    assert [round(value) for _, value, _ in fit.methods["harmonic_balance"].runs] == [4472, 7479]
    assert fit.methods["peak"].value == pytest.approx(5057.0, abs=0.5)
    assert fit.methods["harmonic_balance"].consistent is False
    assert any("No single inertia fits" in text for text in fit.estimate.warnings)
    assert fit.added_inertia == pytest.approx(fit.estimate.value("inertia") - 2348.9)


def test_sine_table_without_drag_says_what_to_do(tmp_path: Path) -> None:
    rows = table("period_s,torque_amplitude_Nm,peak_yaw_rate_rad_s\n40,100,0.12\n", tmp_path)
    with pytest.raises(DataError, match="fit-drag"):
        fit_inertia_table(rows, drag=None, rigid_body=None)


def test_drag_above_torque_is_refused(tmp_path: Path) -> None:
    text = "period_s,torque_amplitude_Nm,peak_yaw_rate_rad_s,quadratic_drag,linear_drag\n40,10,0.2,3532,132\n"
    with pytest.raises(DataError, match=r"table\.csv:2: the drag"):
        fit_inertia_table(table(text, tmp_path), drag=None, rigid_body=None)


def true_thrust(command: np.ndarray) -> np.ndarray:
    excess = np.clip(np.abs(command) - 0.4, 0.0, None)
    return np.asarray(np.where(command > 0, 9.0, -5.0) * excess**2)


def test_noisy_bench_readings_give_a_rising_curve_with_its_dead_zone() -> None:
    rng = np.random.default_rng()
    command = np.tile(np.linspace(-5.0, 5.0, 101), 3)
    fit = fit_bench(command, true_thrust(command) + rng.normal(0.0, 0.3, len(command)))
    assert (np.diff(fit.curve.thrust) >= 0.0).all()
    assert fit.dead_zone is not None
    # Noise of 0.17 N (three repeats) hides thrust of up to 1.2 N, and the curve starts flat: 0.5 V at 5 N/V^2.
    assert fit.dead_zone[0] == pytest.approx(-0.4, abs=0.5)
    assert fit.dead_zone[1] == pytest.approx(0.4, abs=0.5)
    inside = (fit.curve.command >= fit.dead_zone[0]) & (fit.curve.command <= fit.dead_zone[1])
    assert (fit.curve.thrust[inside] == 0.0).all()
    assert np.abs(fit.curve(command) - true_thrust(command)).max() < 1.5  # what the noise can hide
    assert fit.rms == pytest.approx(0.3, rel=0.25)


def test_exact_readings_stay_as_they_are() -> None:
    command = np.arange(1100.0, 1901.0, 4.0)
    thrust = true_thrust((command - 1500.0) / 80.0)
    fit = fit_bench(command[::-1], thrust[::-1])
    assert fit.curve.thrust == pytest.approx(thrust, abs=0.001 * np.abs(thrust).max())
    assert fit.dead_zone is not None
    # Thrust below a thousandth of the largest counts as none: 0.2 V beyond the true dead zone of 0.4 V.
    assert fit.dead_zone[0] == pytest.approx(1500 - 0.4 * 80, abs=0.2 * 80)
    assert fit.dead_zone[1] == pytest.approx(1500 + 0.4 * 80, abs=0.2 * 80)


def test_readings_that_fall_with_the_command_give_a_falling_curve() -> None:
    command = np.linspace(-5.0, 5.0, 41)
    fit = fit_bench(command, -true_thrust(command))
    assert (np.diff(fit.curve.thrust) <= 0.0).all()
    assert fit.curve(np.array([5.0]))[0] < 0.0


@pytest.mark.parametrize("name", ["kaxan_520.csv", "kaxan_540.csv"])
def test_real_headerless_bench(name: str) -> None:
    readings = read_table(SAMPLES / "thruster_bench" / name, headerless=("command", "thrust_N"))
    fit = fit_bench(*bench_readings(readings, command=None, thrust=None, unit=None))
    assert (np.diff(fit.curve.thrust) >= 0.0).all()
    assert fit.dead_zone is not None
    assert -1.3 < fit.dead_zone[0] < fit.dead_zone[1] < 1.3
    assert np.abs(fit.residuals).max() < 0.7  # N, of 100


def test_vendor_sheet_with_units_in_its_header() -> None:
    readings = read_table(SAMPLES / "bluerov2_pier59" / "t200_16V_bench.csv")
    fit = fit_bench(*bench_readings(readings, command=None, thrust=None, unit=None))
    assert fit.dead_zone == (1472.0, 1528.0)
    assert fit.curve.thrust.max() == pytest.approx(5.245 * 9.80665, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n2,3\n3,4\n", "not clear which column"),
        ("command,thrust\n1,2\n2,3\n3,4\n", "does not say its unit"),
        ("command,thrust_N\n1,2\n2,x\n3,4\n", "table.csv:3: thrust_N is 'x'"),
        ("command,thrust_N\n", "no rows"),
    ],
)
def test_bad_bench_is_told(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=message):
        bench_readings(table(text, tmp_path), command=None, thrust=None, unit=None)


def test_two_commands_make_no_curve() -> None:
    with pytest.raises(DataError, match="three commands"):
        fit_bench(np.array([0.0, 1.0]), np.array([0.0, 1.0]))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a;b\n1,5;2\n", [1.5]),
        ("a\tb\n1.5\t2\n", [1.5]),
        ("\ufeffa,b\n1.5,2\n", [1.5]),
        ("# note\na,b\n\n1.5,2\n", [1.5]),
    ],
)
def test_tables_of_every_dialect(text: str, expected: list[float], tmp_path: Path) -> None:
    assert table(text, tmp_path).numbers("a").tolist() == expected


@pytest.mark.parametrize(
    ("value", "error", "expected"),
    [
        (3610.38, 315.4, "3610 ± 315"),
        (103.138, 61.29, "103 ± 61"),
        (5056.93, 0.155, "5056.930 ± 0.155"),
        (0.1234567, 0.00456, "0.1235 ± 0.0046"),
        (123456.0, 45678.0, "123000 ± 46000"),
        (2.5, math.nan, "2.5"),
    ],
)
def test_values_are_rounded_to_their_uncertainty(value: float, error: float, expected: str) -> None:
    assert plus_minus(value, error) == expected


def test_interval_uses_students_t() -> None:
    estimate = Estimate(
        names=("inertia",),
        values=np.array([10.0]),
        covariance=np.array([[4.0]]),
        degrees_of_freedom=3.0,
        method="m",
        samples=5,
    )
    # t of 0.975 at 3 degrees of freedom is 3.182.
    assert estimate.interval("inertia") == pytest.approx((10 - 6.365, 10 + 6.365), abs=1e-3)
