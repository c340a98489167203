"""Diagnosis of the coupled model on simulated logs with known causes."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rovid.core.budget import Budget
from rovid.core.errors import DataError
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import effect_named
from rovid.effects.base import Scales
from rovid.estimate.estimate import Estimate
from rovid.estimate.fisher_information import Innovations, Jacobian
from rovid.planar.dataset import PlanarData, planar_data
from rovid.planar.diagnosis import _agreeing, _fitted_to_all_readings, _in_current, _search, diagnose_planar
from rovid.planar.doubts import contradicted, formless, likelier_suspects, outweighed
from rovid.planar.fit import fit_base, planar_result
from rovid.planar.held_out import Gate, HeldOut, Parts
from rovid.planar.optimum import Linearisation, PlanarOptimum
from rovid.planar.search import PlanarSearch
from rovid.present.documents.diagnosis import next_planar_experiment
from rovid.trial.trial import Campaign
from tests.planar.vehicles import box_rov, campaign, usv

Small = tuple[PlanarData, PlanarOptimum]


@pytest.mark.slow
def test_a_hidden_coupling_is_found_and_predicts_held_out_parts() -> None:
    truth = box_rov(5, couplings=(1.5, 1.0))
    diagnosis = diagnose_planar(campaign(truth, runs=4, levels=12, hold=4.0, seed=1))
    assert [one.effect.key for one in diagnosis.findings] == ["sway_yaw_damping"]
    (found,) = diagnosis.findings
    assert found.standard_errors > 5.0
    # The size is that of the stated estimate: two values with their covariance.
    away, covariance = found.estimate.values, found.estimate.covariance
    assert found.standard_errors == pytest.approx(math.sqrt(away @ np.linalg.solve(covariance, away)))
    assert found.held_out_gain > 20.0
    for name, true in zip(found.estimate.names, truth.couplings, strict=True):
        # 4 standard errors of 2 sizes.
        assert abs(found.estimate.value(name) - true) < 4.0 * found.estimate.standard_error(name)
    assert diagnosis.base is not None
    assert diagnosis.extended is not None
    assert diagnosis.extended.held_out.rmse["yaw_rate"] < diagnosis.base.held_out.rmse["yaw_rate"]


@pytest.mark.slow
def test_a_current_is_fitted_anew_from_slow_positions() -> None:
    """A fit without the current has inertias from which the search does not reach those in the current."""
    noise = {"heading": (0.005, 0.2), "north": (0.05, 1.0), "east": (0.05, 1.0)}
    truth, current = usv(6, current=(0.2, 0.3), noise=noise), effect_named("current")
    data = campaign(truth, runs=2, levels=12, hold=10.0, seed=6)
    search = _search(data, fit_base(data), Budget())
    test = next(one for one in search.screen(search.base) if one.effect.key == current.key)
    stuck = search.polish(search.extended(search.base, test))
    assert stuck.model.base[0] > 1.3 * truth.base[0]
    found = _in_current(search)
    anew = found.fits[frozenset({current.key})]
    assert found.causes(anew) == (current,)
    assert stuck.value - anew.value > 100.0
    np.testing.assert_allclose(anew.model.base[:3], truth.base[:3], rtol=0.05)
    assert anew.canonical().model.value("current.speed") == pytest.approx(np.hypot(0.2, 0.3), rel=0.02)


def test_a_search_without_time_says_so_and_names_nothing() -> None:
    data = campaign(box_rov(5, couplings=(1.5, 1.0)), runs=4, levels=4, hold=4.0, seed=1)
    diagnosis = diagnose_planar(data, budget=Budget(seconds=1e-9))
    assert diagnosis.is_cut_short
    assert not diagnosis.findings
    assert any("--budget" in text for text in diagnosis.warnings)
    assert "--budget" in next_planar_experiment(diagnosis)["run"]


@pytest.mark.slow
def test_nothing_is_found_where_nothing_is_hidden() -> None:
    diagnosis = diagnose_planar(campaign(box_rov(6), runs=4, levels=12, hold=4.0, seed=2))
    assert not diagnosis.findings
    assert diagnosis.extended is not None
    assert not diagnosis.extended.fit.model.effects


def test_logs_without_thrust_or_too_short_are_told_at_once() -> None:
    data = campaign(box_rov(7), runs=1, levels=2, hold=2.0, seed=3)
    assert diagnose_planar(data).verdict == "too_little_data"
    still = tuple(replace(run.trial, commands=0.0 * run.trial.commands) for run in data.runs)
    diagnosis = diagnose_planar(planar_data(Campaign(trials=still, sources=()), data.vehicle))
    assert diagnosis.verdict == "too_little_data"
    assert "no thruster ever runs" in diagnosis.missing


@pytest.mark.parametrize(("constant", "counts"), [(2.0, 8), (17.6, 6), (30.0, 4)])
def test_parts_are_longer_where_the_vehicle_is_slow(constant: float, counts: int) -> None:
    """Two runs of 111 s of a tanker were refused as too short for four parts of 35 s: they were cut into eight."""
    sizes = SimpleNamespace(time=np.array([3.0 * constant, 2.0 * constant, constant]))
    likelihood = SimpleNamespace(grid=SimpleNamespace(yaw_only=False))
    optimum: Any = SimpleNamespace(coordinates=SimpleNamespace(sizes=sizes), likelihood=likelihood)
    data: Any = SimpleNamespace(runs=[SimpleNamespace(duration=111.0)] * 2)
    parts = Parts(data, optimum)
    assert parts.count == counts
    assert (parts.shortest >= parts.least) == (constant < 27.0)


def test_a_filter_that_diverges_next_to_the_optimum_is_refused() -> None:
    one = Innovations(np.zeros(3), np.ones(3))
    piece = Jacobian(slice(0, 3), np.zeros(6), np.full((6, 2), np.inf))
    likelihood = SimpleNamespace(evaluate=lambda _: one, jacobian=lambda *_: (np.ones(2, dtype=bool), [piece]))
    optimum: Any = SimpleNamespace(likelihood=likelihood, x=np.zeros(2))
    with pytest.raises(DataError, match="the filter diverges"):
        Linearisation.of(optimum)


def test_a_candidate_that_diverges_loses_and_the_search_goes_on(small: Small, monkeypatch: pytest.MonkeyPatch) -> None:
    data, base = small
    search = PlanarSearch(data, base, (effect_named("current"),), Budget())
    (test,) = search.screen(base)
    linearised = Linearisation.of

    def diverging(optimum: PlanarOptimum) -> Linearisation:
        if optimum.effects:
            raise DataError("the filter diverges.")
        return linearised(optimum)

    monkeypatch.setattr(Linearisation, "of", diverging)
    candidate = search.extended(base, test)
    assert candidate.value == pytest.approx(base.value)
    assert not search.is_usable(candidate)
    assert search.run(base) is base


@pytest.mark.parametrize(("seconds", "is_unresolved"), [(0.02, True), (0.2, False), (0.0, False)])
def test_a_time_that_the_logs_do_not_resolve_is_no_cause(small: Small, seconds: float, is_unresolved: bool) -> None:
    (data, base), effect = small, effect_named("thruster_lag")
    coordinates, at = base.coordinates.with_effect(effect), base.coordinates.noise_begin
    likelihood = base.likelihood.with_coordinates(coordinates)
    fitted = PlanarOptimum(likelihood, np.insert(base.x, at, seconds / coordinates.units[at]), base.value)
    # The rows of the logs are 0.05 s apart.
    search = PlanarSearch(data, base, (effect,), Budget())
    assert search.is_unresolved(fitted) == is_unresolved


def test_a_model_is_no_less_likely_than_it_is_within_a_larger_one(small: Small) -> None:
    (data, base), effect = small, effect_named("bias_torque:planar")
    at, coordinates = base.coordinates.noise_begin, base.coordinates.with_effect(effect)
    likelihood, x = base.likelihood.with_coordinates(coordinates), np.insert(base.x, at, np.zeros(3))
    larger = PlanarOptimum(likelihood, x, likelihood.value(x))
    # A fit that ended early, 0.3 from the optimum in the logarithm of the inertia of yaw.
    early = base.x + 0.3 * (np.arange(len(base.x)) == 2)
    start = PlanarOptimum(base.likelihood, early, base.likelihood.value(early))
    search = PlanarSearch(data, start, (effect,), Budget())
    assert search.base.value > base.value + 10.0
    rest = search.without(larger, effect)
    assert rest.value <= base.value + THRESHOLDS.search_tolerance
    assert search.base is rest


@pytest.mark.parametrize(
    ("heading", "rate", "floor", "text"),
    [
        (1.31, 0.8, 1.0, "heading after 10 s is 31 %"),
        (0.9, 1.05, 1.0, "yaw rate is 5 %"),
        (0.9, 1.05, 1.2, ""),  # The simulations of a perfect model are no better.
        (0.9, 0.8, 1.0, ""),
    ],
)
def test_no_cause_is_established_that_makes_held_out_errors_larger(
    heading: float, rate: float, floor: float, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One test of all parts together, because a few bad parts are no certain growth."""

    def errors(of_rate: float, of_heading: float) -> HeldOut:
        parts: Any = SimpleNamespace(count=6, windows=[(at, at, 0, 0) for at in range(6)])
        squares = np.tile([0.01, np.nan, 1e-4, 0.01, 0.09], (6, 1))
        # In one part of the six.
        squares[0, 2:4] *= np.maximum(1.0 + 6.0 * (np.array([of_rate, of_heading]) ** 2 - 1.0), 0.0)
        return HeldOut(parts, np.zeros(6), squares)

    lag = named("thruster_lag")
    nothing, model = (SimpleNamespace(effects=effects) for effects in ((), (lag.effect,)))
    search: Any = SimpleNamespace(base=nothing, polish=lambda one: one, without=lambda *_: nothing)
    gate: Any = Gate(search, search)
    gate.held_out = lambda one: errors(rate, heading) if one is model else errors(1.0, 1.0)
    monkeypatch.setattr("rovid.planar.held_out.noise_floors", lambda *_: errors(floor, 1.0))
    found, final, messages = gate.established(model, [lag], [lag])
    assert (found, final) == (([], nothing) if text else ([lag], model))
    assert [text in message for message in messages] == [True] * bool(text)


@pytest.mark.parametrize(
    ("worse", "established", "message"),
    [
        ([{"sway_yaw_damping", "sensor_place"}], {"sensor_place"}, "may stand for the same"),
        ([{"sway_yaw_damping", "sensor_place"}, {"sensor_place"}], set(), "Without place of the velocity log"),
        ([], {"sway_yaw_damping", "sensor_place"}, ""),
    ],
)
def test_a_weaker_cause_does_not_take_the_place_of_one_that_it_stands_for(
    worse: list[set[str]], established: set[str], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In waves, a damping was established next to the true place of a velocity log, and the place was dropped."""
    damping, place = named("sway_yaw_damping"), named("sensor_place")
    search: Any = SimpleNamespace(
        base=frozenset(), polish=lambda one: one, without=lambda model, effect: model - {effect.id}
    )
    gate: Any = Gate(search, search)
    monkeypatch.setattr(
        gate,
        "_worsened",
        lambda model, rest: "an error is larger" if "sensor_place" in model - rest and model in worse else "",
    )
    # Without the place, the place would explain the logs better than the damping.
    monkeypatch.setattr(gate, "tested", lambda *_: (SimpleNamespace(probability=0.1), {}))
    both = [damping, place]
    found, model, messages = gate.established(frozenset({"sway_yaw_damping", "sensor_place"}), both, both)
    assert {one.effect.id for one in found} == set(model) == established
    assert message in " ".join(messages)


def named(effect: str, *rivals: str) -> Any:
    """A finding with the causes that it cannot be told from."""
    return SimpleNamespace(effect=effect_named(effect), indistinguishable=tuple(map(effect_named, rivals)))


def test_a_cause_is_contradicted_where_the_likelihood_names_another() -> None:
    lag, hysteresis = named("thruster_lag", "command_delay"), named("command_hysteresis")
    assert contradicted([lag, hysteresis], [named("command_delay")]) == [hysteresis]
    # Without a cause by the likelihood, nothing contradicts.
    assert contradicted([lag, hysteresis], []) == []


def test_a_cause_by_the_likelihood_alone_is_a_suspect() -> None:
    """Simulations that miss much named nothing in a tanker's current, which the likelihood found: it was not told."""

    def likely(effect: str, held_out_gain: float) -> Any:
        return SimpleNamespace(effect=effect_named(effect), held_out_gain=held_out_gain, indistinguishable=())

    current, lag, delay = likely("current", 40.0), likely("thruster_lag", -3.0), likely("command_delay", 9.0)
    assert likelier_suspects([], [current, lag]) == [current]
    # Where the simulations name a cause, the others are suspects if it contradicts them.
    assert likelier_suspects([delay], [current, lag]) == [current, lag]
    assert likelier_suspects([current], [current, lag]) == []


@pytest.mark.parametrize(
    ("error", "undetermined", "message"),
    [
        (0.1, (), ""),
        (0.2, (), "by only 2.5 standard errors in all readings"),
        # In a current that no model held, the stated error of the exponent was larger than the exponent.
        (0.1, ("thrust_curve_shape.exponent",), "shows, but these logs do not determine its size"),
    ],
)
def test_no_cause_is_established_with_a_size_that_is_open_in_all_readings(
    error: float, undetermined: tuple[str, ...], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stated errors decide. Without the cause all others are tested again: the lag needs it to be determined."""
    shape, lag = named("thrust_curve_shape"), named("thruster_lag")
    names = (*shape.effect.parameter_names, *lag.effect.parameter_names)
    estimate = Estimate(
        names=names, values=np.array([1.5, 0.5]), covariance=np.diag([error**2, 0.01]), method="", samples=9
    )
    coordinates = SimpleNamespace(sizes=SimpleNamespace(effects=Scales(command=1.0, torque=1.0, rate=1.0, wash=1.0)))

    def model(*causes: str) -> Any:
        return SimpleNamespace(causes=causes, coordinates=coordinates)

    def result(_: object, fitted: Any) -> Any:
        refused = undetermined if shape.effect.id in fitted.causes else lag.effect.parameter_names
        return SimpleNamespace(estimate=replace(estimate, refused=dict.fromkeys(refused, "")), causes=fitted.causes)

    monkeypatch.setattr("rovid.planar.diagnosis.refined", lambda fitted, _: fitted)
    monkeypatch.setattr("rovid.planar.diagnosis.planar_result", result)
    search: Any = SimpleNamespace(
        data=None,
        polish=lambda one: one,
        without=lambda fitted, effect: model(*(one for one in fitted.causes if one != effect.id)),
    )
    found, final, fit, messages = _fitted_to_all_readings(search, model(shape.effect.id, lag.effect.id), [shape, lag])
    assert found == ([] if message else [shape, lag])
    every: Any = (final, fit)
    assert [one.causes for one in every] == [tuple(one.effect.id for one in found)] * 2
    assert len(messages) == (2 if message else 0)
    assert message in " ".join(messages)


@pytest.mark.parametrize(
    ("key", "multi_step", "misses", "expected"),
    [
        ("sway_yaw_damping", False, True, True),
        ("sway_yaw_damping", True, False, True),
        ("sway_yaw_damping", False, False, False),
        ("thruster_lag", False, True, False),
        ("current:wandering", False, True, True),
        ("current:wandering", False, False, False),
        ("current", False, True, False),
    ],
)
def test_a_coupling_is_not_established_where_the_model_misses_much(
    key: str, multi_step: bool, misses: bool, expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In waves, the damping of sway and yaw was established for an antenna ahead of the origin.

    A wandering current was established for what the model of a hull with fins misses: it made the innovations white.
    """

    def misses_much(*_: Any, whitened: bool) -> bool:
        return misses and whitened == key.endswith("wandering")

    monkeypatch.setattr("rovid.planar.doubts.misses_much", misses_much)
    model: Any = SimpleNamespace(is_multi_step=multi_step)
    found: Any = SimpleNamespace(effect=effect_named(key))
    data: Any = None
    assert formless(model, data, [found]) == ([found] if expected else [])


def test_a_suspect_current_has_no_negative_speed(small: Small) -> None:
    (data, base), effect = small, effect_named("current")
    likelihood = base.likelihood.with_coordinates(base.coordinates.with_effect(effect))
    x = np.insert(base.x, base.coordinates.noise_begin, [-0.1, 0.5])
    model = planar_result(data, PlanarOptimum(likelihood, x, likelihood.value(x))).model
    assert model.value("current.speed") > 0.0
    assert model.value("current.direction") == pytest.approx(0.5 - np.pi)


def test_a_cause_in_the_place_of_a_better_one_that_failed_a_test_is_outweighed() -> None:
    def gaining(effect: str, bic_gain: float, held_out_gain: float) -> Any:
        return SimpleNamespace(effect=effect_named(effect), bic_gain=bic_gain, held_out_gain=held_out_gain)

    damping, place = gaining("sway_yaw_damping", 40.0, 50.0), gaining("sensor_place:antenna", 90.0, 100.0)
    assert outweighed([damping], [place]) == [(damping, place)]
    # A cause that fits better but predicts worse is no better cause, and another form of a cause is none.
    assert outweighed([damping], [gaining("current", 90.0, 30.0), gaining("sway_yaw_damping:lift", 90.0, 90.0)]) == []


@pytest.mark.parametrize(("score", "expected"), [(59.0, "command_delay"), (20.0, "thruster_lag")])
def test_the_likelier_of_causes_that_simulations_do_not_tell_apart_is_taken(score: float, expected: str) -> None:
    lag, delay, nothing = (
        SimpleNamespace(effects=tuple(map(effect_named, names)), score=one)
        for names, one in ((("thruster_lag",), 60.0), (("command_delay",), score), ((), 0.0))
    )
    search: Any = SimpleNamespace(
        causes=lambda model: model.effects,
        score=lambda model: model.score,
        without=lambda *_: nothing,
        replacements=lambda *_: [delay],
        polish=lambda model: model,
    )
    model: Any = lag
    assert [one.id for one in _agreeing(search, model, {"command_delay"}).effects] == [expected]
    assert _agreeing(search, model, set()) is model
