"""`rovid plan`: the planned run discriminates between causes."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from benchmarks.decisions import DECIDES, FEW, PAIRS, decided
from tests.conftest import SAMPLES, Rovid
from tools.cases import all_cases
from tools.trial_day import write_trial_day
from tools.truth import ROSUB


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two holds and a sine with a lag that these data hardly show."""
    folder = tmp_path_factory.mktemp("few")
    case = next(case for case in all_cases(ROSUB) if case.name == "thruster_lag-first_order-weak")
    write_trial_day(folder, seed=3, truth=case.of(ROSUB), formats="csv", campaign=FEW)
    return folder


@pytest.mark.slow
def test_two_causes_are_distinguished_by_a_fast_command(few: Path, tmp_path: Path, rovid: Rovid) -> None:
    document = rovid("plan", few, "--between", "thruster_lag", "--between", "command_delay", "--json").document
    assert document["decides"]
    assert "fast random" in document["runs"][0]["run"]
    log = pd.read_csv(tmp_path / "plan.csv")
    assert list(log.columns) == ["time_s", "fore", "aft"]
    assert log["time_s"].iloc[-1] == pytest.approx(document["runs"][0]["seconds"], abs=1e-3)
    assert document["commands"]["fore"] == pytest.approx(log["fore"].tolist(), abs=1e-4)
    assert (tmp_path / "plan.png").stat().st_size > 10_000
    gains = [run["gain"] for run in document["runs"] if "rest for two minutes" in run["run"]]
    assert gains[0] < 0.1 * document["runs"][0]["gain"]


@pytest.mark.slow
def test_a_crew_s_limits_are_kept(few: Path, rovid: Rovid) -> None:
    plain = rovid("plan", few, "--json").document
    assert plain["narrow"] in {"inertia", "quadratic_drag", "linear_drag"}
    limits = ("--minutes", 3, "--max-rate", 9, "--turns", 2, "--share", 0.8)
    tight = rovid("plan", few, *limits, "--narrow", "inertia", "--json").document
    for name in ("fore", "aft"):
        assert max(map(abs, tight["commands"][name])) < max(map(abs, plain["commands"][name]))
    assert any(said.startswith("Replaced the earlier plan.csv and plan.png.") for said in tight["warnings"])
    assert 0 < len(tight["runs"]) < len(plain["runs"])
    assert max(run["seconds"] for run in tight["runs"]) <= 180.0
    assert tight["narrow"] == "inertia"
    assert all(math.isfinite(run["gain"]) and run["gain"] > 0.0 for run in tight["runs"])


@pytest.mark.slow
def test_a_matrix_answers_first_and_counts_the_pairs(few: Path, rovid: Rovid) -> None:
    causes = ("bias_torque", "tether_torsion", "thruster_lag", "drag_curvature")
    names = [word for name in causes for word in ("--between", name)]
    document = rovid("plan", few, "--matrix", *names, "--json").document
    assert document["programme"]["runs"] == ["hold_01.csv", "hold_02.csv", "sine_40s.csv"]
    # The other drag parameters imitate a drag curvature of 2 % of the rate, but not one of 30 %.
    assert [cause["effect"] for cause in document["causes"]] == [*causes]
    assert document["not_visible"] == []
    pairs = document["pairs"]
    assert document["separated"] == sum(pair["separated"] for pair in pairs) == len(pairs) == 6
    assert pairs[0]["between"] == ["bias_torque", "tether_torsion"]
    assert document["programme"]["seconds"] > pairs[0]["seconds"] > pairs[-1]["seconds"] > 4.0
    said = rovid("plan", few, "--matrix", *names).out
    assert said.startswith("6 of 6 pairs of causes are told apart in 6 minutes")
    assert "change the simulated rate by 2 %; drag_curvature by 30 %." in " ".join(said.split())


def test_a_matrix_before_any_log_states_its_estimate(tmp_path: Path, rovid: Rovid) -> None:
    """Mass and size give a model; a torque that acts on it tells a lag from a delay, as after the first logs."""
    for name in ("rovid.toml", "thrust_curve.csv"):
        shutil.copy(SAMPLES / "rosub_tank" / name, tmp_path / name)
    names = ("--between", "thruster_lag", "--between", "bias_torque")
    document = rovid("plan", "--matrix", *names, "--json").document
    assert {cause["effect"] for cause in document["causes"]} == {"thruster_lag", "bias_torque"}
    assert document["separated"] == 1
    (said,) = document["warnings"]
    assert "no log yet" in said
    # Rigid body 2335 kg m^2; the logs of this vehicle give 5050 in all.
    assert 2335.0 < float(said.partition("(inertia ")[2].split()[0]) < 3.0 * 5050.0
    refused = rovid("plan", "--matrix", *names, "--effect", "supply_sag")
    assert refused.code == 2
    assert "--effect: needs logs" in refused.err
    toml = tmp_path / "rovid.toml"
    toml.write_text(re.sub("(?m)^length.*", "", toml.read_text()))
    done = rovid("plan", "--matrix", *names)
    assert done.code == 2
    assert "[vehicle] of rovid.toml: gives no length" in done.err


@pytest.mark.slow
def test_a_stale_file_contributes_only_the_names_of_its_effects(few: Path, tmp_path: Path, rovid: Rovid) -> None:
    folder = shutil.copytree(few, tmp_path / "few")
    assert rovid("fit", folder, "--effect", "bias_torque").code == 0
    assert rovid("plan", "--json").document["warnings"] == []
    toml = (folder / "rovid.toml").read_text()
    assert "yaw_arm = 0.43" in toml
    (folder / "rovid.toml").write_text(toml.replace("yaw_arm = 0.43", "yaw_arm = 0.86"))
    (replaced, said) = rovid("plan", "--json").document["warnings"]
    assert replaced.startswith("Replaced the earlier plan.png.")
    assert "parameters.toml is out of date: yaw_arm of" in said
    assert "names of its effects" in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--between", "thruster_lag"), "expects two different causes. Give it once for each"),
        (("--between", "thruster_lag", "--between", "thruster_lag"), "two different causes"),
        (("--between", "thruster_lag", "--between", "comand_delay"), "'command_delay'"),
        (("--narrow", "inertai"), "'inertia'"),
        (("--matrix", "--between", "thruster_lag"), "names one cause; two or more were expected"),
        (("--matrix", "--axes", "planar"), "--matrix: is for one axis"),
        (("--minutes", 0.2), "no run stays within these limits"),
    ],
)
def test_a_mistake_gives_one_message(arguments: tuple[Any, ...], said: str, few: Path, rovid: Rovid) -> None:
    done = rovid("plan", few, *arguments)
    assert done.code == 2
    assert said in done.err
    assert done.err.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize(("name", "rival"), PAIRS)
def test_the_planned_run_decides(name: str, rival: str) -> None:
    case = next(case for case in all_cases(ROSUB) if case.name == name)
    before, after, run = decided(case, rival, seed=5)
    print(f"{run}: {before:.1f} before, {after:.1f} after")
    assert after > max(DECIDES, before)
