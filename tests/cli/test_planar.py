"""The coupled model on the command line, on logs that this file simulates."""

from __future__ import annotations

import json
import math
import re
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import rovid
from rovid.store.planar_study import planar_effect
from tests.conftest import SAMPLES, Rovid, run_rovid

# A box-shaped ROV: inertias with added mass, linear and quadratic drag of surge, sway and yaw.
MASS = np.array([[120.0, 0.0, 0.0], [0.0, 180.0, 6.0], [0.0, 6.0, 22.0]])
LINEAR, QUADRATIC = np.array([20.0, 30.0, 5.0]), np.array([60.0, 110.0, 14.0])
# Columns: force ahead, force to starboard and torque of 1 N of each thruster.
LEVERS = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.35, -0.35, 0.2]])
STEP, HOLD, SECONDS = 0.02, 2.0, 90.0
TRUTH = {
    "surge.inertia": 120.0, "sway.inertia": 180.0, "yaw.inertia": 22.0, "sway_yaw.inertia": 6.0,
    "surge.linear_drag": 20.0, "sway.linear_drag": 30.0, "yaw.linear_drag": 5.0,
    "surge.quadratic_drag": 60.0, "sway.quadratic_drag": 110.0, "yaw.quadratic_drag": 14.0,
}  # fmt: skip
CONFIG = """
[vehicle]
name = "box"

[[thrusters]]
name = "port"
surge = 1.0
yaw_arm = 0.35
curve = "curve.csv"
command = { csv = "port" }

[[thrusters]]
name = "starboard"
surge = 1.0
yaw_arm = -0.35
curve = "curve.csv"
command = { csv = "starboard" }

[[thrusters]]
name = "bow"
sway = 1.0
yaw_arm = 0.2
curve = "curve.csv"
command = { csv = "bow" }

[signals]
time = { csv = "time_s" }
heading = { csv = "heading_deg", unit = "deg" }
surge_velocity = { csv = "u", unit = "m/s" }
sway_velocity = { csv = "v", unit = "m/s" }
north = { csv = "north", unit = "m" }
east = { csv = "east", unit = "m" }
"""


def simulate(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) s, (n, 3) commands in N and (n, 6) heading, u, v, r, north, east; (2.1) to (2.4) by midpoint steps."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, SECONDS, STEP)
    levels = rng.uniform(-40.0, 40.0, (math.ceil(SECONDS / HOLD), 3))
    commands = levels[(time / HOLD).astype(int)]

    def slope(state: np.ndarray, command: np.ndarray) -> np.ndarray:
        nu = state[1:4]
        u, v, r = nu
        p = MASS @ nu
        coriolis = np.array([-p[1] * r, p[0] * r, p[1] * u - p[0] * v])
        rates = np.linalg.solve(MASS, LEVERS @ command - coriolis - LINEAR * nu - QUADRATIC * np.abs(nu) * nu)
        cos, sin = math.cos(state[0]), math.sin(state[0])
        return np.array([r, *rates, u * cos - v * sin, u * sin + v * cos])

    states = np.zeros((len(time), 6))
    for k in range(1, len(time)):
        middle = states[k - 1] + 0.5 * STEP * slope(states[k - 1], commands[k - 1])
        states[k] = states[k - 1] + STEP * slope(middle, commands[k - 1])
    return time, commands, states


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two runs with heading, velocities and positions at 5 Hz, and a little noise."""
    folder = tmp_path_factory.mktemp("planar") / "logs"
    folder.mkdir()
    (folder / "rovid.toml").write_text(CONFIG)
    (folder / "curve.csv").write_text("command,thrust_N\n-60,-60\n60,60\n")
    sizes = np.array([0.1, 0.005, 0.005, 0.02, 0.02])
    for seed in (1, 2):
        time, commands, states = simulate(seed)
        rows = slice(None, None, 10)
        values = np.column_stack(
            (np.degrees(states[:, 0]) % 360.0, states[:, 1], states[:, 2], states[:, 4], states[:, 5])
        )
        values = values[rows] + sizes * np.random.default_rng(seed).standard_normal((len(time[rows]), 5))
        table = np.column_stack((time[rows], values, commands[rows]))
        head = "time_s,heading_deg,u,v,north,east,port,starboard,bow"
        np.savetxt(folder / f"run_{seed}.csv", table, delimiter=",", header=head, comments="", fmt="%.5f")
    return folder


@pytest.fixture(scope="module")
def fitted(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    """The folder of a fit, with its document."""
    folder = tmp_path_factory.mktemp("fitted")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        done = run_rovid("fit", logs, "--axes", "planar", "--json")
    assert done.code == 0, done.err
    return folder, json.loads(done.out)


@pytest.fixture
def work(fitted: tuple[Path, dict[str, object]], rovid: Rovid) -> Callable[..., object]:
    """Run a command beside a copy of the fitted parameter file."""
    shutil.copy(fitted[0] / "parameters_planar.toml", ".")
    return rovid


def test_a_fit_finds_all_parameters(fitted: tuple[Path, dict[str, object]]) -> None:
    folder, document = fitted
    assert document["schema"] == "rovid-fit/1"
    assert document["axes"] == "planar"
    assert document["undetermined"] == []
    for name, truth in TRUTH.items():
        found = document["parameters"][name]  # type: ignore[index]
        # Ten parameters at 4 standard errors, fixed seeds; 2 % for the interval of the log against that of the truth.
        assert abs(found["value"] - truth) < 4.0 * found["standard_error"] + 0.02 * abs(truth), name
    assert document["parameters"]["sway.inertia"]["sname"] == "Y_vdot"  # type: ignore[index]
    assert document["parameters"]["yaw.quadratic_drag"]["unit"] == "N m s^2"  # type: ignore[index]
    written = tomllib.loads((folder / "parameters_planar.toml").read_text())
    assert written["axis"] == "planar"
    assert set(TRUTH) <= set(written["parameters"])


def test_parameters_of_motions_that_are_not_measured_are_refused_by_name(logs: Path, rovid: Rovid) -> None:
    shutil.copytree(logs, "logs")
    measured = CONFIG[: CONFIG.index("surge_velocity")]
    Path("logs/rovid.toml").write_text(measured)
    document = rovid("fit", "logs", "--axes", "planar", "--json").document
    # The port thruster pushes ahead, too: the drift that follows leaves less of the drag than of the inertia.
    known = set(document["parameters"])
    assert {"yaw.inertia"} <= known <= {name for name in TRUTH if name.startswith("yaw.")}
    named = {name for one in document["undetermined"] for name in one["combination"]}
    assert named >= set(TRUTH) - known
    assert all(one["text"] for one in document["undetermined"])
    written = tomllib.loads(Path("parameters_planar.toml").read_text())
    assert set(written["parameters"]) == set(document["parameters"])
    assert set(written["assumed"]) == set(TRUTH) - known
    errors = rovid("simulate", "--axes", "planar", "--json").document["overall"]
    assert set(errors) == {"yaw_rate_r2", "yaw_rate_fit_percent", "yaw_rate_rmse"}


@pytest.mark.slow
def test_the_current_of_the_sample_is_named(rovid: Rovid) -> None:
    done = rovid("diagnose", SAMPLES / "planar_rov", "--axes", "planar", "--budget", "600", "--json")
    assert done.document["verdict"] == "found"
    (finding,) = done.document["findings"]
    assert finding["effect"] == "current"
    for name, truth in (("speed", 0.0826), ("direction", 2.5375)):
        found = finding["parameters"][name]
        assert abs(found["value"] - truth) < 4.0 * found["standard_error"]  # 4 sigma, fixed logs
    gain = done.document["held_out_gain"]["surge_velocity_rmse"]
    assert gain["extended"] < 0.5 * gain["base"]


def test_simulation_errors_of_each_speed(work: Rovid) -> None:
    document = work("simulate", "--axes", "planar", "--json").document
    assert document["schema"] == "rovid-simulation/1"
    for trial in document["trials"]:
        assert trial["surge_velocity_r2"] > 0.98
        assert trial["sway_velocity_r2"] > 0.98
        assert trial["track_error"] < 1.0
        # The noise of the heading is 0.1 deg, that of the restart is larger.
        assert trial["heading_error_10s"] < math.radians(5.0)
    table = work("simulate", "--axes", "planar").out
    assert "Free-running simulation against measurement" in table
    assert "run_2.csv" in table


@pytest.mark.slow
def test_the_page_has_tracks_and_speeds(work: Rovid) -> None:
    done = work("report", "--axes", "planar", "--no-diagnosis")
    assert done.code == 0, done.err
    page = Path("report_planar/index.html").read_text()
    for title in ("Tracks", "Speeds", "Missing forces", "Every trial"):
        assert f">{title}</h2>" in page
    assert "Y_vdot" in page
    # Landmarks have names of their own.
    landmarks = re.findall(r'<h2 id=[^>]*>(.*?)</h2>|role="region" aria-label="(.*?)"', page)
    assert len({first or second for first, second in landmarks}) == len(landmarks)
    assert Path("report_planar/plots/planar_tracks.png").stat().st_size > 1000


def test_the_same_parameters_have_not_changed(work: Rovid) -> None:
    shutil.copy("parameters_planar.toml", "before.toml")
    document = work("compare", "before.toml", "--axes", "planar", "--json").document
    assert document["verdict"] in {"same", "cannot_tell"}
    assert document["changed"] == []
    assert document["prediction"]["a_on_b"]["sway_velocity_r2"] > 0.98


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--axes", "planer"), "planar was expected"),
        (("--axes", "planar", "--axis", "sway"), "together with --axis sway"),
        (("--axes", "planar", "--cutoff", "1.0"), "--cutoff: does not exist with --axes planar"),
        (("--axis", "planar"), "Give --axes planar"),
        (("--axes", "planar", "--effect", "tether_torsion"), "not an effect of the coupled model"),
        (("--axes", "planar", "--effect", "sideslip_moment"), "Munk"),
        (("--axes", "planar", "--effect", "drag_curvature"), "not an effect of the coupled model"),
    ],
)
def test_options_that_do_not_go_together(rovid: Rovid, arguments: tuple[str, ...], words: str) -> None:
    done = rovid("fit", "logs", *arguments)
    assert done.code == 2
    assert words in done.err


@pytest.mark.parametrize("command", ["fit-drag", "fit-inertia", "watch", "fleet", "control", "discover"])
def test_commands_along_one_axis_say_so(rovid: Rovid, command: str) -> None:
    done = rovid(command, "logs", "--axes", "planar")
    assert done.code == 2
    assert "works along one axis" in done.err


def test_effects_of_thrusters_are_effects_of_the_coupled_model() -> None:
    names = ("thruster_lag", "command_delay", "thruster_deadband", "thrust_asymmetry", "current", "bias_torque")
    assert [planar_effect(name).id for name in names] == list(names)
    assert planar_effect("bias_torque").form == "planar"
    assert planar_effect("sway_yaw_damping:lift").key == "sway_yaw_damping:lift"


def test_parameter_files_of_one_axis_and_of_three_are_not_mixed_up(work: Rovid) -> None:
    for command in (("simulate", "-p", "parameters_planar.toml"), ("compare", "parameters_planar.toml", "other")):
        done = work(*command)
        assert done.code == 2
        assert "surge, sway and yaw together" in done.err
    text = Path("parameters_planar.toml").read_text()
    Path("damaged.toml").write_text(
        text.replace('[parameters."sway_yaw.inertia"]\nvalue = ', '[parameters."sway_yaw.inertia"]\nvalue = 9')
    )
    done = work("simulate", "--axes", "planar", "-p", "damaged.toml")
    assert done.code == 2
    assert "not positive definite" in done.err
    Path("foreign.toml").write_text("mine = 1\n")
    done = work("fit", "logs", "--axes", "planar", "-p", "foreign.toml")
    assert done.code == 2
    assert Path("foreign.toml").read_text() == "mine = 1\n"


@pytest.mark.slow
def test_python_gives_the_documents_of_the_commands(logs: Path, fitted: tuple[Path, dict[str, object]]) -> None:
    study = rovid.open(logs, axes="planar")
    fit = study.fit()
    assert json.loads(fit.to_json()) == fitted[1]
    assert fit.parameters["sway.inertia"].unit == fit.to_pandas().loc["sway.inertia", "unit"] == "kg"
    assert "Y_vdot" in repr(fit)
    stored = fitted[0] / "parameters_planar.toml"
    simulated, by_command = study.simulate(fit), run_rovid("simulate", "--axes", "planar", "-p", stored, "--json")
    document = json.loads(simulated.to_json())
    for key in ("trials", "overall", "manoeuvres", "units", "undetermined", "warnings"):
        assert document[key] == by_command.document[key]
    assert simulated.r2["sway_velocity"] > 0.98
    assert simulated.plot().get_ylabel() == "yaw rate, rad/s"
    assert len(simulated.to_pandas()) == 2
    checked = study.check()
    assert json.loads(checked.to_json()) == run_rovid("check", logs, "--axes", "planar", "--json").document
    exported = study.export("mss", fit)
    assert exported.document["mismatch"]["sway_velocity_percent_of_range"] < 0.1  # % as the export promises
    frame = pd.concat([pd.read_csv(path).assign(run=path.name) for path in sorted(logs.glob("run_*.csv"))])
    described = tomllib.loads(CONFIG)
    curve = ([-60.0, 60.0], [-60.0, 60.0])
    thrusters = [one | {"curve": curve, "command": one["command"]["csv"]} for one in described["thrusters"]]
    given: dict[str, Any] = {"signals": described["signals"], "thrusters": thrusters, "run": "run"}
    of_memory = rovid.Study.from_frame(frame, axes="planar", **given)
    assert of_memory.simulate(fit).document["trials"] == simulated.document["trials"]
    wrongs: list[tuple[dict[str, Any], str]] = [
        ({"axes": "planer"}, "planar was expected"),
        ({"axes": "planar", "axis": "sway"}, "with axis"),
    ]
    for wrong, text in wrongs:
        with pytest.raises(rovid.RovidError, match=text):
            rovid.Study.from_frame(frame, **given, **wrong)
    with pytest.raises(rovid.RovidError, match="--axes planar"):
        study.plan()
