"""How sure the parameters are where the likelihood alone would be too sure."""

from __future__ import annotations

import secrets
from pathlib import Path

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fisher_information import Innovations
from rovid.estimate.fit_result import FitResult, fit
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.maximum_likelihood import DISTURBANCE_LIMITS
from rovid.estimate.misspecification import misspecification_covariance
from rovid.estimate.output_error import fit_output_error
from rovid.store.study import open_study
from tests import synthetic
from tests.estimate.test_maximum_likelihood import SHORT
from tests.predictions import NOISE, TIME, TORQUE, fitted_ahead
from tools.trial_day import write_trial_day


@pytest.mark.parametrize(("jump", "every"), [(0.05, 5000), (3.0, 100)])
def test_jumps_of_innovations_make_no_certainty(jump: float, every: int, tmp_path: Path) -> None:
    write_trial_day(tmp_path / "day", seed=secrets.randbelow(10**6), formats="csv", campaign=SHORT)
    runs = open_study([tmp_path / "day"]).runs
    assert runs is not None
    misfit = InnovationLikelihood(InnovationData(runs.items, None, fit_output_error(runs.items)), DISTURBANCE_LIMITS[0])
    top = fit(misfit, misfit.parametrization.initial())

    class Jumping(InnovationLikelihood):
        """Innovations move by a part of their error where the inertia is above the best."""

        def innovations(self, x: FloatArray) -> Innovations:
            error, variance = super().innovations(x)
            moves = jump * (x[0] > top.x[0]) * (np.arange(len(error)) % every == 0)
            return Innovations(error + moves * np.sqrt(variance), variance)

    moved = FitResult.at(Jumping(misfit.data, DISTURBANCE_LIMITS[0]), top.x)
    smooth, jumping = (np.sqrt(np.diag(one.covariance(sandwich=False))) for one in (top, moved))
    assert jumping == pytest.approx(smooth, rel=0.02)


def test_horizons_that_disagree_widen_the_errors_and_are_named() -> None:
    """A torque that comes late shows to short predictions as another drag than to long ones."""
    right = fitted_ahead([synthetic.run(TIME[:900], TORQUE[:900], noise=NOISE[:900]) for _ in range(4)])
    doubt, said = misspecification_covariance(right)
    assert not said
    assert np.sqrt(doubt[0, 0]) < 0.002 * synthetic.ROSUB.inertia
    late = 0.5 * np.convolve(TORQUE, np.ones(60) / 60.0)[: len(TORQUE)]
    cuts = [slice(start, start + 2000) for start in (0, 2000, 4000)]
    runs = [synthetic.run(TIME[:2000], TORQUE[cut], noise=NOISE[:2000], disturbance=late[cut]) for cut in cuts]
    wrong = fitted_ahead(runs)
    doubt, said = misspecification_covariance(wrong)
    assert len(said) == 1
    assert "half of the difference" in said[0]
    assert np.diag(doubt)[:3].max() > 0.0
