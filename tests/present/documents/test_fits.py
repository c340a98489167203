"""Estimates as JSON."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.estimate.estimate import Estimate
from rovid.estimate.thrust_curve import fit_thrust_curve
from rovid.present.documents.fits import (
    axis_document,
    bench_document,
    fit_document,
    parameter_document,
    position_errors,
    simulation_units,
)
from rovid.store.study import open_study
from rovid.trial.axis import AXES, YAW
from tests.conftest import SAMPLES


def test_a_parameter_has_value_error_unit_and_interval_and_a_refused_one_is_left_out() -> None:
    estimate = Estimate(
        names=("quadratic_drag", "linear_drag"),
        values=np.array([3532.0, 0.0]),
        covariance=np.diag((900.0, 0.0)),
        method="m",
        samples=7,
        refused={"linear_drag": "why"},
    )
    document = parameter_document(estimate)
    assert set(document) == {"quadratic_drag"}
    entry = document["quadratic_drag"]
    assert (entry["value"], entry["standard_error"], entry["unit"]) == (3532.0, 30.0, "N m s^2/rad^2")
    assert entry["interval_95"] == pytest.approx([3532.0 - 1.96 * 30.0, 3532.0 + 1.96 * 30.0], abs=0.1)


def test_keys_and_units_are_those_of_the_axis() -> None:
    assert axis_document(YAW) == {}
    assert axis_document(AXES["heave"]) == {"axis": "heave"}
    assert position_errors({10.0: 0.5, 60.0: None}, YAW) == {"heading_error_10s": 0.5, "heading_error_60s": None}
    assert simulation_units(AXES["surge"])["surge_velocity_rmse"] == "m/s"
    assert simulation_units(AXES["surge"])["surge_position_error_10s"] == "m"
    assert simulation_units(YAW)["heading_error_60s"] == "rad"


def test_what_was_refused_cannot_be_identified_and_tables_have_no_filter() -> None:
    study = open_study([SAMPLES / "rosub_paper"])
    fit = study.drag()
    document = fit_document(fit, study)
    assert document["schema"] == "rovid-fit/1"
    assert document["filter"] is None
    assert document["not_identifiable"] == ["thrust_scale", *fit.estimate.refused]
    assert len(document["steady_states"]) == len(fit.points)


def test_a_bench_curve_says_how_far_its_readings_are_off() -> None:
    command = np.repeat(np.linspace(-5.0, 5.0, 21), 2)
    noise = np.tile([0.5, -0.5], 21)
    fit = fit_thrust_curve(command, 4.0 * np.abs(command) * command + noise)
    document = bench_document(fit, "curve.csv")
    assert document["curve"] == "curve.csv"
    assert document["points"] == len(fit.curve.command)
    assert len(document["readings"]) == len(command)
    worst = max(abs(reading["residual"]) for reading in document["readings"])
    assert document["residual_max"] == worst > 0.0
