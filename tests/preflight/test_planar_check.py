"""`rovid check` and `rovid init` for surge, sway and yaw together."""

from __future__ import annotations

import math
import re
import shutil
import tomllib
from dataclasses import astuple
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from rovid.core.array_types import FloatArray
from rovid.preflight.axis_guess import PlanarGuess, guess_planar
from rovid.preflight.command_effects import CommandEffect
from rovid.preflight.config_writer import propeller_lines, share_lines
from rovid.preflight.planar_check import PlanarCheck, check_planar
from rovid.preflight.raw_columns import RawColumn, SignalGuess
from rovid.preflight.thruster_guess import ThrusterCommand
from rovid.readers.campaign import read_campaign
from rovid.trial.config import load_planar_config
from rovid.trial.trial import Trial
from tests.conftest import SAMPLES, Rovid
from tests.planar.campaign import PORT_AND_STARBOARD, SIGNALS, Motion, write_campaign, write_log


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("planar")
    write_campaign(made)
    return made


def checked(folder: Path) -> PlanarCheck:
    return check_planar([folder], load_planar_config(folder / "rovid.toml"))


def test_a_check_has_rate_and_gaps_of_each_sensor(folder: Path, rovid: Rovid) -> None:
    document = rovid("check", folder, "--axes", "planar", "--json").document
    assert (document["schema"], document["axes"]) == ("rovid-check/1", "planar")
    sensors = {sensor["name"]: sensor for sensor in document["sensors"]}
    for name, (rate, gaps) in {"heading": (20.0, 0), "surge_velocity": (5.0, 2), "east": (1.0, 0)}.items():
        assert sensors[name]["rate"] == pytest.approx(rate, rel=1e-3)
        assert (sensors[name]["gaps"], sensors[name]["logs"]) == (gaps, 2)
    assert sensors["sway_velocity"]["longest_gap"] == pytest.approx(15.2, abs=0.21)  # 15 s without, and an interval
    surge, sway, yaw = document["degrees_of_freedom"]
    assert (surge["actuators"], sway["actuators"], yaw["actuators"]) == (
        ["port", "starboard"],
        [],
        ["port", "starboard"],
    )
    assert sway["force"] == 0.0
    assert 0.0 < sway["velocity"] < surge["velocity"]
    assert "sway" in rovid("check", folder, "--axes", "planar").out


def test_a_latency_and_a_sign_show(tmp_path: Path) -> None:
    late = 0.25
    for number in range(2):
        motion = Motion(seed=number)
        # A position reports where the vehicle was.
        motion.columns["n"], motion.columns["e"] = (
            np.interp(motion.time - late, motion.time, motion.columns[name]) for name in ("n", "e")
        )
        write_log(tmp_path / f"run_{number}.csv", motion)
    write_campaign(tmp_path, logs=0)
    check = checked(tmp_path)
    (lag,) = (one for one in check.lags if one.late == "position")
    # The speed is interpolated over 0.2 s, and the latencies tried are 0.025 s apart.
    assert lag.seconds == pytest.approx(late, abs=0.01)
    assert lag.scale == pytest.approx(1.0, abs=0.02)
    assert any(one.kind == "latency" and "position is 0.2" in one.text for one in check.advice)
    (gyro,) = (one for one in check.lags if one.late == "heading")
    assert abs(gyro.seconds) < 0.01
    astern = SIGNALS.replace('{ csv = "u" }', '{ csv = "u", sign = -1 }')
    (tmp_path / "rovid.toml").write_text(PORT_AND_STARBOARD + astern)
    check = checked(tmp_path)
    assert any(one.kind == "sensors_disagree" and one.weight == "grave" for one in check.advice)
    assert check.verdict == "no_go"


def test_a_check_names_what_is_not_measured(folder: Path, tmp_path: Path) -> None:
    for path in folder.glob("*.c*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    kept = [line for line in SIGNALS.splitlines() if not line.startswith(("surge", "sway", "north", "east"))]
    (tmp_path / "rovid.toml").write_text(PORT_AND_STARBOARD + "\n".join(kept))
    check = checked(tmp_path)
    assert [axis.measured for axis in check.axes] == [False, False, True]
    assert math.isnan(check.axes[0].velocity)
    assert any(one.kind == "unmeasured" and "surge and sway cannot" in one.text for one in check.advice)


def test_a_check_names_the_runs_that_are_missing(tmp_path: Path) -> None:
    write_campaign(tmp_path, logs=0)
    motion = Motion(seed=0)
    speed = 0.5 * np.tanh(motion.time / 3.0) + 1e-4 * np.sin(motion.time)
    motion.columns["u"], motion.columns["v"] = speed, 100.0 * 0.05 * np.radians(motion.columns["gyro"])
    write_log(tmp_path / "run.csv", motion)
    signals = "\n".join(line for line in SIGNALS.splitlines() if not line.startswith(("north", "east")))
    (tmp_path / "rovid.toml").write_text(PORT_AND_STARBOARD + signals)
    texts = [one.text for one in checked(tmp_path).advice if one.kind == "missing_run"]
    assert any("ahead and astern" in text and "surge.linear_drag and surge.quadratic_drag" in text for text in texts)
    assert any("turns at two or more speeds ahead" in text for text in texts)  # Sway follows yaw.


def test_init_keeps_thrusters_that_do_not_turn_the_vehicle(tmp_path: Path, rovid: Rovid) -> None:
    """A thruster ahead and one across have names of no thruster; the coupled model needs both."""
    for path in (*sorted((SAMPLES / "planar_rov").glob("run_0[12].csv")), SAMPLES / "planar_rov" / "curve_main.csv"):
        shutil.copy(path, tmp_path)
    done = rovid("init", tmp_path, "--axes", "planar")
    assert done.code == 0
    table, _, following = done.out.partition("Next:")
    assert all(re.search(rf"^{words} ", table, re.MULTILINE) for words in ("surge_velocity", "command of main"))
    assert "--axes planar" in following
    assert re.search(r"measure surge, sway and yaw_arm of \w+, .* and surge and sway of", " ".join(following.split()))
    thrusters = {one["name"]: one for one in tomllib.loads((tmp_path / "rovid.toml").read_text())["thrusters"]}
    assert (thrusters["main"]["surge"], thrusters["lateral"]["sway"], thrusters["main"]["yaw_arm"]) == (1.0, 1.0, 0.0)


def test_init_writes_the_shares_that_the_logs_show(folder: Path, tmp_path: Path, rovid: Rovid) -> None:
    for path in folder.glob("run*.csv"):
        text = path.read_text()
        names = {"a": "port_cmd", "b": "starboard_cmd", "u": "u_m_s", "v": "v_cm_s", "n": "north_m", "e": "east_m"}
        header, rest = text.split("\n", 1)
        columns = [names.get(name, name) for name in header.replace("hdg", "heading_deg").split(",")]
        (tmp_path / path.name).write_text(",".join(columns).replace("t,", "time_s,", 1) + "\n" + rest)
    plain = rovid("init", tmp_path, "--json")
    assert plain.code == 0, plain.err
    text = (tmp_path / "rovid.toml").read_text()
    assert '# surge_velocity = { csv = "u_m_s", unit = "m/s" }' in text
    assert "surge = " not in text
    assert rovid("init", tmp_path, "--axes", "planar", "--force", "--json").code == 0
    config = load_planar_config(tmp_path / "rovid.toml")
    assert {"surge_velocity", "sway_velocity", "north", "east"} <= config.signals.keys()
    port, starboard = config.vehicle.thrusters
    assert (port.surge_share, starboard.surge_share) == (1.0, 1.0)
    assert (port.arm, starboard.arm) == (1.0, -1.0)
    assert port.arm_guessed
    assert rovid("check", tmp_path, "--axes", "planar").code == 0


@pytest.mark.parametrize(("scale", "unit"), [(1.0, "deg"), (1e7, "1e-7 deg")])
def test_a_latitude_and_a_longitude_are_a_position(
    folder: Path, tmp_path: Path, rovid: Rovid, scale: float, unit: str
) -> None:
    for path in folder.glob("*.c*"):
        table = pd.read_csv(path)
        if {"n", "e"} <= set(table):
            # Of an ellipsoid by its radii at 60 deg: 111 412 m of one degree of latitude, 55 800 m of longitude.
            table["lat"], table["lon"] = (
                scale * (60.0 + table["n"] / 111_412.0),
                scale * (table["e"] / 55_800.0 - 180.0),
            )
            table["lon"] += 360.0 * scale * (table["lon"] < -180.0 * scale)
        table.to_csv(tmp_path / path.name, index=False)
    table = pd.read_csv(min(tmp_path.glob("run*.csv")))
    time = table["t"].to_numpy()
    columns = [RawColumn(source=name, time=time, values=table[name].to_numpy()) for name in ("lat", "lon")]
    guess = guess_planar([{column.source: column for column in columns}], set(), ())
    assert {name: (one.source, one.unit) for name, one in guess.signals.items()} == {
        "north": ("lat", unit), "east": ("lon", unit),
    }  # fmt: skip
    lines = [line for line in SIGNALS.splitlines() if not line.startswith(("north", "east"))]
    north, east = f'north = {{ csv = "lat", unit = "{unit}" }}', f'east = {{ csv = "lon", unit = "{unit}" }}'
    (tmp_path / "rovid.toml").write_text(PORT_AND_STARBOARD + "\n".join([*lines, north, east]))

    def read(where: Path) -> list[Trial]:
        return list(read_campaign([where], load_planar_config(where / "rovid.toml")).trials)

    def middle(trial: Trial, name: str) -> FloatArray:
        _, values = astuple(trial.readings[name])
        return np.asarray(values - np.median(values))

    for metres, degrees in zip(read(folder), read(tmp_path), strict=True):
        for name in ("north", "east"):
            assert middle(degrees, name) == pytest.approx(middle(metres, name), rel=2e-5, abs=2e-3)

    (tmp_path / "rovid.toml").write_text(PORT_AND_STARBOARD + "\n".join([*lines, north, 'east = { csv = "e" }']))
    done = rovid("check", tmp_path, "--axes", "planar")
    assert (done.code, "a latitude and a longitude are read together" in done.err) == (2, True)


def test_a_propeller_that_turns_nothing_is_taken_by_its_name() -> None:
    time = 0.1 * np.arange(3000, dtype=np.float64)
    columns = {
        "propeller_rps": np.where(time < 100.0, 10.0, 12.0),
        "u_m_s": 0.3 + 0.05 * np.sin(0.1 * time),
        "north_m": np.sin(0.01 * time),
        "east_m": np.cos(0.01 * time),
        "north_std_m": np.sin(time),
    }
    logs = [{name: RawColumn(source=name, time=time, values=values) for name, values in columns.items()}]
    guess = guess_planar(logs, set(), ())
    assert {name: one.source for name, one in guess.signals.items()} == {
        "surge_velocity": "u_m_s", "north": "north_m", "east": "east_m",
    }  # fmt: skip
    (block,) = tomllib.loads("\n".join(propeller_lines({"csv": guess})))["thrusters"]
    assert (block["surge"], block["command"], block["thrust_constant_guessed"]) == (1.0, {"csv": "propeller_rps"}, 1.0)
    assert block["max_command"] == pytest.approx(13.2)
    (block,) = tomllib.loads("\n".join(propeller_lines({"csv": guess}, "bench.csv")))["thrusters"]
    assert (block["curve"], "thrust_constant" in block) == ("bench.csv", False)


def test_a_fit_refuses_a_rudder_without_propulsion(folder: Path, tmp_path: Path, rovid: Rovid) -> None:
    for path in folder.glob("*.c*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    rudder = '[[rudders]]\nname = "stern"\nposition = [-1.0, 0.0]\nangle = { csv = "a" }\n'
    (tmp_path / "rovid.toml").write_text(rudder + SIGNALS)
    done = rovid("fit", tmp_path, "--axes", "planar", "-p", tmp_path / "p.toml")
    assert done.code == 2
    assert "nothing pushes the vehicle but stern" in done.err


def test_the_sample_is_ready_for_a_fit(rovid: Rovid) -> None:
    document = rovid("check", SAMPLES / "planar_rov", "--axes", "planar", "--json").document
    assert (document["verdict"], document["faults"], document["advice"]) == ("go", [], [])
    noise = {sensor["name"]: sensor["noise"] for sensor in document["sensors"]}
    assert noise["heading"] == pytest.approx(0.00114, rel=0.1)  # as its README says; 10 % of 2600 readings is 5 sigma
    assert noise["surge_velocity"] == pytest.approx(0.0061, rel=0.12)


def test_planar_and_a_single_axis_exclude_each_other(folder: Path, rovid: Rovid) -> None:
    for command in ("check", "init"):
        done = rovid(command, folder, "--axes", "planar", "--axis", "surge")
        assert done.code == 2
        assert "--axes" in done.err


def test_shares_of_vectored_thrusters_show_while_the_vehicle_turns() -> None:
    """Without the turn, its centripetal acceleration would count as thrust."""
    generator = np.random.default_rng(4)
    shares = np.array([[0.7, 0.7, 0.3], [0.7, -0.7, -0.3], [0.7, -0.7, 0.3], [0.7, 0.7, -0.3]])
    commands = np.repeat(generator.uniform(-1.0, 1.0, (60, 4)), 50, axis=0)
    time = 0.1 * np.arange(len(commands), dtype=np.float64)
    states, (u, v, r, heading) = [], np.zeros(4)
    for surge, sway, yaw in commands @ shares:
        states.append((u, v, heading))
        u, v, r, heading = (
            u + 0.1 * (0.5 * surge + r * v - 0.4 * u),
            v + 0.1 * (0.3 * sway - r * u - 0.5 * v),
            r + 0.1 * (2.0 * yaw - 0.8 * r),
            heading + 0.1 * r,
        )
    noisy = np.array(states) + generator.normal(0.0, 0.005, (len(states), 3))
    columns = dict(zip(("u_m_s", "v_m_s", "hdg"), noisy.T, strict=True))
    columns |= {f"t{number}": commands[:, number] for number in range(4)}
    logs = [{name: RawColumn(source=name, time=time, values=values) for name, values in columns.items()}]
    found = [
        ThrusterCommand(name=f"t{at}", source=f"t{at}", direction=0, neutral=0.0, lowest=-1.0, highest=1.0, reason="")
        for at in range(4)
    ]
    guess = guess_planar(logs, {"hdg"}, found, SignalGuess(source="hdg", unit="rad", reason=""))
    for axis, share in zip(("surge", "sway"), shares.T, strict=False):
        assert [guess.effects[axis][one.source].direction for one in found] == np.sign(share).tolist()
    text = "\n".join(share_lines("t1", [guess]))
    assert ("surge = 0.71 " in text, "sway = -0.71 " in text) == (True, True)


def test_a_share_that_the_logs_do_not_show_is_asked_for() -> None:
    block = tomllib.loads("\n".join(share_lines("t1", [PlanarGuess()])))
    assert block == {"surge": 1.0, "surge_guessed": 1.0, "sway": 0.0, "sway_guessed": 0.0}
    assert not PlanarGuess(effects={"surge": {}, "sway": {}}).suits
    shown = PlanarGuess(effects={"surge": {}, "sway": {"t1": CommandEffect(t_statistic=-9.0, size=0.2)}})
    assert shown.suits
    block = tomllib.loads("\n".join(share_lines("t1", [shown])))
    assert block == {"surge": 0.0, "surge_guessed": 0.0, "sway": -1, "sway_guessed": -1}
