"""The page of two campaigns, of parameter files: whole, escaped, and its pictures with units."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from rovid.compare.campaign_fit import campaign_from_parameters
from rovid.compare.comparison import Comparison, compare
from rovid.compare.difference_tests import change_candidates, find_changes
from rovid.core.output_files import COMPARISON, OutputFile, OutputSet
from rovid.present.page.render import write_comparison
from rovid.present.plots import canvas
from rovid.present.plots.results import plot_drag, plot_ratios
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW
from tests.compare.files import stored_at, times
from tests.compare.pairs import VALUES, pair

NASTY = "</script><b>x</b>"


def both(folder: Path) -> Comparison:
    a, b = stored_at(folder / "a.toml"), stored_at(folder / "b.toml", times(1.1, "quadratic_drag"), log="b")
    return compare(campaign_from_parameters(a, NASTY), campaign_from_parameters(b, "b"))


def written(folder: Path, comparison: Comparison) -> str:
    page = OutputFile(folder / "page.html", COMPARISON)
    write_comparison(OutputSet([page]), page, comparison, Assumptions(), ["a note & more"])
    return page.path.read_text(encoding="utf-8")


def test_the_page_is_whole_and_nothing_on_it_acts(tmp_path: Path) -> None:
    text = written(tmp_path, both(tmp_path))
    assert NASTY not in text
    assert "&lt;b&gt;x&lt;/b&gt;" in text
    assert "quadratic drag, 1.1000 ± 0.0051 times" in text.replace("\u00a0", " ")
    assert text.count("<svg") == 2  # no run is simulated without logs
    assert "Predictions of the other" not in text
    assert "A note &amp; more." in text


def test_it_is_known_again(tmp_path: Path) -> None:
    written(tmp_path, both(tmp_path))
    written(tmp_path, both(tmp_path))


def test_pictures_have_units_and_keep_within(tmp_path: Path) -> None:
    del tmp_path
    given = pair(VALUES * [1.0, 1.1, 1.0, 1.0], seed=3)
    changes = find_changes(given, change_candidates(given))
    figures = [plot_ratios(changes, {name: name for name in given.names}), plot_drag(changes, 0.3, YAW)]
    for figure in figures:
        assert figure is not None
        canvas.render_png(figure)
        labels = [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel()) if text]
        assert all(any(unit in label for unit in ("share", "N m", "rad/s")) for label in labels)
        box = figure.get_tightbbox()
        assert min(box.x0, box.y0) >= 0.0
        assert box.x1 <= figure.get_figwidth()


def test_there_is_no_picture_of_what_is_not_known() -> None:
    given = pair(VALUES, count=1)
    changes = find_changes(given, change_candidates(given))
    assert plot_drag(changes, 0.3, YAW) is None
    nothing = replace(given, a=given.a * 0.0, b=given.b * 0.0)
    assert plot_ratios(find_changes(nothing, change_candidates(nothing)), {}) is None
