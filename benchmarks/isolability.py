"""Does `rovid plan --matrix` predict decisions? Expected against realised log-likelihood ratios of simulated campaigns.

Run ``python -m benchmarks.isolability --count 60``. A simulator that shares no code with rovid hides a cause of random
size in three short runs. The matrix predicts the ratio L of the best fits of the cause and of a rival. The cause then
fits better than the rival with the probability that a normal variable of mean L and variance 2 L is positive. rovid
fits both to the files.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import norm

from rovid.effects import effect_named
from rovid.estimate.assumed_models import SizedCause
from rovid.estimate.experiment_design import CandidateModel
from rovid.estimate.isolability import ExpectedFits
from rovid.model.model import Model
from rovid.store.study import Study, open_study
from tools.hidden import Hidden
from tools.programme import CAMPAIGN, Hold, Run, Sine
from tools.trial_day import write_trial_day
from tools.truth import ROSUB

# Causes that the simulator hides with rovid's own equation, at a middling size.
CAUSES = {
    hidden.effect: hidden
    for hidden in (
        Hidden(effect="thruster_lag", form="first_order", parameters={"time_constant": 0.1}),
        Hidden(effect="command_delay", form="constant", parameters={"delay": 0.1}),
        Hidden(effect="bias_torque", form="constant", parameters={"torque": 2.0}),
        Hidden(effect="tether_torsion", form="linear", parameters={"stiffness": 0.3}),
        Hidden(effect="thrust_asymmetry", form="gain", parameters={"reverse_gain": 0.97}),
        Hidden(effect="drag_asymmetry", form="quadratic", parameters={"ratio": 1.06}),
        Hidden(effect="drag_curvature", form="cubic", parameters={"cubic": 1500.0}),
        Hidden(effect="thruster_deadband", form="shift", parameters={"deadband": 0.02}),
    )
}
# Hidden cause and rival.
PAIRS = (
    ("thruster_lag", "command_delay"),
    ("command_delay", "thruster_lag"),
    ("bias_torque", "tether_torsion"),
    ("tether_torsion", "bias_torque"),
    ("thrust_asymmetry", "drag_asymmetry"),
    ("drag_asymmetry", "thrust_asymmetry"),
    ("thrust_asymmetry", "bias_torque"),
    ("bias_torque", "drag_asymmetry"),
    ("drag_curvature", "drag_asymmetry"),
    ("thruster_deadband", "drag_curvature"),
)
RUNS = (
    Run(name="hold", pieces=(Hold(1.55, 50.0), Hold(-2.0, 50.0), Hold(0.0, 20.0))),
    Run(name="sine", pieces=(Sine(1.8, 2.2, 40.0, 3),)),
    next(run for run in CAMPAIGN if run.name == "steps"),
)
# Expected ratios in nats, where the decision is open.
RANGE = (0.05, 4.0)
# Realised ratio in nats within which both causes fit alike, and which counts half.
TIE = 0.05
DYNAMICS = ROSUB.dynamics
BASE = CandidateModel(
    name="the truth",
    model=Model(inertia=DYNAMICS.inertia, quadratic_drag=DYNAMICS.quadratic_drag, linear_drag=DYNAMICS.linear_drag),
    covariance=np.zeros((3, 3)),
    disturbance=ROSUB.disturbance.standard_deviation,
    memory=ROSUB.disturbance.correlation_time,
    noise=math.radians(ROSUB.instruments.angle_noise),
)


def scaled(hidden: Hidden, factor: float) -> Hidden:
    """The cause with ``factor`` times its deviation from no effect."""
    null = hidden.law.null
    return replace(hidden, parameters={name: null + factor * (v - null) for name, v in hidden.parameters.items()})


def cause(hidden: Hidden) -> SizedCause:
    """The same for rovid."""
    return SizedCause(effect=effect_named(hidden.effect), values=np.array(list(hidden.parameters.values())))


def expected(study: Study, hidden: Hidden, rival: str) -> float:
    """Expected log-likelihood ratio of the runs of a study."""
    assert study.campaign is not None
    fits = ExpectedFits(BASE, cause(hidden), study.vehicle, study.campaign.trials)
    return float(fits.gains(effect_named(rival))[""][-1])


def campaigns(count: int, seed: int) -> Iterator[tuple[str, str, float, float]]:
    """Cause, rival, expected and realised log-likelihood ratio of each campaign."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        name, rival = PAIRS[number % len(PAIRS)]
        wanted, own_seed, hidden = rng.uniform(*RANGE), int(rng.integers(10**6)), CAUSES[name]
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place)
            write_trial_day(folder, seed=own_seed, formats="csv", campaign=RUNS)
            for _ in range(2):
                hidden = scaled(hidden, math.sqrt(wanted / max(expected(open_study([folder]), hidden, rival), 1e-3)))
            write_trial_day(folder, seed=own_seed, formats="csv", campaign=RUNS, truth=replace(ROSUB, hidden=(hidden,)))
            study = open_study([folder])
            one, other = (study.likelihood((effect_named(key),)).log_likelihood for key in (name, rival))
            yield name, rival, expected(study, hidden, rival), one - other


def main() -> None:
    """Print each campaign, and predicted and realised numbers of right decisions by expected ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=60)
    options = parser.parse_args()
    rows = []
    for name, rival, wanted, found in campaigns(options.count, options.seed):
        right = 0.5 if abs(found) < TIE else float(found > 0.0)
        rows.append((wanted, float(norm.cdf(math.sqrt(0.5 * wanted))), right))
        print(f"{name:20} {rival:20} {wanted:6.2f} {found:7.2f}", flush=True)
    print("expected ratio | campaigns | right, predicted | right, realised | standard deviations")
    for low, high in ((0.0, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, math.inf)):
        some = [(chance, right) for wanted, chance, right in rows if low <= wanted < high]
        if some:
            chances, right = np.array([chance for chance, _ in some]), sum(right for _, right in some)
            deviation = (right - chances.sum()) / math.sqrt(np.sum(chances * (1.0 - chances)))
            print(f"{low:g} to {high:g} | {len(some)} | {chances.sum():.1f} | {right:g} | {deviation:+.1f}")


if __name__ == "__main__":
    main()
