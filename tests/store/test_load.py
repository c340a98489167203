"""Reading of parameter files and of their history."""

from __future__ import annotations

import json
import re
import shutil
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from rovid.core.errors import ConfigError, OutputError
from rovid.core.output_files import OutputSet
from rovid.store.load import history_output, read_history, read_parameters, update_parameters
from rovid.store.parameter_file import Parameters, Source
from rovid.trial.axis import AXES
from tests.conftest import Rovid
from tests.store.test_parameter_file import NAMES, estimate, written
from tests.whole.test_bad_input import assert_one_message
from tools.programme import Hold, Run, Sine
from tools.trial_day import write_trial_day

MATRIX = r"(?s)matrix = \[.*?\n\]"


def test_logs_that_move_with_the_file_are_found(tmp_path: Path) -> None:
    (tmp_path / "day" / "logs").mkdir(parents=True)
    written(tmp_path / "day", logs=(tmp_path / "day" / "logs", tmp_path / "elsewhere"))
    shutil.move(tmp_path / "day", tmp_path / "deeper" / "day")
    found = read_parameters(tmp_path / "deeper" / "day" / "parameters.toml").logs
    assert found[0] == tmp_path / "deeper" / "day" / "logs"
    assert found[0].is_dir()


@pytest.mark.parametrize(
    ("pattern", "text", "words"),
    [
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>-5.0", "inertia is -5"),
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>0.0", "inertia is 0"),
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>nan", "inertia is nan"),
        (r"(quadratic_drag\]\nvalue = )[^\n]*", r"\g<1>inf", "quadratic_drag is inf"),
        (r"(linear_drag\]\nvalue = )[^\n]*", r"\g<1>-1.0", "linear_drag is -1"),
        (r"(inertia\]\nvalue = )[^\n]*", r'\g<1>"much"', "much"),
        (r"(?s)matrix = \[.*?\n\]", "matrix = [[1.0]]", "damaged"),
        (r"(?s)\[covariance\].*?\n\]\n\]|\[covariance\]\nnames", "[other]\nnames", "no 'covariance'"),
        (r"standard_error = [^\n]*\n", "", "no 'standard_error'"),
        (r"(?s)logs = \[.*?\]", "logs = 5", "damaged"),
        (r"schema = [^\n]*", 'schema = "rovid-parameters/99"', "newer"),
        (r"schema = [^\n]*\n", "", "schema None"),
        (r"\Z", "]]", "is not valid TOML"),
        (r"schema = [^\n]*", 'schema = "rovid-parameters/²"', "rovid-parameters/²"),
        (r"schema = [^\n]*", f'schema = "rovid-parameters/{"9" * 5000}"', "rovid-parameters/1 was expected"),
        (
            r"(inertia\]\nvalue = )[^\n]*",
            rf"\g<1>{'9' * 400}",
            "parameters.inertia.value: is an integer of more than 64 bits",
        ),
        (r"(inertia\]\nvalue = )[^\n]*", rf"\g<1>{'9' * 5000}", "is not valid TOML"),
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>1e300", "inertia is 1e+300; a number up to 1e+18"),
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>1e-300", "inertia is 1e-300, which is not possible"),
        (r"(inertia\]\nvalue = )[^\n]*", r"\g<1>true", "inertia is True; a number"),
        (r"(inertia\]\nvalue = )[^\n]*", rf"\g<1>{'[' * 3000}{']' * 3000}", "nested deeper"),
        (r"samples = \d+", "samples = inf", "samples is inf; a whole number"),
        (r"samples = \d+", "samples = -1", "samples is -1; a whole number"),
        (r"standard_error = [^\n]*", "standard_error = nan", "standard_error of inertia is nan; a number"),
        (r"standard_error = [^\n]*", "standard_error = inf", "standard_error of inertia is inf; a number"),
        (r"standard_error = [^\n]*", "standard_error = -10.0", "standard_error of inertia is -10; zero or more"),
        (MATRIX, "matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]", "is not a square matrix"),
        (MATRIX, "matrix = [[1.0, 0.5, 0.0], [0.4, 1.0, 0.0], [0.0, 0.0, 1.0]]", "not symmetric"),
        (
            MATRIX,
            "matrix = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
            "the covariance is not positive semidefinite",
        ),
        (
            MATRIX,
            "matrix = [[1e-9, 0.0, 0.0], [0.0, -1e-9, 0.0], [0.0, 0.0, 1.0]]",
            "the covariance is not positive semidefinite",
        ),
        (
            MATRIX,
            "matrix = [[1.0, 1.1, 0.0], [1.1, 1.0, 0.0], [0.0, 0.0, 1.0]]",
            "the covariance is not positive semidefinite",
        ),
        (
            MATRIX,
            "matrix = [[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]",
            "the covariance is not positive semidefinite",
        ),
        (
            MATRIX,
            "matrix = [[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]]",
            "the covariance is not positive semidefinite",
        ),
        (MATRIX, "matrix = [[nan, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]", "a covariance is nan"),
        (r'names = \[\n\s+"inertia"', 'names = [ "inertias"', "names of the covariance"),
        (r'names = \[\n\s+"inertia"', 'names = [ "linear_drag"', "names of the covariance"),
    ],
)
def test_a_file_edited_by_hand_is_refused_by_name(pattern: str, text: str, words: str, tmp_path: Path) -> None:
    path = written(tmp_path).path
    path.write_text(re.sub(pattern, text, path.read_text(), count=1))
    with pytest.raises(ConfigError, match=re.escape(words)) as error:
        read_parameters(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    "matrix",
    [
        "[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]",  # less than the standard errors, which hold more
        "[[1e4, -7.071e4, 0.0], [-7.07e4, 5e5, 0.0], [0.0, 0.0, 1e-6]]",  # rounded by hand, wholly correlated
        "[[1e22, 0.0, 0.0], [0.0, 1e-12, 0.0], [0.0, 0.0, 1e-30]]",
    ],
)
def test_valid_covariances_are_accepted(matrix: str, tmp_path: Path) -> None:
    path = written(tmp_path).path
    path.write_text(re.sub(MATRIX, f"matrix = {matrix}", path.read_text()))
    assert len(read_parameters(path).covariance) == 6


def test_zero_drag_is_a_drag(tmp_path: Path) -> None:
    path = written(tmp_path).path
    path.write_text(re.sub(r"(linear_drag\]\nvalue = )[^\n]*", r"\g<1>0.0", path.read_text()))
    assert read_parameters(path).model().linear_drag == 0.0


@pytest.mark.parametrize(("folder", "words"), [(False, "no such parameter file"), (True, "is a folder")])
def test_a_missing_file_and_a_folder_have_different_messages(tmp_path: Path, words: str, *, folder: bool) -> None:
    with pytest.raises(ConfigError, match=words):
        read_parameters(tmp_path if folder else tmp_path / "none.toml")


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
    assert_one_message(rovid("fit"), "parameters.history", "already exists")


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
