"""The filter in C says what rovid's does: a reference that says something else measures nothing."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from benchmarks.passes import LIMIT, SAME, Reference, farthest, points_about, readings_of
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.jit.simd import LANES


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
@pytest.mark.parametrize("lanes", [1, LANES])
@pytest.mark.parametrize("interval", [0.0, 2.0], ids=["one step", "several steps"])
def test_the_filter_in_c_has_the_innovations_of_rovid(tmp_path: Path, lanes: int, interval: float) -> None:
    misfit = InnovationLikelihood(readings_of(60.0, interval), LIMIT)
    points = points_about(misfit, lanes)
    theirs = Reference(tmp_path, lanes).prepared(misfit, points)()
    assert farthest(theirs, misfit.evaluate(points)) < SAME
