"""The history of a parameter file, and updates of both files by several processes."""

from __future__ import annotations

import json
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from rovid.core.errors import OutputError
from rovid.core.output_files import OutputSet
from rovid.store.load import history_output, read_history, read_parameters, update_parameters
from rovid.store.parameter_file import Parameters, Source
from rovid.trial.axis import AXES
from tests.conftest import Rovid
from tests.store.test_parameter_file import NAMES, estimate, written
from tests.whole.test_bad_input import assert_one_message
from tools.programme import Hold, Run, Sine
from tools.trial_day import write_trial_day


def claim_for(stored: Parameters) -> OutputSet:
    return OutputSet([stored.output, history_output(stored.path)])


def added(stored: Parameters, digest: str, scale: float = 1.0, seen: dict[str, float] | None = None) -> Parameters:
    source = Source(name=f"{digest}.csv", sha256=digest, samples=7)
    changed = replace(stored.with_estimate(estimate(scale=scale)), sources=(source,))
    return update_parameters(changed, claim_for(changed), lambda _: changed, detection_limits=seen or {})


def test_records_are_read_latest_first(tmp_path: Path) -> None:
    stored = written(tmp_path)
    models = [added(stored, "a"), added(stored, "b", 2.0, {"thruster_lag": 0.1, "slew_limit": float("inf")})]
    records = list(read_history(stored.path))
    assert [record.parameters.entries for record in records] == [one.entries for one in reversed(models)]
    assert [record.digests for record in records] == [{"b"}, {"a"}]
    assert [dict(record.detection_limits) for record in records] == [{"thruster_lag": 0.1}, {}]
    assert all(record.version and record.written.startswith("20") for record in records)


def test_an_equal_model_adds_no_line(tmp_path: Path) -> None:
    stored = written(tmp_path)
    for digest in ("a", "a", "b", "a"):
        added(stored, digest)
    assert [record.digests for record in read_history(stored.path)] == [{"a"}, {"b"}, {"a"}]


def test_the_history_only_grows(tmp_path: Path) -> None:
    stored = written(tmp_path)
    added(stored, "a")
    before = history_output(stored.path).path.read_text()
    added(stored, "b")
    assert history_output(stored.path).path.read_text().startswith(before)


def test_no_record_of_two_writers_is_lost(tmp_path: Path) -> None:
    stored = written(tmp_path)
    writers = [threading.Thread(target=lambda k=k: [added(stored, f"{k}-{n}") for n in range(10)]) for k in range(2)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert len(list(read_history(stored.path))) == 20


def test_a_damaged_history_still_grows(tmp_path: Path) -> None:
    stored = written(tmp_path)
    added(stored, "a")
    path = history_output(stored.path).path
    damaged = path.read_bytes() + b"\xff cut"
    path.write_bytes(damaged)
    added(stored, "b")
    assert path.read_bytes().startswith(damaged + b"\n{")


def test_a_foreign_file_is_kept(tmp_path: Path) -> None:
    stored = written(tmp_path)
    path = history_output(stored.path).path
    path.write_text("mine")
    with pytest.raises(OutputError, match="is not a history"):
        claim_for(stored)
    assert path.read_text() == "mine"


def test_a_long_name_is_cut(tmp_path: Path) -> None:
    output = history_output(tmp_path / ("ü" * 120 + ".toml"))
    output.path.write_text("")
    assert output.path.suffix == ".history"


def test_joint_fits_write_the_history(rovid: Rovid, tmp_path: Path) -> None:
    day = tmp_path / "day"
    runs = (
        Run(name="holds", pieces=tuple(Hold(volts, 60.0) for volts in (1.04, 1.94, -1.97, -1.0, 1.5, -1.5))),
        Run(name="sine", pieces=(Sine(2.0, 2.51, 20.0, 5),)),
    )
    write_trial_day(day, seed=3, formats="csv", campaign=runs)
    assert rovid("fit-drag", day).code == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["day", "parameters.toml"]
    for arguments in (["fit"], ["fit"], ["fit", "--effect", "bias_torque"]):
        assert rovid(*arguments).code == 0
    lines = (tmp_path / "parameters.history").read_text().splitlines()
    assert len(lines) == 3  # a head, and two models
    assert [source["name"] for source in json.loads(lines[-1])["sources"]] == ["holds.csv", "sine.csv"]
    (tmp_path / "parameters.history").write_text("mine")
    assert_one_message(rovid("fit"), "parameters.history", "is there already")


# Results that cannot be written are saved in the working folder, which `here` replaces.
@pytest.mark.usefixtures("here")
def test_results_of_another_process_are_kept(tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml")
    claim = OutputSet([stored.output])
    replace(stored.with_estimate(estimate(NAMES[1:])), vehicle="another's").write()
    written = update_parameters(stored, claim, lambda now: now.with_estimate(estimate(NAMES[:1])))
    assert set(written.entries) == set(NAMES)
    assert read_parameters(stored.path).vehicle == "another's"


@pytest.mark.usefixtures("here")
def test_a_deleted_file_is_written_again_from_the_read_content(tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml").with_estimate(estimate(NAMES[1:]))
    update_parameters(stored, OutputSet([stored.output]), lambda now: now.with_estimate(estimate(NAMES[:1])))
    assert set(read_parameters(stored.path).entries) == set(NAMES)


@pytest.mark.usefixtures("here")
def test_a_file_replaced_by_another_axis_is_kept_and_the_result_saved_elsewhere(tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml")
    claim = OutputSet([stored.output])
    other = Parameters(path=stored.path, axis=AXES["surge"])
    other.write()
    with pytest.raises(OutputError, match="now holds the parameters of surge"):
        update_parameters(stored, claim, lambda now: now.with_estimate(estimate()))
    assert read_parameters(stored.path).axis is AXES["surge"]


@pytest.mark.usefixtures("here")
def test_an_unwritable_history_keeps_both_files_and_saves_the_result_elsewhere(tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml").with_estimate(estimate(NAMES[1:]))
    stored.write()
    before, history = stored.path.read_bytes(), history_output(stored.path)
    claim = OutputSet([stored.output, history])
    history.path.write_text("mine")
    with pytest.raises(OutputError, match="is not a history of parameters") as refusal:
        update_parameters(stored, claim, lambda now: now.with_estimate(estimate(NAMES[:1])), detection_limits={})
    assert (stored.path.read_bytes(), history.path.read_text()) == (before, "mine")
    saved = Path(str(refusal.value).rpartition(" in ")[2].rstrip("."))
    assert set(read_parameters(saved / "p.toml").entries) == set(NAMES)
