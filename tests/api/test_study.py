"""Studies and records: the numbers of the commands, from folders and from memory, without a file or a word."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import rovid
from rovid.core.errors import ConfigError, LogError, OutputError
from tests.conftest import SAMPLES, run_rovid, write_short_day

DAY = SAMPLES / "rosub_tank"
RUNS = ("hold_05", "sine_40s_a")
SIGNALS = {"time": "time_s", "heading": "heading_deg", "supply_voltage": "supply_V"}


def table() -> pd.DataFrame:
    return pd.concat([pd.read_csv(DAY / f"{run}.csv").assign(run=f"{run}.csv") for run in RUNS])


def described(data: Any, **changes: Any) -> rovid.Study:
    curve = pd.read_csv(DAY / "thrust_curve.csv")
    thrusters = [{"name": n, "yaw_arm": 0.43, "curve": curve, "command": f"{n}_V"} for n in ("fore", "aft")]
    given: dict[str, Any] = {"signals": SIGNALS, "thrusters": thrusters, "run": "run"} | changes
    return rovid.Study.from_frame(data, **given)


def test_import_is_instant_and_loads_nothing_heavy() -> None:
    code = (
        "import sys, time; t = time.process_time(); import rovid; spent = time.process_time() - t\n"
        "print(spent, [name for name in ('numpy', 'pandas', 'scipy', 'matplotlib', 'numba') if name in sys.modules])"
    )
    best = 1.0
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        spent, _, heavy = done.stdout.strip().partition(" ")
        assert heavy == "[]"
        best = min(best, float(spent))
    assert best < 0.15  # s, the promise; of the processor, because other work shares the machine


def test_memory_a_folder_and_the_command_give_one_document(
    tmp_path: Path, here: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "day"
    write_short_day(folder, runs=RUNS)
    of_folder, of_memory = rovid.open(folder).fit(), described(table()).fit()
    assert [*here.iterdir()] == []
    assert sorted(path.name for path in folder.iterdir()) == [
        "hold_05.csv",
        "rovid.toml",
        "sine_40s_a.csv",
        "thrust_curve.csv",
    ]
    assert capfd.readouterr() == ("", "")
    by_command = run_rovid("fit", folder, "--json").document
    assert json.loads(of_folder.to_json()) == by_command
    assert by_command["warnings"] == list(of_folder.warnings)
    # Roll and pitch, which rovid.toml maps in addition, do not move the heading of this vehicle by a tenth of an error.
    for name, value in of_memory.parameters.items():
        assert value.value == pytest.approx(of_folder.parameters[name].value, abs=0.1 * value.standard_error)
    described_frame = of_memory.to_pandas()
    assert described_frame.loc["inertia", "value"] == of_memory.parameters["inertia"].value
    assert "inertia" in repr(of_memory)


def test_arrays_a_frame_and_dates_are_the_same_study() -> None:
    frame = table()
    arrays = {str(name): frame[name].to_numpy() for name in frame.columns}
    dated = frame.assign(time_s=pd.Timestamp("2026-03-01") + pd.to_timedelta(frame["time_s"], unit="s"))
    one, *others = (described(data).logs.campaign for data in (frame, arrays, dated))
    assert one is not None
    for other in others:
        assert other is not None
        for first, second in zip(one.trials, other.trials, strict=True):
            np.testing.assert_allclose(first.time, second.time, atol=1e-6)  # s, the digits of a float date
            np.testing.assert_array_equal(first.position, second.position)
            np.testing.assert_array_equal(first.commands, second.commands)


class Display:
    """IPython's display in a notebook: what one output shows, in turn."""

    def __init__(self) -> None:
        self.shown: list[str] = []

    def display(self, bundle: dict[str, str], *, raw: bool, display_id: bool) -> Display:
        assert raw
        assert display_id
        self.update(bundle, raw=raw)
        return self

    def update(self, bundle: dict[str, str], *, raw: bool) -> None:
        self.shown.append(bundle["text/plain"])


def test_a_notebook_shows_progress_below_the_cell_and_takes_it_away(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = Display()
    shell = SimpleNamespace(get_ipython=lambda: SimpleNamespace(kernel="ipykernel"))
    monkeypatch.setitem(sys.modules, "IPython", shell)
    monkeypatch.setitem(sys.modules, "IPython.display", SimpleNamespace(display=cell.display))
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    checked = described(table().head(500)).check()
    # Shown by the notebook, once, and not by printing too.
    assert "can be fitted" in checked._repr_html_()
    assert "can be fitted" in repr(checked)
    assert cell.shown == ["Checking the logs …", ""]
    cell.shown.clear()
    with pytest.raises(rovid.RovidError):
        rovid.open(DAY, axis="heave").diagnose()
    assert (cell.shown[0], cell.shown[-1]) == ("Reading the logs …", "")
    cell.shown.clear()
    shell.get_ipython = lambda: None  # as in a script that has imported IPython
    described(table().head(500)).check()
    assert cell.shown == []


def curve(value: Any) -> dict[str, Any]:
    return {"thrusters": [{"name": "fore", "yaw_arm": 0.43, "curve": value, "command": "fore_V"}]}


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"signals": {**SIGNALS, "heading": "headin_deg"}}, r"heading: is 'headin_deg'.*heading_deg"),
        ({"signals": {"time": "time_s"}}, r"has no heading"),
        ({"signals": {"heading": "heading_deg"}}, r"\[signals\] time: names no column"),
        ({"signals": {**SIGNALS, "heading": {"column": "heading_deg", "unit": "degrees"}}}, r"one of deg, rad"),
        (curve([1.0, 2.0, 3.0]), r"number 1 curve: is of the type list.*commands, thrusts in N"),
        (curve(([1.0, 1.0], [2.0, 3.0])), r"two or more different commands were expected"),
        ({"run": "trial"}, r"run: is 'trial'"),
        ({"axis": "yam"}, r"yam"),
        ({"cutoff": -1.0}, r"cutoff: is -1; a positive number"),
    ],
)
def test_a_wrong_description_is_one_clear_message(changes: dict[str, Any], wanted: str) -> None:
    with pytest.raises(ConfigError, match=wanted):
        described(table().head(500), **changes)


def test_a_limit_below_zero_is_one_clear_message() -> None:
    study = described(table().head(500))
    with pytest.raises(ConfigError, match="budget: is 0; a positive number"):
        study.diagnose(budget=0.0)
    with pytest.raises(ConfigError, match="share: is -1; a positive number"):
        study.plan(share=-1.0)
    with pytest.raises(ConfigError, match="relevant_change: is nan; a positive number"):
        study.compare(study, relevant_change=np.nan)


def test_a_coupled_study_takes_rudders_and_speeds_from_memory() -> None:
    time = np.arange(0.0, 60.0, 0.1)
    columns = {
        "t": time,
        "psi": 0.1 * np.sin(0.1 * time),
        "volts": np.full(600, 2.0),
        "angle": 20.0 * np.sin(0.2 * time),
    }
    study = rovid.Study.from_frame(
        columns | {"u": 0.5 + 0.1 * np.sin(time), "v": 0.1 * np.cos(time)},
        axes="planar",
        signals={"time": "t", "heading": {"column": "psi", "unit": "rad"}, "surge_velocity": "u", "sway_velocity": "v"},
        thrusters=[{"name": "stern", "surge": 1.0, "curve": ([-5.0, 5.0], [-50.0, 50.0]), "command": "volts"}],
        rudders=[{"name": "fin", "position": [-1.5, 0.0], "area": 0.01, "behind": "stern", "angle": "angle"}],
    )
    assert study.coupled is not None
    (run,) = study.coupled.data.runs
    assert run.sensors == ("heading", "surge_velocity", "sway_velocity")
    np.testing.assert_allclose(run.trial.commands[:, 1], np.radians(columns["angle"]), atol=1e-12)
    assert study.check().document["axes"] == "planar"


def test_a_cell_that_is_no_number_is_named() -> None:
    frame = table().head(500).astype({"fore_V": object})
    frame.loc[16, "fore_V"] = "off"
    with pytest.raises(LogError, match=r"hold_05.csv: row 17: fore_V is 'off'"):
        described(frame)
    with pytest.raises(ConfigError, match="same length"):
        described({"time_s": [0.0, 1.0], "heading_deg": [0.0]})


@pytest.mark.slow
def test_bad_logs_and_saved_files(tmp_path: Path) -> None:
    study = described(
        table(),
        thrusters=[
            {**curve(([-5.0, 5.0], [100.0, -100.0]))["thrusters"][0], "command": one, "name": one}
            for one in ("fore_V", "aft_V")
        ],
    )
    diagnosis = study.diagnose()
    assert (diagnosis.verdict, diagnosis.findings) == ("bad_logs", ())
    with pytest.raises(rovid.RovidError, match="no prediction errors to plot: its verdict is bad_logs"):
        diagnosis.plot()
    with pytest.raises(rovid.RovidError, match="the diagnosis has no model"):
        study.export("json", diagnosis)
    exported = described(table()).export("mujoco")
    target = exported.save(tmp_path / "model.xml")
    assert target.read_text() == exported.content
    target.write_text("mine")
    with pytest.raises(OutputError, match=r"model\.xml"):
        exported.save(target)
