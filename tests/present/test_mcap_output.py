"""`rovid simulate --mcap`: what Foxglove and PlotJuggler are given."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from mcap.reader import make_reader

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError
from rovid.present.residuals import recording_outputs
from rovid.readers import read_log
from rovid.trial.config import load_config
from rovid.trial.trial import Trial
from tests.conftest import SAMPLES, Rovid, run_rovid
from tests.whole.test_bad_input import assert_one_message

TANK = SAMPLES / "rosub_tank"
LOGS = ("steps.mcap", "sine_40s_a.csv", "hold_03.csv")
FIELDS = {
    "/yaw_rate": {"measured_rad_s", "simulated_rad_s", "residual_rad_s"},
    "/heading": {"measured_deg", "simulated_deg"},
    "/torque": {"drive_Nm", "disturbance_Nm"},
    "/commands": {"fore", "aft"},
}


@dataclass(frozen=True)
class Series:
    """(n,) s and (n,) values of one field."""

    time: FloatArray
    values: FloatArray


def fields_of(path: Path) -> dict[str, dict[str, Series]]:
    """Topic -> field -> series, after every message was held against its schema."""
    rows: dict[str, dict[str, list[tuple[float, float]]]] = {}
    last = 0
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        count = 0
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            fields = json.loads(message.data)
            Draft202012Validator(json.loads(schema.data)).validate(fields)
            assert message.log_time >= last
            last, count = message.log_time, count + 1
            for name, value in fields.items():
                rows.setdefault(channel.topic, {}).setdefault(name, []).append((message.log_time * 1e-9, value))
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == count
    return {topic: {name: Series(*np.array(pairs).T) for name, pairs in found.items()} for topic, found in rows.items()}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three logs and their parameters."""
    folder = tmp_path_factory.mktemp("recordings")
    (folder / "logs").mkdir()
    for name in ("rovid.toml", "thrust_curve.csv", *LOGS):
        shutil.copy(TANK / name, folder / "logs" / name)
    assert run_rovid("fit-inertia", folder / "logs", "-p", folder / "parameters.toml").code == 0
    return folder


def simulate(folder: Path, *arguments: object) -> list[Path]:
    document = run_rovid("simulate", "-p", folder / "parameters.toml", *arguments, "--json").document
    return [Path(name) for name in document["recordings"]]


@pytest.mark.slow
def test_a_file_for_each_trial(folder: Path, tmp_path: Path) -> None:
    paths = simulate(folder, "--mcap", tmp_path / "out")
    assert sorted(paths) == [tmp_path / "out" / Path(name).with_suffix(".mcap") for name in sorted(LOGS)]
    config = load_config(folder / "logs" / "rovid.toml")
    for path in paths:
        fields = fields_of(path)
        assert {topic: set(inside) for topic, inside in fields.items()} == FIELDS
        log = next(name for name in LOGS if Path(name).stem == path.stem)
        assert_measured(fields, read_log(folder / "logs" / log, config))


def assert_measured(fields: dict[str, dict[str, Series]], trial: Trial) -> None:
    measured = fields["/heading"]["measured_deg"]
    np.testing.assert_allclose(measured.time, trial.time[trial.measured], atol=1e-9)
    np.testing.assert_allclose(np.deg2rad(measured.values), trial.position[trial.measured], rtol=1e-12)
    for name, values in zip(("fore", "aft"), trial.commands.T, strict=True):
        np.testing.assert_allclose(fields["/commands"][name].values, values)
    rate = fields["/yaw_rate"]
    time = rate["residual_rad_s"].time
    simulated = np.interp(time, rate["simulated_rad_s"].time, rate["simulated_rad_s"].values)
    own = np.interp(time, rate["measured_rad_s"].time, rate["measured_rad_s"].values)
    np.testing.assert_allclose(rate["residual_rad_s"].values, own - simulated, atol=1e-9)
    # The logs were made with these parameters and little else, so the simulation is near and little is left over.
    assert np.std(rate["residual_rad_s"].values) < 0.1 * np.std(own)
    torque = fields["/torque"]
    assert np.std(torque["disturbance_Nm"].values) < 0.3 * np.max(np.abs(torque["drive_Nm"].values))


def test_a_single_trial_may_be_a_file(folder: Path, tmp_path: Path) -> None:
    log = folder / "logs" / "steps.mcap"
    assert simulate(folder, log, "--mcap", tmp_path / "one.mcap") == [tmp_path / "one.mcap"]
    assert simulate(folder, log, "--mcap", tmp_path / "in") == [tmp_path / "in" / "steps.mcap"]
    assert set(fields_of(tmp_path / "one.mcap")) == set(FIELDS)


def test_one_file_for_several_trials_is_refused(folder: Path, tmp_path: Path, rovid: Rovid) -> None:
    done = rovid("simulate", "-p", folder / "parameters.toml", "--mcap", tmp_path / "one.mcap")
    assert_one_message(done, "--mcap", "3 trials", "name a folder")


def test_no_log_is_written_over(folder: Path, rovid: Rovid) -> None:
    done = rovid("simulate", "-p", folder / "parameters.toml", "--mcap", folder / "logs")
    assert_one_message(done, "would write over the log", "steps.mcap")


def trials(*names: str) -> list[Trial]:
    time = np.arange(3.0)
    return [Trial.from_commands(time, np.zeros((3, 1)), name=name) for name in names]


def test_names_stay_apart_and_inside_the_folder(tmp_path: Path) -> None:
    elsewhere = (tmp_path / "mon" / "a.csv").as_posix()
    made = recording_outputs(tmp_path / "out", trials("a.csv", "a.BIN", "b/a.csv", elsewhere, "../c.csv"))
    paths = [output.path for output in made]
    assert len(set(paths)) == 5
    assert paths[:3] == [tmp_path / "out" / name for name in ("a.csv.mcap", "a.BIN.mcap", "b/a.mcap")]
    assert all((tmp_path / "out") in path.resolve().parents for path in paths)


def test_a_file_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").mkdir()
    assert recording_outputs(tmp_path / "x.mcap", trials("a.csv", "b.csv"))[0].path == tmp_path / "x.mcap" / "a.mcap"
    with pytest.raises(ConfigError, match="2 trials"):
        recording_outputs(tmp_path / "y.mcap", trials("a.csv", "b.csv"))
