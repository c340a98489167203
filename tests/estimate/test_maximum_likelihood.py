"""Maximum likelihood of all parameters, and errors that include an incomplete model."""

from __future__ import annotations

import math
import secrets
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from rovid.core.array_types import FloatArray
from rovid.effects import effect_named
from rovid.effects.base import Body
from rovid.estimate.estimate import Estimate
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.maximum_likelihood import DISTURBANCE_LIMITS, fit_likelihood, misspecification_covariance
from rovid.estimate.output_error import fit_output_error
from rovid.model.kernels import simulate
from rovid.store.study import open_study
from rovid.trial.preprocessing import Run, prepare
from rovid.trial.rates import compute_rates
from rovid.trial.trial import Campaign
from tests import synthetic
from tests.conftest import SAMPLES, Rovid, slow
from tests.predictions import NOISE, TIME, TORQUE, fitted_ahead
from tests.synthetic import clock, gauss_markov, trial
from tools.hidden import Hidden
from tools.programme import CAMPAIGN
from tools.trial_day import write_trial_day
from tools.truth import ROSUB

# A quarter of the day is enough for effects of this size, and quick.
SHORT = [run for run in CAMPAIGN if run.name in {"hold_03", "hold_05", "sine_20s", "steps", "multilevel"}]
# Standard errors. Each run draws new days: of the thirty numbers here one lies beyond 3.5 by chance in 70 runs, beyond
# this in 5000. That the errors mean what they say is measured by benchmarks/uncertainty.py.
FARTHEST = 4.5
TRUTH = {
    "inertia": ROSUB.dynamics.inertia,
    "quadratic_drag": ROSUB.dynamics.quadratic_drag,
    "linear_drag": ROSUB.dynamics.linear_drag,
}


def write_short_day(folder: Path) -> int:
    """Write a new day of ``SHORT`` and return its seed."""
    seed = secrets.randbelow(10**6)
    print(f"seed {seed}")
    write_trial_day(folder, seed=seed, formats="csv", campaign=SHORT)
    return seed


@pytest.mark.parametrize("day", ["fixed", "fresh"])
@pytest.mark.slow
def test_everything_about_the_day_comes_back(day: str, tmp_path: Path, rovid: Rovid) -> None:
    seed = 3 if day == "fixed" else secrets.randbelow(10**6)
    print(f"seed {seed}")
    write_trial_day(tmp_path / "day", seed=seed)
    fit = rovid("fit", "day", "--json").document
    for name, truth in TRUTH.items():
        found = fit["parameters"][name]
        assert abs(found["value"] - truth) < FARTHEST * found["standard_error"], name
        assert found["standard_error"] < 0.04 * truth
    assert fit["innovations_white"] is True
    # 3300 s of a torque with a memory of 4 s: some 400 independent values, 7 % after the heading's noise.
    assert fit["disturbance"]["value"] == pytest.approx(ROSUB.disturbance.standard_deviation, rel=0.25)
    assert fit["disturbance"]["correlation_time"]["value"] == pytest.approx(4.0, rel=0.5)
    assert fit["heading_noise_fitted"]["value"] == pytest.approx(np.deg2rad(0.01), rel=0.05)
    assert fit["log_likelihood"] > 0
    assert rovid("simulate", "--json").document["overall"]["yaw_rate_r2"] > 0.995


def test_a_dive_under_autopilot_stays_physical_and_simulates(rovid: Rovid) -> None:
    fit = rovid("fit", SAMPLES / "bluerov2_pier59", "--json").document
    values = {name: found["value"] for name, found in fit["parameters"].items()}
    assert values["inertia"] == pytest.approx(2.5, rel=0.25)
    assert values["quadratic_drag"] >= 0.0
    assert values["linear_drag"] >= 0.0
    assert fit["innovations_white"] is False
    assert fit["free_run_r2"]["this_fit"] >= fit["free_run_r2"]["simulation_fit"] - 0.01
    assert any("not white" in text for text in fit["warnings"])


def test_tables_have_no_likelihood(rovid: Rovid) -> None:
    done = rovid("fit", SAMPLES / "rosub_paper")
    assert done.code == 2
    assert "no time series" in done.err


def advanced_commands(day: Path, samples: int = 6) -> None:
    """Log every command so many samples of 0.05 s before it acts."""
    for path in sorted(day.glob("*.csv")):
        if path.name == "thrust_curve.csv":
            continue
        table = pd.read_csv(path)
        for column in ("fore_V", "aft_V"):
            table[column] = table[column].shift(-samples).ffill()
        table.to_csv(path, index=False)


def curve(change: Callable[[pd.DataFrame], pd.DataFrame]) -> Callable[[Path], None]:
    """Give rovid a thrust curve that is not the vehicle's."""

    def apply(day: Path) -> None:
        path = day / "thrust_curve.csv"
        change(pd.read_csv(path)).to_csv(path, index=False)

    return apply


def stronger_reverse(table: pd.DataFrame) -> pd.DataFrame:
    return table.assign(thrust_N=table.thrust_N.where(table.thrust_N > 0, table.thrust_N / 0.8))


def narrower_dead_zone(table: pd.DataFrame) -> pd.DataFrame:
    beyond = table[table.command.abs() >= 0.1]
    shifted = beyond.assign(command=beyond.command - 0.1 * np.sign(beyond.command))
    return shifted.drop_duplicates("command").sort_values("command")


HIDDEN: dict[str, tuple[Callable[[Path], None], dict[str, float]]] = {
    "command_delay": (advanced_commands, {"delay": 0.3}),
    "thrust_asymmetry": (curve(stronger_reverse), {"reverse_gain": 0.8}),
    "thruster_deadband": (curve(narrower_dead_zone), {"deadband": 0.1}),
}


@pytest.mark.parametrize("effect", ["command_delay", slow("thrust_asymmetry"), slow("thruster_deadband")])
def test_an_effect_hidden_in_the_files_is_measured(effect: str, tmp_path: Path, rovid: Rovid) -> None:
    hide, expected = HIDDEN[effect]
    write_short_day(tmp_path / "day")
    hide(tmp_path / "day")
    base = rovid("fit", "day", "--json", "-p", "base.toml").document
    fit = rovid("fit", "day", "--effect", effect, "--json").document
    assert fit["effects"] == [effect]
    assert fit["log_likelihood"] > base["log_likelihood"] + 100
    truth = TRUTH | {f"{effect}.{name}": value for name, value in expected.items()}
    for name, value in truth.items():
        found = fit["parameters"][name]
        assert abs(found["value"] - value) < FARTHEST * found["standard_error"], name
    # Without the effect the inertia is off by more than its standard error.
    inertia = base["parameters"]["inertia"]
    assert abs(inertia["value"] - TRUTH["inertia"]) > 5.0 * fit["parameters"]["inertia"]["standard_error"]
    simulated = [rovid("simulate", "--json", "-p", p).document for p in ("base.toml", "parameters.toml")]
    errors = [document["overall"]["yaw_rate_rmse"] for document in simulated]
    # The rest is what drives the water: of a dead band 0.55 is left, 0.06 more or less by day.
    assert errors[1] < 0.85 * errors[0]
    assert simulated[1]["effects"] == [effect]


def weaken(path: Path, gain: float) -> None:
    """Log in one trial the commands that would have given the thrust over ``gain``."""
    bench, table = pd.read_csv(path.parent / "thrust_curve.csv"), pd.read_csv(path)
    for column in ("fore_V", "aft_V"):
        thrust = np.interp(table[column], bench.command, bench.thrust_N)
        pushes = thrust != 0.0
        table.loc[pushes, column] = np.interp(thrust[pushes] / gain, bench.thrust_N, bench.command)
    table.to_csv(path, index=False)


@pytest.mark.slow
def test_a_change_of_thrust_in_one_trial_is_measured_and_named(tmp_path: Path, rovid: Rovid) -> None:
    write_short_day(tmp_path / "day")
    weaken(tmp_path / "day" / "multilevel.csv", 0.9)
    said = rovid("diagnose", "day", "--json").document
    # One trial with another thrust may as well be a log of another vehicle: it is named, and the cause is possible.
    (fault,) = said["faults"]
    assert (fault["fault"], fault["logs"]) == ("foreign_log", ["multilevel.csv"])
    assert said["findings"] == []
    (found,) = [one for one in said["suspects"] if one["effect"] == "supply_sag"]
    assert found["form"] == "trial multilevel.csv"
    gain = found["parameters"]["gain"]
    assert abs(gain["value"] - 0.9) < FARTHEST * gain["standard_error"]
    inertia = said["extended"]["parameters"]["inertia"]
    assert abs(inertia["value"] - TRUTH["inertia"]) < FARTHEST * inertia["standard_error"]
    refused = rovid("fit", "day", "--effect", "supply_sag:trial multilevl.csv")
    assert refused.code == 2
    assert "there is no trial 'multilevl.csv'" in refused.err
    assert "'multilevel.csv'" in refused.err


@pytest.mark.slow
def test_changes_of_thrust_in_each_trial_are_measured_and_named(tmp_path: Path, rovid: Rovid) -> None:
    write_short_day(tmp_path / "day")
    # Their mean is one, because no log shows a common factor of all thrust.
    gains = dict(zip(sorted(f"{run.name}.csv" for run in SHORT), (1.1, 0.85, 1.05, 0.9, 1.1), strict=True))
    for name, gain in gains.items():
        weaken(tmp_path / "day" / name, gain)
    said = rovid("diagnose", "day", "--json").document
    (found,) = said["findings"]
    assert found["effect"] == "supply_sag"
    assert found["form"] == "trials " + "|".join(gains)
    for own, gain in zip(found["parameters"].values(), gains.values(), strict=False):
        assert abs(own["value"] - gain) < FARTHEST * own["standard_error"]
    for name, value in TRUTH.items():
        parameter = said["extended"]["parameters"][name]
        assert abs(parameter["value"] - value) < FARTHEST * parameter["standard_error"], name
    assert rovid("simulate", "--json").document["overall"]["yaw_rate_r2"] > 0.999


@pytest.mark.slow
def test_a_different_constant_torque_in_each_trial_is_named(tmp_path: Path, rovid: Rovid) -> None:
    day = tmp_path / "day"
    seed = write_short_day(day)
    torques = dict(zip(sorted(f"{run.name}.csv" for run in SHORT), (60.0, -40.0, 20.0, -80.0, 50.0), strict=True))
    for name, torque in torques.items():
        truth = replace(ROSUB, hidden=(Hidden(effect="bias_torque", form="constant", parameters={"torque": torque}),))
        (run,) = (run for run in SHORT if name == f"{run.name}.csv")
        write_trial_day(tmp_path / name, seed=seed, truth=truth, formats="csv", campaign=[run])
        (tmp_path / name / name).replace(day / name)
    said = rovid("diagnose", "day", "--json").document
    (found,) = said["findings"]
    assert found["effect"] == "bias_torque"
    assert found["form"] == "trials " + "|".join(torques)
    for own, torque in zip(found["parameters"].values(), torques.values(), strict=True):
        assert abs(own["value"] - torque) < FARTHEST * own["standard_error"]
    inertia = said["extended"]["parameters"]["inertia"]
    assert abs(inertia["value"] - TRUTH["inertia"]) < FARTHEST * inertia["standard_error"]


@pytest.mark.parametrize("holds_at", [60.0, slow(240.0)])
def test_a_fitted_thrust_curve_leaves_the_thrust_scale_uncertain(holds_at: float, tmp_path: Path, rovid: Rovid) -> None:
    """Wherever in the range in use the bench's thrust in N is right, the truth is within what is stated."""
    write_short_day(tmp_path / "day")

    def bent(table: pd.DataFrame) -> pd.DataFrame:
        share = table.thrust_N.abs() / holds_at
        return table.assign(thrust_N=np.sign(table.thrust_N) * holds_at * share ** (1.0 / 0.8))

    curve(bent)(tmp_path / "day")
    fit = rovid("fit", "day", "--effect", "thrust_curve_shape", "--json").document
    exponent = fit["parameters"]["thrust_curve_shape.exponent"]
    assert abs(exponent["value"] - 0.8) < FARTHEST * exponent["standard_error"]
    assert exponent["standard_error"] < 0.01
    for name, value in TRUTH.items():
        found = fit["parameters"][name]
        assert abs(found["value"] - value) < 2.5 * found["standard_error"], name
        assert found["standard_error"] < 0.25 * found["value"], name
    assert any("at which thrust" in warning for warning in fit["warnings"])


def test_the_thrust_scale_error_is_a_factor_on_forces_and_their_roots() -> None:
    names = (
        "inertia", "quadratic_drag", "thrust_curve_shape.exponent", "bias_torque.torque",
        "advance_speed_loss.coefficient",  # N^0.5 s/m
    )  # fmt: skip
    sure = Estimate(
        names=names,
        values=np.array([5000.0, 3500.0, 0.8, -10.0, 2.0]),
        covariance=np.diag([30.0, 40.0, 0.01, 4.0, 0.1]) ** 2,
        method="",
        samples=1,
    )
    assert sure.with_thrust_scale_uncertainty(1e-5) is sure
    openly = sure.with_thrust_scale_uncertainty(0.6)
    assert len(openly.warnings) == 1
    assert [openly.standard_error(name) for name in names] == pytest.approx(
        [math.hypot(30.0, 3000.0), math.hypot(40.0, 2100.0), 0.01, math.hypot(4.0, 6.0), math.hypot(0.1, 0.6)]
    )
    low, high = openly.interval("inertia")
    assert low == pytest.approx(5000.0 * math.exp(-1.96 * 0.6), rel=1e-3)
    assert high == pytest.approx(5000.0 * math.exp(1.96 * 0.6), rel=1e-3)
    assert openly.interval("thrust_curve_shape.exponent") == sure.interval("thrust_curve_shape.exponent")
    assert [openly.differs_from_zero(name) == sure.differs_from_zero(name) for name in names] == [True] * 5
    assert np.array_equal(openly.covariance, sure.covariance)


@pytest.mark.slow
def test_the_limit_of_the_disturbance_is_loosened_once_the_effect_is_in(tmp_path: Path, rovid: Rovid) -> None:
    write_short_day(tmp_path / "day")
    advanced_commands(tmp_path / "day", 32)
    plain, delayed = (
        rovid("fit", "day", "--json", *option).document["disturbance"] for option in ([], ["--effect", "command_delay"])
    )
    # Otherwise the disturbance takes up part of the delay, and the simulation is worse.
    assert plain["at_limit"]
    assert plain["limit_share_of_torque"] < delayed["limit_share_of_torque"] == max(DISTURBANCE_LIMITS)
    assert not delayed["at_limit"]


@pytest.mark.slow
def test_an_absent_effect_is_not_significant(tmp_path: Path, rovid: Rovid) -> None:
    deviations = []
    for day in ("one", "two", "three", "four"):
        write_short_day(tmp_path / day)
        fit = rovid("fit", day, "--effect", "bias_torque", "-p", f"{day}.toml", "--json").document
        found = fit["parameters"]["bias_torque.torque"]
        assert found["standard_error"] < 1.0  # N m, of 126 in use
        deviations.append(found["value"] / found["standard_error"])
    # All days together: of many seeds one day in some hundreds lies beyond 3.5 errors by chance alone.
    assert sum(z**2 for z in deviations) < chi2.isf(1e-5, len(deviations))


def test_an_unknown_effect_gets_suggestions(csv_day: Path, rovid: Rovid) -> None:
    done = rovid("fit", csv_day, "--effect", "thruster_leg")
    assert done.code == 2
    assert "'thruster_lag'" in done.err


def gyro_day(bias: float, rng: np.random.Generator) -> list[Run]:
    """Three trials with a heading of 2 deg and a gyro of 0.002 rad/s that may be off by a constant."""
    time = clock(240.0, 10.0)
    runs = []
    for period, push in ((15.0, 150.0), (30.0, 200.0), (60.0, 120.0)):
        torque = push * np.sign(np.sin(2.0 * np.pi * time / period))
        wind = gauss_markov(len(time), 0.1, 3.0, 4.0, rng)
        rate, angle = simulate(time, torque + wind, Body(5057.0, 3532.0, 132.0), 0.0)
        gyro = rate + bias + rng.normal(0.0, 0.002, len(time))
        log = trial(time, torque, angle + rng.normal(0.0, np.deg2rad(2.0), len(time)), rate=gyro)
        rates = compute_rates(log, cutoff=0.5)
        runs.append(Run(trial=log, torque=torque, rates=rates, filtered_torque=rates.filter_held(log, torque)))
    return runs


@pytest.mark.parametrize("bias", [slow(0.0), 0.004])
def test_a_gyro_reduces_the_errors_of_a_poor_compass(bias: float) -> None:
    rng = np.random.default_rng(seed := secrets.randbelow(10**6))
    print(f"seed {seed}")
    days = [gyro_day(bias, rng) for _ in range(8)]
    both = [fit_likelihood(day, gyro=True).estimate for day in days]
    for name, truth in TRUTH.items():
        deviations = [(estimate.value(name) - truth) / estimate.standard_error(name) for estimate in both]
        # All days together: by chance once in a million runs; errors a third of the true ones fail four times of five.
        assert sum(z**2 for z in deviations) < chi2.isf(1e-6, len(days)), name
    alone = fit_likelihood(days[0]).estimate
    assert both[0].standard_error("inertia") < 0.9 * alone.standard_error("inertia")


def test_a_missing_gyro_is_refused(rovid: Rovid) -> None:
    done = rovid("fit", SAMPLES / "rosub_tank", "--gyro")
    assert done.code == 2
    assert "Map yaw_rate" in done.err


@pytest.mark.parametrize(("jump", "every"), [(0.05, 5000), (3.0, 100)])
def test_jumps_of_innovations_do_not_reduce_the_errors(jump: float, every: int, tmp_path: Path) -> None:
    write_short_day(tmp_path / "day")
    runs = open_study([tmp_path / "day"]).runs
    assert runs is not None
    objective = InnovationLikelihood(
        InnovationData(runs.items, None, fit_output_error(runs.items)), DISTURBANCE_LIMITS[0]
    )
    top = fit(objective, objective.parametrization.initial())

    class Jumping(InnovationLikelihood):
        """Innovations move by a part of their error where the inertia is above the best."""

        def innovations(self, x: FloatArray) -> Innovations:
            error, variance = super().innovations(x)
            moves = jump * (x[0] > top.x[0]) * (np.arange(len(error)) % every == 0)
            return Innovations(error + moves * np.sqrt(variance), variance)

    moved = FitResult.at(Jumping(objective.data, DISTURBANCE_LIMITS[0]), top.x)
    smooth, jumping = (np.sqrt(np.diag(one.covariance(sandwich=False))) for one in (top, moved))
    assert jumping == pytest.approx(smooth, rel=0.02)


def test_disagreeing_horizons_widen_the_errors_with_a_warning() -> None:
    """A delayed torque gives short and long predictions different drags."""
    right = fitted_ahead([synthetic.run(TIME[:900], TORQUE[:900], noise=NOISE[:900]) for _ in range(4)])
    doubt, said = misspecification_covariance(right)
    assert not said
    assert np.sqrt(doubt[0, 0]) < 0.002 * synthetic.ROSUB.inertia
    late = 0.5 * np.convolve(TORQUE, np.ones(60) / 60.0)[: len(TORQUE)]
    cuts = [slice(start, start + 2000) for start in (0, 2000, 4000)]
    runs = [synthetic.run(TIME[:2000], TORQUE[cut], noise=NOISE[:2000], disturbance=late[cut]) for cut in cuts]
    wrong = fitted_ahead(runs)
    doubt, said = misspecification_covariance(wrong)
    assert len(said) == 1
    assert "half of the difference" in said[0]
    assert np.diag(doubt)[:3].max() > 0.0


def test_a_sag_that_bursts_reach_in_part_may_exceed_the_thrust() -> None:
    """Full thrust for 2 s of 10 s loses a third at most, by a sag of 1.5 with a time constant of 8 s."""
    sag, time = effect_named("supply_sag"), clock(200.0, rate=5.0)
    pulses = np.where(time % 10.0 < 2.0, np.sign(np.sin(0.13 * time)), 0.0)
    log = trial(time, np.asarray(5.0 * pulses, dtype=np.float64))
    truth = replace(synthetic.ROSUB, effects=(sag,), effect_values=(1.5, 8.0))
    _, position = truth.simulate(log, truth.torque_input(synthetic.VEHICLE, log))
    noisy = replace(log, position=position + np.random.default_rng(3).normal(0.0, 1e-4, len(time)))
    runs = prepare(Campaign(trials=(noisy,), sources=()), synthetic.VEHICLE, cutoff=1.0).items
    found = fit_likelihood(runs, synthetic.VEHICLE, (sag,)).estimate
    error = found.standard_error("supply_sag.sag")
    # 3.5 standard errors, fixed seed.
    assert found.value("supply_sag.sag") == pytest.approx(1.5, abs=3.5 * error)
    assert error < 0.15
