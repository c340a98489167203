"""A parameter file that another process changes meanwhile."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from rovid.core.atomic_write import OutputSet
from rovid.core.errors import OutputError
from rovid.store.history import history_output, update_parameters
from rovid.store.load import read_parameters
from rovid.store.parameter_file import Parameters
from rovid.trial.axis import AXES
from tests.store.test_parameter_file import NAMES, estimate

# What cannot be written is saved in the working folder or a temporary one.
pytestmark = pytest.mark.usefixtures("here")


def test_what_another_process_found_meanwhile_is_kept(tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml")
    claim = OutputSet([stored.output])
    replace(stored.with_estimate(estimate(NAMES[1:])), vehicle="another's").write()
    written = update_parameters(stored, claim, lambda now: now.with_estimate(estimate(NAMES[:1])))
    assert set(written.entries) == set(NAMES)
    assert read_parameters(stored.path).vehicle == "another's"


def test_a_file_that_is_gone_begins_with_what_was_read_of_it(tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml").with_estimate(estimate(NAMES[1:]))
    update_parameters(stored, OutputSet([stored.output]), lambda now: now.with_estimate(estimate(NAMES[:1])))
    assert set(read_parameters(stored.path).entries) == set(NAMES)


def test_a_file_of_another_axis_by_now_is_left_and_the_result_saved(tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml")
    claim = OutputSet([stored.output])
    other = Parameters(path=stored.path, axis=AXES["surge"])
    other.write()
    with pytest.raises(OutputError, match="now holds the parameters of surge"):
        update_parameters(stored, claim, lambda now: now.with_estimate(estimate()))
    assert read_parameters(stored.path).axis is AXES["surge"]


def test_where_the_history_cannot_grow_both_files_stay_and_the_result_is_saved(tmp_path: Path) -> None:
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
