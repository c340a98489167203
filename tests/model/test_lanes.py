"""Lanes of the compiled loops are independent."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numba
import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.effects import TERM_EFFECTS, TERMS, Effect, effect_named
from rovid.effects.base import TERM_PARAMETERS, TERM_STATES, Body, Instant, Numbers, Term, compiled
from rovid.jit.simd import LANES, load, store, switch
from rovid.model.bound_effects import BoundEffect, Equation, PackedTerms, pack_terms, stack_terms
from rovid.model.kernels import SCRATCH_ROWS, ekf3_innovations, ekf5_innovations, predict_multi_step, simulate
from rovid.model.kernels.effect_terms import call_sum_terms, load_body, taking_lanes
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput
from tests.conftest import ROOT
from tests.effects.test_effects import numbers
from tests.filters import Filter, Log, filter_batch, filter_one
from tests.synthetic import ROSUB

OWN = np.linspace(0.95, 1.06, LANES)
NOISE = np.array([15.0, 4.0, 1e-3, 2e-3])
WAVE = effect_named("wave_torque")
each_term = pytest.mark.parametrize("effect", TERM_EFFECTS, ids=lambda effect: effect.key)


def some_logs(rng: np.random.Generator) -> tuple[list[Log], TorqueInput]:
    """Two, unevenly sampled, one with gaps in its angle and both with a gyro that falls silent."""
    logs, torques = [], []
    for count in (150, 90):
        time = np.cumsum(rng.uniform(0.02, 0.08, count))
        torque = 150.0 * np.sign(np.sin(0.9 * time))
        rate, angle = simulate(time, torque, ROSUB.body, 0.02)
        angle = angle + rng.normal(0.0, 1e-3, count)
        angle[50:70] = np.nan
        gyro = np.where(np.arange(count) % 30 < 20, rate + rng.normal(0.0, 2e-3, count), np.nan)
        logs.append(Log(time=time, angle=angle, rate=gyro, first=(0.02, 0.01), start=float(rng.normal())))
        torques.append(torque)
    total = np.concatenate(torques)
    beside = np.column_stack((np.sqrt(np.abs(total)), 0.8 + 0.0 * total, 0.1 * np.sin(total)))
    return logs, TorqueInput.held(total, beside, impulse_variance=np.full(len(total), 2.0))


def alone(kernel: Filter, logs: list[Log], drive: TorqueInput, model: Model, noise: FloatArray) -> list[FloatArray]:
    every = filter_batch(kernel, logs, [drive] * LANES, [model] * LANES, [noise] * LANES)
    return [table[0] for table in every]


@pytest.mark.parametrize("effect", [None, WAVE, *TERM_EFFECTS], ids=lambda effect: effect.key if effect else "none")
def test_lanes_are_independent(effect: Effect | None) -> None:
    """Of intervals that all of them step through at once; drives, noises and parameters are each one's own."""
    rng = np.random.default_rng(5)
    logs, drive = some_logs(rng)
    effects = () if effect is None else (effect,)
    values = np.zeros(0) if effect is None else numbers(effect, start=True)
    kernel = ekf5_innovations if effect is not None and effect.oscillatory else ekf3_innovations
    models = [
        replace(
            ROSUB,
            inertia=own * ROSUB.inertia,
            linear_drag=ROSUB.linear_drag / own,
            effects=effects,
            effect_values=tuple((own * values).tolist()),
        )
        for own in OWN
    ]
    drives = [drive.mapped(partial(np.multiply, own)) for own in OWN]
    noises = [own * NOISE for own in OWN]
    found, variance = filter_batch(kernel, logs, drives, models, noises)
    assert np.isfinite(found).any(axis=(0, 1)).all()
    for at in range(LANES):
        wanted, scatter = alone(kernel, logs, drives[at], models[at], noises[at])
        known = np.isfinite(wanted)
        assert (np.isfinite(found[at]) == known).all()
        assert np.abs((found[at] - wanted)[known] / np.sqrt(scatter[known])).max() < 1e-9
        np.testing.assert_allclose(variance[at][known], scatter[known], rtol=1e-9)
    assert not np.allclose(found[0], found[-1], equal_nan=True)


@pytest.mark.parametrize("kernel", [ekf3_innovations, ekf5_innovations])
def test_all_lanes_take_the_steps_of_the_fastest_one(kernel: Filter) -> None:
    rng = np.random.default_rng(6)
    time = np.cumsum(rng.uniform(0.5, 2.0, 200))
    torque = 100.0 * np.sign(np.sin(0.2 * time))
    _, angle = simulate(time, torque, ROSUB.body, 0.0)
    log, drive = Log(time=time, angle=angle + rng.normal(0.0, 1e-3, 200), first=(0.0, 0.02)), TorqueInput.held(torque)
    models = [replace(ROSUB, linear_drag=linear) for linear in (132.0, 200.0, 5e3, 300.0)]
    if kernel is ekf5_innovations:
        models = [replace(model, effects=(WAVE,), effect_values=(20.0, 0.8, 0.1)) for model in models]
    noise = np.array([15.0, 40.0, 1e-3, 1.0])
    found, variance = filter_batch(kernel, [log], [drive] * LANES, models, [noise] * LANES)
    for at, model in enumerate(models):
        wanted, scatter = filter_one(kernel, log, drive, model, noise.tolist())
        off = np.abs((found[at] - wanted)[:, 0] / np.sqrt(scatter[:, 0])).max()
        share = np.abs(variance[at][:, 0] / scatter[:, 0] - 1.0).max()
        # The one that asks for them takes its own; with the others they cost what the coarser steps were off by.
        assert (off < 1e-9 and share < 1e-9) if at == 2 else (off < 0.02 and 0.0 < share < 0.02)


@numba.njit
def _torques(body: Any, terms: Any, motion: Any, state: Any, change: Any, out: Any) -> None:
    equation = Equation(load_body(body), terms, load(motion, 3))
    beside = load(motion, 4), load(motion, 5), load(motion, 6)
    store(out, 0, call_sum_terms(load(motion, 0), load(motion, 1), load(motion, 2), beside, equation, state, change))


def in_lanes(
    terms: PackedTerms, body: FloatArray, motion: FloatArray, state: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(LANES,) torque and (TERM_STATES, LANES) changes of what is one term; rows of ``motion`` are as in `one_lane`."""
    out, change = np.empty((1, LANES)), np.zeros((TERM_STATES + SCRATCH_ROWS, LANES))
    _torques(body, terms, motion, state, change, out)
    return out[0], change[:TERM_STATES]


def one_lane(effect: Effect, body: Body, motion: FloatArray, p: Numbers, x: Numbers) -> tuple[float, list[float]]:
    """The same of the (7,) motion in one lane: rate, angle, push, start, race, surge and sway."""
    term: Any = effect.acts
    rate, angle, push, start, race, surge, sway = (float(number) for number in motion)
    water = 0.0 if term.entrained_rate is None else term.entrained_rate(p, x)
    torque, change = term.evaluate(Instant(rate, rate - water, angle, start, push, race, surge, sway, body), p, x)
    return torque, [*change, *[0.0] * (TERM_STATES - len(change))]


@each_term
def test_a_term_of_vectors_agrees_with_the_term_of_numbers(effect: Effect) -> None:
    rng = np.random.default_rng(7)
    start = numbers(effect, start=True)
    sizes = np.array([0.3, 3.0, 200.0, 1.0, 15.0, 1.0, 0.5])
    for trial in range(40):
        every = [start * rng.uniform(0.5, 1.5, len(start)) for _ in range(LANES)]
        terms = stack_terms([pack_terms([BoundEffect(effect, own)], 0.5) for own in every])
        bodies = [Body(5057.0, 3532.0, 132.0, 90.0, 0.05) for _ in range(LANES)]
        bodies = [Body(*(rng.uniform(0.5, 1.5, 5) * body)) for body in bodies]
        motion = sizes[:, np.newaxis] * rng.normal(size=(7, LANES))
        # At rest, without thrust, without a state: where signs turn.
        motion[trial % 4, trial % LANES] = 0.0
        motion[4] = np.abs(motion[4])
        state = rng.normal(size=(TERM_STATES, LANES)) * (0.0 if trial == 5 else 0.3)
        torque, change = in_lanes(terms, np.array(bodies).T.copy(), motion, state)
        for at in range(LANES):
            p = (*every[at].tolist(), *[0.0] * (TERM_PARAMETERS - len(start)))
            wanted, wanted_change = one_lane(effect, bodies[at], motion[:, at], p, tuple(state[:, at].tolist()))
            # Products go into sums unrounded in the one and not in the other.
            assert torque[at] == pytest.approx(wanted, rel=1e-9, abs=1e-9)
            assert change[:, at] == pytest.approx(wanted_change, rel=1e-9, abs=1e-9)


@compiled
def _stuck(at: Instant, p: Numbers) -> float:
    if abs(at.rate) < p[0]:
        return -at.thruster_torque
    return -p[1] * math.copysign(1.0, at.rate)


@compiled
def _limited(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    return -p[1] * max(x[0], 0.0), (at.rate if at.rate > p[0] else 0.0)


@compiled
def _swinging(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float, float]:
    if x[1] > 0.0:
        return -p[1] * x[0], x[1], at.body.inertia
    return p[1] * x[0], -x[1], at.sway


@compiled
def _calling(at: Instant, p: Numbers) -> float:
    return 2.0 * _stuck(at, p)


@pytest.mark.parametrize(("function", "states"), [(_stuck, 0), (_limited, 1), (_swinging, 2), (_calling, 0)])
def test_a_branching_term_is_called_lane_by_lane(function: Callable[..., Any], states: int) -> None:
    of_lanes = taking_lanes(function)
    assert of_lanes is not function

    def one(*told: Any) -> Any:
        return of_lanes(*told)

    # As kernels choose one of many.
    chosen = switch({3: one}, one)
    rng = np.random.default_rng(8)
    rows, given = rng.normal(size=(13, LANES)), np.empty((1 + states, LANES))
    p, x = np.array([[0.4], [7.0], [0.0], [0.0]]) * np.ones(LANES), rng.normal(size=(2, LANES))
    rows[0, :2] = 0.1, -3.0

    @numba.njit
    def instant(rows: Any) -> Any:
        body = Body(load(rows, 8), load(rows, 9), load(rows, 10), load(rows, 11), load(rows, 12))
        first = load(rows, 0), load(rows, 1), load(rows, 2), load(rows, 3)
        return Instant(*first, load(rows, 4), load(rows, 5), load(rows, 6), load(rows, 7), body)

    @numba.njit
    def without(rows: Any, p: Any, x: Any, out: Any) -> None:
        store(out, 0, chosen(3, instant(rows), (load(p, 0), load(p, 1), load(p, 2), load(p, 3))))

    @numba.njit
    def with_states(rows: Any, p: Any, x: Any, out: Any) -> None:
        every = chosen(3, instant(rows), (load(p, 0), load(p, 1), load(p, 2), load(p, 3)), (load(x, 0), load(x, 1)))
        store(out, 0, every[0])
        store(out, 1, every[1])
        store(out, states, every[states])

    (with_states if states else without)(rows, p, x, given)
    for at in range(LANES):
        told: list[Any] = [*rows[:8, at].tolist(), Body(*rows[8:, at].tolist())]
        here = Instant(*told)
        own = (tuple(p[:, at].tolist()), tuple(x[:, at].tolist()))
        wanted = function(here, *own) if states else function(here, own[0])
        np.testing.assert_allclose(given[:, at], wanted, rtol=1e-14)


def test_no_term_of_the_catalogue_branches() -> None:
    """One that does is several times slower, in every filter."""
    branching = [effect.key for effect, term in zip(TERM_EFFECTS, TERMS, strict=True) if not _takes_lanes(term)]
    assert branching == []


def _takes_lanes(term: Term) -> bool:
    return taking_lanes(term.torque) is term.torque


def test_a_diverging_prediction_leaves_other_lanes_unchanged() -> None:
    curvature = effect_named("drag_curvature")
    wild = replace(ROSUB, effects=(curvature,), effect_values=(-4e4,))
    count = 120
    rate, angle = 0.03 * np.sin(0.3 * np.arange(count)), np.zeros(count)
    # Above some rate the torque of the effect is more than all drag.
    rate[40] = 0.5
    torque, beside, states = np.full(count, 20.0), np.zeros((count, 3)), np.zeros((count, TERM_STATES))
    restarts = np.array([5, 40, 60, 20])

    def predicted(own: Any) -> FloatArray:
        length = len(own)
        here = np.full(length, 0.5), torque, beside, rate, angle, states, own, np.full(length, 50), np.zeros(length)
        return np.asarray(predict_multi_step(*here, wild.body, wild.terms))

    together = predicted(restarts)
    assert np.isnan(together[1, -1])
    for at in (0, 2, 3):
        # Beside one that grows faster, they take finer steps until that is given up.
        assert together[at] == pytest.approx(predicted(restarts[at : at + 1])[0], rel=1e-4, abs=1e-7)
    assert np.isfinite(together[[0, 2, 3]]).all()


SHORT = """
import json
from dataclasses import replace
import numpy as np
from rovid.effects import effect_named
from rovid.model.torque_input import TorqueInput
from rovid.model.kernels import ekf3_innovations, ekf5_innovations
from tests.filters import Log, filter_one
from tests.synthetic import ROSUB

time = np.array([0.0, 0.1, 0.2, 0.3, 0.5, 2.5, 2.6])
angle = np.array([0.0, 0.01, np.nan, 0.02, 0.04, 0.2, 0.21])
log = Log(time=time, angle=angle, rate=np.where(time > 0.4, 0.1, np.nan))
drive, found = TorqueInput.held(np.full(7, 80.0)), {}
effects = {"oscillatory_drag": (0.5, 0.6), "entrained_swirl:annulus": (0.2, 20.0), "wave_torque": (20.0, 0.8, 0.1)}
for key, values in {"": (), **effects}.items():
    model = replace(ROSUB, effects=(effect_named(key),) if key else (), effect_values=values)
    kernel = ekf5_innovations if key == "wave_torque" else ekf3_innovations
    tables = filter_one(kernel, log, drive, model, (15.0, 4.0, 1e-3, 1e-2))
    found[key] = [np.nan_to_num(table).tolist() for table in tables]
print(json.dumps(found))
"""


def test_uncompiled_filters_agree_with_compiled_ones() -> None:
    said = []
    for off in ("0", "1"):
        environment = os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_DISABLE_JIT": off}
        done = subprocess.run(
            [sys.executable, "-c", SHORT], env=environment, capture_output=True, text=True, check=True
        )
        said.append(json.loads(done.stdout))
    assert list(said[0]) == list(said[1])
    for key, tables in said[0].items():
        for compiled_table, plain_table in zip(tables, said[1][key], strict=True):
            np.testing.assert_allclose(compiled_table, plain_table, rtol=1e-9, atol=1e-12)
