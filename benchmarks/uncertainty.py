"""Do the standard errors hold? Many synthetic days with new seeds: share of truths within one and two of them.

``--hide CASE`` (a name of `tools.cases`) hides an effect in every day and fits it with all else: the scatter of what
is found over its standard errors, which are those of the information matrix, is that over the Cramer-Rao bound.
"""

from __future__ import annotations

import argparse
import secrets
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

from rovid.effects import effect_named
from rovid.estimate.estimate import Estimate
from rovid.estimate.inertia import fit_inertia
from rovid.estimate.maximum_likelihood import fit_likelihood
from rovid.estimate.steady_drag import fit_drag
from rovid.estimate.steady_points import steady_points
from rovid.readers import read_campaign
from rovid.trial.config import find_config, load_config
from rovid.trial.preprocessing import prepare
from tools.cases import Case, all_cases, truth_of
from tools.trial_day import write_trial_day
from tools.truth import VEHICLES, Truth

NAMED: Mapping[str, Truth] = dict(zip(("rosub", "observation", "small"), VEHICLES, strict=True))


def deviations(seed: int, vehicle: str, case: str | None) -> dict[str, float]:
    """(estimate - truth) / standard error of everything that is estimated on the day with this ``seed``."""
    hidden = None if case is None else next(each for each in all_cases(NAMED[vehicle]) if each.name == case)
    with tempfile.TemporaryDirectory() as name:
        truth = truth_of(NAMED[vehicle], () if hidden is None else (hidden,))
        truth = write_trial_day(Path(name), seed=seed, formats="csv", truth=truth)
        config = load_config(find_config([Path(name)]))
        runs = prepare(read_campaign([Path(name)], config), config.vehicle)
    dynamics = truth.dynamics
    true = {"inertia": dynamics.inertia, "quadratic_drag": dynamics.quadratic_drag, "linear_drag": dynamics.linear_drag}
    if hidden is not None:
        effects = (effect_named(hidden.expected_effect or ""),)
        true |= of_effect(hidden)
        return normalised(fit_likelihood(runs.items, config.vehicle, effects).estimate, true, "likelihood")
    drag = fit_drag(steady_points(runs.items, config.vehicle)).estimate
    fit = fit_inertia(runs.items, drag=drag, rigid_body=config.vehicle.rigid_body_inertia)
    assert fit.regression is not None
    sines = {key: fit.methods[key] for key in ("orbit_integral", "harmonic_balance")}
    return (
        normalised(drag, true, "steady")
        | {f"inertia, {key}": (one.value - dynamics.inertia) / one.standard_error for key, one in sines.items()}
        | normalised(fit.regression.estimate, true, "regression")
        | normalised(fit_likelihood(runs.items).estimate, true, "likelihood")
    )


def of_effect(case: Case) -> dict[str, float]:
    return {f"{case.expected_effect}.{name}": value for name, value in (case.expected_parameters or {}).items()}


def normalised(estimate: Estimate, truth: Mapping[str, float], method: str) -> dict[str, float]:
    return {
        f"{name}, {method}": (estimate.value(name) - truth[name]) / estimate.standard_error(name)
        for name in estimate.names
        if name in truth
    }


def table(rows: Sequence[Mapping[str, float]]) -> str:
    lines = [
        f"{'':36} {'within 1 se':>12} {'within 2 se':>12} {'mean':>8} {'scatter':>8}   (68 %, 95 %, 0, 1 expected)"
    ]
    for name in rows[0]:
        column = np.array([row[name] for row in rows])
        inside = [100 * float(np.mean(np.abs(column) <= k)) for k in (1, 1.96)]
        lines.append(
            f"{name:36} {inside[0]:10.1f} % {inside[1]:10.1f} % {column.mean():8.2f} {column.std(ddof=1):8.2f}"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--days", type=int, default=50)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6), help="of the first day")
    parser.add_argument("--vehicle", choices=list(NAMED), default="rosub")
    parser.add_argument("--hide", metavar="CASE", help="thruster_lag-first_order-weak, for one")
    parser.add_argument("--jobs", type=int)
    arguments = parser.parse_args()
    work = partial(deviations, vehicle=arguments.vehicle, case=arguments.hide)
    with ProcessPoolExecutor(arguments.jobs) as pool:
        rows = list(pool.map(work, range(arguments.seed, arguments.seed + arguments.days)))
    print(
        f"{arguments.days} days from seed {arguments.seed}, {arguments.vehicle}, hidden: {arguments.hide or 'nothing'}"
    )
    print(table(rows))


if __name__ == "__main__":
    main()
