"""Inertia from sine runs, from tables, and by all methods side by side."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import DataError
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import fit_inertia, fit_inertia_table
from rovid.estimate.oscillation_tests import (
    SineTrial,
    harmonic_balance,
    orbit_integral,
    peak_bias,
    peak_method,
    sine_trials,
)
from rovid.model.model import Model
from rovid.signals.preprocessing import Run
from rovid.signals.rates import compute_rates
from rovid.trial.tables import read_table
from tests.conftest import SAMPLES
from tests.synthetic import ROSUB, clock, gauss_markov, run, trial
from tests.tables import table

SMALL = Model(inertia=0.6, quadratic_drag=1.5, linear_drag=1.0)


def sine(
    amplitude: float,
    period: float,
    cycles: int,
    model: Model = ROSUB,
    *,
    rate: float = 20.0,
    cutoff: float = 1.0,
    square: bool = False,
    rng: np.random.Generator | None = None,
    disturbance: float = 0.0,
) -> Run:
    time = clock(period * cycles + 10.0, rate)
    wave = np.sin(2.0 * np.pi * time / period) * (time < period * cycles)
    torque = amplitude * (np.abs(wave) * wave if square else wave)
    if rng is None:
        return run(time, torque, model, cutoff=cutoff)
    coloured = gauss_markov(len(time), 1.0 / rate, disturbance, 4.0, rng)
    noise = rng.normal(0.0, np.radians(0.01), len(time))
    return run(time, torque, model, cutoff=cutoff, disturbance=coloured, noise=noise)


@pytest.mark.parametrize(
    ("model", "amplitude", "period", "rate", "cutoff", "tolerance"),
    [
        # Exact for any drag but for harmonics that the filter hides and, in the first, the start dying away.
        (ROSUB, 200.0, 20.0, 20.0, 1.0, 2e-3),
        (ROSUB, 200.0, 40.0, 20.0, 1.0, 1e-3),
        (ROSUB, 100.0, 80.0, 5.0, 0.5, 1e-3),
        (ROSUB, 200.0, 160.0, 20.0, 0.5, 2e-3),  # inertia is 5 % of the torque there
        (SMALL, 5.0, 4.0, 50.0, 5.0, 1e-3),
        (SMALL, 5.0, 4.0, 20.0, 4.0, 2e-3),
    ],
)
@pytest.mark.parametrize("square", [False, True], ids=["sine", "u|u|"])
def test_orbit_integral_and_harmonic_balance_without_noise(
    model: Model, amplitude: float, period: float, rate: float, cutoff: float, tolerance: float, *, square: bool
) -> None:
    trials = sine_trials([sine(amplitude, period, 6, model, rate=rate, cutoff=cutoff, square=square)])
    assert orbit_integral(trials).value == pytest.approx(model.inertia, rel=tolerance)
    assert harmonic_balance(trials, model).value == pytest.approx(model.inertia, rel=tolerance)


def test_without_the_drag_the_balance_keeps_its_quadrature_part() -> None:
    # EFFECTS 1.2: 5163 for 5057, that is 2 %, at 40 s and a peak of 0.17 rad/s.
    value = harmonic_balance(sine_trials([sine(180.0, 40.0, 6)]), None).value
    assert 1.01 < value / ROSUB.inertia < 1.04


def test_the_cutoff_does_not_change_the_inertia() -> None:
    # Torque and rate lose the same share of each harmonic, but the drag's work on the rest would not be zero.
    values = [
        orbit_integral(sine_trials([sine(5.0, 3.0, 12, SMALL, rate=50.0, cutoff=cutoff)])).value
        for cutoff in (2.5, 5.0, 10.0)
    ]
    assert values == pytest.approx([SMALL.inertia] * 3, rel=2e-3)  # uncorrected: 0.610 at 2.5 Hz


def test_standard_errors_hold_in_repetition() -> None:
    rng = np.random.default_rng(seed := int(np.random.default_rng().integers(10**6)))
    print(f"seed {seed}")
    z = []
    for _ in range(40):
        runs = [sine(200.0, 20.0, 8, rng=rng, disturbance=2.5), sine(150.0, 40.0, 6, rng=rng, disturbance=2.5)]
        trials = sine_trials(runs)
        readings = (orbit_integral(trials), harmonic_balance(trials, ROSUB))
        z += [(reading.value - ROSUB.inertia) / reading.standard_error for reading in readings]
    # 40 days, two nearly equal readings each, 10 degrees of freedom: the spread of z is 1.1 +- 0.13; the Birge
    # ratio inflates the error in a third of the days. Four of its standard errors either way.
    assert 0.55 < np.std(z) < 1.65
    assert abs(np.mean(z)) < 4.0 * 1.1 / np.sqrt(40)


def test_first_cycle_is_dropped_and_each_other_left_out_once() -> None:
    (trial,) = sine_trials([sine(200.0, 20.0, 6)])
    assert isinstance(trial, SineTrial)
    assert trial.cycles == len(trial.without) == 5
    assert trial.start == pytest.approx(20.0, abs=0.1)


@pytest.mark.parametrize(("cycles", "found"), [(2, 0), (3, 1)])
def test_fewer_than_three_periods_are_no_sine_trial(cycles: int, found: int) -> None:
    assert len(sine_trials([sine(200.0, 20.0, cycles)])) == found


def test_the_peak_bias_predicts_the_peak_method() -> None:
    trials = sine_trials([sine(227.56, 40.0, 6)])
    reading = peak_method(trials, ROSUB).value / ROSUB.inertia
    assert reading < 0.6  # EFFECTS 1.2: 25 to 58 % of the truth
    assert peak_bias(trials, ROSUB) == pytest.approx(reading, rel=0.01)


def test_a_delay_makes_the_orbit_integral_inconsistent_with_a_warning() -> None:
    rng = np.random.default_rng(5)
    runs = []
    for period in (20.0, 80.0):
        time = clock(6 * period)
        late = 200.0 * np.sin(2.0 * np.pi * np.maximum(time - 0.5, 0.0) / period)
        noise = rng.normal(0.0, np.radians(0.01), len(time))
        acted = run(time, late, noise=noise)
        told = 200.0 * np.sin(2.0 * np.pi * time / period)
        runs.append(replace(acted, torque=told, filtered_torque=acted.rates.filter_held(acted.trial, told)))
    reading = orbit_integral(sine_trials(runs))
    assert reading.consistent is False
    values = [value for _, value, _ in reading.runs]
    assert values[1] > 1.02 * values[0]  # the drag that comes late shows as inertia, most where inertia is small


def test_drag_error_widens_the_balance_but_not_the_orbit() -> None:
    runs = [sine(200.0, 20.0, 6), sine(200.0, 40.0, 6)]
    errors = []
    for size in (0.0, 300.0):
        drag = Estimate(
            names=("quadratic_drag", "linear_drag"),
            values=np.array([ROSUB.quadratic_drag, ROSUB.linear_drag]),
            covariance=np.diag([size**2, 0.0]),
            method="steady turns",
            samples=9,
        )
        methods = fit_inertia(runs, drag=drag, rigid_body=None).methods
        errors.append([methods[name].standard_error for name in ("orbit_integral", "harmonic_balance")])
    assert errors[0][0] == errors[1][0]
    assert errors[1][1] > errors[0][1]


def test_a_vehicle_that_does_not_move_has_no_inertia() -> None:
    time = clock(130.0, 10.0)
    torque = 200.0 * np.sin(2.0 * np.pi * time / 20.0)
    log = trial(time, torque, np.zeros(len(time)), rate=np.zeros(len(time)))
    rates = compute_rates(log, cutoff=1.0)
    still = Run(trial=log, torque=torque, rates=rates, filtered_torque=rates.filter_held(log, torque))
    with pytest.raises(DataError, match=r"never turns under the sine-shaped torque of log: its yaw rate is zero"):
        fit_inertia([still], drag=None, rigid_body=None)


PAPER_SINES = SAMPLES / "rosub_paper" / "sine_trials.csv"


def test_paper_sines_by_peak_and_by_harmonic_balance() -> None:
    fit = fit_inertia_table(read_table(PAPER_SINES), drag=None, rigid_body=2348.9)
    assert [round(value) for _, value, _ in fit.methods["harmonic_balance"].runs] == [4472, 7479]
    assert fit.methods["peak"].value == pytest.approx(5057.0, abs=0.5)
    assert fit.methods["harmonic_balance"].consistent is False
    assert any("No single inertia fits" in text for text in fit.estimate.warnings)
    assert fit.added_inertia == pytest.approx(fit.estimate.value("inertia") - 2348.9)


def test_a_sine_table_without_drag_is_refused_with_advice(tmp_path: Path) -> None:
    rows = table("period_s,torque_amplitude_Nm,peak_yaw_rate_rad_s\n40,100,0.12\n", tmp_path)
    with pytest.raises(DataError, match="fit-drag"):
        fit_inertia_table(rows, drag=None, rigid_body=None)


def test_drag_above_torque_is_refused(tmp_path: Path) -> None:
    text = "period_s,torque_amplitude_Nm,peak_yaw_rate_rad_s,quadratic_drag,linear_drag\n40,10,0.2,3532,132\n"
    with pytest.raises(DataError, match=r"table\.csv:2: the drag"):
        fit_inertia_table(table(text, tmp_path), drag=None, rigid_body=None)
