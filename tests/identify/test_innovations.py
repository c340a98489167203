"""The climb to the most likely parameters."""

from __future__ import annotations

import secrets
from pathlib import Path

from rovid.identify.climb import End, climb
from rovid.identify.free_run import fit_free_run
from rovid.identify.innovations import InnovationMisfit
from rovid.identify.likelihood import LIMITS
from rovid.identify.readings import Readings
from rovid.study import open_study
from tests.identify.test_likelihood import SHORT, advanced_commands
from tools.trial_day import write_trial_day


def test_a_model_that_misses_much_is_fitted_to_the_end(tmp_path: Path) -> None:
    write_trial_day(tmp_path / "day", seed=secrets.randbelow(10**6), formats="csv", campaign=SHORT)
    advanced_commands(tmp_path / "day", 32)
    runs = open_study([tmp_path / "day"]).runs
    assert runs is not None
    misfit = InnovationMisfit(Readings(runs.items, None, fit_free_run(runs.items)), LIMITS[-2])
    first = misfit.coordinates.first()
    soon, late = climb(misfit, first, iterations=25), climb(misfit, first, iterations=300, tolerance=1e-6)
    # By scoring alone it would still be thousands away.
    assert soon.cost - late.cost < 1.0
    assert climb(misfit, late.x).end is End.REACHED
    assert climb(misfit, first, iterations=1).end is End.OUT_OF_STEPS
