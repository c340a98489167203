"""Do the standard errors hold? Many synthetic days with new seeds: share of truths within one and two of them."""

from __future__ import annotations

import argparse
import secrets
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from rovid.config import find_config, load_config
from rovid.identify.estimate import Estimate
from rovid.identify.inertia import fit_inertia
from rovid.identify.likelihood import fit_likelihood
from rovid.identify.steady import fit_drag, steady_points
from rovid.readers import read_campaign
from rovid.runs import prepare
from tools.trial_day import write_trial_day

COLUMNS = (
    *("DQ steady", "DL steady"),
    *("I orbit", "I balance"),
    *("I regression", "DQ regression", "DL regression"),
    *("I likelihood", "DQ likelihood", "DL likelihood"),
)


def deviations(seed: int) -> list[float]:
    """(estimate - truth) / standard error, for each of COLUMNS."""
    with tempfile.TemporaryDirectory() as name:
        truth = write_trial_day(Path(name), seed=seed, formats="csv").dynamics
        config = load_config(find_config([Path(name)]))
        runs = prepare(read_campaign([Path(name)], config), config.vehicle)
    drag = fit_drag(steady_points(runs.items, config.vehicle)).estimate
    fit = fit_inertia(runs.items, drag=drag, rigid_body=config.vehicle.rigid_body_inertia)
    assert fit.regression is not None
    true = {"inertia": truth.inertia, "quadratic_drag": truth.quadratic_drag, "linear_drag": truth.linear_drag}
    sines = [fit.methods[key] for key in ("orbit_integral", "harmonic_balance")]
    return [
        *normalised(drag, true),
        *((reading.value - truth.inertia) / reading.standard_error for reading in sines),
        *normalised(fit.regression.estimate, true),
        *normalised(fit_likelihood(runs.items).estimate, true),
    ]


def normalised(estimate: Estimate, truth: dict[str, float]) -> list[float]:
    return [(estimate.value(name) - truth[name]) / estimate.standard_error(name) for name in estimate.names]


def table(rows: Sequence[Sequence[float]]) -> str:
    z = np.array(rows)
    lines = [f"{'':15} {'within 1 se':>12} {'within 2 se':>12} {'mean':>8} {'rms':>6}   (68 %, 95 %, 0, 1 expected)"]
    for name, column in zip(COLUMNS, z.T, strict=True):
        inside = [100 * float(np.mean(np.abs(column) <= k)) for k in (1, 2)]
        rms = float(np.sqrt(np.mean(column**2)))
        lines.append(f"{name:15} {inside[0]:10.0f} % {inside[1]:10.0f} % {column.mean():8.2f} {rms:6.2f}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--days", type=int, default=50)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6), help="of the first day")
    arguments = parser.parse_args()
    with ProcessPoolExecutor() as pool:
        rows = list(pool.map(deviations, range(arguments.seed, arguments.seed + arguments.days)))
    print(f"{arguments.days} days from seed {arguments.seed}\n{table(rows)}")


if __name__ == "__main__":
    main()
