"""The hard-water simulator against closed forms; what it hides acts, and nothing else does; its folders are logs."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.hard_scores import reliability, score, verdict_on
from tests.conftest import run_rovid
from tools.hard import EFFECTS, VEHICLES, draw, look, write_campaign
from tools.hard import layout as at
from tools.hard.layout import Floats, no_cause
from tools.hard.motion import run
from tools.hard.sea import irregular
from tools.hard.thrust import bench, rotor_step
from tools.hard.vehicles import Vehicle

# A simulator of the tests changes rarely, and none of rovid's code is tested here.
pytestmark = pytest.mark.slow


def still_water(
    vehicle: Vehicle,
    demand: Floats,
    *,
    start: Floats | None = None,
    hull: Floats | None = None,
    cause: Floats | None = None,
) -> Floats:
    """Record of a run without waves, gusts or noise."""
    every = 6
    step = vehicle.time_constant / 60.0
    ticks = demand.size
    count = len(vehicle.thrusters)
    rotor = rotor_step(vehicle.rotor_share * vehicle.time_constant, 0.0, step / 2)
    record = np.zeros((ticks * every, at.N_RECORD))
    run(
        np.zeros(6) if start is None else start, step, every, vehicle.hull() if hull is None else hull,
        np.stack([one.row(0.0) for one in vehicle.thrusters]), np.zeros(at.N_WEATHER),
        np.zeros((2 * ticks * every + 3, at.N_SERIES)), no_cause() if cause is None else cause, no_cause(),
        np.stack([np.stack([rotor] * count)] * 2), np.zeros(ticks, dtype=np.int64),
        np.array([one.yaw for one in vehicle.thrusters]), np.array([one.surge for one in vehicle.thrusters]), 1e6,
        at.OPEN_LOOP, np.zeros(at.N_PILOT), demand, np.zeros(ticks), np.zeros(ticks, dtype=np.int64), np.zeros(ticks),
        np.zeros(ticks), record, np.zeros((ticks, count)),
    )  # fmt: skip
    return record


@pytest.mark.parametrize("key", sorted(VEHICLES))
def test_without_drag_the_energy_stays_and_the_munk_moment_is_in_it(key: str) -> None:
    vehicle = VEHICLES[key]
    hull = vehicle.hull()
    hull[[at.X_U, at.X_UU, at.Y_V, at.Y_VV, at.DL, at.DQ, at.CROSS_FLOW, at.N_UV, at.N_UR]] = 0.0
    # Pods always pull: take the thrusters of one that rests.
    at_rest = vehicle if key != "ship" else VEHICLES["work"]
    start = np.array([0.5, 0.1, 0.5 * vehicle.rate_in_use, 0.0, 0.0, 0.0])
    record = still_water(at_rest, np.zeros(100), start=start, hull=hull)
    u, v, r = record[:, at.R_SURGE], record[:, at.R_SWAY], record[:, at.R_RATE]
    energy = 0.5 * (hull[at.M11] * u**2 + hull[at.M22] * v**2 + hull[at.M33] * r**2) + hull[at.M23] * v * r
    assert energy == pytest.approx(energy[0], rel=1e-6)
    munk = (hull[at.M11] - hull[at.M22]) * 0.5 * 0.1
    slope = (r[1] - r[0]) / (at_rest.time_constant / 60.0)
    # The sway that turning makes feeds back into yaw by the centre of gravity.
    y, n = -hull[at.M11] * 0.5 * r[0], munk - hull[at.M23] * r[0] * 0.5
    expected = (hull[at.M22] * n - hull[at.M23] * y) / (hull[at.M22] * hull[at.M33] - hull[at.M23] ** 2)
    assert slope == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize("demand", [0.3, -0.5])
def test_a_held_command_ends_where_drag_balances_thrust(demand: float) -> None:
    vehicle = VEHICLES["work"]
    hull = vehicle.hull()
    hull[[at.M23, at.CROSS_FLOW]] = 0.0  # turning alone
    record = still_water(vehicle, np.full(200, demand), hull=hull)
    torque = sum(one.arm * bench(one.yaw * demand, one.row(0.0)) for one in vehicle.thrusters)
    linear, quadratic = vehicle.yaw_drag
    rate = np.sign(torque) * (np.sqrt(linear**2 + 4 * quadratic * abs(torque)) - linear) / (2 * quadratic)
    # The pair makes no side force only where both push alike; here they do.
    assert record[-1, at.R_SWAY] == pytest.approx(0.0, abs=1e-9)
    assert record[-1, at.R_RATE] == pytest.approx(rate, rel=1e-6)
    assert record[-1, at.R_BENCH] == pytest.approx(torque, rel=1e-9)


def test_an_effect_of_each_place_moves_the_steady_state_as_its_equation_says() -> None:
    vehicle = VEHICLES["work"]
    hull = vehicle.hull()
    hull[[at.M23, at.CROSS_FLOW]] = 0.0
    linear, quadratic = vehicle.yaw_drag
    torque = sum(one.arm * bench(one.yaw * 0.4, one.row(0.0)) for one in vehicle.thrusters)

    def rate_with(place: int, value: float) -> float:
        cause = no_cause()
        cause[place] = value
        return float(still_water(vehicle, np.full(200, 0.4), hull=hull, cause=cause)[-1, at.R_RATE])

    for place, value, extra in (
        (at.BIAS, 20.0, lambda _: 20.0),
        (at.CUBIC, 8000.0, lambda r: -8000.0 * r**3),
        (at.SCALE, 0.8, lambda _: -0.2 * torque),
        (at.REVERSE, 0.5, lambda _: 0.0),  # nothing pushes astern
    ):
        r = rate_with(place, value)
        assert quadratic * r * r + linear * r == pytest.approx(torque + extra(r), rel=1e-5)


def test_waves_have_the_variance_and_the_frequency_that_were_asked_for() -> None:
    rng = np.random.default_rng(3)
    wave, quadrature = irregular(2.0, "JONSWAP", 0.02, 200_000, rng)
    assert np.std(wave) == pytest.approx(1.0, abs=0.1)
    assert np.std(quadrature) == pytest.approx(1.0, abs=0.1)
    crossings = np.count_nonzero(np.diff(np.sign(wave)) > 0)
    assert 2 * np.pi * crossings / (200_000 * 0.02) == pytest.approx(2.0, rel=0.35)


def test_a_seed_is_a_campaign() -> None:
    one, same, other = draw(5), draw(5), draw(6)
    assert json.dumps(one.truth()) == json.dumps(same.truth())
    assert all(np.array_equal(a.record, b.record) for a, b in zip(one.runs, same.runs, strict=True))
    assert json.dumps(one.truth()) != json.dumps(other.truth())


def test_where_nothing_is_hidden_both_banks_make_the_same_and_the_water_rests() -> None:
    nothing = draw(77, effect="none")
    assert nothing.truth()["hidden"] is None
    for run_ in nothing.runs:
        assert np.array_equal(run_.record[:, at.R_TORQUE], run_.record[:, at.R_TORQUE_PLAIN])
        assert not run_.record[:, [at.R_WATER_0, at.R_WATER_1]].any()


@pytest.mark.parametrize("effect", EFFECTS)
def test_every_cause_can_be_hidden(effect: str) -> None:
    with_it = draw(77, effect=effect)
    assert with_it.truth()["hidden"]["effect"] == effect
    assert all(np.isfinite(run_.record).all() for run_ in with_it.runs)


def test_the_oracle_sees_a_strong_cause_and_knows_the_hull() -> None:
    seen = look(draw(3, vehicle="work", effect="bias_torque"))
    assert seen["visible"] > 0.1
    hull = draw(3, vehicle="work", effect="none")
    fit = look(hull)["told_fit"]
    assert fit["inertia"] == pytest.approx(hull.vehicle.total_inertia, rel=0.15)


@pytest.mark.parametrize("seed", range(4))
def test_rovid_accepts_the_folder(seed: int, tmp_path: Path) -> None:
    campaign = draw(seed, vehicle=sorted(VEHICLES)[seed])
    write_campaign(tmp_path / "logs", campaign)
    logs = run_rovid("check", tmp_path / "logs", "--json").document["logs"]
    assert len(logs) == len(campaign.runs)
    assert sum(log["samples"] for log in logs) == pytest.approx(
        sum(run_.log.time.size for run_ in campaign.runs), rel=0.02
    )


def test_scores_tell_exact_class_there_and_wrong_apart() -> None:
    truth = {
        "hidden": {"effect": "thruster_lag"}, "one_way": False, "also_true": ["wave_torque"], "visible": 0.4,
        "vehicle": "boat", "parameters": {"inertia": 10.0}, "told_fit": {"inertia": 10.5},
        "late_fit": {"inertia": 10.3}, "rotor_seconds": 0.05, "advance_loss": 0.04, "speed_logged": True,
    }  # fmt: skip

    def said(*effects: str) -> dict[str, object]:
        findings = [{"effect": effect, "confidence": 0.9, "cannot_be_told_from": []} for effect in effects]
        model = {"parameters": {"inertia": {"value": 10.4, "standard_error": 0.1}}}
        return {"verdict": "found", "findings": findings, "extended": model, "base": model}

    def scored(*effects: str) -> dict[str, Any]:
        return score({"number": 1, "truth": truth, "said": said(*effects), "failure": ""})

    assert scored("thruster_lag")["established"] == ["exact"]
    # A model with a lag is held against a fit that knows how late the rotors are, any other against one that does not.
    assert scored("thruster_lag")["parameters"]["inertia"]["errors_from_best"] == pytest.approx(1.0)
    assert scored("bias_torque")["parameters"]["inertia"]["errors_from_best"] == pytest.approx(-1.0)
    assert scored("command_delay")["established_right"]
    both = scored("wave_torque", "bias_torque")
    assert both["established"] == ["there", "wrong"]
    assert both["established_wrong"]
    assert not both["first_right"]
    assert scored("wave_torque", "slew_limit")["rank"] == 2
    assert both["strictly"] == [True, False]
    # What it is not told from counts for one judge, and not for the other.
    assert [one[1:] for one in scored("thruster_lag", "command_delay")["odds"]] == [(True, True), (True, False)]
    table, brier = reliability([(0.95, True, True), (0.95, True, False), (0.15, True, True)])
    assert table[-1][1:] == pytest.approx((0.95, 1.0, 0.5))
    assert [row[0] for row in table] == [0, 1, 0, 0, 0, 0, 0, 0, 0, 2]
    assert brier == pytest.approx((2 * 0.05**2 + 0.85**2) / 3)


@pytest.mark.parametrize(
    ("effect", "name", "size", "worth"),
    [
        ("thruster_lag", "time_constant", 0.25, "there"),
        ("thruster_lag", "time_constant", 0.6, "wrong"),
        ("advance_speed_loss", "coefficient", 0.15, "there"),
        ("advance_speed_loss", "coefficient", 0.3, "wrong"),
        ("slew_limit", "rate", 0.2, "wrong"),
    ],
)
def test_what_the_thrusters_have_by_themselves_is_there(effect: str, name: str, size: float, worth: str) -> None:
    truth: dict[str, object] = {"hidden": None, "one_way": False, "also_true": [], "rotor_seconds": 0.2}
    found = {"value": size, "standard_error": 0.05}
    named = {"effect": effect, "parameters": {name: found}, "cannot_be_told_from": []}
    assert verdict_on(named, truth | {"advance_loss": 0.04}) == worth
    assert verdict_on(named, truth | {"advance_loss": 0.0, "rotor_seconds": 0.0}) == "wrong"


@pytest.mark.slow
def test_thrusters_too_slow_for_the_plain_model_are_no_lack_of_data(tmp_path: Path) -> None:
    """Two minutes of an autopilot that swings: without the cause no inertia fits, nor any time constant."""
    write_campaign(tmp_path / "logs", draw(8800021))
    said = run_rovid("diagnose", tmp_path / "logs", "-p", tmp_path / "p.toml", "--json").document
    assert said["verdict"] == "found"
    assert "slew_limit" in {finding["effect"] for finding in said["findings"]}
