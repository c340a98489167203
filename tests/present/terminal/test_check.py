"""What `rovid check` says first, and what it says once."""

from __future__ import annotations

import io
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from rovid.core.formatting import SafeConsole
from rovid.preflight.advice import Advice
from rovid.preflight.check import LogCheck
from rovid.present.terminal.check import check_tasks, show_check
from rovid.trial.fault import Fault
from rovid.trial.trial import Remark
from tests import synthetic
from tests.conftest import SAMPLES, Rovid

FACTS = {"samples": 21, "held_commands": 1, "sine_runs": 0, "noise": 1e-4, "travel": 1.0}
RUN = synthetic.trial(synthetic.clock(1.0), np.zeros(21))


def printed(*advice: Advice, problems: dict[str, str] | None = None, logs: int = 1, width: int = 100) -> list[str]:
    remark = Remark(kind="gap", count=1, text="The heading has gaps (1, of 2.0 s in all); nothing was put in them.")
    trials = tuple(replace(RUN, name=f"run_{at}.csv", remarks=(replace(remark, count=at),)) for at in range(logs))
    out = io.StringIO()
    checked = LogCheck(trials=trials, facts=(FACTS,) * logs, problems=problems or {}, remarks=(), advice=advice)
    show_check(SafeConsole(file=out, width=width), checked)
    return [line.rstrip() for line in out.getvalue().splitlines()]


def test_the_reason_of_a_no_go_precedes_what_a_fit_survives() -> None:
    gap, clocks = (Fault(fault="heading_gaps", logs=("a",), text=text) for text in ("A gap.", "The clocks are apart."))
    grave = Advice(kind="inner_loop", text="The angle steers wheels.", weight="grave")
    checked = LogCheck(
        trials=(RUN,),
        facts=(FACTS,),
        problems={},
        remarks=(),
        advice=(grave, Advice(kind="coast", text="Coast.")),
        faults=(gap, replace(clocks, stops=True)),
    )
    tasks = ["The clocks are apart.", "The angle steers wheels.", "A gap.", "Coast."]
    assert list(check_tasks(checked)) == tasks


def test_the_first_line_decides() -> None:
    aside = Advice(kind="reversals", text="By the way.", weight="aside")
    care = Advice(kind="coast", text="Coast.")
    grave = Advice(kind="clock_offset", text="Mend the clock.", weight="grave")
    assert printed()[0].startswith("Go: ")
    assert printed(aside)[0].startswith("Go: ")
    assert printed(aside, care)[0].startswith("Go with care: ")
    assert printed(grave, care)[0].startswith("No go: ")
    assert printed(problems={"b.csv": "b.csv: bad"})[0].startswith("No go: ")
    assert printed(logs=0, problems={"b.csv": "bad"})[:3] == [printed(grave)[0], "1. b.csv: bad", ""]


def test_all_things_to_do_come_before_the_table() -> None:
    lines = printed(*(Advice(kind="coast", text=f"Do {what}.") for what in "abcde"))
    at = {line: number for number, line in enumerate(lines)}
    table = next(number for number, line in enumerate(lines) if line.startswith("run_0.csv"))
    assert at["1. Do a."] < at["2. Do b."] < at["3. Do c."] < at["4. Do d."] < at["5. Do e."] < table


def test_long_tasks_stand_below_themselves() -> None:
    lines = printed(Advice(kind="coast", text="word " * 30), width=60)
    assert lines[1].startswith("1. word word")
    assert lines[2].startswith("   word word")
    assert max(map(len, lines)) <= 60


def test_a_remark_is_made_once_for_all_logs() -> None:
    lines = printed(logs=16)
    text = " ".join(lines)
    assert text.count("nothing was put in them") == 1
    assert "run_15.csv: The heading has gaps" in text
    assert "Likewise in run_14.csv (14), run_13.csv (13)" in text
    assert "and 10 more." in text


def test_what_keeps_many_logs_from_being_used_is_told_once() -> None:
    alike = {f"bad_{at}.csv": f"day/bad_{at}.csv: has no column 'hdg'." for at in range(9)}
    text = " ".join(" ".join(printed(problems=alike)).split())
    assert "1. 9 of 10 logs cannot be used. bad_0.csv, bad_1.csv, " in text
    assert "bad_4.csv and 4 more: has no column 'hdg'." in text
    assert text.count("'hdg'") == 1
    cut = {"cut.csv": "day/cut.csv:17: is cut.", "short.csv": "day/short.csv:4: is cut."}
    lines = printed(problems={**alike, **cut})
    assert lines[1].startswith("1. 11 of 12 logs cannot be used (reasons below): bad_0.csv, ")
    assert sum("'hdg'" in line for line in lines) == 1
    assert "3. cut.csv:17, short.csv:4: is cut." in lines


def test_no_runs_are_wanted_while_logs_cannot_be_read(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    for name in ("rovid.toml", "thrust_curve.csv", "hold_03.csv", "hold_05.csv"):
        shutil.copy(csv_day / name, tmp_path)
    assert "\n2. Run sines" in rovid("check", tmp_path).out
    bad = tmp_path / "hold_05.csv"
    bad.write_text(bad.read_text().replace("heading_deg", "hdg", 1))
    done = rovid("check", tmp_path)
    assert done.code == 2
    text = " ".join(done.out.split())
    assert text.startswith("No go: a fit would fail, or be wrong. First of all: 1. ")
    assert text.count("has no column 'heading_deg'") == 1
    assert "\n2. " not in done.out


def test_a_good_day_goes_and_clocks_that_differ_stop_it(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    assert rovid("check", csv_day).out.startswith("Go: the logs are good enough for a fit.\n")
    assert rovid("check", csv_day, "--json").document["verdict"] == "go"
    shutil.copytree(csv_day, tmp_path / "late")
    for path in (tmp_path / "late").glob("*.csv"):
        log = pd.read_csv(path)
        commands = [name for name in log.columns if name in {"fore_V", "aft_V"}]
        if commands:
            log[commands] = log[commands].shift(round(0.6 / float(log["time_s"].diff().median()))).bfill()
            log.to_csv(path, index=False)
    done = rovid("check", tmp_path / "late")
    assert done.out.startswith("No go: ")
    assert re.search(r"the vehicle moves 0\.59\d* ± 0\.00\d* s before its commands change", " ".join(done.out.split()))
    assert done.code == 0


def test_a_real_dive_goes_with_care(rovid: Rovid) -> None:
    done = rovid("check", SAMPLES / "bluerov2_pier59" / "dive.csv")
    lines = done.out.splitlines()
    assert lines[0].startswith("Go with care: ")
    assert lines[1].startswith("1. dive.csv: no actuator pushes from 0.0 to 64.5 s, and the vehicle rests.")
    assert lines[2].startswith("2. Use `rovid fit` and `rovid diagnose`, which are valid under feedback;")
    assert "autopilot was on" not in done.out
