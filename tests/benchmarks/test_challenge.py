"""Name That Cause: the scorer counts rightly, the secret has its hash, and the format keeps its secrets."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmarks.challenge.__main__ import ROUNDS
from benchmarks.challenge.page import write_page
from benchmarks.challenge.regressions import Regression, odds_by_bic, prior
from benchmarks.challenge.rules import LABELS, LEVELS, NONE, PARAMETERS, Answer, read_campaign, spread
from benchmarks.challenge.score import crps, problem, score, scored, summary
from benchmarks.challenge.seal import convert, digest

TRUTH = {"simulator": "calm", "cause": "bias_torque", "parameters": dict.fromkeys(PARAMETERS, 10.0),
         "turns": [10.0, -20.0]}  # fmt: skip


def answer(**odds: float) -> Answer:
    sizes = dict.fromkeys(PARAMETERS, [10.0] * 5)
    return {"causes": odds, "parameters": sizes, "heading_deg": [[10.0] * 5, [-20.0] * 5]}


def test_scores_are_those_of_the_rules() -> None:
    sure = score(answer(bias_torque=0.9, none=0.1), TRUTH)
    assert sure["log_score"] == pytest.approx(-math.log(0.9))
    assert (sure["named"], sure["cost"], sure["parameters"], sure["heading"]) == ("bias_torque", 0.0, 0.0, 0.0)
    # Naming at 0.8 costs 1.0 on average, silence 0.9: nothing is named.
    assert score(answer(bias_torque=0.8, none=0.1, thruster_lag=0.1), TRUTH)["cost"] == 1.0
    wrong = score(answer(thruster_lag=0.99, none=0.01), TRUTH)
    assert (wrong["cost"], wrong["false"], wrong["log_score"]) == (5.0, True, pytest.approx(-math.log(1e-3)))
    assert score(answer(none=1.0), TRUTH | {"cause": NONE})["cost"] == 0.0
    silent = score(None, TRUTH)
    assert (silent["p"], silent["cost"]) == (pytest.approx(1.0 / len(LABELS)), 1.0)
    table = summary([sure, wrong, silent])
    assert (table["campaigns"], table["answered"], table["false"], table["cost"]) == (3, 2, 1, 2.0)


def test_crps_of_equal_quantiles_is_the_distance_and_of_a_normal_distribution_nearly_its_own() -> None:
    assert crps([3.0] * len(LEVELS), 5.0) == pytest.approx(2.0)
    normal = crps([-1.2816, -0.5244, 0.0, 0.5244, 1.2816], 0.0)
    # (sqrt 2 - 1)/sqrt pi (Gneiting and Raftery 2007); five quantiles give it within a twentieth.
    assert normal == pytest.approx((math.sqrt(2.0) - 1.0) / math.sqrt(math.pi), rel=0.05)


def test_wrong_answers_are_refused_with_the_reason() -> None:
    assert "'rust'" in problem(answer(rust=1.0), 2)
    assert "sum to 0.5" in problem(answer(none=0.5), 2)
    assert "5 quantiles" in problem(answer(none=1.0) | {"heading_deg": [[1.0], [1.0] * 5]}, 2)
    assert "needs 3 lists" in problem(answer(none=1.0), 3)
    assert "needs 2 lists" in problem({"causes": {"none": 1.0}, "parameters": {}}, 2)
    assert "from 0 to 1" in problem(answer(none=1.0) | {"causes": {"none": "1"}}, 2)
    assert "were expected" in problem(answer(none=1.0) | {"causes": [1.0]}, 2)
    with pytest.raises(ValueError, match="calm_00: the probabilities"):
        scored({"campaigns": {"calm_00": answer(none=0.5)}}, {"calm_00": TRUTH})
    assert sum(spread({"none": 2.0, "bias_torque": 1.0}).values()) == pytest.approx(1.0)


def test_the_secrets_of_open_rounds_have_their_published_hashes() -> None:
    rounds = json.loads(ROUNDS.read_text(encoding="utf-8"))
    assert [one["round"] for one in rounds] == list(range(1, len(rounds) + 1))
    assert all(digest(one["secret"]) == one["sha256"] for one in rounds if one["secret"])


def test_the_scorer_runs_without_rovid(tmp_path: Path) -> None:
    (tmp_path / "truth.json").write_text(json.dumps({"calm_00": TRUTH}))
    path = tmp_path / "mine.json"
    path.write_text(json.dumps({"entrant": "mine", "campaigns": {"calm_00": answer(bias_torque=1.0)}}))
    code = ("import sys; sys.modules['rovid'] = sys.modules['tools'] = None; from benchmarks.challenge import score; "
            f"sys.argv[1:] = [{str(tmp_path)!r}, {str(path)!r}]; score.main()")  # fmt: skip
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "median_p   1" in done.stdout
    path.write_text(json.dumps({"entrant": "mine", "campaigns": {"calm_01": answer(bias_torque=1.0)}}))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert "mine.json: the round has no campaign 'calm_01'; it has calm_00." in done.stderr


def test_a_folder_loses_its_configuration_and_its_held_out_heading(tmp_path: Path) -> None:
    raw, folder = tmp_path / "raw", tmp_path / "campaign"
    raw.mkdir()
    (raw / "rovid.toml").write_text(
        '[vehicle]\nname = "secret"\nmass = 60.0\nlength = 1.0\nwidth = 0.6\n[[thrusters]]\nname = "bow"\n'
        'position = [0.5, 0.0]\ndirection = 90\ncurve = "c.csv"\ncommand = { csv = "bow_V" }\n'
        '[signals]\ntime = { csv = "t" }\nheading = { csv = "h", unit = "deg" }\n'
    )
    (raw / "c.csv").write_text("command,thrust_N\n-10,-20\n10,20\n")
    time = np.arange(0.0, 100.0, 0.1)
    command = 5.0 * np.sign(np.sin(0.3 * time))
    rate = np.zeros_like(time)
    for k in range(1, len(time)):  # 5 kg m^2, 8 N m s^2, and a constant torque of 1 N m
        rate[k] = rate[k - 1] + 0.1 * (command[k - 1] + 1.0 - 8.0 * abs(rate[k - 1]) * rate[k - 1]) / 5.0
    heading = np.degrees(np.cumsum(0.1 * rate)) % 360.0
    pd.DataFrame({"t": time + 7.0, "h": heading, "bow_V": command}).to_csv(raw / "run_01.csv", index=False)
    turns = convert(raw, folder, {}, None)
    assert sorted(path.name for path in folder.iterdir()) == ["run_01.csv", "vehicle.json"]
    campaign = read_campaign(folder)
    (run,) = campaign.runs
    assert campaign.description["thrusters"][0]["yaw_arm_m"] == pytest.approx(0.5)
    assert np.isnan(run.heading[run.time > campaign.cut]).all()
    assert np.isfinite(run.heading[run.time <= campaign.cut]).all()
    unwrapped = np.cumsum(0.1 * rate)
    known = np.degrees(np.interp(campaign.asked, time, unwrapped) - np.interp(campaign.cut, time, unwrapped))
    assert turns == pytest.approx(known.tolist(), abs=1e-6)
    # The regression sees what acts, and an answer keeps the format.
    odds = odds_by_bic(Regression(campaign).candidates())
    assert max(odds, key=lambda name: odds[name]) == "bias_torque"
    assert problem(prior(campaign), len(campaign.asked)) == ""
    truths = {"calm_00": TRUTH | {"turns": turns}}
    documents = {"prior": {"campaigns": {"calm_00": prior(campaign)}, "failures": {}}}
    here = {"round": 1, "sealed": "2026-01-01", "sha256": "0", "secret": None}
    page = write_page({"prior": scored(documents["prior"], truths)}, documents, here, None)
    assert "| prior | 1 of 1 | 0.03 |" in page
    assert "DX 2025" not in page
    page = write_page({"rovid": scored(documents["prior"], truths)}, documents, here, None)
    assert "won with a mean probability of the truth of 66 %.\nThe median here is *rovid* 3 % (mean 3 %)." in page
