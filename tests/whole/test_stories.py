"""What a new user does, played again: no number contradicts another, no guess is unmarked, none is of yesterday."""

from __future__ import annotations

import html
import json
import re
import shutil
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from rovid.store.load import read_parameters
from tests.conftest import Done, Rovid, blank_plots, diagnosed_once, run_rovid
from tools.hidden import Hidden
from tools.programme import CAMPAIGN
from tools.trial_day import write_trial_day
from tools.truth import ROSUB

SHORT = [run for run in CAMPAIGN if run.name in {"hold_03", "hold_05", "sine_20s", "steps", "multilevel"}]
LAG = Hidden(effect="thruster_lag", form="first_order", parameters={"time_constant": 0.6})
WEAK = Hidden(effect="thrust_asymmetry", form="gain", parameters={"reverse_gain": 0.75})
INERTIA, DRAG = 5057.0, 3532.0
# Of the guess, one meter, over the truth.
SCALE = 1.0 / 0.43


def text_of(page: str) -> str:
    """What a reader sees of a page, or of a part of it."""
    body = re.sub(r"<(style|script)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return re.sub(r"[\s\u2007\u2008]+", " ", html.unescape(re.sub(r"<[^>]+>", " ", body)))


def section_of(page: str, key: str) -> str:
    """What a reader sees of one section of a page."""
    return text_of(page.split(f'<section id="{key}"')[1].split("</section>", maxsplit=1)[0])


def tables(page: str) -> list[tuple[str, str]]:
    """Caption and body of each table of a page, as a reader sees them."""
    found = re.findall(r"<caption>(.*?)</caption>(.*?)</table>", page, re.DOTALL)
    return [(text_of(caption), text_of(body)) for caption, body in found]


def inertia_in(folder: Path) -> float:
    return read_parameters(folder / "parameters.toml").entries["inertia"].value


@dataclass(frozen=True)
class Played:
    """The page, and what each command printed."""

    folder: Path
    page: str
    done: dict[str, Done]


@pytest.fixture(scope="module")
def placeholder(tmp_path_factory: pytest.TempPathFactory) -> Played:
    """Logs of which nobody knows the arms: init, check, report."""
    folder = tmp_path_factory.mktemp("placeholder")
    write_trial_day(folder / "day", seed=3, formats="csv", campaign=SHORT)
    (folder / "day" / "rovid.toml").unlink()
    done = {}
    with pytest.MonkeyPatch.context() as patch, blank_plots("steady_torque", "overview"):
        patch.chdir(folder)
        for command in ("init", "check", "report", "fit"):
            done[command] = run_rovid(command, "day")
            assert done[command].code == 0, done[command].err
        # The page as it was before the arms were put right.
        page = Path("report/index.html").read_text()
        for command in ("simulate", "plan"):
            done[command] = run_rovid(command)
            assert done[command].code == 0, done[command].err
    return Played(folder=folder, page=page, done=done)


@pytest.mark.parametrize("command", ["init", "check", "report", "fit", "simulate", "plan"])
def test_every_command_begins_with_what_is_guessed(command: str, placeholder: Played) -> None:
    first = placeholder.done[command].out.splitlines()[0]
    assert first.startswith(
        "Guessed by rovid init, not measured: yaw_arm of fore and aft. Inertia, drag and every torque"
    )


def test_every_table_and_plot_that_hangs_on_a_guess_says_so(placeholder: Played) -> None:
    found = inertia_in(placeholder.folder)
    assert found == pytest.approx(SCALE * INERTIA, rel=0.01)
    hanging = [(caption, body) for caption, body in tables(placeholder.page) if re.search(r"\bN m\b|\bkg m²", body)]
    assert len(hanging) >= 5
    assert [caption for caption, _ in hanging if "by guessed yaw_arm" not in caption] == []
    others = [caption for caption, body in tables(placeholder.page) if not re.search(r"\bN m\b|\bkg m²| N\b", body)]
    assert [caption for caption in others if "guessed" in caption] == []
    drawing = (placeholder.folder / "report" / "plots" / "steady_torque.svg").read_text()
    assert "#b3001b" in drawing.lower()
    assert "#b3001b" not in (placeholder.folder / "report" / "plots" / "overview.svg").read_text().lower()


def test_no_guessed_inertia_stands_bare(placeholder: Played) -> None:
    found = inertia_in(placeholder.folder)
    # Tables say so in their captions.
    prose = text_of(re.sub(r"<table.*?</table>", "", placeholder.page, flags=re.DOTALL))
    bare = [number[0] for number in re.finditer(r"(?<!guessed )\b1[12]\d{3}(\.\d)? ± [\d.]+ kg", prose)]
    assert bare == []
    assert f"guessed {found:.0f}" in section_of(placeholder.page, "model")
    assert "The water adds" not in prose
    before, _, first = placeholder.page.partition('<section id="summary"')
    assert "Guessed by rovid init, not measured: yaw_arm of fore and aft." in text_of(before)
    assert not re.search(r"(?<!guessed )\b[\d.]+( ± [\d.]+)? (N m|kg)", text_of(first.split("</section>")[0]))


def test_a_fit_marks_each_placeholder(placeholder: Played) -> None:
    rows = {name: row for row in placeholder.done["fit"].out.splitlines() for name in row.split()[:1]}
    assert all(rows[name].rstrip().endswith("guessed") for name in ("inertia", "quadratic_drag", "linear_drag"))
    assert "disturbance torque guessed" in placeholder.done["fit"].out


def test_ratios_stand_in_the_place_of_placeholders(placeholder: Played) -> None:
    model = section_of(placeholder.page, "model")
    ratio = re.search(r"inertia over quadratic drag I/DQ ([\d.]+) ± ([\d.]+) rad", model)
    assert ratio is not None
    assert float(ratio[1]) == pytest.approx(INERTIA / DRAG, abs=4 * float(ratio[2]))  # 4 sigma, fixed seed
    assert re.search(r"I/DQ +1\.4\d* ± 0\.0\d+ +rad", placeholder.done["fit"].out)


@pytest.mark.slow
def test_nothing_is_handed_on_that_hangs_on_a_guess(placeholder: Played, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(placeholder.folder)
    for command in (("control",), ("export", "json")):
        refused = run_rovid(*command)
        assert (refused.code, refused.out) == (2, "")
        assert "yaw_arm of fore and aft" in refused.err
        assert refused.err.count("\n") == 1
    page = text_of(placeholder.page)
    assert "A controller. parameters.toml depends on values guessed by rovid init" in page
    assert "Exports. parameters.toml depends on values guessed by rovid init" in page
    assert not Path("rovid.json").exists()
    forced = run_rovid("export", "json", "-o", "forced.json", "--force")
    assert forced.code == 0, forced.err
    assert forced.out.startswith("Guessed by rovid init")
    document = json.loads(Path("forced.json").read_text())
    assert document["guessed"] == ["yaw_arm of fore", "yaw_arm of aft"]
    gains = run_rovid("control", "--force", "--json").document
    assert gains["guessed"] == document["guessed"]
    assert gains["warnings"][0].startswith("Guessed by rovid init")


def test_programs_are_told_of_placeholders(placeholder: Played, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(placeholder.folder)
    document = run_rovid("fit", "day", "-p", "other.toml", "--json").document
    assert document["parameters"]["inertia"]["placeholder"] is True
    assert document["guessed"] == ["yaw_arm of fore", "yaw_arm of aft"]
    assert document["ratios"]["inertia/quadratic_drag"]["value"] == pytest.approx(INERTIA / DRAG, rel=0.05)


@pytest.fixture(scope="module")
def put_right(placeholder: Played, tmp_path_factory: pytest.TempPathFactory) -> Played:
    """The arms put right, and the report asked for again."""
    folder = tmp_path_factory.mktemp("right") / "all"
    shutil.copytree(placeholder.folder, folder)
    config = folder / "day" / "rovid.toml"
    config.write_text(config.read_text().replace("yaw_arm = 1.0", "yaw_arm = 0.43"))
    done = {}
    with pytest.MonkeyPatch.context() as patch, blank_plots():
        patch.chdir(folder)
        for command in (("simulate",), ("control",), ("export", "json"), ("report",), ("control", "--json")):
            done[" ".join(command)] = run_rovid(*command)
    return Played(folder=folder, page=(folder / "report" / "index.html").read_text(), done=done)


@pytest.mark.parametrize("command", ["simulate", "control", "export json"])
def test_parameters_of_other_arms_are_refused_in_a_line(command: str, put_right: Played) -> None:
    refused = put_right.done[command]
    assert (refused.code, refused.out) == (2, "")
    assert "parameters.toml: is out of date: yaw_arm of fore was 1 and is 0.43" in refused.err
    assert "rovid report" in refused.err
    assert refused.err.count("\n") == 1


def test_a_report_fits_them_again_and_shows_no_old_number(put_right: Played) -> None:
    done = put_right.done["report"]
    assert done.code == 0, done.err
    note, path = done.out.splitlines()[0], done.out.splitlines()[-1]
    assert "parameters.toml no longer held, and was fitted again: yaw_arm of fore was 1 and is 0.43" in note
    assert path == "report/index.html"
    assert inertia_in(put_right.folder) == pytest.approx(INERTIA, rel=0.01)
    shown = text_of(put_right.page)
    assert not re.search(r"\b1[12]\d{3}\.?\d* ± ", shown)
    assert "guess" not in shown
    assert put_right.done["control --json"].document["guessed"] == []


def test_a_browser_shows_guesses_in_red_and_none_once_they_are_put_right(
    placeholder: Played, put_right: Played, tmp_path: Path
) -> None:
    pytest.importorskip("fcntl", reason="Chromium is driven over a POSIX pipe")
    from tests.present.chromium import NAMES, chromium, find_chromium

    if find_chromium() is None:
        pytest.skip(f"no browser: none of {', '.join(NAMES)} on the PATH")
    first = "document.querySelector('p.guessed')"
    page = tmp_path / "guessed.html"
    page.write_text(placeholder.page)
    with chromium(tmp_path / "profile", "--window-size=1280,800") as tab:
        for scheme, colour in (("light", "rgb(179, 0, 27)"), ("dark", "rgb(255, 138, 138)")):
            tab.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
            tab.open(page)
            assert tab.ask(f"getComputedStyle({first}).color") == colour
        assert tab.ask(f"{first}.innerText").startswith("Guessed by rovid init")
        # On the first screen, before any number.
        assert tab.ask(f"{first}.getBoundingClientRect().bottom") < 400
        tab.open(put_right.folder / "report" / "index.html")
        assert tab.ask("document.querySelectorAll('.guessed').length") == 0
        assert tab.complaints == []


@pytest.fixture(scope="module")
def lagged(tmp_path_factory: pytest.TempPathFactory) -> Played:
    """The README's own order, on a day with a lag and weak reverse thrust."""
    folder = tmp_path_factory.mktemp("lagged")
    truth = replace(ROSUB, hidden=(LAG, WEAK))
    write_trial_day(folder / "day", seed=5, formats="csv", truth=truth, campaign=SHORT)
    done = {}
    with pytest.MonkeyPatch.context() as patch, blank_plots(), diagnosed_once({}):
        patch.chdir(folder)
        done["fit-drag"] = run_rovid("fit-drag", "day")
        # What is handed on is asked for by itself.
        options = {"fit-inertia": ["--json"], "diagnose": ["--json"], "report": ["--no-control", "--no-export"]}
        for command in ("fit-inertia", "simulate", "diagnose", "report"):
            done[command] = run_rovid(command, *options.get(command, []))
        after = {name: run_rovid(name, "--json") for name in ("simulate", "control")}
        done |= {f"{name} after": found for name, found in after.items()}
        done["export"] = run_rovid("export", "json")
    for command, each in done.items():
        assert each.code == 0, (command, each.err)
    return Played(folder=folder, page=(folder / "report" / "index.html").read_text(), done=done)


def documents(played: Played) -> dict[str, dict[str, Any]]:
    return {name: done.document for name, done in played.done.items() if done.out.startswith("{")}


def test_one_inertia_everywhere(lagged: Played) -> None:
    found, said = inertia_in(lagged.folder), documents(lagged)
    assert found == pytest.approx(INERTIA, rel=0.02)
    assert said["diagnose"]["extended"]["parameters"]["inertia"]["value"] == pytest.approx(found)
    assert said["simulate after"]["parameters"]["inertia"]["value"] == pytest.approx(found)
    exported = json.loads((lagged.folder / "rovid.json").read_text())
    assert exported["parameters"]["inertia"]["value"] == pytest.approx(found)
    causes = {"thruster_lag", "thrust_asymmetry"}
    assert {finding["effect"] for finding in said["diagnose"]["findings"]} == causes
    for document in ("simulate after", "control after"):
        assert {key.partition(":")[0] for key in said[document]["effects"]} == causes
    shown = re.search(r"inertia I, kg m² \S+ ± \S+ (\S+) ± ", section_of(lagged.page, "model"))
    assert shown is not None
    assert float(shown[1]) == pytest.approx(found, rel=1e-3)
    for trial in said["simulate after"]["trials"]:
        assert f"{trial['yaw_rate_r2']:.4f}" in section_of(lagged.page, "trials")


def test_the_biased_inertia_stands_beside_it_as_what_it_is(lagged: Played) -> None:
    found, biased = inertia_in(lagged.folder), documents(lagged)["fit-inertia"]["parameters"]["inertia"]["value"]
    assert biased > 1.05 * found
    shown = text_of(lagged.page)
    (said,) = re.findall(r"By orbit integral over whole periods: [^)]*\)\. This method does not model [^.]*\.", shown)
    # Its error includes what the equation lacks.
    assert "(as the model, within their errors)" in said
    assert "thruster lag" in said
    assert "asymmetric thrust" in said
    model = section_of(lagged.page, "model")
    assert f"{biased:.0f}" not in model
    # The lag changes no other number: the only caution is that it may act in the sensor.
    alone = r"Read this before you use the numbers The thruster lag may act in the sensor: [^.]*\. [^.]*which\. Symbols"
    assert re.search(alone, model)
    assert not [text for text in documents(lagged)["diagnose"]["warnings"] if "orbit integral" in text]


def test_a_file_of_an_older_rovid_is_read_and_its_standing_said(lagged: Played, tmp_path: Path, rovid: Rovid) -> None:
    shutil.copytree(lagged.folder / "day", tmp_path / "day")
    text = (lagged.folder / "parameters.toml").read_text()
    text = re.sub(r"\[rests_on\].*?(?=\[\[sources\]\])", "", text, flags=re.DOTALL)
    (tmp_path / "parameters.toml").write_text(re.sub(r"^path = .*\n", "", text, flags=re.MULTILINE))
    document = rovid("simulate", "--json").document
    assert any("does not name its inputs" in text for text in document["warnings"])
    assert document["overall"]["yaw_rate_r2"] > 0.99
