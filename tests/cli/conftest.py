"""A day of logs for the commands."""

from __future__ import annotations

from pathlib import Path

import pytest

from tools.programme import Hold, Run, Sine
from tools.trial_day import write_trial_day

SMALL_DAY = (
    Run(name="holds up", pieces=(Hold(1.04, 60.0), Hold(1.55, 60.0), Hold(1.94, 60.0))),
    Run(name="holds dówn", pieces=(Hold(-1.29, 60.0), Hold(-1.97, 60.0))),
    Run(name="sine", pieces=(Sine(2.0, 2.51, 20.0, 5),)),
)


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("a day") / "søme logs"
    write_trial_day(folder, seed=3, formats="csv", campaign=SMALL_DAY)
    return folder
