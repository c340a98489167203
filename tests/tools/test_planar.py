"""Planar campaigns: one draw for one seed and index, the equation of motion, and folders that rovid reads."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.conftest import run_rovid
from tools.planar import FAMILIES, FORMS, draw, simulated, truth_of, write_campaign
from tools.planar.campaign import hull_of
from tools.planar.causes import rows_with
from tools.planar.motion import Floats, Hull, Ship, slopes
from tools.planar.vehicles import kvlcc2

# A simulator of the tests changes rarely, and none of rovid's code is tested here.
pytestmark = pytest.mark.slow

SEED = 7
STILL = Ship()


def test_the_same_seed_gives_the_same_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_campaign(tmp_path / name, draw(SEED, 2))
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    assert files == sorted(path.name for path in (tmp_path / "b").iterdir())
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def accelerations(hull: Hull, nu: Floats) -> Floats:
    """Accelerations (3,) without actuators."""
    rates, water = np.zeros(6), np.zeros(5)
    empty, commands = np.zeros((0, 16)), np.zeros(0)
    slopes(np.array([0.0, 0.0, 0.3, *nu]), hull, STILL, empty, commands, np.zeros((0, 2)), np.zeros((0, 2)),
           commands, water, rates)  # fmt: skip
    return rates[3:6]


def test_without_damping_the_kinetic_energy_is_constant_and_with_it_falls() -> None:
    """d/dt (nu' M nu / 2) = nu' M nu_dot, which is -nu' D nu (Fossen 2011, C is skew-symmetric)."""
    undamped = Hull(120.0, 190.0, 25.0, 40.0, *6 * (0.0,))
    damped = undamped._replace(surge_linear=3.0, sway_quadratic=40.0, yaw_linear=5.0, strip=9.0, strip_length=1.4,
                               strip_centre=0.2, Y_uv=3.0, N_ur=2.0, N_uur=1.0)  # fmt: skip
    mass = np.array([[120.0, 0.0, 0.0], [0.0, 190.0, 25.0], [0.0, 25.0, 40.0]])
    rng = np.random.default_rng(1)
    for nu in rng.normal(size=(50, 3)):
        kinetic = float(nu @ mass @ nu)
        assert abs(nu @ mass @ accelerations(undamped, nu)) < 1e-12 * kinetic * 200.0
        assert nu @ mass @ accelerations(damped, nu) < 0.0


def test_the_accelerations_are_those_of_the_matrices() -> None:
    """M nu_dot = -C nu - D nu with C of Fossen (2011), equation 3.57 with the velocities' rows of M."""
    hull = Hull(120.0, 190.0, 25.0, 40.0, 3.0, 20.0, 4.0, 50.0, 5.0, 6.0, Y_r=-2.0, N_v=1.5, bias_y=0.7)
    mass = np.array([[120.0, 0.0, 0.0], [0.0, 190.0, 25.0], [0.0, 25.0, 40.0]])
    for nu in np.random.default_rng(2).normal(size=(50, 3)):
        momentum = mass @ nu
        coriolis = np.array([
            [0.0, 0.0, -momentum[1]], [0.0, 0.0, momentum[0]], [momentum[1], -momentum[0], 0.0],
        ])  # fmt: skip
        damping = np.diag([3.0, 4.0, 5.0]) + np.diag([20.0, 50.0, 6.0]) * np.abs(nu)
        damping[1, 2], damping[2, 1] = 2.0, -1.5
        expected = np.linalg.solve(mass, np.array([0.0, 0.7, 0.0]) - coriolis @ nu - damping @ nu)
        assert accelerations(hull, nu) == pytest.approx(expected, rel=1e-12, abs=1e-13)


def test_the_tanker_turns_as_published() -> None:
    """Free-running KVLCC2 models at 35 deg: advance 3.11 to 3.25, tactical diameter 3.08 to 3.34 lengths."""
    ship, revolutions = kvlcc2(7.0)
    state, rates = np.zeros(8), np.zeros(8)
    state[3] = 1.179
    rows, none = np.zeros((2, 16)), np.zeros((2, 2))
    commands, water, hull = np.array([60.0 * revolutions, 0.0]), np.zeros(5), Hull(*10 * (1.0,))
    track = []
    for k in range(6000):
        commands[1] = min(35.0, 15.8 * 0.02 * k)
        slopes(state, hull, ship, rows, np.zeros(2), none, none, commands, water, rates)
        if k == 0:
            # The propeller balances the resistance; the rudder amidships has no incidence.
            assert np.abs(rates[3:6]).max() < 1e-6
        state = state + 0.02 * rates
        track.append(state[:3].copy())
    north, east, psi = np.array(track).T
    assert 0.93 * 3.11 < north[np.argmax(psi > 0.5 * np.pi)] / 7.0 < 1.07 * 3.25
    assert 0.93 * 3.08 < east[np.argmax(psi > np.pi)] / 7.0 < 1.07 * 3.34


def test_the_strips_are_the_integral_of_fossen() -> None:
    """-0.5 rho Cd T times the integral of |v + x r| (v + x r), and with the arm x (Fossen 2011, eq. 6.91, 6.92)."""
    plain = Hull(1.0, 1.0, 0.0, 1.0, *6 * (0.0,))
    strips = plain._replace(strip=7.0, strip_length=2.0, strip_centre=0.3)
    x = np.linspace(-0.7, 1.3, 200_001)
    for v, r in ((0.4, 0.9), (-0.5, 0.6), (0.2, -2.0), (1.0, 0.0)):
        flow = np.abs(v + x * r) * (v + x * r)
        got = accelerations(strips, np.array([0.0, v, r]))
        assert got[1] == pytest.approx(-7.0 * np.trapezoid(flow, x), rel=1e-8, abs=1e-8)
        assert got[2] == pytest.approx(-7.0 * np.trapezoid(x * flow, x), rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("hidden", ["none", "thruster_lag", "current:wandering", "command_delay"])
def test_the_motion_agrees_with_an_adaptive_method(family: str, hidden: str) -> None:
    if family == "tanker" and hidden not in {"none", "current:wandering"}:
        assert hidden in FORMS
        return
    campaign = draw(SEED, 0, hidden, family)
    vehicle, cause = campaign.vehicle, campaign.cause
    run = min(campaign.runs, key=lambda one: one.before)
    seconds = min(0.9 * run.length, 4.0 * max(vehicle.time_constants), 40.0 / campaign.command_hz,
                  100.0 * run.step)  # fmt: skip
    kept = int(np.searchsorted(run.stamps[0], seconds))
    delay = cause.delay if cause else 0.0
    rows, grid = rows_with(vehicle, cause), run.step * np.arange(len(run.series))
    ends = run.before + run.stamps[0][kept] - campaign.sensors[0].latency
    columns = [np.ascontiguousarray(run.series[:, j]) for j in range(5)]
    arrivals = run.sent + delay
    edges = [0.0, *arrivals[(arrivals > 0.0) & (arrivals < ends)].tolist(), ends]
    state = np.zeros(6 + len(vehicle.actuators))
    state[2] = run.heading
    state[3] = vehicle.full[0] * run.demands[0, 0] ** 0.5 if vehicle.ship.length else 0.0
    for begin, end in itertools.pairwise(edges):
        k = int(np.searchsorted(arrivals, begin, side="right")) - 1
        commands = run.commands[k] if k >= 0 else np.zeros(run.commands.shape[1])

        def rates(t: float, y: Floats, commands: Floats = commands) -> Floats:
            water = np.array([np.interp(t, grid, column) for column in columns])
            out = np.zeros(y.size)
            slopes(y, hull_of(campaign), vehicle.ship, rows, vehicle.rests(), vehicle.commands, vehicle.thrusts,
                   commands, water, out)  # fmt: skip
            return out

        state = solve_ivp(rates, (begin, end), state, rtol=1e-8, atol=1e-9, max_step=0.5 * run.step).y[:, -1]
    # The step of 1/25 of a time constant gives four digits; the disturbance has corners at its points.
    scale = np.array([*2 * (vehicle.full[0] * seconds,), 1.0, *vehicle.full])
    assert np.abs((run.truth[0][kept] - state[:6]) / scale).max() < 2e-4


def test_shorter_steps_change_next_to_nothing() -> None:
    campaign = draw(SEED, 0, "none", "rov")
    fine = simulated(campaign, replay=True, refine=4.0)
    for a, b in zip(campaign.runs, fine.runs, strict=True):
        assert np.abs(a.truth[0][:, 3:] - b.truth[0][:, 3:]).max() < 1e-3 * max(campaign.vehicle.full)


def test_hidden_causes_show_and_nothing_does_not() -> None:
    for effect in ("current", "sway_yaw_damping", "bias_torque"):
        assert draw(SEED, 1, effect, "rov").changed > 5.0, effect
    nothing = draw(SEED, 1, "none", "rov")
    truth = truth_of(nothing)
    json.dumps(truth, allow_nan=False)
    assert truth["hidden"] is None
    assert len(truth["comparable"]) == 10


def test_a_compass_alone_determines_no_drag_of_a_boat_without_speed() -> None:
    """Pure turns on the spot: nothing moves ahead, and no measurement could tell the drag ahead."""
    campaign = draw(SEED, 3, "none", "rov", sensors=("compass",))
    runs = tuple(replace(run, demands=run.demands * (0.0, 0.0, 1.0)) for run in campaign.runs)
    truth = truth_of(simulated(replace(campaign, runs=runs)))
    assert "surge.quadratic_drag" in truth["undetermined"]
    assert "yaw.inertia" in truth["determined"]


@pytest.mark.parametrize("log_format", ["csv", "csv_parts", "mcap"])
def test_rovid_reads_the_folders_along_one_axis(tmp_path: Path, log_format: str) -> None:
    campaign = draw(SEED, 4, "none", "usv", sensors=("compass", "dvl"), log_format=log_format)
    write_campaign(tmp_path / "logs", campaign)
    done = run_rovid("fit", tmp_path / "logs", "-p", tmp_path / "p.toml", "--json")
    assert done.code == 0, done.err
    assert done.document["parameters"]["inertia"]["value"] > 0.0
