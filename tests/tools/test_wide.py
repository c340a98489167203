"""Wide campaigns: one draw for one seed and index, the equation of motion, and every cause as stated."""

from __future__ import annotations

import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.conftest import slow
from tools.wide import FORMS, Campaign, after_refit, draw, truth_of, write_campaign
from tools.wide.campaign import VISIBLE, Run, deviation, simulated
from tools.wide.motion import Floats, Physics, Pilot, simulate
from tools.wide.truth import whitening

# A simulator of the tests changes rarely, and none of rovid's code is tested here.
pytestmark = pytest.mark.slow

SEED = 7
QUICK = 12  # index of a small campaign
ALL_FORMS = [(effect, form) for effect, forms in FORMS.items() for form in forms]
QUICK_FORMS = {
    ("command_hysteresis", "play"),
    ("thrust_asymmetry", "growing"),
    ("thruster_lag", "torque"),
    ("drag_curvature", "exponent"),
    ("tether_torsion", "stiffening"),
    ("heading_deviation", "two cycles"),
}


def small(effect: str, form: str | None = None, first: int = 0) -> Campaign:
    """The first campaign of few readings."""
    for index in range(first, first + 60):
        campaign = draw(SEED, index, effect, form)
        if sum(run.time.size for run in campaign.runs) < 3000:
            return campaign
    pytest.fail("no small campaign among 60")


def test_the_same_seed_gives_the_same_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_campaign(tmp_path / name, draw(SEED, QUICK))
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert files == sorted(path.name for path in (tmp_path / "b").iterdir())
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    assert truth_of(draw(SEED, QUICK)) == truth_of(draw(SEED, QUICK))
    assert truth_of(draw(SEED, QUICK + 1)) != truth_of(draw(SEED, QUICK))
    assert truth_of(draw(SEED + 1, QUICK)) != truth_of(draw(SEED, QUICK))


def test_draws_cover_the_stated_ranges() -> None:
    drawn = [truth_of(draw(SEED, index)) for index in range(60)]
    for truth in drawn:
        json.dumps(truth, allow_nan=False)
        assert 0.1 <= truth["time_constant"] <= 60.0
        assert truth["samples"] < 60_000
        assert truth["heading_hz"] * truth["time_constant"] >= 7.99
        assert 1.0 <= truth["heading_hz"] <= 100.0
        assert 2 <= len(truth["runs"]) <= 12
    assert len({truth["unit"] for truth in drawn}) == 5
    assert {truth["format"] for truth in drawn} == {"csv", "csv_pair", "mcap"}
    assert {run["start"] for truth in drawn for run in truth["runs"]} == {"rest", "under_way", "step"}
    assert {truth["thrusters"] for truth in drawn} == {1, 2, 3, 4, 5, 6}
    inertias = [truth["inertia"] for truth in drawn]
    assert max(inertias) / min(inertias) > 1e6
    nothing = sum(truth["effect"] is None for truth in drawn)
    assert 5 <= nothing <= 25  # a quarter of 60, within three standard deviations
    assert all(not truth["visible"] for truth in drawn if truth["effect"] is None)


def reference(campaign: Campaign, run: Run, seconds: float) -> tuple[float, float]:
    """Heading and rate at ``seconds`` of the plain vehicle, by an adaptive method from command to command."""
    vehicle = campaign.vehicle
    state = np.array([run.heading, 0.0])
    edges = [*run.sent[run.sent < seconds].tolist(), seconds]
    grid = run.series_begin + run.series_step * np.arange(run.series.shape[0])
    for k, (begin, end) in enumerate(itertools.pairwise(edges)):
        thrusts = [
            np.interp(u, vehicle.commands, table) for u, table in zip(run.commands[k], vehicle.thrusts, strict=True)
        ]
        torque = float(vehicle.arms @ np.array(thrusts))

        def slope(t: float, y: Floats, torque: float = torque) -> list[float]:
            drag = vehicle.quadratic_drag * abs(y[1]) * y[1] + vehicle.linear_drag * y[1]
            return [y[1], (torque + float(np.interp(t, grid, run.series[:, 0])) - drag) / vehicle.inertia]

        longest = 0.5 * run.series_step  # or the method steps over the disturbance
        state = solve_ivp(slope, (begin, end), state, rtol=1e-9, atol=1e-12, max_step=longest).y[:, -1]
    return float(state[0]), float(state[1])


@pytest.mark.parametrize("first", [0, 40])
def test_without_a_cause_runs_follow_the_plain_equation(first: int) -> None:
    campaign = small("none", first=first)
    run = campaign.runs[-1]
    place = min(int(np.searchsorted(run.time, 15.0 * campaign.vehicle.time_constant)), run.time.size - 1)
    heading, rate = reference(campaign, run, float(run.time[place]))
    # The tolerance is that of RK4 at a fiftieth of the time constant, with kinks of the disturbance inside steps.
    assert run.truth[place, 1] == pytest.approx(rate, abs=1e-4 * campaign.vehicle.full_rate)
    assert run.truth[place, 0] == pytest.approx(
        heading, abs=3e-4 * campaign.vehicle.full_rate * campaign.vehicle.time_constant
    )


# One form of each stage, between command and heading; `make test-slow` takes all of them.
@pytest.mark.parametrize(("effect", "form"), [one if one in QUICK_FORMS else slow(*one) for one in ALL_FORMS])
def test_every_form_shows_and_is_integrated_finely(effect: str, form: str) -> None:
    campaign = small(effect, form)
    truth = truth_of(campaign)
    assert (truth["effect"], truth["form"]) == (effect, form)
    assert VISIBLE <= truth["visibility"] < 5.0
    finer = simulated(campaign, replay=False, refine=2.0)
    change = np.concatenate([a.truth[:, 1] - b.truth[:, 1] for a, b in zip(campaign.runs, finer.runs, strict=True)])
    size = np.concatenate([run.truth[:, 1] for run in campaign.runs])
    if all(run.pilot.angle == 0.0 for run in campaign.runs):  # a pilot may see the same heading one command later
        assert np.sqrt(np.mean(change**2)) < 2e-3 * np.sqrt(np.mean(size**2))
    if effect not in {"command_delay", "wave_torque", "heading_deviation"}:
        assert campaign.physics != campaign.plain


def test_a_small_cause_changes_the_rate_in_proportion() -> None:
    campaign = small("thruster_lag", "torque")
    plain = simulated(campaign, campaign.plain, replay=True, refine=4.0)
    changes = []
    for share in (0.04, 0.02):
        physics = campaign.plain._replace(lag=share * campaign.vehicle.time_constant, lag_kind=1.0)
        late = simulated(campaign, physics, replay=True, refine=4.0)
        away = [a.truth[:, 1] - b.truth[:, 1] for a, b in zip(late.runs, plain.runs, strict=True)]
        changes.append(np.sqrt(np.mean(np.concatenate(away) ** 2)))
    assert changes[0] / changes[1] == pytest.approx(2.0, rel=0.05)  # of first order in the lag


def step(physics: Physics, seconds: float, command: float = 1.0, count: int = 200) -> tuple[Floats, Floats]:
    """Time in s and record of a step of one thruster of 1 N and 1 m, from rest."""
    time = np.linspace(0.0, seconds, count)
    thrusters, x = np.array([[1.0, 0.0, 0.0, 1.0]]), np.linspace(-1.0, 1.0, 3)[np.newaxis]
    record, series = np.zeros((count, 4)), np.zeros((3, 4))
    series[:, 3] = 1.0
    times = np.concatenate([[0.0, 0.0], time])
    kinds, places = np.array([0, 1] + [2] * count), np.array([0, 0, *range(count)])
    simulate(
        physics, Pilot(), thrusters, x, x.copy(), times, kinds, places, np.array([[command]]), np.ones(1), 0.0, seconds,
        series, 0.0, 0.0, 1e-3, record,
    )  # fmt: skip
    return time, record


def test_a_step_answers_by_the_formulas() -> None:
    plain = Physics(inertia=2.0, quadratic=0.0, linear=1.0)
    time, record = step(plain, 8.0)
    np.testing.assert_allclose(record[:, 1], 1.0 - np.exp(-time / 2.0), atol=1e-9)
    time, record = step(plain._replace(lag=0.5, lag_kind=1.0), 8.0)
    exact = 1.0 - (2.0 * np.exp(-time / 2.0) - 0.5 * np.exp(-time / 0.5)) / 1.5
    np.testing.assert_allclose(record[:, 1], exact, atol=1e-8)
    # Two lags in series are the one lag of a model with a lag in front.
    time, record = step(plain._replace(lag=0.5, lag_kind=5.0, second_lag=0.2), 8.0)
    shares = [(2.0, 2.0**2 / ((2.0 - 0.5) * (2.0 - 0.2))), (0.5, 0.5**2 / ((0.5 - 2.0) * (0.5 - 0.2))),
             (0.2, 0.2**2 / ((0.2 - 2.0) * (0.2 - 0.5)))]  # fmt: skip
    exact = 1.0 - np.sum([share * np.exp(-time / tau) for tau, share in shares], axis=0)
    np.testing.assert_allclose(record[:, 1], exact, atol=1e-8)
    time, record = step(plain._replace(slew_up=0.5, slew_down=0.5), 8.0)
    ramp = np.where(time < 2.0, 0.5 * (time - 2.0 + 2.0 * np.exp(-time / 2.0)), np.nan)
    np.testing.assert_allclose(record[time < 2.0, 1], ramp[time < 2.0], atol=1e-6)


def test_trapped_water_is_inertia_at_first_and_nothing_in_the_end() -> None:
    physics = Physics(inertia=2.0, quadratic=0.0, linear=1.0, memory=3.0, memory_time=0.01)
    time, record = step(physics, 20.0)
    # Water that follows at once is inertia: 5 kg m2 in all.
    np.testing.assert_allclose(record[:, 1], 1.0 - np.exp(-time / 5.0), atol=5e-3)
    assert record[-1, 1] == pytest.approx(1.0 - np.exp(-4.0), abs=1e-3)


def test_steady_rates_are_those_of_the_laws() -> None:
    plain = Physics(inertia=1.0, quadratic=2.0, linear=0.0)
    rate = np.sqrt(0.5)
    assert step(plain, 20.0)[1][-1, 1] == pytest.approx(rate, rel=1e-6)
    swirl = plain._replace(swirl=0.4, swirl_time=1.0)
    assert step(swirl, 60.0)[1][-1, 1] == pytest.approx(rate / 0.6, rel=1e-4)
    water = plain._replace(annulus=1.0, annulus_brake=2.0)  # both drags carry the torque of 1 N m
    assert step(water, 80.0)[1][-1, 1] == pytest.approx(2.0 * rate, rel=1e-3)
    assert step(plain._replace(bias=1.0), 20.0)[1][-1, 1] == pytest.approx(1.0, rel=1e-6)
    assert step(plain._replace(coulomb=0.5, coulomb_rate=0.01), 20.0)[1][-1, 1] == pytest.approx(0.5, rel=1e-6)
    assert step(plain._replace(reverse=0.5), 20.0, -1.0)[1][-1, 1] == pytest.approx(-0.5, rel=1e-6)
    assert step(plain._replace(deadband=0.5), 20.0)[1][-1, 1] == pytest.approx(0.5, rel=1e-6)
    assert step(plain._replace(sag=0.5, sag_time=1.0), 60.0)[1][-1, 1] == pytest.approx(0.5, rel=1e-4)
    assert step(plain._replace(play=0.5), 20.0)[1][-1, 1] == pytest.approx(np.sqrt(0.375), rel=1e-6)


def test_logs_hold_the_motion_and_the_commands(tmp_path: Path) -> None:
    from rovid.readers import read_campaign
    from rovid.trial.config import load_config

    seen = set()
    for index in range(60):
        campaign = draw(SEED, index)
        if campaign.format in seen or sum(run.time.size for run in campaign.runs) > 9000:
            continue
        seen.add(campaign.format)
        folder = tmp_path / campaign.format
        write_campaign(folder, campaign)
        trials = read_campaign([folder], load_config(folder / "rovid.toml")).trials
        assert len(trials) == len(campaign.runs)
        for trial, run in zip(trials, campaign.runs, strict=True):
            heading = trial.position[trial.measured]
            assert len(heading) == run.time.size
            psi = run.truth[:, 0] + deviation(campaign.cause, run.truth[:, 0])
            away = np.angle(np.exp(1j * (heading - psi)))
            assert np.std(away) < 2.0 * campaign.noise
    assert seen == {"csv", "csv_pair", "mcap"}


def test_what_a_refit_absorbs() -> None:
    lag, drag = after_refit(small("thruster_lag", "torque")), after_refit(small("drag_curvature", "cubic"))
    assert 0.0 < lag["left"] < 1.0
    assert lag["evidence"] > 20.0
    assert 0.0 < drag["left"] < truth_of(small("drag_curvature", "cubic"))["visibility"]
    nothing = after_refit(small("none"))
    assert nothing["left"] < 1e-9
    assert nothing["evidence"] < 1e-6


def test_evidence_is_that_of_white_noise() -> None:
    """Of a campaign's own noise the whitened rest has unit variance, within what its length allows."""
    campaign = small("none", first=40)
    run = campaign.runs[0]
    rng = np.random.default_rng(3)
    step = 1.0 / campaign.heading_hz
    noise = np.diff(rng.normal(0.0, campaign.noise, run.time.size + 1)) / step
    white = np.fft.irfft(np.fft.rfft(noise) * whitening(campaign, noise.size), noise.size)
    # The derivative's spectrum is that of a difference only well below the Nyquist frequency, and the disturbance's
    # share of the density is left out here: the variance is between a tenth and one.
    assert 0.1 < np.mean(white**2) < 1.2
