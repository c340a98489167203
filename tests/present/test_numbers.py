"""One result, told once: JSON, terminal, page, parameter file and comparison show the same figures."""

from __future__ import annotations

import io
import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from rovid.core.formatting import SafeConsole, plus_minus, to_json
from rovid.effects import every_form
from rovid.present.documents.diagnosis import diagnosis_document
from rovid.present.number_format import DASH, parameter_title, rounded_errors
from rovid.present.page.summary import summarize
from rovid.present.report_data import ReportData
from rovid.present.sentences import cause_title
from rovid.present.terminal.diagnosis import show_diagnosis
from rovid.trial.axis import AXES, Axis
from tests.conftest import SAMPLES, Rovid, diagnosed_once
from tests.present.conftest import study_of
from tools import wide
from tools.dirty.folder import write_folder
from tools.hard import campaign as hard
from tools.hard.writing import write_campaign as write_hard
from tools.planar import campaign as planar
from tools.planar.writing import write_campaign as write_planar

Document = dict[str, Any]
# Blanks that align decimal points, and other blanks.
_BLANKS = re.compile(r"[\s\u00a0\u2007\u2008]+")

# Standard errors by which two fits differ at most whose log-likelihoods agree to 0.1: sqrt(2 * 0.1).
SAME_OPTIMUM = 0.45


def plain(text: str) -> str:
    """``text`` of a terminal or of a page without markup and alignment."""
    return _BLANKS.sub(" ", re.sub(r"<[^>]*>", " ", text))


def sized(parameter: Document) -> str:
    return plus_minus(parameter["value"], parameter["standard_error"])


def runner_up_titles(effect_id: str, axis: Axis) -> str:
    """A pattern of the titles of all forms of an effect: the document has the effect alone."""
    titles = {form.title for form in every_form() if form.id == effect_id} | {cause_title(effect_id)}
    return "|".join(re.escape(axis.reword(title)) for title in sorted(titles))


def check_diagnosis(document: Document, terminal: str, page: str, stored: Document) -> None:
    """Compare the figures of a diagnosis in all places where they are shown."""
    terminal, page, axis = plain(terminal), plain(page), AXES[document.get("axis", "yaw")]
    for name, parameter in document["extended"]["parameters"].items():
        # The form of an effect stands between its id and the parameter.
        effect, dot, own = name.rpartition(".")
        shown = rf"{re.escape(effect)}[\w:]*{re.escape(dot + own)}[\w:]*"
        assert re.search(rf"{shown} {re.escape(sized(parameter))} ", terminal), name
        written = next(one for key, one in stored["parameters"].items() if re.sub(r":\w+", "", key) == name)
        assert sized(written) == sized(parameter), name
        assert sized(parameter) in page, name
    # The page of the coupled model has the parameters of the extended model alone.
    plain_model = {} if "axes" in document else document["base"]["parameters"]
    for name, parameter in plain_model.items():
        title = re.escape(parameter_title(name))
        assert re.search(rf"{title}[^±]*? {re.escape(sized(parameter))} ", page), name
    for finding in document["findings"]:
        effect = finding["effect"]
        size = sized(next(iter(finding["parameters"].values())))
        assert page.count(size) >= 2, effect  # the first screen, and the table of the model
        assert f"log-likelihood gain: {finding['log_likelihood_gain']:.0f} after" in terminal, effect
        assert f"gain {finding['held_out_gain']:.0f} on trials" in page, effect
        if finding["runner_up"] is not None:
            named, gain = runner_up_titles(finding["runner_up"]["effect"], axis), finding["runner_up"]["gain"]
            assert re.search(rf"by alternative causes: (?:{named})[^,;]* {gain:.0f}\b", terminal), effect
            # Titles of forms follow in brackets. A dependence on a signal is no cause, and may come first.
            assert re.search(rf"(?:{named})[^;]* {gain:.0f}\b", page), effect
    gain = document["held_out_gain"]
    # A model with suspects alone is extended, too.
    is_extended = document["findings"] or gain["yaw_rate_rmse"]["extended"] != gain["yaw_rate_rmse"]["base"]
    sides = ("base", "extended", "noise_floor") if is_extended else ("base", "noise_floor")
    errors = []
    for key, each in gain.items():
        if key.endswith(("_rmse", "_error_10s", "_error_60s")) and each["base"] is not None:
            factor = math.degrees(1.0) if each["unit"] == "rad" else 1.0
            errors.append(rounded_errors([each[side] and factor * each[side] for side in sides]))
    for row in errors:
        assert " ".join(row) in terminal
        assert " ".join(row) in page
    assert all(value in page for row in errors for value in row if row[0] != DASH)
    if "axes" not in document:
        share = document["removed_share"]["value"]
        removed = f"The causes remove {'all' if share >= 0.995 else f'{100 * share:.0f} %'} of the mean square"
        assert removed in terminal
        assert removed in page
        share = 100.0 * document["unexplained"]["share_of_torque_variance"]
        assert f"left unexplained: {share:.2g} %" in terminal


def test_a_diagnosis_reads_the_same_everywhere(lagged: ReportData, lagged_folder: Path) -> None:
    assert lagged.diagnosis is not None
    document = json.loads(to_json(diagnosis_document(lagged.diagnosis, study_of(lagged))))
    stream = io.StringIO()
    show_diagnosis(SafeConsole(file=stream, width=200), lagged.diagnosis, lagged.vehicle)
    page = (lagged_folder / "report" / "index.html").read_text(encoding="utf-8")
    # The alternatives are in the descriptions of the plots.
    page = re.sub(r'alt="([^"]*)"', r"> \1 <", page)
    stored = tomllib.loads((lagged_folder / "parameters.toml").read_text(encoding="utf-8"))
    check_diagnosis(document, stream.getvalue(), page, stored)
    step = summarize(lagged).next_step
    assert step.run in stream.getvalue()
    assert step.run[1:] in plain(page)


def parameter_of(stored: Document, name: str) -> Document:
    """An entry of a parameter file; ``name`` with or without the form of its effect, which the file has."""
    entries: Document = {re.sub(r":\w+", "", key): one for key, one in stored["parameters"].items()}
    return dict(entries[re.sub(r":\w+", "", name)])


def check_commands(rovid: Rovid, logs: Path, file: Path, along: tuple[object, ...], diagnosed: Document) -> None:
    """Compare the figures of all other commands with those of the diagnosis and of its parameter ``file``."""
    stored = tomllib.loads(file.read_text(encoding="utf-8"))
    simulated, shown = rovid("simulate", "-p", file, *along, "--json").document, rovid("simulate", "-p", file, *along)
    for name, parameter in simulated["parameters"].items():
        assert sized(parameter) == sized(parameter_of(stored, name)), name
    for trial in simulated["trials"]:
        for key, value in trial.items():
            assert not key.endswith("_r2") or value is None or f"{value:.4f}" in shown.out, (trial["name"], key)
    planned = rovid("plan", "-p", file, *along, "-o", file.with_name("plan.csv"), "--json")
    if planned.code == 0:
        best = planned.document["runs"][0]["run"]
        assert best in plain(rovid("plan", "-p", file, *along, "-o", file.with_name("plan.csv")).out)
    if "planar" not in along:
        check_fits(rovid, logs, file, along, diagnosed)
        check_watch(rovid, logs, file, along, diagnosed)


def check_fits(rovid: Rovid, logs: Path, file: Path, along: tuple[object, ...], diagnosed: Document) -> None:
    """Compare the plain model of a fit, and the campaigns of comparisons, with the diagnosis of the same logs."""
    stored = tomllib.loads(file.read_text(encoding="utf-8"))
    fitted = rovid("fit", logs, "-p", file.with_name("f.toml"), *along, "--json").document["parameters"]
    other = tomllib.loads(file.with_name("f.toml").read_text(encoding="utf-8"))
    same_criterion = {one.get("method") for one in (*other["parameters"].values(), *stored["parameters"].values())}
    for name, parameter in diagnosed["base"]["parameters"].items():
        assert sized(fitted[name]) == sized(parameter_of(other, name)), name
        # The errors of a diagnosis include what suspects would change; it says so.
        if len(same_criterion) == 1 and not diagnosed["suspects"] and not diagnosed["guessed"]:
            # Both fit the plain model, from other starts.
            error = fitted[name]["standard_error"]
            assert abs(fitted[name]["value"] - parameter["value"]) <= SAME_OPTIMUM * error, name
            assert error == pytest.approx(parameter["standard_error"], rel=0.05), name
    for a, b in ((file.with_name("f.toml"), file), (file, logs)):
        compared = rovid("compare", a, b, *along, "--budget", "3600", "--json").document
        screen = plain(rovid("compare", a, b, *along, "--budget", "3600").out)
        # No vehicle changes between two fits of the same logs.
        assert compared["verdict"] != "changed"
        for name, sides in compared["parameters"].items():
            if name == "thrust_scale" or sides["b"] is None:
                continue
            assert sized(sides["b"]) in screen, name
            gap = abs(sides["b"]["value"] - parameter_of(stored, name)["value"])
            assert gap <= SAME_OPTIMUM * sides["b"]["standard_error"], name


def check_watch(rovid: Rovid, logs: Path, file: Path, along: tuple[object, ...], diagnosed: Document) -> None:
    """Compare the end of a trial day with the diagnosis and the plan of the same logs."""
    watched = ("watch", logs, "--once", "-p", file.with_name("w.toml"), "-o", file.with_name("next.csv"), *along)
    followed = [json.loads(line) for line in rovid(*watched, "--budget", "3600", "--json").out.splitlines()]
    for event in followed:
        if event["event"] == "suspects" and event["parameters"]:
            assert {re.sub(r":\w+", "", name): sized(one) for name, one in event["parameters"].items()} == {
                name: sized(one) for name, one in diagnosed["extended"]["parameters"].items()
            }
        if event["event"] == "next_run" and event["narrow"]:
            planned = rovid("plan", "-p", file, *along, "-o", file.with_name("plan.csv"), "--json").document
            assert event["run"] == planned["runs"][0]["run"]


# Samples with their options, and made-up campaigns: tool and number.
SAMPLE_OPTIONS: dict[str, tuple[str, ...]] = {
    "rosub_hidden": (),
    "rosub_tank": (),
    "bldc_bench": (),
    "bluerov2_dataflash": (),
    "bluerov2_pier59/dive.csv": (),
    "bluerov2_pier59/dive.mcap": (),
    "kvlcc2_roll_decay": ("--axis", "roll"),
    "pitch_tank": ("--axis", "pitch"),
    "planar_rov": ("--axes", "planar"),
    "surge_tank": ("--axis", "surge"),
}
COUNTS = {"wide": 11, "hard": 3, "dirty": 3, "planar": 3}
MADE_UP = [f"{tool} {number}" for tool, count in COUNTS.items() for number in range(count)]
SEED = 551
# Samples whose command is an order to a controller, not a torque.
REFUSED = ("f110_car", "robotino_motors")


def source(name: str, folder: Path) -> tuple[Path, tuple[str, ...]]:
    """Logs of a sample, or of a campaign that is made up in ``folder``, and the options that they need."""
    if name in SAMPLE_OPTIONS:
        return SAMPLES / name, SAMPLE_OPTIONS[name]
    tool, number = name.split()
    if tool == "wide":
        wide.write_campaign(folder / "logs", wide.draw(SEED, int(number)))
    elif tool == "hard":
        write_hard(folder / "logs", hard.draw(SEED + int(number)))
    elif tool == "planar":
        write_planar(folder / "logs", planar.draw(SEED, int(number), samples=4000))
    else:
        write_folder(folder / "logs", SEED, int(number), fault=None)
    return folder / "logs", ("--axes", "planar") if tool == "planar" else ()


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SAMPLE_OPTIONS, *MADE_UP])
def test_all_commands_show_one_result(name: str, tmp_path: Path, rovid: Rovid) -> None:
    (logs, along), file = source(name, tmp_path), tmp_path / "p.toml"
    with diagnosed_once({}):
        document = rovid("diagnose", logs, *along, "-p", file, "--json", "--budget", "3600").document
        if document["base"] is None:
            return
        terminal = rovid("diagnose", *along, "-p", file, "--budget", "3600").out
        assert rovid("report", *along, "-p", file, "-o", tmp_path / "report", "--budget", "3600").code == 0
        page = re.sub(r'alt="([^"]*)"', r"> \1 <", (tmp_path / "report" / "index.html").read_text(encoding="utf-8"))
        stored = tomllib.loads(file.read_text(encoding="utf-8"))
        check_diagnosis(document, terminal, page, stored)
        check_commands(rovid, logs, file, along, document)


@pytest.mark.slow
@pytest.mark.parametrize("name", REFUSED)
def test_what_no_model_holds_for_is_refused_in_one_message(name: str, rovid: Rovid) -> None:
    for command in ("fit-drag", "fit", "diagnose", "report", "plan", "compare", "discover"):
        done = rovid(command, *[SAMPLES / name] * (1 + (command == "compare")))
        assert done.code == 2, command
        assert done.err.count("rovid:") == 1, (command, done.err)
        assert "Traceback" not in done.err
