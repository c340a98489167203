"""`rovid fit-thrust-scale`, and the scale in rovid.toml that every fit then carries."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.conftest import SAMPLES, Rovid, write_short_day
from tests.whole.test_bad_input import assert_one_message

TRUE = 1.2


def write_pulls(path: Path, column: str, factor: float = 1.0) -> None:
    curve = pd.read_csv(SAMPLES / "rosub_tank" / "thrust_curve.csv")
    volts = np.array([1.5, 2.0, 2.5, 3.0])
    thrust = 2.0 * np.interp(volts, curve["command"], curve["thrust_N"])
    noise = 1.0 + np.array([0.003, -0.002, 0.001, -0.001])
    pd.DataFrame({"fore_V": volts, "aft": volts, column: TRUE * factor * thrust * noise}).to_csv(path, index=False)


@pytest.mark.parametrize(("column", "factor"), [("force_N", 1.0), ("weight_N", 1.0), ("torque_Nm", 0.43)])
def test_a_scale_from_a_table_is_carried_into_every_fit(
    column: str, factor: float, tmp_path: Path, rovid: Rovid
) -> None:
    day = tmp_path / "day"
    write_short_day(day)
    (day / "tests").mkdir()
    table = day / "tests" / "pulls.csv"  # Among the logs it is a table and no log.
    write_pulls(table, column, factor)
    document = rovid("fit-thrust-scale", table, "--json").document
    found, error_for_fits = document["thrust_scale"], document["thrust_scale_error"]
    assert abs(found["value"] - TRUE) < 3.0 * found["standard_error"]
    assert 0.01 * TRUE < found["standard_error"] < 0.012 * TRUE  # 1 % of the balance, and the scatter
    if column != "force_N":
        return
    exact = rovid("fit-thrust-scale", table, "--reference-error", "0").out
    assert "Fits take a larger one, because the readings are few." in exact
    assert "larger" not in rovid("fit-thrust-scale", table).out
    before = rovid("fit-drag", day, "-p", "before.toml", "--json").document
    assert "thrust_scale" in before["not_identifiable"]
    settings = day / "rovid.toml"
    lines = f"thrust_scale = {found['value']}\nthrust_scale_error = {error_for_fits}\n[[thrusters]]"
    settings.write_text(settings.read_text().replace("[[thrusters]]", lines, 1))
    after = rovid("fit-drag", day, "-p", "after.toml", "--json").document
    assert "thrust_scale" not in after["not_identifiable"]
    relative = error_for_fits / found["value"]
    assert 1.0 < error_for_fits / found["standard_error"] < 1.1  # four readings, whose scatter is a tenth of the error
    for name, value in before["parameters"].items():
        scaled = after["parameters"][name]
        assert scaled["value"] == pytest.approx(found["value"] * value["value"], rel=1e-6)
        error = math.hypot(found["value"] * value["standard_error"], relative * scaled["value"])
        assert scaled["standard_error"] == pytest.approx(error, rel=1e-6)
    # The scale of rovid.toml is part of the answer: the same pulls give the same scale again.
    again = rovid("fit-thrust-scale", table, "--json").document["thrust_scale"]
    assert again["value"] == pytest.approx(found["value"], rel=1e-9)
    assert "thrust_scale_error" in (tmp_path / "after.toml").read_text()
    mixed = rovid("fit-thrust-scale", "--before", "before.toml", "--after", "after.toml", "--added", "100")
    assert_one_message(mixed, "after.toml", "rests on another thrust than", "thrust_scale_error is new")


def test_a_lift_needs_no_heading(tmp_path: Path, rovid: Rovid) -> None:
    config = """[vehicle]
name = "v"
[[thrusters]]
name = "lift"
heave = 0.8
curve = "curve.csv"
command = "lift_V"
[signals]
time = "time_s"
depth = { csv = "depth_m", unit = "m" }
"""
    (tmp_path / "rovid.toml").write_text(config)
    (tmp_path / "curve.csv").write_text("command,thrust_N\n-5,-100\n0,0\n5,100\n")
    table = tmp_path / "lift.txt"
    table.write_text("lift_V,weight_N\n1,19.2\n2,38.3\n3,57.8\n4,76.7\n")
    found = rovid("fit-thrust-scale", table, "--json").document["thrust_scale"]
    assert abs(found["value"] - TRUE) < 3.0 * found["standard_error"]  # by the share of the thrust that lifts, 0.8
    table.write_text("lift_V,torque_Nm\n1,19.2\n2,38.3\n3,57.8\n4,76.7\n")
    assert_one_message(rovid("fit-thrust-scale", table), "lift.txt", "no force", "heave")


def test_wrong_tests_are_one_message(tmp_path: Path, rovid: Rovid) -> None:
    day = tmp_path / "day"
    write_short_day(day, runs=["hold_03"])
    table = day / "pulls.txt"
    for text, wanted in {
        "fore_V,aft_V,pull\n1,1,2\n": "one of force_N, weight_N and torque_Nm",
        "bow,force_N\n1,2\n": "commands (fore_V, aft_V) were expected",
        "fore_V,force_N\n1,2\n900,3\n1,3\n": "fore_V leaves the curve of fore",
        "fore_V,force_N\n1,2\n1,2\n": "2 readings with a force; at least 3",
    }.items():
        table.write_text(text)
        done = rovid("fit-thrust-scale", table)
        assert (done.code, done.out) == (2, "")
        assert wanted in done.err
    assert rovid("fit-thrust-scale").code == 2
