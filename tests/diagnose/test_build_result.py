"""Results and stated selections."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rovid.core.errors import DataError
from rovid.diagnose import build_result, stated_selection
from rovid.diagnose.algorithm import conclude
from rovid.diagnose.build_result import _wave_finding, subsets
from rovid.diagnose.candidate_fits import Alternative
from rovid.diagnose.formulas import search
from rovid.diagnose.selection import Selection
from rovid.diagnose.stated_selection import _between_laws, _deviation, average_over_suspects, is_established, state
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import Suspected
from rovid.effects import CATALOGUE, Effect, effect_named
from rovid.estimate.estimate import Estimate
from rovid.estimate.filter_data import InnovationData
from rovid.estimate.fit_result import FitResult
from rovid.estimate.innovation_likelihood import InnovationLikelihood
from rovid.estimate.maximum_likelihood import LikelihoodFit, fit_likelihood
from rovid.estimate.parametrization import INERTIA
from tests import synthetic
from tests.predictions import BIAS, NOISE, TIME, TORQUE

FEW = 200
NAMES = ("inertia", "quadratic_drag", "linear_drag")
VALUES = np.array([3000.0, 900.0, 40.0])


def estimate() -> Estimate:
    return Estimate(
        names=NAMES, axis=synthetic.ROSUB.axis, values=VALUES, covariance=np.eye(3), method="", samples=FEW, warnings=()
    )


@pytest.fixture(scope="module")
def rival() -> Alternative:
    runs = [synthetic.run(TIME[:FEW], TORQUE[:FEW], noise=NOISE[:FEW])]
    objective = InnovationLikelihood(InnovationData(runs, synthetic.LOGGED, synthetic.ROSUB), 0.05, (BIAS,))
    return Alternative(BIAS, 10.0, FitResult.at(objective, objective.parametrization.initial()))


def test_a_suspect_adds_its_deviation_to_the_covariance_by_its_probability(rival: Alternative) -> None:
    suspected = Suspected(rival, 0.5, 10.0, ())
    off = rival.fitted.model.values[:3] - VALUES
    told = average_over_suspects(estimate(), [suspected])
    assert told.covariance == pytest.approx(np.eye(3) + 0.5 * np.outer(off, off))
    assert told.values.tolist() == VALUES.tolist()
    assert told.warnings == ("The standard errors include what constant torque would change, if it acts.",)


def test_probabilities_of_suspects_add_up_to_one_at_most(rival: Alternative) -> None:
    one, two = (
        average_over_suspects(estimate(), [Suspected(rival, 1.0, 10.0, ())]),
        [Suspected(rival, 0.8, 10.0, ())] * 2,
    )
    assert average_over_suspects(estimate(), two).covariance == pytest.approx(one.covariance)


def test_without_suspects_the_covariance_stays() -> None:
    assert average_over_suspects(estimate(), []).covariance.tolist() == np.eye(3).tolist()


@pytest.mark.parametrize(("other", "weight"), [("same", 1.0), ("another", np.exp(-3.0))])
def test_another_law_counts_by_akaike_and_another_cause_by_schwarz(
    monkeypatch: pytest.MonkeyPatch, other: str, weight: float
) -> None:
    def law(name: str, likelihood: float, parameters: int) -> Any:
        x, effects = np.zeros(parameters), [SimpleNamespace(id=name)]
        score = likelihood - 4.5 * parameters
        return SimpleNamespace(effects=effects, value=-likelihood, x=x, score=score, key=object(), is_white=True)

    model, rest = law("same", 100.0, 2), law("", 0.0, 0)
    search = SimpleNamespace(without=lambda *_: rest, replacements=lambda *_: [law(other, 106.0, 4)])
    monkeypatch.setattr(stated_selection, "bic_score", lambda one: one.score)
    monkeypatch.setattr(stated_selection, "is_plausible", lambda _: True)
    monkeypatch.setattr(stated_selection, "is_signal", lambda _: False)
    monkeypatch.setattr(stated_selection, "_deviation", lambda *_: np.array([2.0, 0.0, 0.0]))
    selected: Any = SimpleNamespace(model=model, search=search)
    first, second = _between_laws(selected, estimate())
    added = first + second
    assert added[0, 0] == pytest.approx(4.0 * weight / (1.0 + weight))


def keys(count: int) -> list[tuple[str, ...]]:
    return [tuple(effect.key for effect in chosen) for chosen in subsets(CATALOGUE[:count])]


def test_up_to_three_causes_give_all_subsets() -> None:
    one, two, three = (effect.key for effect in CATALOGUE[:3])
    assert keys(0) == keys(1) == []
    assert keys(2) == [(one,), (two,)]
    assert keys(3) == [(one,), (two,), (three,), (one, two), (one, three), (two, three)]


def test_more_causes_are_added_one_by_one() -> None:
    names = tuple(effect.key for effect in CATALOGUE[:5])
    assert keys(5) == [names[:1], names[:2], names[:3], names[:4]]


def widen(monkeypatch: pytest.MonkeyPatch, errors: float) -> None:
    """What the model lacks makes the constant torque this many standard errors large."""

    def wider(estimate: Estimate, _: FitResult) -> Estimate:
        covariance = np.array(estimate.covariance)
        for at, name in enumerate(estimate.names):
            if name == "bias_torque.torque":
                covariance[at, at] = (estimate.values[at] / errors) ** 2
        return replace(estimate, covariance=covariance)

    monkeypatch.setattr(stated_selection, "include_missing_torque", wider)


def test_a_cause_that_is_large_in_the_stated_errors_stays(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    widen(monkeypatch, 1.01 * THRESHOLDS.min_stated_errors)
    stated = state(selection)
    assert stated.selection is selection
    assert stated.size_in_errors(BIAS) == pytest.approx(1.01 * THRESHOLDS.min_stated_errors)


def test_a_cause_that_the_stated_errors_leave_open_is_a_suspect(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The model and all figures are without it, as if it had failed a rule."""
    widen(monkeypatch, 0.99 * THRESHOLDS.min_stated_errors)
    told = conclude(selection, ())
    assert told.verdict == "suspected"
    assert told.findings == ()
    assert [one.effect.id for one in told.suspects] == ["bias_torque"]
    assert told.suspects[0].probability <= THRESHOLDS.max_suspect_probability
    # One-step predictions do not determine the disturbance here, and so no floor under it.
    assert (math.isnan(told.noise_floor), told.position_floors) == (True, {})
    assert told.extended is not None
    assert told.extended.model.effects == ()
    assert "bias_torque.torque" not in told.extended.estimate.names
    # One model, one error: what the suspect would change is part of both.
    assert told.base is not None
    assert told.base.estimate.covariance.tolist() == told.extended.estimate.covariance.tolist()
    assert any("only 3.0 of the standard errors that include what the model lacks" in one for one in told.warnings)


@pytest.mark.parametrize("same_cause", [True, False])
def test_only_another_cause_in_its_place_speaks_against_a_cause(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, *, same_cause: bool
) -> None:
    """Another form may have another size. The stated error of the size includes it, but it is no reason for nothing."""

    def between_laws(_: Selection, estimate: Estimate) -> tuple[np.ndarray, np.ndarray]:
        at = [name == "bias_torque.torque" for name in estimate.names]
        away = np.diag(estimate.values * at) ** 2
        none = np.zeros_like(away)
        return (away, none) if same_cause else (none, away)

    monkeypatch.setattr(stated_selection, "_between_laws", between_laws)
    told = conclude(selection, ())
    assert [one.effect.id for one in told.findings] == ["bias_torque"] * same_cause
    for finding in told.findings:
        name = "bias_torque.torque"
        assert finding.standard_errors > THRESHOLDS.min_stated_errors
        assert finding.estimate.standard_error(name) > abs(finding.estimate.value(name))


@pytest.mark.parametrize(
    ("is_beaten", "lacks", "product"),
    [(False, True, False), (True, True, False), (True, False, True), (True, False, False)],
)
def test_a_cause_that_a_formula_beats_is_a_suspect(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, *, is_beaten: bool, lacks: bool, product: bool
) -> None:
    """A model that lacks no torque, and no product of signals, is not challenged."""

    class Search:
        lacks_product, model = product, None

        def __init__(self, *_: object, with_sizes: bool) -> None: ...

        def rival(self, _: object) -> Any:
            return SimpleNamespace(signals=("rate", "roll")) if is_beaten else None

    monkeypatch.setattr(search, "FormulaSearch", Search)
    monkeypatch.setattr(search, "lacks_torque", lambda _: lacks)
    problem: Any = None
    told = conclude(search.doubt_stand_ins(problem, replace(selection, multi_step=False)), ())
    is_doubted = is_beaten and (lacks or product)
    assert [one.effect.id for one in told.findings] == ["bias_torque"] * (not is_doubted)
    assert [one.effect.id for one in told.suspects] == ["bias_torque"] * is_doubted
    assert all(one.probability < THRESHOLDS.likely for one in told.suspects)
    assert any("A formula of rate and roll predicts" in one for one in told.warnings) is is_doubted


@pytest.mark.parametrize("has_cause", [True, False])
def test_the_plain_model_is_that_of_the_fit(selection: Selection, *, has_cause: bool) -> None:
    """Without a cause its parameters, not those of the search, are the result."""
    fitted = selection.base.model
    model = replace(fitted, inertia=1.1 * fitted.inertia)
    plain: Any = SimpleNamespace(estimate=replace(estimate(), values=model.values), model=model)
    told = conclude(selection if has_cause else replace(selection, model=selection.base), (), plain)
    assert told.base is not None
    assert told.extended is not None
    assert told.base.model == model
    assert told.base.estimate is (plain.estimate if has_cause else told.extended.estimate)
    assert told.base.estimate.values.tolist() == plain.estimate.values.tolist()
    assert (told.extended.model == model) is not has_cause
    assert (told.extended.estimate.value("inertia") == model.inertia) is not has_cause


@pytest.mark.parametrize(("method", "stated"), [(InnovationLikelihood.method, True), ("predictions", False)])
def test_waves_without_another_cause_are_stated_as_in_the_fit_with_them(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, method: str, *, stated: bool
) -> None:
    """Inertia and drag fitted without the waves have errors several times as large."""
    wave = effect_named("wave_torque")
    test: Any = SimpleNamespace(established=SimpleNamespace(effects=(BIAS, wave)), imitated=(), likelier=selection.base)
    plain: Any = SimpleNamespace(estimate=estimate(), model=selection.base.model)
    values, covariance = np.append(VALUES, 8.0), 0.1 * np.eye(4)
    names = (*NAMES, "wave_torque.amplitude")
    own = replace(
        estimate(), names=names, values=values, covariance=covariance, method=method, warnings=("of the fit",)
    )
    fitted = LikelihoodFit(
        estimate=own,
        lasting=np.zeros((4, 4)),
        model=selection.base.model,
        log_likelihood=0.0,
        disturbance=1.0,
        correlation_time=1.0,
        position_noise=1e-4,
        rate_only=False,
        limit=0.05,
        at_limit=True,
        white=False,
        free_run_r2=0.9,
        simulation_r2=0.9,
    )
    asked = list[tuple[Effect, ...]]()

    def fit_likelihood(_runs: object, _vehicle: object, effects: tuple[Effect, ...]) -> LikelihoodFit:
        asked.append(effects)
        return fitted

    monkeypatch.setattr(stated_selection, "fit_likelihood", fit_likelihood)
    assert state(replace(selection, waves=test), plain).waves is None  # another cause acts
    told = state(replace(selection, model=selection.base, waves=test), plain)
    assert asked == [(wave,)]
    assert (told.waves is not None) is stated
    if told.waves is not None:
        # What suspects would change counts next to waves, too.
        covariance[:3, :3] += told.estimate.covariance - plain.estimate.covariance
        assert told.waves.estimate.covariance == pytest.approx(covariance)
        assert told.waves.estimate.values.tolist() == values.tolist()
        assert told.waves.estimate.warnings[0] == "of the fit"


def test_what_fails_without_the_dropped_cause_is_dropped_too(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    dropped: list[str] = []

    def drop(one: Selection, keys: Collection[str]) -> Selection:
        dropped.extend(keys)
        return replace(one, model=one.base)

    monkeypatch.setattr(stated_selection, "drop_likely", drop)
    widen(monkeypatch, 1.0)
    stated = state(selection)
    assert dropped == [BIAS.key]
    assert not stated.selection.search.is_allowed(BIAS)


def test_effects_that_show_only_together_count_in_the_errors(selection: Selection) -> None:
    without = replace(selection, model=selection.base)
    plain, wider = (state(one).estimate for one in (without, replace(without, dropped=selection.model)))
    off = selection.model.canonical().model.values[:3] - plain.values
    assert wider.covariance - plain.covariance == pytest.approx(0.5 * np.outer(off, off))


def test_an_inertia_that_missing_effects_make_uncertain_is_no_lack_of_excitation(
    selection: Selection, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A model with effects that show only together, and a plain fit with the error of a missing torque."""
    without = replace(selection, model=selection.base)
    plain = fit_likelihood(selection.data.runs, selection.data.vehicle)
    wide = replace(plain, estimate=replace(plain.estimate, covariance=1e6 * plain.estimate.covariance))
    x = selection.model.x.copy()
    x[INERTIA] += math.log(5.0)
    far = replace(without, dropped=replace(selection.model, x=x))
    stated = state(far, wide).estimate
    assert stated.standard_error("inertia") > 0.5 * stated.value("inertia")

    def unknown(estimate: Estimate, _: float) -> None:
        raise DataError(f"the inertia is {estimate.value('inertia')}")

    # Without excitation nothing is stated.
    monkeypatch.setattr(stated_selection, "require_inertia", unknown)
    with pytest.raises(DataError, match="the inertia is"):
        state(far, wide)


@pytest.mark.parametrize(
    ("errors", "probability", "expected"), [(2.9, 0.97, False), (3.1, 0.97, True), (9.0, 0.9, False)]
)
def test_waves_are_established_by_the_same_rule(
    selection: Selection, errors: float, probability: float, *, expected: bool
) -> None:
    (finding,) = conclude(selection, ()).findings
    assert is_established(replace(finding, standard_errors=errors, probability=probability)) is expected


@pytest.mark.parametrize(("size", "is_suspect"), [(0.9, False), (1.1, True)])
def test_waves_smaller_than_their_standard_error_are_no_suspect(
    selection: Selection, monkeypatch: pytest.MonkeyPatch, size: float, is_suspect: bool
) -> None:
    waves: Any = SimpleNamespace(fitted=selection.model, probability=0.97, gain=42.0, bic_gain=30.0, held_out_gain=9.0)
    monkeypatch.setattr(build_result, "size_in_errors", lambda *_: size)
    assert (_wave_finding(replace(selection, waves=waves)) is not None) == is_suspect


@pytest.mark.parametrize(
    ("name", "other", "names", "difference"),
    [
        # The form with both has no first harmonic where two cycles act, and that is no error of their amplitude.
        ("heading_deviation:two_cycles.amplitude", "heading_deviation:mixed", ("amplitude", "second_amplitude"), 0.0),
        # Losses at a tenth of the largest thrust and at the largest thrust.
        ("thrust_curve_shape:saturating.loss", "thrust_curve_shape:parabola", ("loss",), 0.0),
        ("speed_dependent_damping.linear", "speed_dependent_damping:estimated", ("linear",), 0.0),
        ("thruster_lag.time_constant", "thruster_lag:command", ("time_constant",), -0.05),
    ],
)
def test_parameters_of_one_name_that_are_other_quantities_are_not_compared(
    name: str, other: str, names: tuple[str, ...], difference: float
) -> None:
    estimate: Any = SimpleNamespace(names=("inertia", name), values=np.array([2.0, 0.05]))
    every = ("inertia", *(f"{other}.{own}" for own in names))
    model = SimpleNamespace(names=every, values=np.array([2.5, 0.0, 0.05][: len(every)]))
    fitted: Any = SimpleNamespace(effects=(effect_named(other),), canonical=lambda: fitted, model=model)
    replaced = effect_named(name.rpartition(".")[0])
    assert _deviation(estimate, fitted, replaced) == pytest.approx([0.5, difference])
