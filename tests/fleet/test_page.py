"""The fleet's page and plots: their content and the escaping of names."""

from __future__ import annotations

import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from rovid.core.output_files import FLEET_PAGE, PAGE
from rovid.effects import CATALOGUE
from rovid.fleet.campaigns import CampaignRecord
from rovid.fleet.page import cause_changes, fleet_page, headline, history, timeline
from rovid.fleet.results import Fleet, shrink
from rovid.present.plots.canvas import BLACK, RED
from tests.fleet.conftest import Made, fleet_of

DAY = 86400.0


def seasons(made: Made) -> Fleet:
    records = []
    for vehicle in ("one", "two"):
        for k in range(4):
            lag = ("thruster_lag",) if k in {1, 2} else ()
            value = 100.0 + k + (60.0 if (vehicle, k) == ("two", 3) else 0.0)
            record = made(
                f"{vehicle}/{k}", {"inertia": (value, 1.0)}, vehicle=vehicle, start=1.7e9 + 90 * k * DAY, causes=lag
            )
            records.append(record)
    return fleet_of(*records, CampaignRecord(campaign="zz", folder="", digest="", error="no logs", failure="input"))


def test_cause_changes_are_in_order_of_time(made: Made) -> None:
    assert list(cause_changes(seasons(made)))[:2] == [
        "one: thruster lag appeared between one/0 and one/1.",
        "one: thruster lag disappeared between one/2 and one/3.",
    ]


def test_every_cause_has_its_title(made: Made) -> None:
    causes = tuple(effect.id for effect in CATALOGUE)
    text = fleet_page(fleet_of(made("a", {}, causes=causes[::2], suspects=causes[1::2])), ())
    assert all(effect.title in text for effect in CATALOGUE)


def test_the_headline_counts(made: Made) -> None:
    said = "9 campaigns of 2 vehicles: cause found in 4, nothing found in 4, no diagnosis of 1."
    assert headline(seasons(made)) == said
    assert headline(fleet_of(made("a", {}, suspects=("bias_torque",)))) == "1 campaign of 1 vehicle: suspected in 1."


class _Seen(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.links: list[str] = []
        self.sources: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for key, value in attrs:
            if key == "href" and tag == "a":
                self.links.append(value or "")
            elif key in {"src", "srcset", "data"}:
                self.sources.append(value or "")


def test_the_page_is_complete_and_self_contained(made: Made) -> None:
    fleet = seasons(made)
    text = fleet_page(fleet, shrink(fleet))
    seen = _Seen(text)
    assert seen.sources == []
    assert "script" not in seen.tags
    assert {f"campaigns/{record.campaign}.json" for record in fleet.records} <= set(map(unquote, seen.links))
    for words in ("no logs", "Sister vehicles", "two/3 (inertia)", "2023-11-14 22:13", "prefers-color-scheme: dark"):
        assert words in text
    assert text.count("<svg") == 2  # the timeline and one parameter
    assert not re.search(r"url\((?!#)", text)
    assert "Sister vehicles" not in fleet_page(fleet, ())


def test_names_are_escaped(made: Made) -> None:
    name = '<script>alert("1")</script>\u202e'
    text = fleet_page(fleet_of(made(name, {"inertia": (1.0, 1.0)}, vehicle=name, start=1.0)), ())
    assert "<script" not in text
    assert "\u202e" not in text


def test_a_fleet_without_dates_or_diagnoses_has_a_page_too(made: Made) -> None:
    assert "The logs hold no date" in fleet_page(fleet_of(made("a", {"inertia": (1.0, 0.0)})), ())
    assert "No campaign determines a parameter." in fleet_page(
        fleet_of(CampaignRecord(campaign="a", folder="", digest="", error="no logs")), ()
    )


def test_the_page_is_not_a_report(made: Made, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text(fleet_page(fleet_of(made("a", {})), ()), encoding="utf-8")
    assert FLEET_PAGE.matches(tmp_path / "index.html")
    assert not PAGE.matches(tmp_path / "index.html")


def test_each_campaign_has_a_marker_and_an_interval(made: Made) -> None:
    records = [made(f"{k}", {"inertia": (100.0 + k, 2.0)}, vehicle=f"{k % 2}", start=1e9 + k) for k in range(6)]
    figure = history(fleet_of(*records, made("x", {})), "inertia", {"3"}, None)
    (panel,) = figure.axes
    marks = [line for line in panel.lines if line.get_marker() == "o"]
    assert sorted(float(np.asarray(line.get_ydata())[0]) for line in marks) == [100.0 + k for k in range(6)]
    assert [np.asarray(line.get_ydata())[0] for line in marks if line.get_color() == RED] == [103.0]
    spans = [np.ptp(np.asarray(line.get_ydata())) for line in panel.lines if line.get_color() in {RED, BLACK}]
    assert sum(np.isclose(span, 2 * 1.96 * 2.0) for span in spans) == 6
    assert {text.get_text() for text in panel.texts} == {"0", "1"}


def test_dissimilar_vehicles_are_plotted_relative_to_their_median(made: Made) -> None:
    large = [made(f"l{k}", {"inertia": (5000.0 + 100.0 * k, 50.0)}, vehicle="large", start=1e9 + k) for k in (-1, 0, 1)]
    small = [made(f"s{k}", {"inertia": (0.5, 0.01)}, vehicle="small", start=1e9 + k) for k in range(2)]
    figure = history(fleet_of(*large, *small), "inertia", set(), None)
    (panel,) = figure.axes
    marks = [float(np.asarray(line.get_ydata())[0]) for line in panel.lines if line.get_marker() == "o"]
    assert np.allclose(sorted(marks), [-2.0, 0.0, 0.0, 0.0, 2.0])
    assert {text.get_text() for text in panel.texts} == {"large 5000", "small 0.500"}
    assert "deviation from each vehicle's median in %" in figure.texts[0].get_text()


def test_the_timeline_has_a_row_for_each_vehicle(made: Made) -> None:
    records = [made(f"{k}", {}, vehicle=f"v{k % 3}", start=1.7e9 + 1e6 * k, causes=("x",) * (k > 3)) for k in range(6)]
    figure = timeline(fleet_of(*records, made("undated", {})))
    (panel,) = figure.axes
    assert [label.get_text() for label in panel.get_yticklabels()] == ["one", "v0", "v1", "v2"]
    counts = {str(line.get_label()): len(np.asarray(line.get_xdata())) for line in panel.lines}
    assert counts == {"cause found": 2, "nothing found": 4}
