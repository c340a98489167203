"""From a study to the page: what the parameter file holds is kept, what it lacks is added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from rovid.core.output_files import OutputSet
from rovid.present.page import build
from rovid.present.report_data import ReportData
from rovid.store.load import read_parameters
from rovid.store.parameter_file import Parameters
from rovid.store.study import Study


@pytest.fixture
def study(day: ReportData, tmp_path: Path) -> Study:
    assert day.campaign is not None
    log = tmp_path / "log.csv"
    log.write_text("x\n")
    trials = tuple(replace(trial, path=log) for trial in day.campaign.trials)
    campaign = replace(day.campaign, trials=trials)
    return Study(paths=(tmp_path,), vehicle=day.vehicle, campaign=campaign, runs=day.runs)


def gathered(stored: Parameters, study: Study, monkeypatch: pytest.MonkeyPatch) -> ReportData:
    """The evidence that would go on the page."""
    found: list[ReportData] = []

    def keep(folder: Path, evidence: ReportData, *, claim: OutputSet, journal: Sequence[str] = ()) -> Path:
        found.append(evidence)
        return folder

    monkeypatch.setattr(build, "write_report", keep)
    build.build_report(stored, study, Path("report"), diagnosed=False, controlled=False, exported=False)
    return found[0]


def test_an_empty_file_gets_all_parameters(study: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "parameters.toml"
    evidence = gathered(Parameters(path=path), study, monkeypatch)
    written = read_parameters(path)
    assert written.entries == evidence.parameters.entries
    assert set(written.entries) == {"inertia", "quadratic_drag", "linear_drag"}
    assert len(written.sources) == len(evidence.simulations)


def test_a_drag_found_with_the_inertia_is_kept(
    study: Study, day: ReportData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert day.inertia is not None
    assert day.inertia.regression is not None
    stored = Parameters(path=tmp_path / "parameters.toml").with_estimate(
        day.inertia.regression.estimate, study.provenance
    )
    stored.write()
    before = stored.path.read_bytes()
    evidence = gathered(stored, study, monkeypatch)
    assert stored.path.read_bytes() == before
    assert evidence.parameters.entries == stored.entries
    # The steady turns are there to judge the inertia by, the peak method included.
    assert evidence.inertia is not None
    assert evidence.inertia.peak_bias is not None
