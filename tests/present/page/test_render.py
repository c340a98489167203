"""The page: whole, self-contained, honest about what is missing, safe with what names may hold."""

from __future__ import annotations

import html
import re
from dataclasses import replace
from datetime import date
from html.parser import HTMLParser
from pathlib import Path

import pytest

from rovid import __version__
from rovid.core import spmd
from rovid.core.errors import OutputError
from rovid.core.formatting import plus_minus
from rovid.present.number_format import as_sentence
from rovid.present.page import figures
from rovid.present.page.figures import ReportFigures, draw_figures
from rovid.present.page.render import render_page, write_report
from rovid.present.plots import trials
from rovid.present.report_data import ReportData
from rovid.store.parameter_file import Entry, Parameters, read_source
from rovid.trial.trial import Campaign
from tests.conftest import SHOWN_PLOTS, blank_plots
from tests.present.conftest import GAP, identified, make_evidence, make_vehicle

TODAY = date(2026, 3, 7)
SECTIONS = (
    "Trials",
    "The model",
    "What is left over",
    "Drag from steady turns",
    "Inertia",
    "What these data cannot tell",
    "Where it comes from",
)
# Of the English that a reader of a day without a diagnosis is given; the tables of its nine trials included.
MOST_WORDS = 1330  # of a day with eleven trials


class Parts(HTMLParser):
    """Every address on a page, every id, the images without a text, and the tags that are left open."""

    VOID = frozenset({"meta", "img", "br", "link", "input", "hr"})

    def __init__(self, page: str) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.ids: list[str] = []
        self.tags: list[str] = []
        self.open: list[str] = []
        self.images_without_text = 0
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        known = dict(attrs)
        self.tags.append(tag)
        self.addresses += [str(value) for key, value in attrs if key in {"src", "href", "srcset", "action", "data"}]
        self.ids += [str(known["id"])] if "id" in known else []
        self.images_without_text += tag == "img" and not known.get("alt")
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def written(folder: Path, evidence: ReportData) -> str:
    return write_report(folder, evidence, today=TODAY).read_text(encoding="utf-8")


def without_plots(evidence: ReportData) -> str:
    """The page alone, which takes a hundredth of the time of its plots."""
    return render_page(evidence, ReportFigures(), today=TODAY)


def shown_text(page: str) -> str:
    """What a reader sees: no tags, entities resolved, spaces squeezed."""
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", page)))


def titles(page: str) -> tuple[str, ...]:
    """Of all sections, folded or not."""
    return tuple(re.findall(r"<h2[^>]*>(.*?)</h2>", page))


@pytest.fixture(scope="module")
def folder(day: ReportData, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page, with the plots that it shows; those of trials but the first are blank."""
    folder = tmp_path_factory.mktemp("report")
    with blank_plots(*SHOWN_PLOTS, "trial_01_hold_0_csv"):
        write_report(folder, day, today=TODAY, journal=("84mm",))
    return folder


@pytest.fixture(scope="module")
def page(folder: Path) -> str:
    return (folder / "index.html").read_text(encoding="utf-8")


def test_every_section_is_there_and_reached_from_the_top(page: str) -> None:
    assert titles(page)[1:] == SECTIONS
    parts = Parts(page)
    assert not parts.open
    assert len(set(parts.ids)) == len(parts.ids)
    inside = {address.removeprefix("#") for address in parts.addresses if address.startswith("#")}
    assert inside <= set(parts.ids)
    assert inside >= {"model", "drag", "sources"}


def test_what_a_reader_can_skip_is_folded(page: str) -> None:
    folded = re.findall(r'<details id="(\w+)" class="section">', page)
    assert folded == ["drag", "inertia", "limits", "sources"]
    assert len(shown_text(re.sub(r"<(script|style|svg)\b.*?</\1>", "", page, flags=re.DOTALL)).split()) < MOST_WORDS


def test_page_needs_nothing_but_itself(page: str) -> None:
    parts = Parts(page)
    assert all(address.startswith(("#", "data:image/png;base64,")) for address in parts.addresses)
    assert not {"link", "iframe", "object"} & set(parts.tags)
    assert parts.tags.count("script") == 2  # the viewer's data, and the viewer
    assert "url(" not in page
    assert "@import" not in page
    assert parts.images_without_text == 0


def test_page_opens_with_how_well_the_model_does(page: str) -> None:
    first = shown_text(page.split('<section id="summary"')[1].split("</section>", maxsplit=1)[0])
    assert re.search(r"The model explains R² = 0\.\d{4} of the yaw rate\.", first)
    assert re.search(r"The simulated heading is [\d.]+ deg off after \d+ s\.", first)
    assert "No diagnosis was made" in first
    assert "rovid diagnose" in first


def test_parameters_stand_with_their_errors_and_units(page: str, day: ReportData) -> None:
    model = shown_text(page.split('<section id="model"')[1].split("</section>", maxsplit=1)[0])
    for entry in day.parameters.entries.values():
        value = plus_minus(entry.value, entry.standard_error)
        assert re.search(re.escape(value).replace("±\\ ", r"±\s+"), model), value
        assert entry.method in model
    assert "kg m²" in model


def test_added_inertia_is_the_files_inertia_less_the_rigid_bodys(page: str, day: ReportData) -> None:
    rigid_body = 100.0 * (1.2**2 + 0.8**2) / 12.0
    entry = day.parameters.entries["inertia"]
    assert f"adds {plus_minus(entry.value - rigid_body, entry.standard_error)} kg m²" in shown_text(page)


def test_every_trial_is_in_the_tables_and_has_its_plot(page: str, folder: Path, day: ReportData) -> None:
    assert day.campaign is not None
    names = [trial.name for trial in day.campaign.trials]
    for name in names:
        assert page.count(f'<th scope="row" class="k">{name}</th>') >= 1
        assert f"<option>{name}</option>" in page or f"<option selected>{name}</option>" in page
    png, svg = ({path.stem for path in (folder / "plots").glob(f"*.{kind}")} for kind in ("png", "svg"))
    assert png == svg
    assert png >= {*SHOWN_PLOTS}
    assert len(png - {*SHOWN_PLOTS}) == len(names)
    assert page.count("<img ") == len(SHOWN_PLOTS)  # each trial is in the viewer
    assert page.count("<svg xmlns") == 2  # the worst trial, for a wide screen and for a narrow one


def test_a_simulation_that_misses_nothing_says_so(day: ReportData) -> None:
    exact = [replace(item, position_errors=dict.fromkeys(item.position_errors, 0.0)) for item in day.simulations]
    page = without_plots(replace(day, simulations=tuple(exact)))
    assert re.search(r"The simulated heading is 0\.0+ deg off after \d+ s", shown_text(page))


def test_page_says_how_it_was_done_and_what_it_cannot_tell(page: str, day: ReportData) -> None:
    text = shown_text(page)
    assert day.runs is not None
    assert f"low pass of {day.runs.cutoff:.3g} Hz, chosen from the data" in text
    assert "I·ṙ + DQ·|r|·r + DL·r = T(u) + d" in text
    assert day.inertia is not None
    assert day.inertia.peak_bias is not None
    assert f"biased: {100 * day.inertia.peak_bias:.0f} % of the true inertia on the model's own motion" in text
    assert "A pull against a load cell determines the scale." in text
    assert f"7 March 2026, rovid {__version__}" in text
    assert "heading growing" in text
    assert "heading falling" in text


def test_parameters_that_go_together_are_shaded(page: str) -> None:
    table = page.split("Correlation of parameters</caption>")[1].split("</table>", maxsplit=1)[0]
    assert re.search(r'<td class="s\d">−0\.\d\d</td>', table)
    assert table.count("<tr>") == 4


def test_same_evidence_same_bytes(folder: Path, day: ReportData, tmp_path: Path) -> None:
    write_report(tmp_path, replace(day, simulations=day.simulations[:1]), today=TODAY)
    again = [path for path in (tmp_path / "plots").iterdir() if "overview" not in path.name]
    assert len(again) == 2 * len(SHOWN_PLOTS)
    for path in again:
        assert path.read_bytes() == (folder / "plots" / path.name).read_bytes(), path.name
    assert without_plots(day) == without_plots(day)


@pytest.mark.slow
def test_names_are_text_not_markup_nor_mathematics(tmp_path: Path) -> None:
    vehicle = make_vehicle("<script>alert(1)</script>")
    names = {"hold_1.csv": 'a & "b" <i>.csv', "hold_2.csv": "cost$1$_{.csv", "sine_a.csv": "試験.csv"}
    page = written(tmp_path, make_evidence(tmp_path, names, vehicle))
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "a &amp; &#34;b&#34; &lt;i&gt;.csv" in page
    assert "cost$1$_{.csv" in page
    assert "試験.csv" in page
    assert not Parts(page).open


def test_what_a_reader_noticed_and_what_was_left_out_is_said(day: ReportData) -> None:
    assert day.campaign is not None
    first, *others = day.campaign.trials
    campaign = replace(
        day.campaign,
        trials=(replace(first, remarks=(GAP,)), *others),
        remarks=(replace(GAP, kind="repeated", text="b.csv was left out: it repeats a.csv."),),
    )
    text = shown_text(without_plots(replace(day, campaign=campaign)))
    assert GAP.text in text
    assert "11 trials in numbers; the reader noticed something in 1" in text
    assert "Read this before you use the numbers" in text
    assert "b.csv was left out: it repeats a.csv." in text


def test_other_methods_stand_beside_the_model_as_what_they_are(day: ReportData) -> None:
    entry = day.parameters.entries["quadratic_drag"]
    lag = Entry(value=0.3, standard_error=0.01, unit="s", method="maximum likelihood")
    other = replace(entry, value=55.0, method="maximum likelihood")
    entries = {**day.parameters.entries, "quadratic_drag": other, "thruster_lag.time_constant": lag}
    text = shown_text(without_plots(replace(day, parameters=replace(day.parameters, entries=entries))))
    assert re.search(
        r"By steady turns, [^:]*: quadratic drag DQ 39\.9\d* ± 0\.31 N m s²/rad² \(27 % below the model's\)\.", text
    )
    assert "This method does not model thruster lag." in text
    assert "Read this before" not in text


def test_another_method_within_its_error_is_beside_it_too(day: ReportData) -> None:
    entry = day.parameters.entries["inertia"]
    other = replace(entry, value=entry.value + 0.5 * entry.standard_error, method="maximum likelihood")
    stored = replace(day.parameters, entries={**day.parameters.entries, "inertia": other})
    text = shown_text(without_plots(replace(day, parameters=stored)))
    assert "Read this before" not in text
    assert re.search(r"By orbit integral over whole periods: inertia I \S+ ± \S+ kg m² \(as the model, within", text)


def test_without_holds_the_refusal_stands_in_place_of_the_drag(day: ReportData, tmp_path: Path) -> None:
    stored = Parameters(path=tmp_path / "p.toml", entries={"inertia": day.parameters.entries["inertia"]})
    refusal = "no held command of at least 8 s under which the vehicle turns. Hold each command longer."
    evidence = replace(day, drag=None, drag_refusal=refusal, parameters=stored, simulations=())
    text = shown_text(without_plots(evidence))
    assert text.count("No held command of at least 8 s") >= 3  # summary, drag, what cannot be told
    assert "quadratic drag DQ is not determined" in text
    assert "not determined" in text
    assert "Nothing was simulated: inertia or drag is missing." in text
    made = draw_figures(replace(evidence, inertia=None))
    assert not made["steady"]
    assert not made["overview"]
    assert not made["residuals"]


@pytest.mark.slow
def test_copies_draw_the_same_plots(day: ReportData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = replace(day, inertia=None, simulations=day.simulations[:1])
    plots = []
    for cores in (1, 2):
        monkeypatch.setattr(spmd, "core_count", lambda: cores)  # noqa: B023 - called within the iteration
        plots.append(draw_figures(few).files(tmp_path))
    assert len(plots[0]) >= 10
    assert plots[0] == plots[1]


def test_without_sines_the_regression_stands_alone(tmp_path: Path) -> None:
    names = {name: name for name in ("hold_0.csv", "hold_2.csv", "hold_4.csv", "step.csv")}
    evidence = make_evidence(tmp_path, names)
    assert evidence.inertia is not None
    text = shown_text(without_plots(evidence))
    assert "There is no sine run: only the regression determines the inertia." in text
    assert "Not possible here: peak method" in text
    assert as_sentence(evidence.inertia.refused["orbit_integral"]) in text


def test_without_inertia_the_refusal_stands_in_its_place(day: ReportData) -> None:
    entries = {name: entry for name, entry in day.parameters.entries.items() if name != "inertia"}
    evidence = replace(
        day,
        parameters=replace(day.parameters, entries=entries),
        inertia=None,
        inertia_refusal="inertia cannot be determined from these logs: the thrusters never push.",
        simulations=(),
    )
    text = shown_text(without_plots(evidence))
    assert "inertia I is not determined. Inertia cannot be determined from these logs" in text
    assert "What is left over" not in text


def test_nothing_at_all_still_makes_a_page(tmp_path: Path) -> None:
    evidence = ReportData(
        vehicle=replace(make_vehicle(), thrusters=()),
        parameters=Parameters(path=tmp_path / "p.toml"),
        campaign=None,
        runs=None,
        drag=None,
        drag_refusal="there is no table of steady states.",
        inertia=None,
        inertia_refusal="there is no table of sine trials.",
        simulations=(),
    )
    page = written(tmp_path, evidence)
    assert titles(page)[1:] == ("The model", *SECTIONS[-2:])
    text = shown_text(page)
    assert "There is no table of steady states." in text
    assert "There is no table of sine trials." in text
    assert "<img" not in page


def test_a_gap_in_the_heading_shows_in_the_table(day: ReportData, tmp_path: Path) -> None:
    assert day.campaign is not None
    trials = list(day.campaign.trials)
    heading = trials[0].position.copy()
    heading[200:260] = float("nan")
    trials[0] = replace(trials[0], position=heading)
    campaign = Campaign(trials=tuple(trials), sources=(tmp_path,))
    page = without_plots(identified(day.vehicle, campaign, tmp_path))
    row = re.search(r'hold_0.csv</th><td class="n">40</td>.*?</tr>', page)
    assert "longest gap" in page
    assert row is not None
    assert "3.05" in row.group(0)


def test_logs_are_listed_with_the_hash_of_their_bytes(day: ReportData, tmp_path: Path) -> None:
    assert day.campaign is not None
    log = tmp_path / "log.csv"
    log.write_text("x\n")
    trials = tuple(replace(trial, path=log) for trial in day.campaign.trials)
    campaign = replace(day.campaign, trials=trials)
    sources = tuple(read_source(trial.name, trial.path, 7) for trial in trials[:-1])
    stored = replace(day.parameters, sources=sources)
    page = without_plots(replace(day, campaign=campaign, parameters=stored))
    assert page.count("73cb3858a687a8494ca3323053016282f3dad39d42cf62ca4e79dda2aac7d9ac") == len(trials)
    assert page.count("parameters, this page") == len(trials) - 1
    assert page.count("this page only") == 1


@pytest.mark.slow
def test_of_many_trials_all_are_drawn_small_and_the_worst_large(
    day: ReportData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(figures, "LARGE_PLOTS", 2)
    monkeypatch.setattr(trials, "PER_SHEET", 4)
    written(tmp_path, replace(day, drag=None, drag_refusal="none.", inertia=None, inertia_refusal="none."))
    assert sorted(path.name for path in (tmp_path / "plots").glob("overview*.png")) == [
        "overview_01.png",
        "overview_02.png",
        "overview_03.png",
    ]
    worst = sorted(day.simulations, key=lambda item: -item.fit.rmse)[:2]
    large = {path.stem.split("_", 2)[2] for path in (tmp_path / "plots").glob("trial_*.png")}
    assert large == {item.run.trial.name.replace(".", "_") for item in worst}


def test_a_further_parameter_of_the_file_is_shown(day: ReportData) -> None:
    extra = Entry(value=0.31, standard_error=0.02, unit="s", method="maximum likelihood")
    stored = replace(day.parameters, entries={**day.parameters.entries, "thruster_lag.time_constant": extra})
    text = shown_text(without_plots(replace(day, parameters=stored)))
    assert "thruster lag: time constant" in text
    assert "0.310" in text
    assert "τ·dT'/dt + T' = T" in text


@pytest.fixture
def little(day: ReportData) -> ReportData:
    """Evidence with two plots only."""
    return replace(day, runs=None, campaign=None, simulations=(), inertia=None, inertia_refusal="no logs.")


def test_a_folder_that_cannot_be_one_is_refused(little: ReportData, tmp_path: Path) -> None:
    blocked = tmp_path / "report"
    blocked.write_text("a file\n")
    with pytest.raises(OutputError, match="cannot be written"):
        write_report(blocked, little, today=TODAY)
    assert blocked.read_text() == "a file\n"


def test_a_page_that_was_there_stays_whole_when_a_plot_cannot_be_written(little: ReportData, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("the page of yesterday\n")
    (tmp_path / "plots").write_text("a file\n")
    with pytest.raises(OutputError):
        write_report(tmp_path, little, today=TODAY)
    assert (tmp_path / "index.html").read_text() == "the page of yesterday\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["index.html", "plots"]
