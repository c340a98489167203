"""Standard errors of maximum likelihood beside a bootstrap over trials: whole trials drawn again with replacement.

``python -m benchmarks.bootstrap LOGS --effect thruster_lag`` fits the logs once and then each draw of them.
"""

from __future__ import annotations

import argparse
import secrets
from dataclasses import replace
from pathlib import Path

import numpy as np

from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import fit
from rovid.estimate.maximum_likelihood import add_effects, fit_innovations
from rovid.estimate.output_error import fit_output_error
from rovid.model.parameter_names import base_names
from rovid.store.study import open_study
from rovid.trial.axis import YAW


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--effect", action="append", default=[], metavar="ID")
    parser.add_argument("--draws", type=int, default=60)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6))
    arguments = parser.parse_args()
    study = open_study(arguments.logs)
    assert study.runs is not None
    runs, effects = study.runs.items, tuple(effect_named(name) for name in arguments.effect)
    start = fit_output_error(runs)
    data = InnovationData(runs, study.vehicle, start)
    fitted = fit_innovations(data, data.free_run_r2(start))
    if effects:
        fitted = add_effects(fitted, effects)
    white = fitted.is_white
    stated = np.sqrt(np.diag(fitted.covariance(sandwich=not white)))
    rng, drawn = np.random.default_rng(arguments.seed), []
    for _ in range(arguments.draws):
        chosen = [runs[k] for k in rng.integers(len(runs), size=len(runs))]
        again = replace(fitted.objective, data=InnovationData(chosen, study.vehicle, start))
        drawn.append(fit(again, fitted.x).model.values)
    scatter = np.std(drawn, axis=0, ddof=1)
    source = "curvature (white innovations)" if white else "scatter between stretches"
    print(f"{len(runs)} trials, {arguments.draws} draws, seed {arguments.seed}; stated by {source}")
    names = [*base_names(YAW), *(f"{effect.key}.{p.name}" for effect in effects for p in effect.parameters)]
    for name, value, one, other in zip(names, fitted.model.values, stated, scatter, strict=True):
        print(f"{name:32} {value:12.5g}  stated {one:10.3g}  bootstrap {other:10.3g}  ratio {other / one:5.2f}")


if __name__ == "__main__":
    main()
