"""Inertia and damping from sine runs and free decays."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from rovid.core.array_types import FloatArray
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
from rovid.trial.axis import AXES
from rovid.trial.preprocessing import Run, prepare
from rovid.trial.rates import compute_rates
from rovid.trial.segments import find_releases, swing_period
from rovid.trial.tables import read_table
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle
from tests.conftest import SAMPLES, Rovid, slow
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


@pytest.mark.slow
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


SHIP = SAMPLES / "kvlcc2_roll_decay"
# Of 1 kg m^2: damping, stiffness, its bend, and where the ship is level.
LINEAR, QUADRATIC, STIFFNESS, BEND, LEVEL = 0.03, 0.25, 4.0, 1.5, 0.02
PERIOD = 2.0 * math.pi / math.sqrt(STIFFNESS)
TOML = """
[signals]
time = { csv = "time_s" }
roll = { csv = "roll_rad", unit = "rad" }
"""
UNITS = {
    "quadratic_drag": "N m s^2/rad^2 per kg m^2",
    "linear_drag": "N m s/rad per kg m^2",
    "restoring_stiffness": "N m/rad per kg m^2",
    "trim": "rad",
}


def swings(start: float, seconds: float, *, bend: float = 0.0) -> FloatArray:
    """Tilt in rad at 20 Hz of a ship that is let go of at ``start`` rad from its level."""

    def slope(_: float, y: FloatArray) -> list[float]:
        restoring = STIFFNESS * (1.0 + bend * y[0] ** 2) * math.sin(y[0])
        return [y[1], -restoring - (QUADRATIC * abs(y[1]) + LINEAR) * y[1]]

    time = np.arange(0.0, seconds, 0.05)
    solved = solve_ivp(slope, (0.0, seconds), [start, 0.0], t_eval=time, rtol=1e-9, atol=1e-12)
    return np.asarray(solved.y[0] + LEVEL)


def pushed(start: float) -> FloatArray:
    """At rest, then over to ``start`` by hand within two seconds."""
    return np.concatenate((np.full(200, LEVEL), LEVEL + start * np.linspace(0.0, 1.0, 40) ** 2))


def log_of(tilt: FloatArray) -> Trial:
    time = 0.05 * np.arange(len(tilt), dtype=np.float64)
    nothing = np.zeros((len(tilt), 0))
    return Trial(name="log", path=Path("log"), time=time, position=tilt, commands=nothing, axis=AXES["roll"])


def write(folder: Path, logs: dict[str, FloatArray], toml: str = TOML) -> None:
    folder.mkdir()
    (folder / "rovid.toml").write_text(toml)
    rng = np.random.default_rng(7)
    for name, tilt in logs.items():
        noisy = np.round(tilt + rng.normal(0.0, 2e-4, len(tilt)), 5)
        pd.DataFrame({"time_s": 0.05 * np.arange(len(tilt)), "roll_rad": noisy}).to_csv(folder / name, index=False)


def within(reading: dict[str, Any], truth: float, share: float) -> bool:
    off = abs(reading["value"] - truth)
    return bool(off < 4.0 * reading["standard_error"] and reading["standard_error"] < share * abs(truth))


def test_a_log_is_used_from_each_release_on() -> None:
    first, second = swings(0.3, 40.0), swings(-0.2, 30.0)
    tilt = np.concatenate((pushed(0.3), first, pushed(-0.2), second))
    begins = [240, 240 + 800 + 240]
    found = find_releases(log_of(tilt))
    assert [abs(part.start - begin) <= 1 for part, begin in zip(found, begins, strict=True)] == [True, True]
    assert found[0].stop <= 240 + 800
    assert tilt[found[1]].size > 300


@pytest.mark.parametrize("seconds", [0.5, 5.0])
def test_a_tilt_held_before_the_release_is_left_out(seconds: float) -> None:
    free = swings(0.3, 40.0)
    count = round(seconds / 0.05)
    tilt = np.concatenate((np.full(count, free[0]), free))
    noise = np.random.default_rng(3).normal(0.0, 1e-3, len(tilt))
    (part,) = find_releases(log_of(tilt + noise))
    assert count - 2 <= part.start < count + 12  # at 90 % of the tilt at the latest
    (alone,) = find_releases(log_of(free))
    assert alone.start == 0


@pytest.mark.parametrize("step", [0.0, 0.02])
def test_readings_at_rest_are_no_release(step: float) -> None:
    """Their noise, or the steps between which they toggle, would swing with a period of their own."""
    noise = np.random.default_rng(7).normal(0.0, 1e-3, 67)
    tilt = 0.2 + (step * np.rint(noise / 2e-3) if step else noise)
    assert find_releases(log_of(tilt)) == []
    assert np.isnan(swing_period(log_of(tilt)))


def test_swings_of_waves_after_a_decay_are_no_release() -> None:
    decay, waves = swings(0.3, 90.0), swings(0.045, 20.0)
    tilt = np.concatenate((decay, np.linspace(decay[-1], waves[0], 40), waves))
    (part,) = find_releases(log_of(tilt))
    assert part.stop <= len(decay)


def test_swings_that_are_held_up_end_a_release() -> None:
    tilt = swings(0.3, 60.0)
    held = np.where(np.arange(len(tilt)) < 600, tilt, LEVEL + 0.2 * (tilt - LEVEL))
    (part,) = find_releases(log_of(held))
    assert 500 < part.stop <= 600
    (whole,) = find_releases(log_of(tilt))
    assert whole.stop > 1000


def test_an_undamped_motion_is_no_release() -> None:
    time = np.arange(0.0, 60.0, 0.05)
    beats = 0.2 * np.sin(2.0 * time) * np.sin(0.9 * time)
    assert find_releases(log_of(beats)) == []
    with pytest.raises(DataError, match="they hold no decaying swings"):
        prepare(Campaign(trials=(log_of(beats),), sources=()), Vehicle(name="ship", thrusters=(), axis=AXES["roll"]))


def test_a_decay_about_another_angle_is_moved_to_that_of_the_others() -> None:
    """By ballast, or because the sensor was set to zero in between."""
    tilts = [swings(0.3, 40.0), swings(-0.2, 40.0), swings(0.25, 40.0) + 0.1]
    logs = tuple(replace(log_of(tilt), name=name) for tilt, name in zip(tilts, "abc", strict=True))
    runs = prepare(Campaign(trials=logs, sources=()), Vehicle(name="ship", thrusters=(), axis=AXES["roll"]))
    released = [run.trial.position[0] - LEVEL for run in runs.items]
    assert released == pytest.approx([0.3, -0.2, 0.25], abs=2e-3)
    (remark,) = (one.text for one in runs.remarks if one.kind == "level")
    assert remark.startswith("c swings about")


def test_a_tilt_in_degrees_is_not_read_as_radians(tmp_path: Path, rovid: Rovid) -> None:
    write(tmp_path / "day", {"one.csv": swings(-0.25, 60.0), "two.csv": np.degrees(swings(0.2, 60.0))})
    document = rovid("check", tmp_path / "day", "--axis", "roll", "--json").document
    (fault,) = document["faults"]
    assert (document["verdict"], fault["fault"], fault["logs"]) == ("no_go", "scaled_heading", ["two.csv"])


def test_period_damping_and_ratios_come_back(tmp_path: Path, rovid: Rovid) -> None:
    both = np.concatenate((pushed(0.3), swings(0.3, 60.0), pushed(-0.15), swings(-0.15, 40.0)))
    write(tmp_path / "day", {"both.csv": both, "one.csv": swings(-0.25, 60.0)})
    fit = rovid("fit", "day", "--axis", "roll", "--json").document
    assert {name: entry["unit"] for name, entry in fit["parameters"].items()} == UNITS
    assert "inertia" in fit["not_identifiable"]
    (used,) = (text for text in fit["warnings"] if text.startswith("Only the free swings"))
    assert used.count("both.csv, ") == 2
    (fault,) = fit["faults"]
    assert (fault["fault"], fault["size"], fault["remedy"]) == ("several_releases", 2.0, "cut")
    assert fault["at"] == pytest.approx([12.0, 84.0], abs=0.2)
    assert "one.csv (" in used
    decay = fit["decay"]
    for name, truth in (("restoring_stiffness", STIFFNESS), ("linear_drag", LINEAR), ("quadratic_drag", QUADRATIC)):
        assert within(decay["over_inertia"][name], truth, 0.1), name
        assert decay["over_inertia"][name]["value"] == fit["parameters"][name]["value"]
    assert decay["natural_period"]["value"] == pytest.approx(
        PERIOD * (1.0 + decay["amplitude"]["value"] ** 2 / 16), 2e-3
    )
    assert within(decay["damping_terms"]["linear"], LINEAR / (2.0 * math.sqrt(STIFFNESS)), 0.1)
    # Energy: 8/(3 pi) of frequency and amplitude is the linear drag of the quadratic one, in the middle of the swing.
    largest = decay["swings"][0]
    assert [swing["name"].partition(",")[0] for swing in decay["swings"]] == ["both.csv", "both.csv", "one.csv"]
    usual = LINEAR / 4.0 + 4.0 / (3.0 * math.pi) * QUADRATIC * largest["amplitude"]
    assert 0.7 * usual < largest["damping_ratio"]["value"] < usual
    simulated = rovid("simulate", "--axis", "roll", "--json").document
    assert simulated["overall"]["roll_rate_r2"] > 0.999
    assert "inertia" not in simulated["parameters"]


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("fit-inertia", "so the inertia cannot be determined. Run `rovid fit`"),
        ("fit-drag", "so the inertia cannot be determined. Run `rovid fit`"),
        ("plan", "there are no commands to plan"),
    ],
)
def test_undetermined_quantities_are_refused(command: str, said: str, rovid: Rovid) -> None:
    done = rovid(command, SHIP, "--axis", "roll", "-p", "p.toml")
    assert done.code == 2
    assert said in done.err


def test_a_vehicle_without_restoring_torque_needs_actuators(tmp_path: Path, rovid: Rovid) -> None:
    write(tmp_path / "day", {"one.csv": swings(0.2, 30.0)}, TOML.replace("roll =", "heading ="))
    done = rovid("fit", "day", "--json")
    assert done.code == 2
    assert "there are none, and no torque is mapped" in done.err


def test_the_real_ship_has_its_natural_period(rovid: Rovid) -> None:
    fit = rovid("fit", SHIP, "--axis", "roll", "-p", "p.toml", "--json").document
    assert fit["decay"]["natural_period"]["value"] == pytest.approx(2.54, rel=0.005)
    assert [swing["name"] for swing in fit["decay"]["swings"]] == [f"decay_{n}.csv" for n in (21337, 21338, 21340)]


@pytest.mark.slow
def test_the_real_ship_is_damped_by_its_speed_and_bends(rovid: Rovid) -> None:
    effects = ("--effect", "speed_dependent_damping", "--effect", "restoring_curve")
    fit = rovid("fit", SHIP, "--axis", "roll", *effects, "-p", "p.toml", "--json").document
    assert fit["decay"]["natural_period"]["value"] == pytest.approx(2.54, rel=0.005)
    damping, bend = (fit["parameters"][n] for n in ("speed_dependent_damping.linear", "restoring_curve.cubic"))
    assert damping["value"] > 10.0 * damping["standard_error"]
    assert bend["value"] > 5.0 * bend["standard_error"]
    still, _, sailing = (swing["damping_ratio"]["value"] for swing in fit["decay"]["swings"])
    assert sailing > 1.7 * still
    assert fit["free_run_r2"]["this_fit"] > 0.99


@pytest.mark.parametrize("damage", ["walk", slow("shuffled"), "moves"])
@pytest.mark.parametrize("command", ["fit", slow("fit-inertia"), slow("diagnose")])
def test_motion_that_is_no_swing_is_refused(command: str, damage: str, tmp_path: Path, rovid: Rovid) -> None:
    rng = np.random.default_rng(5)
    shutil.copytree(SHIP, tmp_path / "day")
    for path in sorted((tmp_path / "day").glob("decay*.csv")):
        log = pd.read_csv(path)
        roll = log["roll_rad"].to_numpy()
        if damage == "walk":
            log["roll_rad"] = 1e-3 * np.cumsum(rng.normal(size=len(roll)))
        elif damage == "shuffled":
            log["roll_rad"] = in_another_order(roll, rng)
        else:
            log["roll_rad"] = np.cumsum(in_another_order(np.diff(roll, prepend=roll[0]), rng))
        log.to_csv(path, index=False)
    done = rovid(command, "day", "--axis", "roll", "-p", "p.toml", *(["--json"] if command == "diagnose" else []))
    if command == "diagnose":
        assert done.document["verdict"] == "too_little_data"
        assert "these logs are no free decay" in done.document["missing"]
        return
    assert done.code == 2
    assert ("these logs are no free decay" if command == "fit" else "inertia cannot be determined") in done.err


def in_another_order(values: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Blocks of about 15 ``values`` in random order."""
    parts = np.array_split(values, len(values) // 15)
    return np.concatenate([parts[at] for at in rng.permutation(len(parts))])
