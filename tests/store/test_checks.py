"""Unchanged inputs of a parameter file, and agreement of the methods."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.estimate.estimate import Estimate
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.store.checks import check_freshness, method_disagreement
from rovid.store.load import read_parameters
from rovid.store.parameter_file import Entry, Parameters, Provenance, absolute_paths, read_source
from tests.store.test_parameter_file import estimate
from tests.trial.test_config_fingerprint import CURVE, TOML, settings

ORBIT = "orbit integral over whole periods"


def estimated(inertia: float, error: float, method: str) -> Estimate:
    return Estimate(
        names=("inertia",), values=np.array([inertia]), covariance=np.array([[error**2]]), method=method, samples=9
    )


def entries(inertia: float, error: float, method: str) -> Mapping[str, Entry]:
    return {"inertia": Entry(value=inertia, standard_error=error, unit="kg m^2", method=method)}


@pytest.mark.parametrize(
    ("before", "now", "believed"),
    [(ORBIT, InnovationLikelihood.method, "this result"), (InnovationLikelihood.method, ORBIT, "the other result")],
)
def test_disagreeing_methods_give_one_warning(before: str, now: str, believed: str) -> None:
    (text,) = method_disagreement(entries(67.0, 2.0, before), estimated(17.0, 1.0, now))
    assert "22 joint standard errors" in text
    assert f"Use {believed}" in text


def test_agreeing_methods_give_no_warning() -> None:
    assert method_disagreement(entries(67.0, 2.0, ORBIT), estimated(62.0, 1.0, InnovationLikelihood.method)) == []
    assert method_disagreement({}, estimated(62.0, 1.0, InnovationLikelihood.method)) == []
    # The same command again, with more logs.
    assert method_disagreement(entries(67.0, 2.0, ORBIT), estimated(17.0, 1.0, ORBIT)) == []


def origin_of(folder: Path, toml: str = TOML) -> Provenance:
    found = settings(folder, toml)
    logs = sorted(folder.glob("log*.csv"))
    sources = tuple(read_source(log.name, log, 7) for log in logs)
    return Provenance(logs=absolute_paths([folder]), vehicle="v", sources=sources, settings=found)


@pytest.fixture
def day(tmp_path: Path) -> Path:
    folder = tmp_path / "day"
    folder.mkdir()
    for name in ("log_1.csv", "log_2.csv"):
        (folder / name).write_text(name)
    return folder


@pytest.fixture
def stored(day: Path, tmp_path: Path) -> Parameters:
    """The file as read again."""
    written = Parameters(path=tmp_path / "parameters.toml").with_estimate(estimate(), origin_of(day))
    written.write()
    return read_parameters(written.path)


def test_unchanged_inputs_are_fresh(stored: Parameters, day: Path) -> None:
    for origin in (None, origin_of(day)):
        found = check_freshness(stored, origin)
        assert (found.changes, found.remarks) == ((), ())


def test_each_change_is_reported(stored: Parameters, day: Path) -> None:
    (day / "rovid.toml").write_text(TOML.replace("0.43", "0.44"))
    (day / "curve.csv").write_text(CURVE.replace("1000", "1001"))
    (day / "log_1.csv").write_text("another")
    (day / "log_2.csv").unlink()
    found = check_freshness(stored, None)
    assert found.changes == (
        "yaw_arm of fore was 0.43 and is 0.44",
        "curve of fore has changed",
        "log_1.csv has changed",
        "log_2.csv is gone",
    )
    assert found.reason.endswith("log_1.csv has changed; 1 more")


def test_a_log_added_after_the_fit_gives_a_remark(stored: Parameters, day: Path) -> None:
    (day / "log_3.csv").write_text("new")
    found = check_freshness(stored, origin_of(day))
    assert found.changes == ()
    (said,) = found.remarks
    assert said.startswith("log_3.csv: added after the fit")


def test_other_logs_may_have_other_columns_but_not_other_thrusters(stored: Parameters, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (other / "log_9.csv").write_text("x")
    assert check_freshness(stored, origin_of(other, TOML.replace("heading_deg", "psi"))).changes == ()
    driven = check_freshness(stored, origin_of(other, TOML.replace("0.43", "0.5")))
    assert driven.changes == ("yaw_arm of fore was 0.43 and is 0.5",)


def test_moved_inputs_cannot_be_checked(stored: Parameters, day: Path) -> None:
    shutil.rmtree(day)
    found = check_freshness(stored, None)
    assert found.changes == ()
    assert "cannot check whether it is up to date" in found.remarks[0]


def test_inputs_moved_together_are_fresh(stored: Parameters, day: Path, tmp_path: Path) -> None:
    there = tmp_path / "there"
    there.mkdir()
    shutil.move(day, there / "day")
    shutil.move(stored.path, there / "parameters.toml")
    found = check_freshness(read_parameters(there / "parameters.toml"), None)
    assert (found.changes, found.remarks) == ((), ())


def test_a_copy_of_the_file_finds_its_logs(stored: Parameters, day: Path, tmp_path: Path) -> None:
    away = replace(stored, sources=tuple(replace(s, path=tmp_path / "away" / s.name) for s in stored.sources))
    assert check_freshness(away, None).changes == ()
    (day / "log_1.csv").write_text("another")
    (day / "log_2.csv").unlink()
    # A missing folder may belong to another machine.
    assert check_freshness(away, None).changes == ("log_1.csv has changed",)


def test_an_older_file_only_names_its_logs(stored: Parameters, day: Path) -> None:
    old = replace(stored, settings=None, sources=tuple(replace(source, path=None) for source in stored.sources))
    old.write()
    read = read_parameters(old.path)
    assert "rests_on" not in old.path.read_text()
    assert "cannot check whether it is up to date" in check_freshness(read, origin_of(day)).remarks[0]
    (day / "rovid.toml").write_text(TOML.replace("0.43", "0.44"))
    assert check_freshness(read, origin_of(day)).changes == ()
    (day / "log_1.csv").write_text("another")
    assert check_freshness(read, origin_of(day)).changes == ("log_1.csv has changed",)


def test_other_parameters_of_an_older_file_stay_unchecked(stored: Parameters, day: Path) -> None:
    old = replace(stored, settings=None)
    assert old.with_estimate(estimate(("inertia",)), origin_of(day)).settings is None
    assert old.with_estimate(estimate(), origin_of(day)).settings is not None


def test_a_file_keeps_the_logs_of_each_of_its_parameters(stored: Parameters, day: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    (other / "log_9.csv").write_text("x")
    both = stored.with_estimate(estimate(("inertia",)), origin_of(other))
    assert [source.name for source in both.sources] == ["log_1.csv", "log_2.csv", "log_9.csv"]
    found = check_freshness(both, origin_of(other))
    assert found.changes == ()
    assert found.remarks == ("log_1.csv, log_2.csv: part of the fit, but not among these logs.",)
    assert both.logs == absolute_paths([other])
    whole = both.with_estimate(estimate(), origin_of(day))
    assert [source.name for source in whole.sources] == ["log_1.csv", "log_2.csv"]
