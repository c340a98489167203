"""One of two campaigns: which causes both models get."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.compare.campaign_fit import (
    CampaignFit,
    campaign_from_parameters,
    campaign_from_study,
    shared_effects,
    shared_estimate,
)
from rovid.core.errors import DataError
from rovid.diagnose.result import Diagnosis, Finding
from rovid.effects import effect_named
from rovid.estimate.estimate import Estimate
from rovid.store.study import open_study
from tests.compare.files import LAGGING, PLAIN, stored_at
from tests.conftest import SAMPLES

NOTHING = Estimate(names=(), values=np.zeros(0), covariance=np.zeros((0, 0)), method="", samples=0)


def finding(key: str, worth: float, confidence: float = 0.97) -> Finding:
    return Finding(
        effect=effect_named(key),
        estimate=NOTHING,
        gain=worth,
        bic_gain=worth,
        held_out_gain=worth,
        probability=confidence,
        alternatives=(),
        indistinguishable=(),
    )


@pytest.fixture(scope="module")
def plain(before: Path) -> CampaignFit:
    return campaign_from_study(open_study([before]), "before")


def found(day: CampaignFit, *findings: Finding, suspects: tuple[Finding, ...] = ()) -> CampaignFit:
    return replace(day, diagnosis=Diagnosis(verdict="found", findings=findings, suspects=suspects))


def test_both_get_the_causes_of_either_in_one_form_each(plain: CampaignFit) -> None:
    a = found(plain, finding("thruster_lag", 50.0), finding("bias_torque", 20.0))
    b = found(plain, finding("thruster_lag:rotor", 80.0), suspects=(finding("thrust_asymmetry", 9.0, 0.6),))
    assert [effect.key for effect in shared_effects(a, b)] == ["thruster_lag:rotor", "bias_torque", "thrust_asymmetry"]


def test_what_is_only_possible_or_of_one_trial_is_not_shared(plain: CampaignFit) -> None:
    a = found(plain, finding("supply_sag:trial sine.csv", 30.0), suspects=(finding("drag_curvature", 4.0, 0.3),))
    assert shared_effects(a, found(plain)) == []


def test_not_all_thrusters_are_weak_at_once(plain: CampaignFit) -> None:
    a = found(plain, finding("thruster_imbalance:fore", 50.0))
    b = found(plain, finding("thruster_imbalance:aft", 60.0))
    assert [effect.key for effect in shared_effects(a, b)] == ["thruster_imbalance:aft"]


def test_what_needs_a_signal_that_one_lacks_is_left_out(plain: CampaignFit) -> None:
    needs = next(key for key in ("speed_dependent_damping", "sideslip_moment") if effect_named(key).needs)
    assert shared_effects(found(plain, finding(needs, 50.0)), found(plain)) == []


def test_a_file_says_what_stands_in_it(tmp_path: Path) -> None:
    day = campaign_from_parameters(stored_at(tmp_path / "p.toml", LAGGING), "p")
    said = shared_estimate(day, day.found_effects)
    assert said.names == tuple(LAGGING)
    assert np.allclose(np.sqrt(np.diag(said.covariance)), [error for _, error in LAGGING.values()])
    assert not said.white  # nobody knows


def test_what_was_looked_for_in_vain_is_nothing_within_what_would_have_been_seen(tmp_path: Path) -> None:
    day = campaign_from_parameters(stored_at(tmp_path / "p.toml", PLAIN), "p", {"thruster_lag": 0.05})
    said = shared_estimate(day, [effect_named("thruster_lag")])
    assert said.names[-1] == "thruster_lag.time_constant"
    assert said.values[-1] == 0.0
    assert 0.0 < said.covariance[-1, -1] ** 0.5 < 0.05


def test_tables_are_refused() -> None:
    with pytest.raises(DataError, match="tables"):
        campaign_from_study(open_study([SAMPLES / "rosub_paper"]), "paper")
