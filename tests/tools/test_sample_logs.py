"""The simulator against another integrator, and the shipped files against what is said of them."""

from __future__ import annotations

import ast
import json
import re
import sys
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from scipy.integrate import odeint
from scipy.optimize import least_squares
from scipy.signal import butter, sosfiltfilt

from tests.conftest import ROOT, SAMPLES
from tools.programme import CAMPAIGN, LEAD, Hold, Run
from tools.simulate import MICRO, SUBSTEP, Held, disturbance_torque, simulate
from tools.t200_curve import thrust_curve
from tools.trial_day import main, write_trial_day
from tools.truth import OBSERVATION, ROSUB, Attitude, Disturbance, FloatArray, Instruments, Truth

# A simulator of the tests changes rarely, and none of rovid's code is tested here.
pytestmark = pytest.mark.slow

TANK = SAMPLES / "rosub_tank"
DIVE = SAMPLES / "bluerov2_pier59"
SEED = 1  # named in rosub_tank/README.md
STILL = ("coast_01", "steps", "multilevel", "fore_only")
HOLDS = [run for run in CAMPAIGN if run.name.startswith("hold_")]


def still(truth: Truth) -> Truth:
    """``truth`` without disturbance, noise, roll and pitch."""
    return replace(
        truth,
        disturbance=Disturbance(standard_deviation=0.0),
        attitude=Attitude(roll=0.0, pitch=0.0, wander=0.0),
        instruments=Instruments(angle_noise=0.0),
    )


@dataclass
class Series:
    """Time in s against value, of one topic."""

    time: FloatArray
    value: FloatArray


def messages(path: Path) -> list[tuple[str, int, Any]]:
    """(topic, log time in ns, decoded message) of every message, by the mcap library alone."""
    with path.open("rb") as stream:
        reader = make_reader(stream)
        factory = DecoderFactory()
        found: list[tuple[str, int, Any]] = []
        for schema, channel, message in reader.iter_messages():
            decode = factory.decoder_for(channel.message_encoding, schema) or json.loads
            found.append((channel.topic, message.log_time, decode(message.data)))
    return found


def payloads(path: Path) -> list[tuple[str, int, bytes]]:
    with path.open("rb") as stream:
        return [(c.topic, m.log_time, m.data) for _, c, m in make_reader(stream).iter_messages()]


def logged(path: Path) -> dict[str, Series]:
    """heading in deg, fore and aft in V of a log of either kind; time 0 as in CSV is the first command's."""
    if path.suffix == ".csv":
        table = pd.read_csv(path)
        time = table["time_s"].to_numpy(dtype=np.float64)
        names = {"heading": "heading_deg", "fore": "fore_V", "aft": "aft_V"}
        return {key: Series(time, table[name].to_numpy(dtype=np.float64)) for key, name in names.items()}
    topics = {"heading": "/phins/heading", "fore": "/thrusters/fore", "aft": "/thrusters/aft"}
    everything = messages(path)
    # Runs of a day start on whole seconds; the log begins some milliseconds later.
    start = everything[0][1] // 1_000_000_000 * 1_000_000_000
    series = {}
    for key, topic in topics.items():
        times = [(log_time - start) / 1e9 for name, log_time, _ in everything if name == topic]
        values = [
            message["data"] if isinstance(message, dict) else message.data
            for name, _, message in everything
            if name == topic
        ]
        series[key] = Series(np.array(times), np.array(values, dtype=np.float64))
    return series


def run_path(folder: Path, run: Run) -> Path:
    (path,) = folder.glob(f"{run.name}.*")
    return path


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("day")
    write_trial_day(folder, seed=SEED)
    return folder


@pytest.fixture(scope="module")
def still_day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("still")
    write_trial_day(folder, seed=SEED, truth=still(ROSUB), campaign=[run for run in CAMPAIGN if run.name in STILL])
    return folder


def test_tools_never_import_rovid() -> None:
    for path in (ROOT / "tools").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert not any(name.split(".")[0] == "rovid" for name in names), path


def test_shipped_day_has_the_files_of_the_campaign(day: Path) -> None:
    assert {path.name for path in TANK.iterdir()} - {"README.md"} == {path.name for path in day.iterdir()}


@pytest.mark.parametrize("suffix", [".csv", ".toml"])
def test_shipped_text_is_regenerated_byte_for_byte(day: Path, suffix: str) -> None:
    for path in sorted(TANK.glob(f"*{suffix}")):
        assert path.read_bytes() == (day / path.name).read_bytes(), path.name


def test_shipped_mcap_is_regenerated_message_for_message(day: Path) -> None:
    for path in sorted(TANK.glob("*.mcap")):
        assert payloads(path) == payloads(day / path.name), path.name


def test_the_day_that_hides_something_is_regenerated_as_its_readme_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = " ".join((SAMPLES / "rosub_hidden" / "README.md").read_text().replace("\\\n", " ").split())
    command = re.search(r"python -m tools\.trial_day sample_logs/rosub_hidden (.*? coast_02)", said)
    assert command is not None
    monkeypatch.setattr(sys, "argv", ["trial_day", str(tmp_path), *command[1].split()])
    main()
    names = {path.name for path in (SAMPLES / "rosub_hidden").iterdir()} - {"README.md"}
    assert names == {path.name for path in tmp_path.iterdir()}
    for name in names:
        assert (tmp_path / name).read_bytes() == (SAMPLES / "rosub_hidden" / name).read_bytes(), name


def test_what_cannot_be_hidden_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["trial_day", str(tmp_path), "--hide", "gremlins:1"])
    with pytest.raises(SystemExit):
        main()


def test_another_seed_is_another_day_under_the_same_commands(tmp_path: Path) -> None:
    run = CAMPAIGN[0]
    for seed in (1, 2):
        write_trial_day(tmp_path / str(seed), seed=seed, formats="csv", campaign=[run])
    one, two = (pd.read_csv(tmp_path / str(seed) / f"{run.name}.csv") for seed in (1, 2))
    assert (one["fore_V"] == two["fore_V"]).all()
    assert (one["heading_deg"] != two["heading_deg"]).mean() > 0.99


def test_csv_day_has_no_mcap(tmp_path: Path) -> None:
    write_trial_day(tmp_path, seed=5, formats="csv", truth=OBSERVATION)
    assert {path.suffix for path in tmp_path.iterdir()} == {".csv", ".toml"}
    assert len(list(tmp_path.glob("*.csv"))) == len(CAMPAIGN) + 1


def integrated(series: dict[str, Series]) -> FloatArray:
    """Heading in rad since the first sample, from the logged commands by scipy, event by event."""
    heading = series["heading"].time
    events = np.unique(np.concatenate([[0.0], *(s.time for s in series.values())]))
    state, states = np.zeros(2), [np.zeros(2)]
    dynamics = ROSUB.dynamics
    for begin, end in pairwise(events.tolist()):
        torque = 0.0
        for thruster in ROSUB.thrusters:
            command = series[thruster.name]
            index = int(np.searchsorted(command.time, begin, side="right")) - 1
            volts = command.value[max(index, 0)]
            torque += thruster.yaw_arm * float(thruster.curve.thrust(np.array([volts]))[0])

        def slope(_: float, y: FloatArray, torque: float = torque) -> list[float]:
            drag = (dynamics.quadratic_drag * abs(y[1]) + dynamics.linear_drag) * y[1]
            return [y[1], (torque - drag) / dynamics.inertia]

        state = odeint(slope, state, (begin, end), rtol=1e-9, atol=1e-12, tfirst=True)[-1]
        states.append(state)
    angle = np.array(states)[np.searchsorted(events, heading), 0]
    return np.asarray(angle - angle[0])


@pytest.mark.parametrize("name", STILL)
def test_logged_commands_reproduce_the_logged_heading(still_day: Path, name: str) -> None:
    run = next(run for run in CAMPAIGN if run.name == name)
    series = logged(run_path(still_day, run))
    measured = np.unwrap(series["heading"].value, period=360.0)
    # Both ends of each difference are rounded to 0.001 deg.
    np.testing.assert_allclose(measured - measured[0], np.degrees(integrated(series)), rtol=0.0, atol=0.0011)


@pytest.mark.parametrize("run", HOLDS, ids=lambda run: run.name)
def test_every_shipped_hold_turns_at_its_analytic_rate(run: Run) -> None:
    series = logged(run_path(TANK, run))
    heading, command = series["heading"], series["fore"]
    ends = LEAD + np.cumsum([piece.duration for piece in run.pieces])
    for piece, end in zip(run.pieces, ends, strict=True):
        if not isinstance(piece, Hold) or piece.volts == 0.0:
            continue
        late = (heading.time > end - 60.0) & (heading.time < end)
        slope = np.polyfit(heading.time[late], np.unwrap(np.radians(heading.value[late])), 1)[0]
        dynamics = ROSUB.dynamics
        volts = float(command.value[np.searchsorted(command.time, end - 1.0)])
        expected = dynamics.steady_rate(ROSUB.yaw_torque(volts))
        damping = 2.0 * dynamics.quadratic_drag * abs(expected) + dynamics.linear_drag
        # The mean disturbance of 60 s; a slope weighs it unevenly, hence the 1.2.
        disturbance = ROSUB.disturbance
        spread = np.sqrt(1.2 * 2.0 * disturbance.correlation_time / 60.0) * disturbance.standard_deviation
        assert abs(slope - expected) < 3.0 * spread / damping, piece  # 3 sigma, fixed seed


@pytest.mark.parametrize("truth", [ROSUB, OBSERVATION], ids=lambda truth: truth.name.split()[0])
def test_integration_has_converged(truth: Truth) -> None:
    quiet = replace(truth, disturbance=Disturbance(standard_deviation=0.0))
    # One of each kind.
    runs = {run.name: run for run in CAMPAIGN}
    for name in ("hold_07", "sine_20s", "staircase", "coast_01", "steps", "multilevel", "aft_only"):
        run = runs[name]
        sample = np.arange(0, int(run.duration * MICRO) + 1, 50_000)
        held = Held(instant=sample + 3_700, value=run.command(sample / MICRO))
        coarse, fine = (
            simulate(quiet, (held, held), sample, np.random.default_rng(0), substep=substep)
            for substep in (SUBSTEP, SUBSTEP // 2)
        )
        # A hundredth of the heading's noise.
        np.testing.assert_allclose(np.degrees(coarse.heading), np.degrees(fine.heading), rtol=0.0, atol=1e-4)


def test_disturbance_has_the_stated_size_and_memory() -> None:
    knots = np.arange(0, 40_000 * MICRO, 200_000, dtype=np.int64)
    torque = disturbance_torque(ROSUB.disturbance, knots, np.random.default_rng(3))
    lag = 20  # 4 s, the correlation time
    # 10 000 correlation times: 0.7 % is one standard error of the first, 0.01 about one of the second.
    assert np.std(torque) == pytest.approx(2.5, rel=0.03)
    assert np.mean(torque[lag:] * torque[:-lag]) / np.var(torque) == pytest.approx(np.exp(-1.0), abs=0.04)


def test_curve_table_is_the_true_curve_to_its_stated_error() -> None:
    table = pd.read_csv(TANK / "thrust_curve.csv")
    command = np.linspace(-5.0, 5.0, 20_001)
    interpolated = np.interp(command, table["command"], table["thrust_N"])
    exact = ROSUB.thrusters[0].curve.thrust(command)
    np.testing.assert_allclose(interpolated, exact, rtol=0.0, atol=0.0024)  # N, as the README has it


def test_ros2_quaternion_is_the_heading_north_east_down() -> None:
    found = messages(TANK / "sine_20s.mcap")
    headings = {time: message.data for topic, time, message in found if topic == "/phins/heading"}
    orientations = [(time, message.orientation) for topic, time, message in found if topic == "/phins/imu"]
    assert len(orientations) == len(headings) > 3000
    for time, q in orientations:
        yaw = np.degrees(np.arctan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2)))
        assert (yaw - headings[time] + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=1e-9)


def test_json_header_stamp_is_the_log_time() -> None:
    for topic, time, message in messages(TANK / "steps.mcap"):
        if topic.startswith("/phins/"):
            stamp = message["header"]["stamp"]
            assert stamp["sec"] * 1_000_000_000 + stamp["nanosec"] == time


def test_paper_tables_are_the_papers() -> None:
    steady = pd.read_csv(SAMPLES / "rosub_paper" / "table3.csv")
    assert list(steady.columns) == ["command", "yaw_rate_rad_s", "torque_Nm"]
    # Equal steps of 5 kgf on each thruster at a total arm of 0.859 m, rounded to 0.1 N m.
    np.testing.assert_allclose(steady["torque_Nm"], 42.14 * np.arange(1, 6), atol=0.06)
    second = pd.read_csv(SAMPLES / "rosub_paper" / "sine_trials.csv").iloc[1]
    difference = second["torque_amplitude_Nm"] - second["steady_torque_Nm"]
    assert difference / second["peak_acceleration_rad_s2"] == pytest.approx(5057.0)


@pytest.fixture(scope="module")
def dive() -> dict[str, pd.DataFrame]:
    """Topic -> fields of dive.mcap against time_s."""
    rows: dict[str, list[dict[str, float]]] = {}
    for topic, time, message in messages(DIVE / "dive.mcap"):
        rows.setdefault(topic, []).append({"time_s": time / 1e9, **message})
    return {topic: pd.DataFrame(fields) for topic, fields in rows.items()}


def test_dive_is_the_same_in_both_formats(dive: dict[str, pd.DataFrame]) -> None:
    table = pd.read_csv(DIVE / "dive.csv")
    np.testing.assert_allclose(table["t_s"], dive["/ATT"]["time_s"], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(table["heading_deg"], dive["/ATT"]["Yaw"], rtol=0.0, atol=1e-6)
    rates = {topic: (len(rows) - 1) / np.ptp(rows["time_s"]) for topic, rows in dive.items()}
    expected = {"/ATT": 10, "/RATE": 10, "/RCOU": 10, "/BAT": 10, "/IMU": 25}
    assert {topic: round(rate) for topic, rate in rates.items()} == expected


def test_t200_curve_is_the_bench_table_in_newtons(tmp_path: Path) -> None:
    shipped = pd.read_csv(DIVE / "t200_16V_curve.csv")
    made = thrust_curve(DIVE / "t200_16V_bench.csv")
    np.testing.assert_allclose(shipped.to_numpy(), made.to_numpy(), rtol=1e-5)
    assert np.interp([1100.0, 1500.0, 1900.0], shipped["command"], shipped["thrust_N"]) == pytest.approx(
        [-4.06948 * 9.80665, 0.0, 5.24504 * 9.80665], rel=1e-5
    )
    rough = tmp_path / "bench.csv"
    rough.write_text(" PWM (µs), Force (Kg f)\n1500,0\n1600,1\n1600,3\n,4\n1700,\n", encoding="utf-8")
    np.testing.assert_allclose(thrust_curve(rough), [[1500.0, 0.0], [1600.0, 19.6133]])


def _yaw_torque(dive: dict[str, pd.DataFrame]) -> FloatArray:
    curve = pd.read_csv(DIVE / "t200_16V_curve.csv")
    pulses = dive["/RCOU"]
    return sum(
        (
            arm * np.interp(pulses[f"C{k}"], curve["command"], curve["thrust_N"])
            for k, arm in enumerate((-0.167, 0.167, -0.167, 0.167), start=1)
        ),
        start=np.zeros(len(pulses)),
    )


def test_dive_signs_agree_with_the_autopilots_yaw_output(dive: dict[str, pd.DataFrame]) -> None:
    rate = dive["/RATE"]
    output = np.interp(dive["/RCOU"]["time_s"], rate["time_s"], rate["YOut"])
    pulses = dive["/RCOU"][[f"C{k}" for k in range(1, 5)]].to_numpy(dtype=np.float64) - 1500.0
    regression = np.column_stack([pulses, np.ones(len(pulses))])
    weights, *_ = np.linalg.lstsq(regression, output)
    assert np.sign(weights[:4]).tolist() == [-1.0, 1.0, -1.0, 1.0]
    assert np.var(output - regression @ weights) < 0.001 * np.var(output)


def test_dive_is_explained_by_the_bench_curve_as_its_readme_says(dive: dict[str, pd.DataFrame]) -> None:
    time = np.arange(0.1, 199.8, 0.02)
    pulses, gyro = dive["/RCOU"]["time_s"].to_numpy(), dive["/IMU"]
    torque = _yaw_torque(dive)[np.searchsorted(pulses, time, side="right") - 1]
    rate = np.interp(time, gyro["time_s"], gyro["GyrZ"])
    sections = butter(2, 1.0, fs=50.0, output="sos")

    def smooth(series: FloatArray) -> FloatArray:
        return np.asarray(sosfiltfilt(sections, series))

    def misfit(parameters: FloatArray) -> FloatArray:
        inertia, damping = parameters
        # Exact for a held torque; quadratic drag is left out, for free fits put it at zero.
        decay = np.exp(-damping / inertia * 0.02)
        simulated = np.empty(len(time))
        simulated[0] = rate[0]
        for k in range(len(time) - 1):
            simulated[k + 1] = decay * simulated[k] + (1.0 - decay) * torque[k] / damping
        return smooth(simulated) - smooth(rate)

    fit = least_squares(misfit, [1.0, 3.0], bounds=([0.05, 0.01], [50.0, 50.0]))
    assert fit.x == pytest.approx([2.5, 5.3], abs=0.1)
    assert 1.0 - np.var(fit.fun) / np.var(smooth(rate)) == pytest.approx(0.89, abs=0.01)
