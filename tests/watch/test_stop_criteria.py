"""Stop criteria of a trial day."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.errors import ConfigError
from rovid.estimate.estimate import Estimate
from rovid.model.parameter_names import base_names
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW, axis_named
from rovid.watch.session import parse_criteria


def estimate(error: float, *, guess: Assumptions | None = None, refused: bool = False) -> Estimate:
    return Estimate(
        names=("inertia", "thruster_lag:rotor.time_constant"),
        values=np.array([100.0, 0.5]),
        covariance=np.diag([error**2, 0.01**2]),
        method="",
        samples=1,
        refused={"inertia": "nothing drives it"} if refused else {},
        assumptions=guess or Assumptions(),
    )


def test_criteria_are_names_and_percentages() -> None:
    (first, second, third) = parse_criteria(" inertia 2 %, quadratic drag 5%,thruster_lag 95 %", YAW)
    assert (first.name, first.share, first.is_effect) == ("inertia", 0.02, False)
    assert (second.name, second.share) == ("quadratic_drag", 0.05)
    assert (third.name, third.is_effect) == ("thruster_lag", True)
    assert str(third) == "thruster_lag 95 %"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("inertia", "a name and a percentage were expected"),
        ("inertia 2", "a name and a percentage were expected"),
        ("inertai 2 %", "'inertia'"),
        ("thruster_lag.time 2 %", "'time_constant'"),
        ("inertia 0 %", "cannot be reached"),
        ("thruster_lag 100 %", "cannot be reached"),
    ],
)
def test_invalid_criteria_are_refused(text: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        parse_criteria(text, YAW)


def test_names_are_those_of_the_axis() -> None:
    *_, restoring = base_names(axis_named("roll"))
    (one,) = parse_criteria(f"{restoring} 10 %", axis_named("roll"))
    assert not one.is_effect
    with pytest.raises(ConfigError):
        parse_criteria(f"{restoring} 10 %", YAW)


def test_causes_need_a_diagnosis() -> None:
    with pytest.raises(ConfigError, match="needs a diagnosis"):
        parse_criteria("thruster_lag 90 %", YAW, diagnosed=False)


def test_a_parameter_criterion_uses_the_95_percent_interval() -> None:
    (one, lag) = parse_criteria("inertia 2 %, thruster_lag.time_constant 5 %", YAW)
    # 1.96 standard errors to either side.
    for error, met in ((1.0, True), (1.03, False)):
        standing = one.status(estimate(error), None)
        assert standing.current == pytest.approx(0.0196 * error, rel=1e-3)
        assert standing.met is met
    assert lag.status(estimate(1.0), None).met


def test_unknown_parameters_do_not_meet_a_criterion() -> None:
    (one,) = parse_criteria("inertia 50 %", YAW)
    guess = Assumptions(items=("curve of fore",), thrusters=1)
    for known in (None, estimate(1.0, refused=True), estimate(1.0, guess=guess)):
        standing = one.status(known, None)
        assert (standing.current, standing.met) == (None, False)
