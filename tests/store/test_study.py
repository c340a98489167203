"""Content of LOGS, and requests that are refused early."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import ConfigError, DataError
from rovid.core.output_files import PLAN, OutputFile, OutputSet
from rovid.diagnose import log_rivals
from rovid.diagnose.result import Diagnosis
from rovid.effects import effect_named
from rovid.store.parameter_file import Entry, Parameters
from rovid.store.study import Study, input_files, open_study
from rovid.trial.axis import AXES
from tests.conftest import SAMPLES

PAPER = SAMPLES / "rosub_paper"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Study:
    """A hold and a sine of the sample day."""
    folder = tmp_path_factory.mktemp("logs")
    for name in ("rovid.toml", "thrust_curve.csv", "hold_03.csv", "sine_40s_a.csv"):
        shutil.copy(SAMPLES / "rosub_tank" / name, folder)
    return open_study([folder])


@pytest.fixture(scope="module")
def tables() -> Study:
    return open_study([PAPER])


def test_logs_have_runs_and_tables_none(logs: Study, tables: Study) -> None:
    assert logs.runs is not None
    assert len(logs.runs.items) == 2
    assert tables.runs is None
    assert tables.steady == PAPER / "table3.csv"
    assert tables.position_noise() is None


def test_the_median_torque_ignores_zeros(logs: Study, tables: Study) -> None:
    assert logs.runs is not None
    torque = np.abs(np.concatenate([run.torque for run in logs.runs.items]))
    assert logs.median_torque() == np.median(torque[torque > 0.0])
    assert tables.median_torque() is not None


def test_effects_on_missing_trials_or_signals_are_refused(logs: Study) -> None:
    logs.require_effects([effect_named("thruster_lag"), effect_named("thruster_imbalance:fore")])
    with pytest.raises(
        ConfigError, match=r"thruster_imbalance:for: does not suit .*Nearest: 'thruster_imbalance:fore'"
    ):
        logs.require_effects([effect_named("thruster_imbalance:for")])
    with pytest.raises(ConfigError, match="restoring_curve: does not exist for yaw"):
        logs.require_effects([effect_named("restoring_curve")])
    with pytest.raises(ConfigError, match="needs surge_velocity, which not all of these logs hold"):
        logs.likelihood((effect_named("speed_dependent_damping"),))


def test_the_file_of_another_vehicle_is_named_with_a_remedy(logs: Study) -> None:
    entry = Entry(value=1.1, standard_error=0.1, unit="1", method="")
    stored = Parameters(path=Path("p.toml"), entries={"thruster_imbalance:bow.gain": entry})
    with pytest.raises(ConfigError, match=r"p\.toml: holds an effect .*thruster_imbalance:bow: .* give -p") as caught:
        logs.require_stored_effects(stored)
    assert "another vehicle" in str(caught.value)


def test_tables_have_no_time_series(tables: Study) -> None:
    with pytest.raises(DataError, match="holds no time series"):
        tables.likelihood()
    with pytest.raises(ConfigError, match=r"--axis: .*is a table of yaw"):
        open_study([PAPER], axis=AXES["surge"])


def test_notes_of_a_diagnosis_mark_numbers_of_guessed_arms(logs: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    note = "This may change the inertia by up to 6.7 kg m^2."
    monkeypatch.setattr(log_rivals, "diagnose_logs", lambda *_: Diagnosis(verdict="too_little_data", warnings=(note,)))
    thrusters = tuple(replace(one, arm_guessed=True) for one in logs.vehicle.thrusters)
    guessed = replace(logs, vehicle=replace(logs.vehicle, thrusters=thrusters))
    assert guessed.diagnosis().warnings == ("This may change the inertia by up to guessed 6.7 kg m^2.",)
    assert logs.diagnosis().warnings == (note,)


def test_input_files_are_logs_config_and_curves_but_no_plan(tmp_path: Path) -> None:
    for name in ("rovid.toml", "thrust_curve.csv", "hold_03.csv"):
        shutil.copy(SAMPLES / "rosub_tank" / name, tmp_path)
    planned = OutputFile(tmp_path / "plan.csv", PLAN)
    OutputSet([planned]).write({planned: '"time_s",fore\n0,1\n'})
    assert {path.name for path in input_files([tmp_path])} == {"rovid.toml", "thrust_curve.csv", "hold_03.csv"}
    assert input_files([]) == []
