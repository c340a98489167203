"""The fleet's plots show every campaign."""

from __future__ import annotations

import numpy as np

from rovid.fleet.plots import history, timeline
from rovid.present.plots.canvas import BLACK, RED
from tests.fleet.conftest import Made, fleet_of


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
