"""Is a run with optimised levels and switching times worth more than the best run of the list?

Run ``python -m benchmarks.designs``. The problems are the pairs of causes of `benchmarks.decisions`, each after its few
logs, and one parameter of the model with the first cause. The worth is the expected information per minute.
"""

from __future__ import annotations

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

from benchmarks.decisions import FEW, PAIRS
from rovid.effects import effect_named
from rovid.estimate.candidate_runs import RunLimits
from rovid.estimate.experiment_design import candidate_model, plan_experiment
from rovid.store.study import open_study
from tools.cases import all_cases
from tools.trial_day import write_trial_day
from tools.truth import ROSUB

# Parameters of the problems, in turn; "" for that of the cause.
PARAMETERS = ("inertia", "linear_drag", "quadratic_drag", "")


def main() -> None:
    """Print each problem with the ratio of both runs, and how many ratios are 2 or more."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seed", type=int, default=3)
    options = parser.parse_args()
    cases = {case.name: case for case in all_cases(ROSUB)}
    ratios = []
    for number, (name, rival) in enumerate(PAIRS):
        case = cases[name]
        with tempfile.TemporaryDirectory() as place:
            write_trial_day(Path(place), seed=options.seed, truth=case.of(ROSUB), formats="csv", campaign=FEW)
            study = open_study([Path(place)])
        assert study.campaign is not None
        causes = [effect_named(key) for key in (case.expected_effect or "", rival)]
        models = [candidate_model(study.likelihood((cause,)), cause.key) for cause in causes]
        parameter = PARAMETERS[number % len(PARAMETERS)] or models[0].model.names[3]
        for some, narrow in ((models, ""), (models[:1], parameter)):
            runs = plan_experiment(
                some, study.vehicle, study.campaign.trials, replace(RunLimits(), design=True), narrow
            ).runs
            of_list = max(one.information_per_minute for one in runs if not one.run.name.startswith("designed"))
            (designed,) = [one for one in runs if one.run.name.startswith("designed")]
            ratios.append(designed.information_per_minute / of_list)
            print(f"{name:38} {narrow or rival:30} {of_list:8.3g} {ratios[-1]:6.2f}", flush=True)
    print(f"{sum(ratio >= 2.0 for ratio in ratios)} of {len(ratios)} at least twice, least {min(ratios):.2f}")


if __name__ == "__main__":
    main()
