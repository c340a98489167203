"""Inertia from a table of sine trials."""

from __future__ import annotations

from pathlib import Path

import pytest

from rovid.core.errors import DataError
from rovid.estimate.inertia_table import fit_inertia_table
from rovid.trial.tables import read_table
from tests.conftest import SAMPLES
from tests.tables import table

PAPER_SINES = SAMPLES / "rosub_paper" / "sine_trials.csv"


def test_paper_sines_by_peak_and_by_harmonic_balance() -> None:
    fit = fit_inertia_table(read_table(PAPER_SINES), drag=None, rigid_body=2348.9)
    assert [round(value) for _, value, _ in fit.methods["harmonic_balance"].runs] == [4472, 7479]
    assert fit.methods["peak"].value == pytest.approx(5057.0, abs=0.5)
    assert fit.methods["harmonic_balance"].consistent is False
    assert any("No single inertia fits" in text for text in fit.estimate.warnings)
    assert fit.added_inertia == pytest.approx(fit.estimate.value("inertia") - 2348.9)


def test_sine_table_without_drag_says_what_to_do(tmp_path: Path) -> None:
    rows = table("period_s,torque_amplitude_Nm,peak_yaw_rate_rad_s\n40,100,0.12\n", tmp_path)
    with pytest.raises(DataError, match="fit-drag"):
        fit_inertia_table(rows, drag=None, rigid_body=None)


def test_drag_above_torque_is_refused(tmp_path: Path) -> None:
    text = "period_s,torque_amplitude_Nm,peak_yaw_rate_rad_s,quadratic_drag,linear_drag\n40,10,0.2,3532,132\n"
    with pytest.raises(DataError, match=r"table\.csv:2: the drag"):
        fit_inertia_table(table(text, tmp_path), drag=None, rigid_body=None)
