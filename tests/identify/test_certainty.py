"""How sure the parameters are where the likelihood alone would be too sure."""

from __future__ import annotations

import secrets
from pathlib import Path

import numpy as np
import pytest

from rovid.ground.arrays import FloatArray
from rovid.identify.certainty import covariance, form_doubt
from rovid.identify.free_run import fit_free_run
from rovid.identify.innovations import Likelihood
from rovid.identify.likelihood import LIMITS
from rovid.identify.records import Records
from rovid.study import open_study
from tests import synthetic
from tests.identify.test_likelihood import SHORT
from tests.predictions import NOISE, TIME, TORQUE, ahead_likelihood
from tools.trial_day import write_trial_day


@pytest.mark.parametrize(("jump", "every"), [(0.05, 5000), (3.0, 100)])
def test_jumps_of_innovations_make_no_certainty(jump: float, every: int, tmp_path: Path) -> None:
    write_trial_day(tmp_path / "day", seed=secrets.randbelow(10**6), formats="csv", campaign=SHORT)
    runs = open_study([tmp_path / "day"]).runs
    assert runs is not None
    likelihood = Likelihood(Records(runs.items, None, fit_free_run(runs.items)), LIMITS[0])
    top, _ = likelihood.climb(likelihood.first())

    class Jumping(Likelihood):
        """Innovations move by a part of their error where the inertia is above the best."""

        def innovations(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
            error, variance = super().innovations(x)
            return error + jump * (x[0] > top[0]) * np.sqrt(variance) * (np.arange(len(error)) % every == 0), variance

    smooth, jumping = (
        np.sqrt(np.diag(covariance(kind(likelihood.records, LIMITS[0]), top, sandwich=False)))
        for kind in (Likelihood, Jumping)
    )
    assert jumping == pytest.approx(smooth, rel=0.02)


def test_horizons_that_disagree_widen_the_errors_and_are_named() -> None:
    """A torque that comes late shows to short predictions as another drag than to long ones."""
    right = ahead_likelihood([synthetic.run(TIME[:900], TORQUE[:900], noise=NOISE[:900]) for _ in range(4)])
    x, _ = right.climb(right.first())
    doubt, said = form_doubt(right, x)
    assert not said
    assert np.sqrt(doubt[0, 0]) < 2.0 * np.sqrt(covariance(right, x, sandwich=True)[0, 0])
    late = 0.1 * np.convolve(TORQUE, np.ones(60) / 60.0)[: len(TORQUE)]
    cuts = [slice(start, start + 2000) for start in (0, 2000, 4000)]
    runs = [synthetic.run(TIME[:2000], TORQUE[cut], noise=NOISE[:2000], disturbance=late[cut]) for cut in cuts]
    wrong = ahead_likelihood(runs)
    x, _ = wrong.climb(wrong.first())
    doubt, said = form_doubt(wrong, x)
    assert len(said) == 1
    assert "half of the difference" in said[0]
    assert np.diag(doubt)[:3].max() > 0.0
