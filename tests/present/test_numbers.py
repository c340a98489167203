"""One result, told once: JSON, terminal, page, parameter file and comparison show the same figures."""

from __future__ import annotations

import io
import json
import math
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import pytest

from rovid.core.formatting import SafeConsole, plus_minus, to_json
from rovid.present.documents.diagnosis import diagnosis_document
from rovid.present.number_format import DASH, parameter_title, rounded_errors
from rovid.present.page.summary import summarize
from rovid.present.report_data import ReportData
from rovid.present.sentences import cause_title
from rovid.present.terminal.diagnosis import show_diagnosis
from rovid.trial.axis import AXES
from tests.conftest import SAMPLES, Rovid, diagnosed_once
from tests.present.conftest import study_of
from tools.wide import draw, write_campaign

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
    for name, parameter in document["base"]["parameters"].items():
        title = re.escape(parameter_title(name))
        assert re.search(rf"{title}[^±]*? {re.escape(sized(parameter))} ", page), name
    for finding in document["findings"]:
        effect = finding["effect"]
        size = sized(next(iter(finding["parameters"].values())))
        assert page.count(size) >= 2, effect  # the first screen, and the table of the model
        assert f"log-likelihood gain: {finding['log_likelihood_gain']:.0f} after" in terminal, effect
        assert f"gain {finding['held_out_gain']:.0f} on trials" in page, effect
        if finding["runner_up"] is not None:
            title, gain = axis.reword(cause_title(finding["runner_up"]["effect"])), finding["runner_up"]["gain"]
            assert re.search(rf"by alternative causes: {re.escape(title)}[^,;]* {gain:.0f}\b", terminal), effect
            # Titles of forms follow in brackets. A dependence on a signal is no cause, and may come first.
            assert re.search(rf"{re.escape(title)}[^;]* {gain:.0f}\b", page), effect
    gain = document["held_out_gain"]
    rate = next(one for key, one in gain.items() if key.endswith("_rmse"))
    sides = ("base", "extended", "noise_floor") if document["findings"] else ("base", "noise_floor")
    errors = [rounded_errors([rate[key] for key in sides])]
    for horizon in (10, 60):
        position = next(one for key, one in gain.items() if key.endswith(f"_error_{horizon}s"))
        factor = math.degrees(1.0) if position["unit"] == "rad" else 1.0
        errors.append(rounded_errors([position[key] and factor * position[key] for key in sides]))
    for row in errors:
        assert " ".join(row) in terminal
        assert " ".join(row) in page
    assert all(value in page for row in errors for value in row if row[0] != DASH)
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


@pytest.mark.slow
@pytest.mark.parametrize("sample", ["rosub_hidden", "rosub_tank"])
def test_every_command_on_a_sample_shows_one_result(sample: str, tmp_path: Path, rovid: Rovid) -> None:
    logs, file = SAMPLES / sample, tmp_path / "p.toml"
    document = rovid("diagnose", logs, "-p", file, "--json", "--budget", "3600").document
    terminal = rovid("diagnose", "-p", file, "--budget", "3600").out
    assert rovid("report", "-p", file, "-o", tmp_path / "report", "--budget", "3600").code == 0
    page = re.sub(r'alt="([^"]*)"', r"> \1 <", (tmp_path / "report" / "index.html").read_text(encoding="utf-8"))
    check_diagnosis(document, terminal, page, tomllib.loads(file.read_text(encoding="utf-8")))
    fitted = rovid("fit", logs, "-p", tmp_path / "f.toml", "--json").document["parameters"]
    for name, parameter in document["base"]["parameters"].items():
        # Both fit the plain model, from other starts.
        error = fitted[name]["standard_error"]
        assert abs(fitted[name]["value"] - parameter["value"]) < SAME_OPTIMUM * error
        assert error == pytest.approx(parameter["standard_error"], rel=0.05)
    compared = rovid("compare", file, logs, "--json").document["parameters"]
    shown = plain(rovid("compare", file, logs).out)
    for name, sides in compared.items():
        assert sized(sides["b"]) in shown, name
        gap = abs(sides["b"]["value"] - document["extended"]["parameters"][name]["value"])
        assert gap < SAME_OPTIMUM * sides["b"]["standard_error"], name


# Further samples with their axis, and made-up campaigns of tools.wide.
OTHERS = {"bldc_bench": "yaw", "bluerov2_dataflash": "yaw", "kvlcc2_roll_decay": "roll"}
MADE_UP, SEED = (0, 1, 2, 3, 4, 6, 7, 8), 551


@pytest.mark.slow
@pytest.mark.parametrize("source", [*OTHERS, *MADE_UP])
def test_the_diagnosis_of_other_samples_and_of_made_up_campaigns_reads_the_same(
    source: str | int, tmp_path: Path, rovid: Rovid
) -> None:
    logs, file = tmp_path / "logs", tmp_path / "p.toml"
    if isinstance(source, int):
        write_campaign(logs, draw(SEED, source))
    else:
        shutil.copytree(SAMPLES / source, logs)
    along = ("--axis", OTHERS.get(str(source), "yaw"), "-p", file, "--budget", "3600")
    with diagnosed_once({}):
        document = rovid("diagnose", logs, *along, "--json").document
        terminal = rovid("diagnose", *along).out
        assert rovid("report", *along, "-o", tmp_path / "report", "--no-control", "--no-export").code == 0
    page = re.sub(r'alt="([^"]*)"', r"> \1 <", (tmp_path / "report" / "index.html").read_text(encoding="utf-8"))
    check_diagnosis(document, terminal, page, tomllib.loads(file.read_text(encoding="utf-8")))
