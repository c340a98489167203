from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from rovid.estimate.estimate import Estimate
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.store.checks import method_disagreement
from rovid.store.parameter_file import Entry

ORBIT = "orbit integral over whole periods"


def estimate(inertia: float, error: float, method: str) -> Estimate:
    return Estimate(
        names=("inertia",),
        values=np.array([inertia]),
        covariance=np.array([[error**2]]),
        method=method,
        samples=9,
    )


def entries(inertia: float, error: float, method: str) -> Mapping[str, Entry]:
    return {"inertia": Entry(value=inertia, standard_error=error, unit="kg m^2", method=method)}


@pytest.mark.parametrize(
    ("before", "now", "believed"),
    [(ORBIT, InnovationLikelihood.method, "this result"), (InnovationLikelihood.method, ORBIT, "the other result")],
)
def test_disagreeing_methods_give_one_warning(before: str, now: str, believed: str) -> None:
    (text,) = method_disagreement(entries(67.0, 2.0, before), estimate(17.0, 1.0, now))
    assert "22 joint standard errors" in text
    assert f"Use {believed}" in text


def test_agreeing_methods_give_no_warning() -> None:
    assert method_disagreement(entries(67.0, 2.0, ORBIT), estimate(62.0, 1.0, InnovationLikelihood.method)) == []
    assert method_disagreement({}, estimate(62.0, 1.0, InnovationLikelihood.method)) == []
    # The same command again, with more logs.
    assert method_disagreement(entries(67.0, 2.0, ORBIT), estimate(17.0, 1.0, ORBIT)) == []
