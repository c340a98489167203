"""Maximum likelihood: the truth of an independent simulator, and sanity where the model is wrong."""

from __future__ import annotations

import math
import secrets
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

from rovid.campaign.vehicle import ThrustCurve, Thruster, Vehicle
from rovid.effects import MOTION, effect_named
from rovid.ground.arrays import FloatArray
from rovid.identify.certainty import covariance
from rovid.identify.estimate import Estimate
from rovid.identify.free_run import fit_free_run
from rovid.identify.innovations import Likelihood
from rovid.identify.likelihood import LIMITS, fit_likelihood
from rovid.identify.records import Records
from rovid.identify.whiteness import innovations_are_white
from rovid.model.kernels import effects_along, innovations, innovations_wide, simulate
from rovid.model.model import Model
from rovid.motion.rates import rates_of
from rovid.motion.runs import Run
from rovid.study import open_study
from tests.conftest import SAMPLES, Rovid
from tests.synthetic import clock, gauss_markov, trial
from tools.programme import CAMPAIGN
from tools.trial_day import write_trial_day
from tools.truth import ROSUB

# A quarter of the day is enough for effects of this size, and quick.
SHORT = [run for run in CAMPAIGN if run.name in {"hold_03", "hold_05", "sine_20s", "steps", "multilevel"}]
# Standard errors. Each run draws new days: of the thirty numbers here one lies beyond 3.5 by chance in 70 runs, beyond
# this in 5000. That the errors mean what they say is measured by benchmarks/uncertainty.py.
FARTHEST = 4.5
NO_EFFECTS = Model(inertia=1.0, quadratic_drag=1.0, linear_drag=1.0).terms()
TRUTH = {
    "inertia": ROSUB.dynamics.inertia,
    "quadratic_drag": ROSUB.dynamics.quadratic_drag,
    "linear_drag": ROSUB.dynamics.linear_drag,
}


@pytest.mark.parametrize("day", [pytest.param("fixed", marks=pytest.mark.slow), "fresh"])
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


@pytest.mark.parametrize("name", ["coloured", "spiky"])
def test_what_is_not_white_is_seen(name: str) -> None:
    rng = np.random.default_rng()
    white = rng.normal(size=20_000)
    series = {
        "coloured": white[1:] + 0.1 * white[:-1],
        "spiky": np.where(rng.random(20_000) < 0.005, 20.0, 1.0) * white,
    }[name]
    assert not innovations_are_white([series])


def test_white_is_seldom_called_coloured() -> None:
    rng = np.random.default_rng()
    trials = rng.normal(size=(200, 25, 200))
    # One in a thousand expected: more than three of 200 happens once in 15 000 runs.
    assert sum(not innovations_are_white(list(series)) for series in trials) <= 3


def random_run(count: int) -> tuple[FloatArray, FloatArray]:
    """Irregular instants and a torque held between them."""
    rng = np.random.default_rng()
    return np.cumsum(rng.uniform(0.01, 0.4, count)), rng.normal(0.0, 100.0, count)


def test_without_disturbance_innovations_are_the_output_error() -> None:
    time, torque = random_run(400)
    rate, angle = simulate(time, torque, 5057.0, 3532.0, 132.0, 0.02)
    measured = angle + np.random.default_rng().normal(0.0, 1e-3, len(time))
    measured[0] = 0.0
    missing, nothing = np.full(len(time), np.nan), np.zeros(len(time))
    error, variance = innovations(
        time,
        torque,
        np.zeros((len(time), 3)),
        nothing,
        nothing,
        measured,
        missing,
        np.array([5057.0, 3532.0, 132.0, *np.zeros(8)]),
        *NO_EFFECTS,
        np.array([1e-6, 4.0, 1e-3, 1.0]),
        np.array([0.02, 1e-9]),
    )
    # What the filter learns from the first heading alone, a few parts in a hundred of the noise, is left.
    assert np.max(np.abs(error[1:, 0] - (measured - angle)[1:])) < 1.1e-3
    assert variance[-1, 0] == pytest.approx(1e-6, rel=0.05)
    assert np.isfinite(rate).all()


def test_filter_variance_against_a_fine_grid() -> None:
    # The same filter fed every instant and every hundredth part of it, where nothing is measured.
    time, torque = random_run(200)
    fine = np.unique(np.concatenate([np.linspace(a, b, 100, endpoint=False) for a, b in pairwise(time)] + [time[-1:]]))
    at = np.searchsorted(fine, time)
    held = torque[np.clip(np.searchsorted(time, fine, side="right") - 1, 0, len(time) - 1)]
    _, angle = simulate(time, torque, 2.5, 1.5, 5.0, 0.0)
    model = (np.array([2.5, 1.5, 5.0, *np.zeros(8)]), *NO_EFFECTS)
    noise, start = np.array([5.0, 1.0, 1e-3, 1.0]), np.array([0.0, 0.1])
    none, never = np.zeros(len(time)), np.zeros(len(fine))
    sparse = np.full(len(fine), np.nan)
    sparse[at] = angle
    coarse, coarse_variance = innovations(
        time, torque, np.zeros((len(time), 3)), none, none, angle, np.full(len(time), np.nan), *model, noise, start
    )
    exact, exact_variance = innovations(
        fine, held, np.zeros((len(fine), 3)), never, never, sparse, np.full(len(fine), np.nan), *model, noise, start
    )
    # Sub-steps of a twentieth of the shortest time constant leave the second-order transition a few percent off.
    assert coarse_variance[1:, 0] == pytest.approx(exact_variance[at, 0][1:], rel=0.05)
    assert coarse[1:, 0] == pytest.approx(exact[at, 0][1:], abs=0.05 * float(np.sqrt(exact_variance[at, 0].max())))


def test_an_open_impulse_widens_what_the_filter_expects() -> None:
    time = np.arange(0.0, 4.0, 0.5)
    none, scatter = np.zeros(len(time)), np.where(time == 2.0, 3.0**2, 0.0)
    angle = np.where(time == 0.0, 0.0, np.nan)
    angle[time == 2.5] = 0.0
    model = (np.array([2.0, *np.zeros(10)]), *NO_EFFECTS)
    noise, start = np.array([1e-6, 4.0, 1e-3, 1.0]), np.array([0.0, 1e-6])
    _, variance = innovations(
        time, none, np.zeros((len(time), 3)), none, scatter, angle, none + np.nan, *model, noise, start
    )
    # A kick at any instant of the half second, (3 / 2) rad/s in all, has a third of the angle's square.
    assert variance[time == 2.5, 0] == pytest.approx((3.0 / 2.0 * 0.5) ** 2 / 3.0, rel=1e-3)


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


@pytest.mark.parametrize("effect", HIDDEN)
def test_an_effect_hidden_in_the_files_is_measured(effect: str, tmp_path: Path, rovid: Rovid) -> None:
    hide, expected = HIDDEN[effect]
    seed = secrets.randbelow(10**6)
    print(f"seed {seed}")
    write_trial_day(tmp_path / "day", seed=seed, formats="csv", campaign=SHORT)
    hide(tmp_path / "day")
    base = rovid("fit", "day", "--json", "-p", "base.toml").document
    fit = rovid("fit", "day", "--effect", effect, "--json").document
    assert fit["effects"] == [effect]
    assert fit["log_likelihood"] > base["log_likelihood"] + 100
    truth = TRUTH | {f"{effect}.{name}": value for name, value in expected.items()}
    for name, value in truth.items():
        found = fit["parameters"][name]
        assert abs(found["value"] - value) < FARTHEST * found["standard_error"], name
    # Without the effect the inertia is off by more than its error says: that is why it matters.
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


def test_thrust_of_another_size_in_one_trial_is_measured_and_named(tmp_path: Path, rovid: Rovid) -> None:
    seed = secrets.randbelow(10**6)
    print(f"seed {seed}")
    write_trial_day(tmp_path / "day", seed=seed, formats="csv", campaign=SHORT)
    weaken(tmp_path / "day" / "multilevel.csv", 0.9)
    said = rovid("diagnose", "day", "--json").document
    (found,) = said["findings"]
    assert (found["effect"], found["form"]) == ("supply_sag", "trial multilevel.csv")
    gain = found["parameters"]["gain"]
    assert abs(gain["value"] - 0.9) < FARTHEST * gain["standard_error"]
    inertia = said["extended"]["parameters"]["inertia"]
    assert abs(inertia["value"] - TRUTH["inertia"]) < FARTHEST * inertia["standard_error"]
    assert rovid("simulate", "--json").document["overall"]["yaw_rate_r2"] > 0.999
    refused = rovid("fit", "day", "--effect", "supply_sag:trial multilevl.csv")
    assert refused.code == 2
    assert "names none of these trials" in refused.err
    assert "supply_sag:trial multilevel.csv" in refused.err


@pytest.mark.parametrize("holds_at", [60.0, 240.0])
def test_a_bent_curve_leaves_the_scale_of_all_thrust_open(holds_at: float, tmp_path: Path, rovid: Rovid) -> None:
    """Wherever in the range in use the bench's thrust in N is right, the truth is within what is stated."""
    seed = secrets.randbelow(10**6)
    print(f"seed {seed}")
    write_trial_day(tmp_path / "day", seed=seed, formats="csv", campaign=SHORT)

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


def test_how_open_the_scale_is() -> None:
    """Of a curve that bends by a power e, |e - 1| times the logarithm of the thrust over that of no change."""
    one = Thruster(
        name="one", arm=0.5, curve=ThrustCurve(command=np.array([-10.0, 10.0]), thrust=np.array([-1e3, 1e3]))
    )
    idle = replace(one, name="idle", arm=0.0)
    vehicle = Vehicle(name="", thrusters=(one, idle))
    time = np.array([0.0, 3.0, 4.0])  # 3 s of 200 N and 1 s of 600 N, and a tenth of the largest is 100 N
    commands = np.array([[2.0, 9.0], [-6.0, 9.0], [0.0, 9.0]])
    run = replace(trial(time, np.zeros(3)), commands=commands)
    bare = Model(inertia=1.0, quadratic_drag=1.0, linear_drag=1.0)
    model = replace(bare, effects=(effect_named("thrust_curve_shape"),), effect_values=(0.7,))
    squares = 0.3**2 * np.log([2.0, 6.0]) ** 2
    expected = math.sqrt(squares @ [200.0 * 3.0, 600.0 * 1.0] / 1200.0)
    assert model.scale_doubt(vehicle, [run]) == pytest.approx(expected)
    assert bare.scale_doubt(vehicle, [run]) == 0.0
    lagging = replace(bare, effects=(effect_named("thruster_lag"),), effect_values=(0.7,))
    assert lagging.scale_doubt(vehicle, [run]) == 0.0


def test_an_open_scale_is_of_forces_alone_and_has_no_sign() -> None:
    names = ("inertia", "quadratic_drag", "thrust_curve_shape.exponent", "bias_torque.torque")
    sure = Estimate(
        names=names,
        values=np.array([5000.0, 3500.0, 0.8, -10.0]),
        covariance=np.diag([30.0, 40.0, 0.01, 4.0]) ** 2,
        method="",
        samples=1,
    )
    assert sure.with_scale_doubt(1e-5) is sure
    openly = sure.with_scale_doubt(0.6)
    assert len(openly.warnings) == 1
    assert [openly.standard_error(name) for name in names] == pytest.approx(
        [math.hypot(30.0, 3000.0), math.hypot(40.0, 2100.0), 0.01, math.hypot(4.0, 6.0)]
    )
    low, high = openly.interval("inertia")
    assert low == pytest.approx(5000.0 * math.exp(-1.96 * 0.6), rel=1e-3)
    assert high == pytest.approx(5000.0 * math.exp(1.96 * 0.6), rel=1e-3)
    assert openly.interval("thrust_curve_shape.exponent") == sure.interval("thrust_curve_shape.exponent")
    assert [openly.differs_from_zero(name) == sure.differs_from_zero(name) for name in names] == [True] * 4
    assert np.array_equal(openly.covariance, sure.covariance)


@pytest.mark.parametrize(("jump", "every"), [(0.05, 5000), (3.0, 100)])
def test_jumps_of_innovations_make_no_certainty(jump: float, every: int, tmp_path: Path) -> None:
    write_trial_day(tmp_path / "day", seed=secrets.randbelow(10**6), formats="csv", campaign=SHORT)
    runs = open_study([tmp_path / "day"]).runs
    assert runs is not None
    likelihood = Likelihood(Records(runs.items, None, fit_free_run(runs.items)), LIMITS[0])
    top, _ = likelihood.climb(likelihood.first())

    class Jumping(Likelihood):
        """Innovations move by a part of their error where the inertia is above the best."""

        def innovations(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
            error, variance = super().innovations(x)
            return error + jump * (x[0] > top[0]) * np.sqrt(variance) * (np.arange(len(error)) % every == 0), variance

    smooth, jumping = (
        np.sqrt(np.diag(covariance(kind(likelihood.records, LIMITS[0]), top, sandwich=False)))
        for kind in (Likelihood, Jumping)
    )
    assert jumping == pytest.approx(smooth, rel=0.02)


def test_the_disturbance_is_let_go_once_the_cause_is_in(tmp_path: Path, rovid: Rovid) -> None:
    write_trial_day(tmp_path / "day", seed=secrets.randbelow(10**6), formats="csv", campaign=SHORT)
    advanced_commands(tmp_path / "day", 32)
    plain, delayed = (
        rovid("fit", "day", "--json", *option).document["disturbance"] for option in ([], ["--effect", "command_delay"])
    )
    # Else it would take the delay's part, and the simulation would be the worse for it.
    assert plain["at_limit"]
    assert plain["limit_share_of_torque"] < delayed["limit_share_of_torque"] == max(LIMITS)
    assert not delayed["at_limit"]


def test_a_model_that_misses_much_is_fitted_to_the_end(tmp_path: Path) -> None:
    write_trial_day(tmp_path / "day", seed=secrets.randbelow(10**6), formats="csv", campaign=SHORT)
    advanced_commands(tmp_path / "day", 32)
    runs = open_study([tmp_path / "day"]).runs
    assert runs is not None
    likelihood = Likelihood(Records(runs.items, None, fit_free_run(runs.items)), LIMITS[-2])
    _, soon = likelihood.climb(likelihood.first(), iterations=25)
    _, late = likelihood.climb(likelihood.first(), iterations=300, tolerance=1e-6)
    # By scoring alone it would still be thousands away.
    assert soon - late < 1.0


def test_an_effect_that_is_not_there_is_told_from_nothing(tmp_path: Path, rovid: Rovid) -> None:
    deviations = []
    for day in ("one", "two", "three", "four"):
        seed = secrets.randbelow(10**6)
        print(f"seed {seed}")
        write_trial_day(tmp_path / day, seed=seed, formats="csv", campaign=SHORT)
        fit = rovid("fit", day, "--effect", "bias_torque", "-p", f"{day}.toml", "--json").document
        found = fit["parameters"]["bias_torque.torque"]
        assert found["standard_error"] < 1.0  # N m, of 126 in use
        deviations.append(found["value"] / found["standard_error"])
    # All days together: of many seeds one day in some hundreds lies beyond 3.5 errors by chance alone.
    assert sum(z**2 for z in deviations) < chi2.isf(1e-5, len(deviations))


def test_an_unknown_effect_is_offered_its_neighbours(csv_day: Path, rovid: Rovid) -> None:
    done = rovid("fit", csv_day, "--effect", "thruster_leg")
    assert done.code == 2
    assert "'thruster_lag'" in done.err


@pytest.mark.parametrize("bias", [0.0, 0.004])
def test_a_gyro_narrows_what_a_poor_compass_leaves_open(bias: float) -> None:
    """A heading of 2 deg alone, and with a gyro of 0.002 rad/s that may be off by a constant."""
    rng = np.random.default_rng()
    time = clock(240.0, 10.0)
    runs = []
    for period, push in ((15.0, 150.0), (30.0, 200.0), (60.0, 120.0)):
        torque = push * np.sign(np.sin(2.0 * np.pi * time / period))
        wind = gauss_markov(len(time), 0.1, 3.0, 4.0, rng)
        rate, angle = simulate(time, torque + wind, 5057.0, 3532.0, 132.0, 0.0)
        gyro = rate + bias + rng.normal(0.0, 0.002, len(time))
        log = trial(time, torque, angle + rng.normal(0.0, np.deg2rad(2.0), len(time)), rate=gyro)
        rates = rates_of(log, cutoff=0.5)
        runs.append(Run(trial=log, torque=torque, rates=rates, drive=rates.held(log, torque)))
    alone, both = (fit_likelihood(runs, gyro=use).estimate for use in (False, True))
    for name, truth in TRUTH.items():
        # Four standard errors: three numbers, passed by chance once in 5000 runs.
        assert abs(both.value(name) - truth) < 4.0 * both.standard_error(name), name
    assert both.standard_error("inertia") < 0.9 * alone.standard_error("inertia")


def test_a_gyro_that_is_not_logged_is_asked_for(rovid: Rovid) -> None:
    done = rovid("fit", SAMPLES / "rosub_tank", "--gyro")
    assert done.code == 2
    assert "Map yaw_rate" in done.err


@pytest.mark.parametrize("gain", [0.1, 0.3])
@pytest.mark.parametrize("frequency", [1.3, 2.5, 4.0])
@pytest.mark.parametrize("blind", [False, True])
def test_the_filter_knows_how_well_it_knows_a_tank(frequency: float, gain: float, blind: bool) -> None:
    inertia, drag, damping, white, sigma, tau = 500.0, 60.0, 0.03, 5e-4, 3.0, 4.0
    rng = np.random.default_rng(seed := secrets.randbelow(10**6))
    print(f"seed {seed}")
    time = np.arange(0.0, 120.0, 0.2)
    torque = 60.0 * np.sign(np.sin(2.0 * np.pi * time / 23.0))
    # Angle, rate, disturbance, q integrated, q.
    a, noise = np.zeros((5, 5)), np.zeros((5, 5))
    swing, leak = frequency**2, 2.0 * damping * frequency
    a[0, 1], a[2, 2], a[3, 4], a[4] = 1.0, -1.0 / tau, 1.0, (0.0, 1.0, 0.0, -swing, -leak)
    a[1] = np.array([0.0, -drag / inertia, 1.0 / inertia, 0.0, 0.0]) - gain * frequency * a[4]
    noise[2, 2] = 2.0 * sigma**2 / tau
    both = expm(np.block([[-a, noise], [np.zeros((5, 5)), a.T]]) * 0.2)
    step = both[5:, 5:].T
    grown, push = step @ both[:5, 5:], np.array([[0.0], [1.0 / inertia], [0.0], [0.0], [0.0]])
    pushed = expm(np.block([[a, push], [np.zeros((1, 6))]]) * 0.2)[:5, 5]
    truth = np.zeros(5)
    angle = np.zeros(len(time))
    for k in range(1, len(time)):
        truth = step @ truth + pushed * torque[k - 1] + rng.multivariate_normal(np.zeros(5), grown, method="svd")
        angle[k] = truth[0] + rng.normal(0.0, white)
    if blind:
        angle[200:300] = np.nan
    state, p = np.zeros(5), np.diag([white**2, 1e-8, sigma**2, 0.0, 0.0])
    wanted = np.full((len(time), 2), np.nan)
    for k, reading in enumerate(angle):
        if k > 0:
            state, p = step @ state + pushed * torque[k - 1], step @ p @ step.T + grown
        if np.isfinite(reading):
            wanted[k] = reading - state[0], p[0, 0] + white**2
            use = p[:, 0] / wanted[k, 1]
            state, p = state + use * wanted[k, 0], p - np.outer(use, p[0])

    effect = effect_named("tank_seiche")
    terms, kinds = np.array([[gain, frequency, damping, 0.0]]), np.array([MOTION.index(effect)])
    base, nothing = np.array([inertia, 0.0, drag, 0.0, frequency, *np.zeros(6)]), np.zeros(len(time))
    series = (time, torque, np.zeros((len(time), 3)), nothing, nothing, angle, np.full(len(time), np.nan))
    numbers = np.array([sigma, tau, white, 1.0])
    error, variance = innovations_wide(*series, base, terms, kinds, numbers, np.zeros(0), np.array([0.0, 1e-4]))
    known = np.isfinite(wanted[:, 0])
    assert variance[known, 0] == pytest.approx(wanted[known, 1], rel=0.005)
    assert (error[known, 0] - wanted[known, 0]) / np.sqrt(wanted[known, 1]) == pytest.approx(0.0, abs=0.02)


def test_a_tank_rings_out_along_a_course() -> None:
    frequency, damping, period = 5.0, 0.01, 0.1
    time = np.arange(0.0, 100.0, period)
    rate = np.where(time < 5.0, 0.2 * np.sin(0.2 * np.pi * time), 0.0)
    course, beside = np.column_stack([rate, nothing := np.zeros(len(time)), nothing]), np.zeros((len(time), 3))
    terms, kinds = np.array([[0.2, frequency, damping, 0.0]]), np.array([MOTION.index(effect_named("tank_seiche"))])
    base = np.array([500.0, 0.0, 60.0, 0.0, frequency, *np.zeros(6)])
    torque, _ = effects_along(period, course, beside, base, terms, kinds)
    first, last = (np.abs(torque[(time > at) & (time < at + 10.0)]).max() for at in (6.0, 86.0))
    assert last / first == pytest.approx(math.exp(-damping * frequency * 80.0), rel=0.3)
