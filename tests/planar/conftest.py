"""A small campaign with its fit, which several tests share."""

from __future__ import annotations

import pytest

from rovid.planar.dataset import PlanarData
from rovid.planar.fit import fit_base
from rovid.planar.optimum import PlanarOptimum
from tests.planar.vehicles import box_rov, campaign


@pytest.fixture(scope="session")
def small() -> tuple[PlanarData, PlanarOptimum]:
    """A vehicle in still water, and the fit without effects."""
    data = campaign(box_rov(3), runs=2, levels=6, hold=4.0, seed=2)
    return data, fit_base(data)
