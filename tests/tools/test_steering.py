"""The runs for the test of feedback are what they are called."""

from __future__ import annotations

import numpy as np
import pytest

from tools.steering import CLOSED, OPEN, steered


@pytest.mark.parametrize("kind", [*OPEN, *CLOSED])
def test_a_run_is_whole_and_the_same_again(kind: str) -> None:
    for seed in range(3):
        run, again = steered(kind, seed), steered(kind, seed)
        assert np.array_equal(run.heading, again.heading)
        assert len(run.time) == len(run.heading) == len(run.torque)
        assert np.isfinite(run.heading).all()
        assert np.ptp(run.torque) > 0.0


def test_a_zigzag_by_heading_turns_at_its_heading() -> None:
    run = steered("zigzag by heading", 4)
    at = np.flatnonzero(np.diff(run.torque))[1:]
    senses = np.sign(run.torque[at])
    places = [run.heading[at][senses == sense] for sense in (1.0, -1.0)]
    assert np.mean(places[0]) - np.mean(places[1]) > 10.0 * max(map(np.std, places))


def test_a_heading_is_held() -> None:
    run = steered("heading hold", 2)
    later = run.heading[len(run.heading) // 2 :]
    assert np.std(later) < np.radians(5.0)
