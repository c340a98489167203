"""The recommendation of the coupled model after a diagnosis of yaw."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rovid.diagnose.log_rivals import coupled_causes, coupled_sentence
from rovid.diagnose.result import Diagnosis, Finding
from rovid.effects import effect_named
from rovid.estimate.estimate import Estimate
from rovid.trial.trial import Trial


def found(*names: str) -> Diagnosis:
    estimate = Estimate(names=(), values=np.zeros(0), covariance=np.zeros((0, 0)), method="", samples=0)
    findings = tuple(
        Finding(
            effect=effect_named(name),
            estimate=estimate,
            gain=50.0,
            bic_gain=45.0,
            held_out_gain=40.0,
            standard_errors=9.0,
            probability=0.97,
            alternatives=(),
            indistinguishable=(),
        )
        for name in names
    )
    return Diagnosis(verdict="found", findings=findings)


def trial(*channels: str) -> Trial:
    time = np.arange(10.0)
    extras = {name: np.zeros(10) for name in channels}
    return Trial(
        name="run", path=Path("run"), time=time, position=np.zeros(10), commands=np.zeros((10, 1)), extras=extras
    )


@pytest.mark.parametrize(
    ("names", "channels", "coupled"),
    [
        (("sideslip_moment", "thruster_lag"), ("surge_velocity", "sway_velocity"), ("sideslip_moment",)),
        (("sideslip_moment", "wave_torque"), ("surge_velocity", "sway_velocity"), ("sideslip_moment", "wave_torque")),
        (("wave_torque", "thruster_lag"), ("surge_velocity", "sway_velocity"), ()),
        (("sideslip_moment",), (), ()),
    ],
)
def test_motion_along_sway_recommends_the_coupled_model_where_it_is_logged(
    names: tuple[str, ...], channels: tuple[str, ...], coupled: tuple[str, ...]
) -> None:
    diagnosis, trials = found(*names), [trial(*channels)]
    assert coupled_causes(diagnosis, trials) == coupled
    assert ("--axes planar" in coupled_sentence(diagnosis, trials)) == bool(coupled)
