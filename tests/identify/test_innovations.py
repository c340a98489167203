"""The climb to the most likely parameters."""

from __future__ import annotations

import secrets
from pathlib import Path

from rovid.identify.free_run import fit_free_run
from rovid.identify.innovations import Likelihood
from rovid.identify.likelihood import LIMITS
from rovid.identify.records import Records
from rovid.study import open_study
from tests.identify.test_likelihood import SHORT, advanced_commands
from tools.trial_day import write_trial_day


def test_a_model_that_misses_much_is_fitted_to_the_end(tmp_path: Path) -> None:
    write_trial_day(tmp_path / "day", seed=secrets.randbelow(10**6), formats="csv", campaign=SHORT)
    advanced_commands(tmp_path / "day", 32)
    runs = open_study([tmp_path / "day"]).runs
    assert runs is not None
    likelihood = Likelihood(Records(runs.items, None, fit_free_run(runs.items)), LIMITS[-2])
    _, soon = likelihood.climb(likelihood.first(), iterations=25)
    _, late = likelihood.climb(likelihood.first(), iterations=300, tolerance=1e-6)
    # By scoring alone it would still be thousands away.
    assert soon - late < 1.0
