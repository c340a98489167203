"""How far a target's motion is from rovid's."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rovid.export.resimulation import compare_rates


def test_what_runs_away_is_off_by_a_number_all_the_same() -> None:
    mismatch = compare_rates(np.array([0.0, 0.1, 0.2]), np.array([0.0, 1e200, -1e200]))
    assert mismatch.rms == pytest.approx(1e200 * math.sqrt(2.0 / 3.0))
