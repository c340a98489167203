"""The filter in C says what rovid's does: a reference that says something else measures nothing."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from benchmarks.passes import LANES, LIMIT, SAME, Reference, farthest, passes, points_about, readings_of
from rovid.identify.innovations import InnovationMisfit


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("lanes", [1, LANES])
@pytest.mark.parametrize("interval", [0.0, 2.0], ids=["one step", "several steps"])
def test_the_filter_in_c_has_the_innovations_of_rovid(tmp_path: Path, lanes: int, interval: float) -> None:
    misfit = InnovationMisfit(readings_of(60.0, interval), LIMIT)
    points = points_about(misfit, lanes)
    theirs = Reference(tmp_path, lanes).prepared(misfit, points)()
    assert farthest(theirs, passes(misfit, points)) < SAME


def test_rovid_is_asked_for_several_sets_at_once_where_it_can() -> None:
    misfit = InnovationMisfit(readings_of(20.0), LIMIT)
    points = points_about(misfit, 3)
    each = [misfit.innovations(x) for x in points]
    # Side by side sums are taken in another order.
    assert farthest(passes(misfit, points), each) < SAME
    assert len({float(one.error[-1]) for one in each}) == len(points)
