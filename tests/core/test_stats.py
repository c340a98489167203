"""Each tail and quantile is that of the distribution it is named after, and is imported when it is asked for."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from rovid.core.stats import chi2_sf, f_cdf, f_sf, logistic, logit, t_cdf, t_quantile
from tests.conftest import SAMPLES

FREEDOM = (1.0, 2.5, 20.0)


@pytest.mark.parametrize("freedom", FREEDOM)
@pytest.mark.parametrize("value", [0.0, 0.3, 4.0, 80.0])
def test_tails(freedom: float, value: float) -> None:
    assert chi2_sf(freedom, value) == pytest.approx(stats.chi2(freedom).sf(value))
    assert f_sf(3.0, freedom, value) == pytest.approx(stats.f(3.0, freedom).sf(value))
    assert f_cdf(3.0, freedom, value) == pytest.approx(stats.f(3.0, freedom).cdf(value))
    assert t_cdf(freedom, -value) == pytest.approx(stats.t(freedom).cdf(-value))


@pytest.mark.parametrize("probability", [0.025, 0.5, 0.975])
def test_quantiles(probability: float) -> None:
    for freedom in FREEDOM:
        assert t_quantile(probability, freedom) == pytest.approx(stats.t(freedom).ppf(probability))
    assert t_quantile(probability, math.inf) == pytest.approx(stats.norm.ppf(probability))


def test_odds() -> None:
    for probability in (0.001, 0.5, 0.96):
        assert logit(probability) == pytest.approx(math.log(probability / (1.0 - probability)))
        assert logistic(logit(probability)) == pytest.approx(probability)
    assert (logit(0.0), logit(1.0)) == (-math.inf, math.inf)
    assert (logistic(-math.inf), logistic(-1e6), logistic(1e6)) == (0.0, 0.0, 1.0)


def test_a_command_that_needs_none_does_not_wait_for_them(here: Path) -> None:
    ended = "try: main()\nfinally: print('scipy.special' in sys.modules)"
    code = f"import sys\nfrom rovid.cli.cli import main\n{ended}"
    command = [sys.executable, "-c", code, "convert", str(SAMPLES / "rosub_tank" / "hold_03.csv"), "-o", "hold.csv"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=here)
    assert done.stdout.splitlines()[-1] == "False"
    assert np.loadtxt(here / "hold.csv", delimiter=",", skiprows=1, usecols=0).size > 100
