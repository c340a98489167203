"""Formulas: units and prices of the grammar, the effect file, the regression, and laws of an independent simulation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rovid.diagnose.formulas import grammar, search
from rovid.diagnose.formulas.effect_file import effect_of, effect_source, is_possible
from rovid.diagnose.formulas.grammar import Grammar
from rovid.diagnose.formulas.products import Factor, Product, oscillated, remembered
from rovid.diagnose.formulas.regression import InnovationRegression
from rovid.diagnose.formulas.search import FormulaSearch
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import CATALOGUE, plugins
from rovid.effects.actuator_inputs import TrialRows
from rovid.effects.base import Body, Instant, Term
from tests.conftest import Rovid

UNITS = {"rate": "rad/s", "roll": "rad", "surge_velocity": "m/s", "depth": "[depth]", "thruster_torque": "N m"}


def factor(signal: str, shape: str = "linear", centre: float = 0.0) -> Factor:
    return Factor(signal, shape, 0.02, centre)


@pytest.mark.parametrize(
    ("product", "unit"),
    [
        (Product(()), "N m"),
        (Product((factor("roll", "quadratic"),)), "N m/rad^2"),
        (Product((factor("rate"),)), "N m s/rad"),
        (Product((factor("rate"), factor("surge_velocity", "size"))), "N m s^2/(rad m)"),
        (Product((factor("thruster_torque"), factor("depth"))), "1/[depth]"),
        (Product((factor("thruster_torque", "sign"), factor("roll", "cosine"))), "N m"),
        (Product((factor("thruster_torque", "quadratic"),), "memory", (2.0,)), "1/(N m)"),
        (Product((factor("thruster_torque", "root"),)), "(N m)^0.5"),
        (Product((factor("rate"), factor("thruster_torque", "root_size"))), "(N m)^0.5 s/rad"),
    ],
)
def test_the_unit_of_a_coefficient_makes_a_product_a_torque(product: Product, unit: str) -> None:
    assert product.unit_of_coefficient(UNITS) == unit


def test_a_longer_formula_costs_more() -> None:
    short = [Product((factor(name),)) for name in UNITS]
    long = [Product((factor(name, "cubic"),)) for name in UNITS]
    grammar = Grammar((*short, *long), {}, {}, UNITS)
    # Both are one of five; two symbols more cost a bit each.
    assert grammar.price(long[0]) - grammar.price(short[0]) == pytest.approx(2.0 * np.log(2.0))
    assert grammar.price(short[0]) == pytest.approx(np.log(2.0) + np.log(5.0))


def test_a_memory_follows_a_step_by_its_time_constant() -> None:
    time = np.linspace(0.0, 8.0, 81)
    np.testing.assert_allclose(remembered(time, np.ones(81), 2.0), 1.0 - np.exp(-time / 2.0), atol=1e-12)


def test_the_effect_file_computes_the_formula() -> None:
    products = (
        Product((factor("rate", "cubic"), factor("roll", "size", 0.1))),
        Product((factor("thruster_torque", "sign"),), "memory", (3.0,)),
    )
    assert is_possible(products)
    assert not is_possible((products[0], Product((factor("depth"),))))
    effect = effect_of(effect_source(products, (2.0, 0.5), UNITS, name="mine", axis="yaw"))
    assert isinstance(effect.acts, Term)
    assert (effect.needs, effect.acts.states) == (("roll",), 1)
    assert [parameter.unit for parameter in effect.parameters] == ["N m s^3/rad^4", "N m", "s"]
    # at.surge holds the size of roll less 0.1.
    at = Instant(0.3, 0.3, 1.0, 0.4, 0.05, 0.0, 0.7, 0.0, Body(5000.0, 3500.0, 130.0))
    torque, derivatives = effect.acts.evaluate(at, (2.0, 5.0, 3.0), (0.1,))
    assert torque == pytest.approx(2.0 * 0.3**3 * 0.7 + 5.0 * 0.1)
    assert derivatives == pytest.approx([(np.tanh(0.05 / 0.02) - 0.1) / 3.0])
    plugins._check(replace(effect, id="mine"), ())  # noqa: SLF001 - raises where the effect is no plug-in
    assert effect.acts.fastest is not None
    assert effect.acts.fastest({"tau2": 3.0}) == pytest.approx(1.0 / 3.0)


def test_a_lagging_torque_is_its_memory_less_itself() -> None:
    lag = Product((factor("thruster_torque"),), "memory", (2.0,))
    time, torque = np.linspace(0.0, 4.0, 41), np.ones(41)
    np.testing.assert_allclose(lag.values({"thruster_torque": torque}, time), -np.exp(-time / 2.0), atol=1e-12)
    assert lag.text_with(["2 s"]) == "(memory(thruster_torque, 2 s) - thruster_torque)"
    acts = effect_of(effect_source((lag,), (1.0,), UNITS, name="mine", axis="yaw")).acts
    assert isinstance(acts, Term)
    at = Instant(0.3, 0.3, 1.0, 0.4, 10.0, 0.0, 0.0, 0.0, Body(5000.0, 3500.0, 130.0))
    total, derivatives = acts.evaluate(at, (0.5, 4.0), (6.0,))
    assert (total, *derivatives) == pytest.approx((0.5 * (6.0 - 10.0), (10.0 - 6.0) / 4.0))


def test_a_formula_may_hold_the_thrust_of_one_thruster_and_the_time_of_the_campaign() -> None:
    inputs = replace(plugins._inputs(CATALOGUE[0]), trials=(TrialRows(start_offset=7200.0),))  # noqa: SLF001
    thrust = np.column_stack((np.arange(5.0), -np.arange(5.0)))
    expected = {"thrust:b": -np.arange(5.0), "campaign_hours": 2.0 + np.arange(5.0) / 3600.0}
    for signal, series in expected.items():
        product = Product((factor("rate", "quadratic"), factor(signal)))
        effect = effect_of(effect_source((product,), (1.0,), {"rate": "rad/s", signal: "N"}, name="mine", axis="yaw"))
        assert isinstance(effect.acts, Term)
        assert effect.needs == ()
        assert effect.acts.surge_from_thrust is not None
        np.testing.assert_allclose(effect.acts.surge_from_thrust(inputs, thrust, {}), series)


def test_two_thrusters_have_products_of_their_speeds() -> None:
    """One takes in the jet of the other: the loss of thrust goes with both speeds, the roots of the thrusts."""
    factors = {name: factor(name) for name in ("rate", "thrust:a", "thrust:b")}
    shapes = {tuple(one.shape for one in product.factors) for product in grammar._products(factors, 2.0)}  # noqa: SLF001
    roots = ("root", "root_size")
    assert {(one, other) for one in roots for other in roots} <= shapes


def test_a_sum_of_products_of_the_log_alone_is_one_series() -> None:
    units = {"thrust:a": "N", "thrust:b": "N", "roll": "rad"}
    first, second = Product((factor("thrust:a"), factor("thrust:b", "size"))), Product((factor("roll", "square"),))
    assert is_possible((first, second))
    assert not is_possible((first, Product((factor("rate"), factor("roll")))))
    effect = effect_of(effect_source((first, second), (1.0, 1.0), units, name="mine", axis="yaw"))
    assert isinstance(effect.acts, Term)
    assert effect.acts.surge_from_thrust is not None
    thrust = np.column_stack((np.arange(5.0), -np.arange(5.0)))
    inputs = replace(plugins._inputs(CATALOGUE[0]), extras={"roll": np.full(5, 3.0)})  # noqa: SLF001
    series = effect.acts.surge_from_thrust(inputs, thrust, {"c1": 2.0, "c2": 0.5})
    np.testing.assert_allclose(series, 2.0 * np.arange(5.0) ** 2 + 4.5)
    at = Instant(0.3, 0.3, 1.0, 0.4, 0.05, 0.0, 7.0, 0.0, Body(5000.0, 3500.0, 130.0))
    assert effect.acts.evaluate(at, (2.0, 0.5), ()) == (7.0, ())


def test_the_file_of_two_products_is_a_plugin() -> None:
    """Both coefficients are the size: without them the effect is zero."""
    units = {**UNITS, "thrust:a": "N"}
    rate, roll = Product((factor("rate", "cubic"),)), Product((factor("roll", "square"),))
    for products in ((rate, roll), (roll, Product((factor("thrust:a", "root"),)))):
        effect = effect_of(effect_source(products, (1.0, 1.0), units, name="mine", axis="yaw"))
        assert effect.size_count == 2
        plugins._check(effect, ())  # noqa: SLF001 - raises where the effect is no plug-in


def test_gains_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(3)
    own, regressors = rng.normal(size=(60, 2)), rng.normal(size=(60, 3))
    regressors[:, 2] = own @ [1.0, 2.0]  # what the model can do anyway explains nothing
    residual = 0.4 * regressors[:, 0] + rng.normal(size=60)
    residual -= own @ np.linalg.lstsq(own, residual, rcond=None)[0]
    blocks = np.repeat(np.arange(6), 10)

    def summed(terms: np.ndarray) -> np.ndarray:
        return np.array([terms[blocks == k].sum(axis=0) for k in range(6)])

    def outer(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return summed(a[:, :, np.newaxis] * b[:, np.newaxis, :])

    every = np.hstack((own, regressors))
    found = InnovationRegression(
        summed(every * residual[:, np.newaxis]), outer(own, own), outer(own, regressors), summed(regressors**2),
        regressors.T @ regressors,
    )  # fmt: skip
    for k, gain in enumerate(found.gains()[:2]):
        _, (rest,), *_ = np.linalg.lstsq(np.column_stack((own, regressors[:, k])), residual, rcond=None)
        assert gain == pytest.approx(0.5 * (residual @ residual - rest), rel=1e-9)
    assert found.gains()[2] == 0.0
    twice = np.where(np.arange(6) < 3, 2.0, 0.0)
    assert found.gains(twice)[0] != pytest.approx(found.gains()[0])


def write_logs(folder: Path, ballast: float) -> None:
    """Six runs of a vehicle with logged roll, and a torque ``ballast`` * roll |roll| in N m."""
    folder.mkdir()
    signals = 'time = { csv = "time_s" }\nheading = { csv = "heading_deg", unit = "deg" }\n'
    signals += 'torque = { csv = "torque_Nm" }\nroll = { csv = "roll_deg", unit = "deg" }\n'
    vehicle = '[vehicle]\nname = "simulated"\nmass = 2600.0\nlength = 2.6\nwidth = 2.0\n'
    (folder / "rovid.toml").write_text(f"{vehicle}[signals]\n{signals}")
    interval, steps, time = 0.2, 20, np.arange(0.0, 200.0, 0.2)
    levels = np.random.default_rng(8).choice([-180.0, -90.0, 0.0, 90.0, 180.0], size=(2, 40))
    torques = (
        np.where(time % 100.0 < 70.0, 120.0, 0.0),
        np.where(time % 100.0 < 70.0, -120.0, 0.0),
        150.0 * np.sin(2.0 * np.pi * time / 40.0),
        180.0 * np.sin(2.0 * np.pi * time / 20.0),
        levels[0][(time // 11.0).astype(int)],
        levels[1][(time // 7.0).astype(int)],
    )
    for number, torque in enumerate(torques):
        rng = np.random.default_rng(number)
        roll = 0.1 * np.sin(2.0 * np.pi * time / 37.0 + rng.uniform(0.0, 6.0)) + 0.05 * np.sin(time / 3.3 + number)
        heading, rate, slow, rows = rng.uniform(0.0, 6.0), 0.0, 0.0, ["time_s,heading_deg,torque_Nm,roll_deg"]
        for k, push in enumerate(torque):
            degrees = np.degrees(heading) + rng.normal(0.0, 0.02)
            rows.append(f"{time[k]:.1f},{degrees % 360.0:.4f},{push:.3f},{np.degrees(roll[k]):.4f}")
            slow += -slow * interval / 4.0 + 1.5 * np.sqrt(2.0 * interval / 4.0) * rng.normal()
            for _ in range(steps):
                hidden = ballast * roll[k] * abs(roll[k]) + slow
                rate += interval / steps * (push + hidden - 3500.0 * abs(rate) * rate - 130.0 * rate) / 5000.0
                heading += interval / steps * rate
        (folder / f"run_{number}.csv").write_text("\n".join(rows) + "\n")


@pytest.mark.slow
def test_a_law_of_no_catalogue_is_found_and_its_file_is_an_effect(tmp_path: Path, rovid: Rovid) -> None:
    write_logs(tmp_path / "logs", 2500.0)
    found = rovid("discover", "logs", "--write", "law.py", "--plot", "law.png", "--json").document
    (best, *_) = found["formulas"]
    assert (best["signals"], list(best["parameters"])) == (["roll"], ["c1"])
    assert "roll*abs(roll)" in best["formula"]
    coefficient = best["parameters"]["c1"]
    assert coefficient["unit"] == "N m/rad^2"
    assert abs(coefficient["value"] - 2500.0) < 4.0 * coefficient["standard_error"] + 25.0
    assert best["held_out_gain"] > 0.8
    fitted = rovid("fit", "logs", "--effect", "law", "--effects-from", "law.py", "--json").document
    assert fitted["parameters"]["law.c1"]["value"] == pytest.approx(coefficient["value"], rel=0.02)


@pytest.mark.slow
def test_without_a_hidden_law_no_formula_is_offered(tmp_path: Path, rovid: Rovid) -> None:
    write_logs(tmp_path / "logs", 0.0)
    assert rovid("discover", "logs", "--json").document["formulas"] == []


@pytest.mark.parametrize(("lead", "is_rival"), [(-1.0, False), (THRESHOLDS.tie(50.0) - 1.0, False), (20.0, True)])
def test_a_rival_predicts_better_than_all_causes_beyond_a_tie(
    monkeypatch: pytest.MonkeyPatch, lead: float, *, is_rival: bool
) -> None:
    causes: Any = SimpleNamespace(effects=("lag",))
    base = SimpleNamespace(effects=())
    folds = {id(causes): [SimpleNamespace(log_likelihood=70.0)], id(base): [SimpleNamespace(log_likelihood=20.0)]}
    formula = SimpleNamespace(held_out_nats=50.0 + lead)
    found: Any = FormulaSearch.__new__(FormulaSearch)
    found.model, found.terms = causes, 1
    found.problem = SimpleNamespace(innovations=SimpleNamespace(base=base))
    monkeypatch.setattr(found, "_selection", lambda _: SimpleNamespace(folds=lambda model: folds[id(model)]))
    monkeypatch.setattr(found, "_candidates", lambda _, __, longest: [None] if longest == 1 else [])
    monkeypatch.setattr(found, "_validated", lambda _: formula)
    assert found.rival(causes) is (formula if is_rival else None)


@pytest.mark.parametrize(("effect", "counts"), [("wave_torque", True), ("thruster_lag", False)])
def test_a_formula_has_to_beat_waves_too(monkeypatch: pytest.MonkeyPatch, effect: str, *, counts: bool) -> None:
    """The search for formulas has no waves in its model: any formula would beat that."""
    challenged = list[Any]()
    monkeypatch.setattr(search, "lacks_torque", lambda _: True)
    own = SimpleNamespace(model="without waves", rival=challenged.append)
    monkeypatch.setattr(search, "FormulaSearch", lambda *_, with_sizes: own)
    cause = next(one for one in CATALOGUE if one.id == effect)
    model = SimpleNamespace(effects=(cause,), canonical=lambda: None)
    selection: Any = SimpleNamespace(model=model, multi_step=False, waves=None, is_out_of_time=False)
    problem: Any = None
    assert search.doubt_stand_ins(problem, selection) is selection
    assert challenged == [model if counts else "without waves"]


@pytest.mark.parametrize(("gain", "is_doubted"), [(2.0 * THRESHOLDS.bic_margin, True), (THRESHOLDS.bic_margin, False)])
def test_causes_next_to_which_a_product_pays_are_doubted(
    monkeypatch: pytest.MonkeyPatch, gain: float, *, is_doubted: bool
) -> None:
    """Although no torque of the known kinds is missing, as with the interference of two thrusters."""
    monkeypatch.setattr(search, "lacks_torque", lambda _: False)
    monkeypatch.setattr(search, "regress", lambda *_, **__: SimpleNamespace(gains=lambda: np.array([0.0, gain])))
    monkeypatch.setattr(search, "product_effects", lambda *_: [])
    monkeypatch.setattr(search, "drop_likely", lambda one, keys: keys)
    monkeypatch.setattr(search, "replace", lambda one, **_: one)
    found: Any = FormulaSearch.__new__(FormulaSearch)
    products = [Product((factor("rate", "cubic"),)), Product((factor("rate", "sign"),))]
    found.model, found.grammar = None, SimpleNamespace(products=products, price=lambda _: 3.0)
    monkeypatch.setattr(found, "rival", lambda _: SimpleNamespace(signals=("rate",)))
    monkeypatch.setattr(search, "FormulaSearch", lambda *_, with_sizes: found if with_sizes else None)
    cause: Any = SimpleNamespace(id="lag", key="lag", title="lag", is_wave=False)
    model = SimpleNamespace(effects=(cause,), canonical=lambda: None)
    selection: Any = SimpleNamespace(model=model, multi_step=False, waves=None, is_out_of_time=False)
    selection.with_message = selection.ban = lambda *_: selection
    doubted: Any = search.doubt_stand_ins(cause, selection)
    assert doubted == ["lag"] if is_doubted else doubted is selection


@pytest.mark.parametrize("with_sizes", [False, True])
def test_terms_of_a_cause(monkeypatch: pytest.MonkeyPatch, *, with_sizes: bool) -> None:
    """A loss of thrust by the speed that leaves thrust unexplained which changes with the speed has two terms.

    A size of its own in single trials is no law; a formula that is to replace it is compared with a model that has it.
    """
    loss = next(one for one in CATALOGUE if one.id == "advance_speed_loss")
    loss, size = replace(loss, needs=("surge_velocity",)), replace(loss, form="trial a.csv")
    signals = [SimpleNamespace(id=f"signal {name}", is_wave=False) for name in ("surge_velocity", "depth")]
    monkeypatch.setattr(search, "Grammar", SimpleNamespace(of=lambda *_: None))
    monkeypatch.setattr(search, "replace", lambda one, **_: one)
    fits = SimpleNamespace(cache=SimpleNamespace(fits={}))
    model = SimpleNamespace(effects=(loss,), key="", data=SimpleNamespace(usual_time=1.0))
    innovations = SimpleNamespace(
        begin=lambda *_: model, search=lambda _: fits, search_data=None, pieces=(), data=SimpleNamespace(runs=())
    )
    data = SimpleNamespace(vehicle=SimpleNamespace(), runs=())
    problem: Any = SimpleNamespace(data=data, innovations=innovations, pieces=())
    objective = SimpleNamespace(with_effects=lambda _: None)
    selected: Any = SimpleNamespace(
        effects=(loss, size, *signals), objective=objective, without=lambda *_: ((loss,), np.zeros(0))
    )
    assert FormulaSearch(problem, selected, with_sizes=with_sizes).terms == 2 + with_sizes


@pytest.mark.parametrize("refuted", [-3.0, 60.0], ids=["gains nothing", "gains much less"])
def test_a_product_that_its_fit_refutes_does_not_compete_in_the_bootstrap(
    monkeypatch: pytest.MonkeyPatch, refuted: float
) -> None:
    products = [Product((factor("rate", "sign"),)), Product((factor("rate", "cubic"),))]
    regression = SimpleNamespace(
        own=np.zeros((4, 0, 0)),
        gains=lambda _=None: np.array([60.0, 50.0]),
        correlation=lambda: np.array([[1.0, 0.4], [0.4, 1.0]]),
    )
    scores = {products[0]: refuted, products[1]: 200.0}
    base: Any = SimpleNamespace(score=0.0, value=0.0)
    monkeypatch.setattr(search, "regress", lambda *_, **__: regression)
    monkeypatch.setattr(search, "product_effects", lambda *_: [])
    monkeypatch.setattr(search, "bic_score", lambda fitted: fitted.score)
    monkeypatch.setattr(search, "is_plausible", lambda _: True)
    found: Any = FormulaSearch.__new__(FormulaSearch)
    found.report, found.model = (lambda _: None), base
    found.grammar = SimpleNamespace(products=products, price=lambda _: 0.0)
    found.search = SimpleNamespace(misspecification_allowance=lambda *_, **__: 0.0)
    candidate: Any = search._Candidate  # noqa: SLF001
    fits = {
        one: candidate((one,), SimpleNamespace(score=scores[one], value=-scores[one]), base, 0.0, 0.0)
        for one in products
    }
    monkeypatch.setattr(found, "_fitted", lambda _, some: fits[some[0]])
    best, *_ = found._candidates(base, longest=1)  # noqa: SLF001
    assert (best.products, best.inclusion) == ((products[1],), 1.0)


@pytest.mark.parametrize("damping", [0.1, 1.0])
def test_an_oscillation_follows_its_equation(damping: float) -> None:
    """Against an integration of x''/w^2 + 2*z*x'/w + x = u by small steps."""
    time = np.cumsum(np.random.default_rng(3).uniform(0.05, 0.15, 120))
    values = np.sin(0.8 * time) + (time > 5.0)
    frequency = 1.4
    x = speed = 0.0
    expected = [0.0]
    for k in range(1, len(time)):
        for _ in range(2000):
            step = (time[k] - time[k - 1]) / 2000
            speed += step * (frequency**2 * (values[k - 1] - x) - 2.0 * damping * frequency * speed)
            x += step * speed
        expected.append(x)
    np.testing.assert_allclose(oscillated(time, values, frequency, damping), expected, atol=2e-3)


def test_the_effect_file_holds_an_oscillation_and_what_acts_now_times_the_past() -> None:
    ringing = Product((factor("rate"),), "oscillation", (1.4, 0.1))
    sag = Product((factor("thruster_torque", "size"),), "memory", (8.0,), (factor("thruster_torque"),))
    assert sag.text_with(["8 s"]) == "thruster_torque*memory(abs(thruster_torque), 8 s)"
    assert sag.unit_of_coefficient(UNITS) == "1/(N m)"
    assert not is_possible((ringing, sag))
    at = Instant(0.3, 0.3, 1.0, 0.4, -10.0, 0.0, 0.0, 0.0, Body(5000.0, 3500.0, 130.0))
    for product, numbers, states, expected in (
        (ringing, (2.0, 1.4, 0.1), (0.5, 0.2), (1.0, 0.2, 1.4**2 * (0.3 - 0.5) - 2.0 * 0.1 * 1.4 * 0.2)),
        (sag, (-0.001, 8.0), (50.0,), (-0.001 * -10.0 * 50.0, (10.0 - 50.0) / 8.0)),
    ):
        acts = effect_of(effect_source((product,), (1.0,), UNITS, name="mine", axis="yaw")).acts
        assert isinstance(acts, Term)
        total, derivatives = acts.evaluate(at, numbers, states)
        assert (total, *derivatives) == pytest.approx(expected)


def test_drag_that_remembers_the_motion_turns_around_with_it() -> None:
    products = [one for one in grammar._products({"rate": factor("rate")}, 2.0) if one.outside]  # noqa: SLF001
    assert {"abs(rate)*memory(rate)", "rate*rate*swept_memory(tanh(rate/0.02))"} <= {one.text for one in products}
    time, rate = np.linspace(0.0, 6.0, 61), np.cumsum(np.random.default_rng(1).normal(0.0, 0.1, 61))
    for product in products:
        there, back = (product.values({"rate": sign * rate}, time) for sign in (1.0, -1.0))
        np.testing.assert_allclose(there, -back, atol=1e-12)


def test_a_memory_over_the_swept_angle_stands_still_with_the_vehicle() -> None:
    wake = Product((factor("rate", "sign"),), "swept_memory", (0.5,), (factor("rate", "square"),))
    time, rate = np.linspace(0.0, 6.0, 61), np.repeat([0.4, 0.0, -0.4], [20, 21, 20])
    swept = 0.4 * 2.0  # rad until the vehicle stops; it turns back from 4.1 s on
    before, back = 1.0 - np.exp(-swept / 0.5), np.exp(-0.4 * (time[41:] - 4.1) / 0.5)
    expected = np.concatenate((1.0 - np.exp(-0.4 * time[:20] / 0.5), np.zeros(21), (1.0 + before) * back - 1.0))
    np.testing.assert_allclose(wake.values({"rate": rate}, time), rate**2 * expected, atol=1e-6)
    assert wake.text_with(["0.5 rad"]) == "rate*rate*swept_memory(tanh(rate/0.02), 0.5 rad)"
    acts = effect_of(effect_source((wake,), (1.0,), UNITS, name="mine", axis="yaw")).acts
    assert isinstance(acts, Term)
    at = Instant(-0.3, -0.3, 1.0, 0.4, 10.0, 0.0, 0.0, 0.0, Body(5000.0, 3500.0, 130.0))
    total, derivatives = acts.evaluate(at, (5.0, 0.5), (0.8,))
    assert (total, *derivatives) == pytest.approx((5.0 * 0.09 * 0.8, 0.3 * (-1.0 - 0.8) / 0.5))


@pytest.mark.parametrize("operator", ["limit", "play", "root_limit", "root_play"])
def test_an_actuator_without_limits_leaves_no_torque(operator: str) -> None:
    """The effect file holds the operator's output less the torque, as the grammar's own values."""
    product = Product((factor("thruster_torque"),), operator, (0.5,))
    torque = 3.0 * np.sin(np.arange(5.0))
    inputs = replace(plugins._inputs(CATALOGUE[0]), arms=np.array([2.0]))  # noqa: SLF001
    effect = effect_of(effect_source((product,), (1.0,), UNITS, name="mine", axis="yaw"))
    assert isinstance(effect.acts, Term)
    assert effect.acts.surge_from_thrust is not None
    (constant,) = product.units_of_constants(1)
    for value, leaves in ((0.5, True), (1e6 if "limit" in operator else 0.0, False)):
        series = effect.acts.surge_from_thrust(inputs, 0.5 * torque[:, None], {constant: value})
        change = replace(product, constants=(value,)).values({"thruster_torque": torque}, inputs.time)
        np.testing.assert_allclose(series - torque, change, atol=1e-12)
        # A limited rate takes a moment for each change, and the last value has no interval to reach.
        assert np.any(np.abs(change[:-1]) > 1e-4) == leaves
        at = Instant(0.3, 0.3, 1.0, 0.4, torque[2], 0.0, series[2], 0.0, Body(5000.0, 3500.0, 130.0))
        assert effect.acts.evaluate(at, (2.0, value), ())[0] == pytest.approx(2.0 * change[2])
