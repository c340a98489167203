"""The data of the Kalman filter, and likelihoods of data in chunks."""

from __future__ import annotations

import tracemalloc
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.diagnose.screening import score_tests
from rovid.effects import effect_named
from rovid.estimate import filter_data
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fisher_information import NormalEquations
from rovid.estimate.fit_result import FitResult
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.trial.preprocessing import Run
from tests import synthetic
from tests.predictions import NOISE, TIME, TORQUE

SECONDS = synthetic.clock(120.0)
RUN = synthetic.run(SECONDS, np.where(SECONDS < 60.0, 100.0, -100.0))


def readings(run: Run, *, interval: float = 0.0, gyro: bool = False) -> InnovationData:
    return InnovationData([run], synthetic.LOGGED, synthetic.ROSUB, gyro=gyro, interval=interval)


def test_an_interval_skips_readings_except_the_last() -> None:
    (every,) = readings(RUN).times
    assert len(every) == len(SECONDS)
    (quick,) = readings(RUN, interval=1.0).times
    assert np.diff(quick) == pytest.approx(1.0)
    assert quick[-1] == SECONDS[-1]


def test_a_gap_in_thinned_data_is_crossed_in_steps() -> None:
    """An effect without influence keeps the likelihood; one step over a whole gap made it better by hundreds."""
    gap = RUN.trial.position.copy()
    gap[1150:1400] = np.nan  # the torque changes its sign at sample 1200
    broken = replace(RUN, trial=replace(RUN.trial, position=gap))
    data = readings(broken, interval=0.4)
    (steps,) = data.times
    assert np.max(np.diff(steps)) < 0.5
    ((angles, _),) = data.innovation_samples
    assert not np.isnan(gap[np.searchsorted(SECONDS, steps[angles])]).any()
    plain = InnovationLikelihood(data, 0.01)
    x = plain.parametrization.initial()
    delay = effect_named("command_delay")
    other = plain.with_effects((delay,))
    neutral = [parameter.neutral for parameter in delay.parameters]
    assert other.value(np.concatenate((x, neutral))) == pytest.approx(plain.value(x), abs=0.1)


def test_every_reading_but_the_first_has_an_innovation() -> None:
    gap = RUN.trial.position.copy()
    gap[100:200] = np.nan
    data = readings(replace(RUN, trial=replace(RUN.trial, position=gap)))
    ((angles, _),) = data.innovation_samples
    assert len(angles) == len(SECONDS) - 1 - 100
    ((begin, _),) = data.innovation_spans
    assert len(begin) == len(angles)


def test_a_gyro_is_used_only_on_request() -> None:
    noise = 1e-3 * np.random.default_rng(1).normal(size=len(SECONDS))
    run = replace(RUN, trial=replace(RUN.trial, rate=np.gradient(RUN.trial.position, SECONDS) + noise))
    ((_, rates),) = readings(run).innovation_samples
    assert not len(rates)
    assert readings(run).gyro_noise == 1.0
    asked = readings(run, gyro=True)
    ((_, rates),) = asked.innovation_samples
    assert len(rates) == len(SECONDS)
    # Of 2400 differences the size is known to two percent.
    assert asked.gyro_noise == pytest.approx(1e-3, rel=0.1)


def test_a_rate_only_trial_has_one_known_position() -> None:
    integrated = replace(RUN.trial, rate=np.gradient(RUN.trial.position, SECONDS), rate_only=True)
    ((angles, rates),) = readings(replace(RUN, trial=integrated)).innovation_samples
    assert not len(angles)
    assert len(rates) == len(SECONDS)


def test_corrected_angles_are_cached() -> None:
    off, (chunk,) = effect_named("heading_deviation"), readings(RUN).chunks
    models = [replace(synthetic.ROSUB, effects=(off,), effect_values=(size, 0.3)) for size in (0.05, 0.05, 0.06)]
    first, same, other = (chunk.corrected_angle(model) for model in models)
    assert first is same
    assert not np.array_equal(first.angle, other.angle)
    assert first.gain is not None
    plain = chunk.corrected_angle(synthetic.ROSUB)
    assert plain.angle is chunk.corrected_angle(synthetic.ROSUB).angle
    assert plain.gain is None


KEYS = (
    "",
    "thruster_lag",
    "supply_sag:drift",
    "wave_torque",
    "tank_seiche",
    "heading_deviation",
    "bias_torque:trials run 0|run 1|run 2",
)
# Of a torque in N m; a run begins s after the first.
PIECES = [(0, 700, 0.0), (500, 1300, 900.0), (300, 700, 4000.0)]


def run(number: int, begin: int, end: int, since: float) -> Run:
    time, torque = TIME[begin:end] - TIME[begin], TORQUE[begin:end]
    made = synthetic.run(time, torque, noise=NOISE[begin:end])
    commands = torque[:, None] / 100.0
    return replace(made, trial=replace(made.trial, name=f"run {number}", campaign_time=since, commands=commands))


RUNS = [run(number, *piece) for number, piece in enumerate(PIECES)]


def objective_of(
    monkeypatch: pytest.MonkeyPatch, at_once: int, key: str, interval: float = 0.0, runs: Sequence[Run] = RUNS
) -> InnovationLikelihood:
    """With so many instants gone through at once at most."""
    monkeypatch.setattr(filter_data, "_CHUNK_SAMPLES", at_once)
    data = InnovationData(runs, synthetic.VEHICLE, synthetic.ROSUB, interval=interval)
    objective = InnovationLikelihood(data, 0.05, (effect_named(key),) if key else ())
    assert len(objective.chunks) == (1 if at_once > 2000 else len(runs))
    return objective


def point(objective: InnovationLikelihood) -> FloatArray:
    """(p,) coordinates with some of every effect."""
    x = objective.parametrization.initial()
    for _, place in objective.parametrization.effect_slices():
        x[place] += 0.1
    return np.clip(x, *objective.parametrization.bounds)


@pytest.mark.parametrize("interval", [0.0, 0.4], ids=["all", "few"])
@pytest.mark.parametrize("key", KEYS)
def test_chunks_give_the_likelihood_of_all_runs(monkeypatch: pytest.MonkeyPatch, key: str, interval: float) -> None:
    whole = objective_of(monkeypatch, 10_000, key, interval)
    cut = objective_of(monkeypatch, 100, key, interval)
    x = point(whole)
    here, there = whole.innovations(x), cut.innovations(x)
    # The filter of a chunk takes the integration steps that the chunk needs, fewer than those of all runs.
    scatter = np.sqrt(here.variance)
    assert np.max(np.abs(there.error - here.error) / scatter) < 1e-3
    assert np.max(np.abs(np.sqrt(there.variance) / scatter - 1.0)) < 1e-3
    assert cut.value(x) == pytest.approx(whole.value(x), abs=1e-2)
    assert cut.value(x) == pytest.approx(sum(chunk.value(x) for chunk in cut.chunks))
    one, other = (NormalEquations.from_jacobians(objective.jacobian(x)) for objective in (whole, cut))
    size = np.sqrt(np.diag(one.information))
    np.testing.assert_allclose(
        other.information / np.outer(size, size), one.information / np.outer(size, size), atol=1e-3
    )
    np.testing.assert_allclose(other.gradient / size, one.gradient / size, atol=0.02)


def test_known_evaluations_of_all_runs_are_reused(monkeypatch: pytest.MonkeyPatch) -> None:
    cut = objective_of(monkeypatch, 100, "bias_torque")
    x = point(cut)
    known, anew = (
        NormalEquations.from_jacobians(cut.jacobian(x, known)) for known in (cut.evaluate_with_spare(x), None)
    )
    assert known.gradient == pytest.approx(anew.gradient)
    assert known.information == pytest.approx(anew.information)


def test_masked_innovations_are_left_out_of_each_chunk(monkeypatch: pytest.MonkeyPatch) -> None:
    cut = objective_of(monkeypatch, 100, "bias_torque")
    x, every = point(cut), cut.innovations(point(cut))
    counted = np.arange(len(every.error)) % 3 == 0
    some = cut.with_effects(cut.effects, counted)
    assert some.innovations(x).error == pytest.approx(every.error[counted])
    assert [chunk.rows.stop - chunk.rows.start for chunk in some.chunks] == [
        int(counted[chunk.rows].sum()) for chunk in cut.chunks
    ]
    assert some.value(x) == pytest.approx(some.value_of(some.innovations(x)))
    costs = some.held_out_values([some, cut], [x, x])
    assert costs == pytest.approx([some.value(x), cut.value(x)])
    rows = [piece.rows for piece in some.robust_jacobian(x)]
    assert [row.start for row in rows] == [0, *(row.stop for row in rows[:-1])]


def test_jacobians_take_the_memory_of_one_chunk(monkeypatch: pytest.MonkeyPatch) -> None:
    """A Jacobian of all runs at once would hold one series for each coordinate."""
    many = [run(number, *PIECES[number % len(PIECES)]) for number in range(30)]
    taken = []
    for at_once in (100_000, 100):
        objective = objective_of(monkeypatch, at_once, "supply_sag:drift", runs=many)
        x = point(objective)
        known = objective.evaluate_with_spare(x)
        # The first evaluation fills the caches.
        NormalEquations.from_jacobians(objective.jacobian(x, known))
        tracemalloc.start()
        NormalEquations.from_jacobians(objective.jacobian(x, known))
        taken.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    whole, cut = taken
    assert cut < 0.3 * whole


def test_score_tests_of_chunks_equal_those_of_all_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    forms = [effect_named(key) for key in KEYS[1:]]
    every = []
    for at_once in (10_000, 100):
        objective = objective_of(monkeypatch, at_once, "")
        every.append(score_tests(FitResult.at(objective, objective.parametrization.initial()), forms))
    for one, other in zip(*every, strict=True):
        assert other.gain == pytest.approx(one.gain, rel=0.01, abs=0.01)
        assert other.directions.gains_unfitted == pytest.approx(one.directions.gains_unfitted, rel=1e-3, abs=0.02)
        assert other.start == pytest.approx(one.start, rel=0.02, abs=1e-3)
