"""Expected evidence between causes: against the exact Gaussian likelihood, and its limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.estimate.assumed_models import SIZE_SHARES, SizedCause, sized_cause, sized_causes
from rovid.estimate.experiment_design import CandidateModel
from rovid.estimate.isolability import IsolabilityMatrix, isolability
from rovid.model.kernels import simulate
from rovid.model.model import Model
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Thruster, Vehicle
from tests.synthetic import ROSUB, VEHICLE, VOLTS, clock, trial

TIME = clock(160.0, rate=2.0)
COMMAND = np.select([TIME < 10.0, TIME < 60.0, TIME < 110.0], [0.0, 2.0, -1.5], 0.8)
LOG = trial(TIME, COMMAND)
BASE = CandidateModel(
    name="the model", model=ROSUB, covariance=np.zeros((3, 3)), disturbance=3.0, memory=4.0, noise=2e-4
)
BIAS = SizedCause(effect=effect_named("bias_torque"), values=np.array([4.0]))
REVERSE = SizedCause(effect=effect_named("thrust_asymmetry"), values=np.array([0.95]))


def matrix(causes: list[SizedCause], programme: list[Trial], vehicle: Vehicle = VEHICLE) -> IsolabilityMatrix:
    return isolability(BASE, causes, vehicle, programme)


def exact(bias: float, thrust: float) -> float:
    """Log-likelihood ratio of a bias torque against weaker reverse thrust, inertia and drag refitted, linearised.

    The heading is Gaussian with the covariance of the disturbance through the linearised motion, and of the noise.
    """
    torque = 100.0 * COMMAND
    body = replace(ROSUB).body
    _, mean = simulate(TIME, torque, body, 0.0)

    def change(torque: np.ndarray, model: Model = ROSUB, step: float = 1.0) -> np.ndarray:
        _, angle = simulate(TIME, torque, model.body, 0.0)
        return (np.asarray(angle) - mean) / step

    count = len(TIME)
    kicks = np.column_stack([change(torque + 1e-3 * (np.arange(count) == at), step=1e-3) for at in range(count)])
    memory = np.exp(-np.abs(TIME[:, None] - TIME) / BASE.memory)
    covariance = BASE.disturbance**2 * kicks @ memory @ kicks.T + BASE.noise**2 * np.eye(count)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    free = [
        change(torque, replace(ROSUB, inertia=ROSUB.inertia * 1.0001)),
        change(torque, replace(ROSUB, quadratic_drag=ROSUB.quadratic_drag * 1.0001)),
        change(torque, replace(ROSUB, linear_drag=ROSUB.linear_drag * 1.0001)),
        change(np.where(torque < 0.0, 0.9999 * torque, torque)),
    ]
    jacobian = whiten @ np.column_stack([one / np.linalg.norm(one) for one in free])
    shift = whiten @ change(torque + bias)
    if thrust != 1.0:
        shift = whiten @ change(np.where(torque < 0.0, thrust * torque, torque))
        own = change(torque + 1e-3)
        jacobian[:, 3] = whiten @ own / np.linalg.norm(own)
    rest = shift - jacobian @ np.linalg.lstsq(jacobian, shift, rcond=1e-12)[0]
    return 0.5 * float(rest @ rest)


def test_the_evidence_is_that_of_the_exact_likelihood() -> None:
    (pair,) = matrix([BIAS, REVERSE], [LOG]).pairs
    wanted = min(exact(4.0, 1.0), exact(0.0, 0.95))
    # The filter starts with an unknown rate and is linearised at each step.
    assert pair.gain == pytest.approx(wanted, rel=0.05)


def test_repetitions_add_their_evidence() -> None:
    once, four_times = (matrix([BIAS, REVERSE], [LOG] * count) for count in (1, 4))
    (short,), (long,) = once.pairs, four_times.pairs
    assert long.gain == pytest.approx(4.0 * short.gain, rel=1e-3)
    assert (once.open_pairs, four_times.open_pairs) == ((short,), ())
    # Part of a run decides as much as its share of the whole.
    assert long.seconds == pytest.approx(short.seconds, abs=0.25 * LOG.duration)


def test_causes_of_no_visible_size_make_no_pairs() -> None:
    weak = replace(BIAS, values=0.1 * BIAS.values), replace(REVERSE, values=np.array([0.995]))
    found = matrix(list(weak), [LOG])
    assert set(found.invisible) == {"bias_torque", "thrust_asymmetry"}
    assert not found.pairs


def test_a_cause_that_drag_imitates_counts_at_the_size_that_shows() -> None:
    curvature = sized_cause(effect_named("drag_curvature"), BASE, VEHICLE, [LOG])
    assert curvature is not None
    assert curvature.share == SIZE_SHARES[0]
    found = matrix([curvature], [LOG])
    assert not found.invisible
    (shown,) = found.causes
    assert shown.share in SIZE_SHARES[1:]
    assert shown.values[0] > 2.0 * curvature.values[0]


def test_a_thruster_that_never_acts_alone_is_not_visible() -> None:
    pair = Vehicle(name="two", thrusters=tuple(Thruster(name=name, arm=0.5, curve=VOLTS) for name in "ab"))
    imbalance = SizedCause(effect=effect_named("thruster_imbalance:a"), values=np.array([0.8]))
    both = replace(LOG, commands=np.column_stack((COMMAND, COMMAND)))
    alone = replace(LOG, commands=np.column_stack((COMMAND, 0.0 * COMMAND)))
    assert matrix([imbalance], [both], pair).invisible == ("thruster_imbalance:a",)
    assert matrix([imbalance], [both, alone], pair).invisible == ()


def test_a_torque_cell_separates_thrust_from_other_torques() -> None:
    found = matrix([BIAS, REVERSE], [LOG])
    (pair,) = found.pairs
    assert found.separated_by("torque cell") == [pair]
    assert pair.with_sensor["supply voltage"] == pair.seconds
    assert found.sensor_causes["DVL speeds"] == ("speed_dependent_damping",)


def test_each_cause_changes_the_rate_as_much() -> None:
    causes = sized_causes(BASE, VEHICLE, [LOG])
    assert {"thruster_lag", "bias_torque", "slew_limit", "tether_torsion"} <= {cause.name for cause in causes}
    rate, _ = simulate(TIME, 100.0 * COMMAND, ROSUB.body, 0.0)
    bias = next(cause for cause in causes if cause.name == "bias_torque").values[0]
    moved, _ = simulate(TIME, 100.0 * COMMAND + bias, ROSUB.body, 0.0)
    share = np.sqrt(np.mean((np.asarray(moved) - rate) ** 2) / np.mean(np.asarray(rate) ** 2))
    assert share == pytest.approx(0.02, rel=0.05)
