"""A small fleet: two vehicles, three campaigns that can be diagnosed, one without rovid.toml."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rovid.fleet.campaigns import CampaignRecord
from rovid.fleet.results import Fleet
from tools.cases import hide
from tools.programme import Hold, Run, Sine
from tools.trial_day import write_trial_day
from tools.truth import ROSUB

# The shortest data for a diagnosis, because each one is a process.
SHORT = (
    Run(name="up", pieces=(Hold(1.04, 40.0), Hold(1.94, 40.0)), format="json"),
    Run(name="down", pieces=(Hold(-1.29, 40.0), Hold(-1.97, 40.0))),
    Run(name="sine", pieces=(Sine(2.0, 2.51, 20.0, 4),)),
)
GOOD = ("alpha/spring", "alpha/summer", "beta/summer")


@pytest.fixture(scope="session")
def sea(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the fleet; tests do not write into it."""
    folder = tmp_path_factory.mktemp("fleet") / "the sea"
    for seed, name in enumerate(GOOD):
        truth = replace(ROSUB, hidden=(hide(ROSUB, "thruster_lag:0.8"),)) if name == "alpha/summer" else ROSUB
        write_trial_day(folder / name, seed=seed, truth=truth, campaign=SHORT)
    for name, vehicle in (("alpha/spring", "Älpha"), ("alpha/summer", "Älpha"), ("beta/summer", "Beta")):
        config = folder / name / "rovid.toml"
        lines = config.read_text(encoding="utf-8").splitlines()
        at = next(place for place, line in enumerate(lines) if line.startswith("name = "))
        lines[at] = f'name = "{vehicle}"'
        config.write_text("\n".join(lines) + "\n", encoding="utf-8")
    lost = folder / "beta" / "lost & found"
    lost.mkdir(parents=True)
    shutil.copy(folder / "alpha/spring/down.csv", lost)
    return folder


Made = Callable[..., CampaignRecord]


@pytest.fixture
def made() -> Made:
    """Make a record with values and standard errors by name."""

    def make(
        name: str,
        values: Mapping[str, tuple[float, float]],
        *,
        vehicle: str = "one",
        start: float | None = None,
        causes: tuple[str, ...] = (),
        suspects: tuple[str, ...] = (),
        guessed: bool = False,
    ) -> CampaignRecord:
        parameters: dict[str, Any] = {
            key: {"value": value, "standard_error": error, "unit": "kg m^2"}
            | ({"placeholder": True} if guessed else {})
            for key, (value, error) in values.items()
        }
        diagnosis: dict[str, Any] = {
            "verdict": "found" if causes else "suspected" if suspects else "nothing_found",
            "findings": [{"effect": effect} for effect in causes],
            "suspects": [{"effect": effect} for effect in suspects],
            "guessed": ["yaw_arm of fore"] if guessed else [],
            "base": {"parameters": parameters},
            "extended": None,
        }
        return CampaignRecord(campaign=name, folder="", digest="", vehicle=vehicle, start=start, diagnosis=diagnosis)

    return make


def fleet_of(*records: CampaignRecord) -> Fleet:
    return Fleet(axis="yaw", records=records)
