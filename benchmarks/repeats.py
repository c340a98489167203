"""Do the stated errors agree with the scatter between repeats of a manoeuvre?

Run ``python -m benchmarks.repeats FOLDER zigzag turn``: each log of FOLDER whose name begins with a word is fitted
alone, and all logs of the word together. The scatter between logs of one word is compared with the stated errors (F
test). Different manoeuvres excite what the model lacks differently, so their fits are compared too.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.errors import DataError
from rovid.core.stats import chi2_sf
from rovid.estimate.estimate import Estimate
from rovid.estimate.maximum_likelihood import fit_likelihood
from rovid.readers import read_campaign
from rovid.trial.config import find_config, load_config
from rovid.trial.preprocessing import prepare
from rovid.trial.trial import Campaign, Trial
from rovid.trial.vehicle import Vehicle

NAMES = ("inertia", "quadratic_drag", "linear_drag")


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """Mean square deviation of repeats from their weighted mean, in stated errors; its probability or a larger one."""

    ratio: float
    probability: float


def scatter(values: Sequence[float], errors: Sequence[float]) -> Scatter:
    """F test of the scatter of two or more ``values`` against their ``errors``."""
    value, weight = np.array(values), 1.0 / np.square(errors)
    mean = float(value @ weight / weight.sum())
    square, freedom = float(weight @ (value - mean) ** 2), len(values) - 1
    return Scatter(ratio=square / freedom, probability=chi2_sf(freedom, square))


def fitted(campaign: Campaign, trials: Sequence[Trial], vehicle: Vehicle) -> Estimate | None:
    """Fit of some trials; None where they do not determine the inertia."""
    try:
        return fit_likelihood(prepare(replace(campaign, trials=tuple(trials)), vehicle).items, vehicle).estimate
    except DataError:
        return None


def row(words: str, estimate: Estimate | None) -> str:
    if estimate is None:
        return f"{words:40} not determined"
    each = [f"{estimate.value(name):10.5g} ± {estimate.standard_error(name):<9.3g}" for name in NAMES]
    return f"{words:40} {' '.join(each)}"


def table(estimates: Sequence[Estimate]) -> FloatArray:
    """(2, n, 3) values and errors of inertia and drags."""
    rows = [[(one.value(name), one.standard_error(name)) for name in NAMES] for one in estimates]
    return np.moveaxis(np.array(rows), 2, 0)


def compare(words: str, estimates: Sequence[Estimate]) -> None:
    """Print the F test of some estimates of the same parameters."""
    values, errors = table(estimates)
    each = [scatter(values[:, at], errors[:, at]) for at in range(len(NAMES))]
    print(f"{words:40} " + " ".join(f"F {one.ratio:.2f} (p = {one.probability:.2g})".ljust(22) for one in each))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="logs and rovid.toml")
    parser.add_argument("words", nargs="+", help="beginnings of the names of repeats")
    options = parser.parse_args()
    config = load_config(find_config([options.folder]))
    campaign = read_campaign([options.folder], config)
    print(f"{'':40} " + " ".join(name.ljust(22) for name in NAMES))
    together = list[tuple[str, Estimate]]()
    for word in options.words:
        trials = [trial for trial in campaign.trials if trial.name.startswith(word)]
        logs = [list(group) for _, group in groupby(trials, key=lambda trial: trial.path)]
        alone = [fitted(campaign, log, config.vehicle) for log in logs]
        for log, estimate in zip(logs, alone, strict=True):
            print(row(log[0].path.stem, estimate))
        known = [estimate for estimate in alone if estimate is not None]
        if len(known) > 1:
            compare(f"{word}: {len(known)} of {len(logs)} logs", known)
        whole = fitted(campaign, trials, config.vehicle)
        print(row(f"{word}: all", whole))
        if whole is not None:
            together.append((word, whole))
    for (one, first), (other, second) in pairwise(together):
        compare(f"{one} against {other}", [first, second])


if __name__ == "__main__":
    main()
