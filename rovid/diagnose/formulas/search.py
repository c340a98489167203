"""Search for formulas for the torque that a model leaves unexplained.

1. *Regress*: `regression` predicts the gain of every product of the grammar. Each pays for the length of its code.
2. *Fit*: the best products become effects in the form of a plug-in, and are fitted with all other parameters by maximum
   likelihood. A second product is added if its gain pays for it.
3. *Validate*: a formula passes the rules of `rovid.diagnose.validation` that concern size and prediction. A formula
   next to the plain model also has to beat the causes of the diagnosis.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.core.budget import ProgressCallback
from rovid.core.formatting import significant
from rovid.diagnose.candidate_fits import bic_score, fit_from_best_start, is_plausible
from rovid.diagnose.cross_validation import held_out_log_likelihood
from rovid.diagnose.formulas.effect_file import effect_of, effect_source, is_possible, names_of
from rovid.diagnose.formulas.grammar import Grammar
from rovid.diagnose.formulas.products import Product
from rovid.diagnose.formulas.regression import InnovationRegression, inclusion, product_effects, regress
from rovid.diagnose.objectives import SearchProblem, without_waves
from rovid.diagnose.selection import Selection
from rovid.diagnose.signal_regressors import is_signal, signal_name
from rovid.diagnose.stated_selection import model_estimate
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.diagnose.validation import (
    drop_likely,
    predicts_worse,
    raises_disturbance,
    simulates_worse,
    too_large,
    too_small,
)
from rovid.effects.further_terms import trials_in_form
from rovid.estimate.estimate import Estimate
from rovid.estimate.fit_result import FitResult
from rovid.estimate.missing_torque import lacks_torque
from rovid.model.model import Model

# Formulas in a result, single products that are fitted next to one model, and products of the longest formula.
_MOST, _FITTED, _LONGEST = 3, 5, 4
# Products that are fitted in the place of the causes of a diagnosis.
_RIVALS = 2
# Correlation of two regressors above which they are the same formula, for fits and for the inclusion frequency.
_SAME, _SIMILAR = 0.97, 0.9
# Least correlation with the nearest effect of the catalogue.
_NEAR = 0.5
# Least share of the best formula's gain that another formula has.
_COMPARABLE = 0.5
# Draws of the block bootstrap, its seed, and the least inclusion frequency of a formula.
_DRAWS, _SEED, _INCLUDED = 100, 56, 0.3
_CUT_SHORT = (
    "The budget was used up before the diagnosis came to its end: a cause of the catalogue may be missing, and a "
    "formula may stand in for it. Give a larger --budget."
)
_RULES = (predicts_worse, too_large, too_small, raises_disturbance, simulates_worse)


@dataclass(frozen=True, kw_only=True, eq=False)
class Formula:
    """A formula that predicts, next to the causes of the model ``without`` it."""

    products: tuple[Product, ...]
    sizes: tuple[float, ...]  #: RMS value of each product.
    estimate: Estimate  #: Of the formula's parameters, by name.
    gain: float  #: Log-likelihood gain in nats.
    price: float  #: Length of the formula's code in nats.
    held_out_nats: float  #: Log-likelihood gain on trials that were not fitted.
    #: Share of the mean square error of the free-running rate on trials that were not fitted that the formula removes.
    held_out_gain: float
    inclusion: float  #: Share of bootstrap draws in which the regression selects the formula.
    nearest: str | None  #: Id of the most similar effect of the catalogue.
    model: Model  #: The model with the formula.
    without: Model  #: The model without the formula.

    @property
    def beside(self) -> tuple[str, ...]:
        """Ids of the causes in the model."""
        return tuple(effect.id for effect in self.without.effects)

    @property
    def signals(self) -> tuple[str, ...]:
        """The signals in it."""
        return tuple(dict.fromkeys(signal for product in self.products for signal in product.signals))

    @property
    def text(self) -> str:
        """The formula with its numbers."""
        terms = []
        for k, product in enumerate(self.products, start=1):
            constants = [
                f"{significant(self.estimate.value(name), 3)}{f' {unit}' * (unit != '1')}"
                for name, unit in product.units_of_constants(k).items()
            ]
            terms.append(f"{significant(self.estimate.value(f'c{k}'), 3)}*{product.text_with(constants)}")
        return " + ".join(terms).replace("+ -", "- ")


@dataclass(frozen=True, kw_only=True, eq=False)
class Discovery:
    """Formulas, best first, and the data that they were found in."""

    formulas: tuple[Formula, ...] = ()
    causes: tuple[str, ...] = ()  #: Ids of the causes that the diagnosis selects.
    missing: str = ""  #: What the data lack; empty if nothing.
    warnings: tuple[str, ...] = ()
    grammar: Grammar | None = None

    def source(self, formula: Formula, name: str, axis: str) -> str:
        """Text of the effect file of a ``formula``."""
        assert self.grammar is not None  # noqa: S101 - a formula has one
        return effect_source(formula.products, formula.sizes, self.grammar.units, name=name, axis=axis)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A fitted formula."""

    products: tuple[Product, ...]
    fitted: FitResult
    without: FitResult
    price: float
    inclusion: float

    @property
    def score(self) -> float:
        """BIC score less the price."""
        return bic_score(self.fitted) - self.price


class FormulaSearch:
    """Search for formulas next to the model that the diagnosis selected.

    ``with_sizes``: The model keeps sizes of single trials: needed where a formula is to replace them.
    """

    def __init__(
        self,
        problem: SearchProblem,
        selected: FitResult,
        report: ProgressCallback = lambda _: None,
        *,
        with_sizes: bool = False,
    ) -> None:
        self.problem, self.report = problem, report
        vehicle = problem.data.vehicle
        assert vehicle is not None  # noqa: S101 - a diagnosis has one
        objective = problem.innovations
        # Otherwise such a size only describes these logs: no law, and no reason against one.
        laws = (one for one in without_waves(selected.effects) if not is_signal(one))
        named = tuple(one for one in laws if with_sizes or not trials_in_form(one.form))
        effects, x = selected.without(*(effect for effect in selected.effects if effect not in named))
        kept = replace(selected, objective=selected.objective.with_effects(effects), x=x)
        self.model = objective.begin(objective.search_data, kept, kept)
        self.search = objective.search(self.model)
        self.search.cache.fits[self.model.key] = self.model
        self.pieces = objective.pieces
        parts = [*objective.data.runs, *(piece.run for piece in problem.pieces)]
        self.grammar = Grammar.of(problem.data.runs, parts, self.model.data.usual_time, vehicle)
        # A cause that leaves a torque of its own signal unexplained needs the term of that signal too.
        needs = {name for effect in named for name in effect.needs}
        own = [one for one in selected.effects if is_signal(one) and signal_name(one) in needs]
        self.terms, self.count = len(named) + len(own), 0

    def run(self) -> Discovery:
        """The formulas that pass, best first."""
        contexts = {model.key: model for model in (self.model, self.problem.innovations.base)}
        every = [one for context in contexts.values() for one in self._candidates(context)]
        # The same two products may be reached from either; the better one came first.
        found = {(one.without.key, frozenset(one.products)): one for one in reversed(every)}.values()
        causes = tuple(effect.id for effect in self.model.effects)
        formulas: list[Formula] = []
        for one in sorted(found, key=lambda one: -one.score):
            if formulas and (len(formulas) == _MOST or self._gain(one) < _COMPARABLE * formulas[0].gain):
                break
            # Of formulas with the same signals the best one is printed.
            signals = {frozenset(formula.signals) for formula in formulas}
            formula = self._validated(one)
            if formula is not None and frozenset(formula.signals) not in signals:
                formulas.append(formula)
        warnings = (_CUT_SHORT,) if self.problem.budget.not_tried else ()
        return Discovery(formulas=tuple(formulas), causes=causes, grammar=self.grammar, warnings=warnings)

    def rival(self, causes: FitResult) -> Formula | None:
        """A formula that predicts trials that were not fitted better than the model with all ``causes``, beyond a tie.

        It has as many products as the causes have terms at most: a longer one may hold a cause that acts, and a further
        law.
        """
        base, own = self.problem.innovations.base, self._selection(self.model)
        for one in self._candidates(base, _RIVALS, longest=self.terms):
            formula = self._validated(one)
            if formula is None:
                continue
            least = held_out_log_likelihood(own.folds(causes)) - held_out_log_likelihood(own.folds(base))
            if formula.held_out_nats >= least + THRESHOLDS.tie(least):
                return formula
        return None

    @property
    def lacks_product(self) -> bool:
        """Whether a product pays for itself next to the causes, as the regression predicts."""
        products = [one for one in self.grammar.products if is_possible([one])]
        _, _, net = self._regressed(self.model, products, jointly=False)
        return bool(net.max() >= THRESHOLDS.bic_margin)

    def _regressed(
        self, context: FitResult, products: Sequence[Product], *, jointly: bool = True
    ) -> tuple[InnovationRegression, FloatArray, FloatArray]:
        """Regression of products next to one model, their prices, and their gains less the prices."""
        found = regress(context, products, partial(product_effects, self.grammar), jointly=jointly)
        prices = np.array(list(map(self.grammar.price, products)))
        return found, prices, found.gains() - prices

    def _selection(self, model: FitResult) -> Selection:
        problem = self.problem
        return Selection(
            search=self.search, data=problem.data, base=problem.innovations.base, model=model, pieces=self.pieces
        )

    def _gain(self, one: _Candidate) -> float:
        return one.without.value - one.fitted.value

    def _candidates(self, context: FitResult, count: int = _FITTED, longest: int = _LONGEST) -> Iterator[_Candidate]:
        """Fitted formulas next to one model whose gain pays for them, of the ``count`` best products."""
        self.report("Regressing the missing torque on products of signals …")
        products = [product for product in self.grammar.products if is_possible([product])]
        found, prices, net = self._regressed(context, products)
        correlation = np.abs(found.correlation())
        chosen: list[int] = []
        for k in np.argsort(-net).tolist():
            if len(chosen) == count or net[k] < THRESHOLDS.bic_margin:
                break
            if all(correlation[k, other] < _SAME for other in chosen):
                chosen.append(k)
        self.report(f"Fitting {len(chosen)} formulas …")
        # The gain has to pay for the formula, and to exceed what approximate equations of the causes may explain.
        least = max(THRESHOLDS.bic_margin, self.search.misspecification_allowance(context, white=False))
        singles = {k: self._fitted(context, (products[k],)) for k in chosen}
        singles = {
            k: one for k, one in singles.items() if is_plausible(one.fitted) and one.score >= bic_score(context) + least
        }
        if not singles:
            return
        # What the regression predicted, and the fit of a product refuted, does not compete in the bootstrap.
        least_gain = _COMPARABLE * max(map(self._gain, singles.values()))
        kept = [k for k, one in singles.items() if self._gain(one) >= least_gain]
        refuted = correlation[[k for k in chosen if k not in kept]].max(axis=0, initial=0.0)
        competes = (refuted < _SIMILAR) | (correlation[kept].max(axis=0) > refuted)
        drawn = inclusion(found, np.where(competes, prices, np.inf), np.random.default_rng(_SEED), _DRAWS)
        every = [replace(one, inclusion=float(np.mean(correlation[k, drawn] > _SIMILAR))) for k, one in singles.items()]
        best = sorted(every, key=lambda one: -one.score)[:_MOST]
        for one in (self._extended(one, longest) for one in best):
            if one.score >= bic_score(self.model) + THRESHOLDS.bic_margin:
                yield one

    def _fitted(self, context: FitResult, products: tuple[Product, ...], share: float = 0.0) -> _Candidate:
        self.count += 1
        source = effect_source(
            products, self._sizes(products), self.grammar.units, name=f"formula_{self.count}", axis=self._axis
        )
        objective = context.objective.with_effects((*context.effects, effect_of(source)))
        starts = objective.parametrization.initial_values()
        fitted = fit_from_best_start(objective, context, starts, THRESHOLDS.search_iterations)
        self.search.cache.fits[fitted.key] = fitted
        return _Candidate(products, fitted, context, sum(map(self.grammar.price, products)), share)

    @property
    def _axis(self) -> str:
        return self.problem.data.axis.name

    def _sizes(self, products: Sequence[Product]) -> tuple[float, ...]:
        joined = [np.concatenate(list(self.grammar.values(product).values())) for product in products]
        return tuple(max(float(np.sqrt(np.mean(values**2))), 1e-12) for values in joined)

    def _extended(self, one: _Candidate, longest: int) -> _Candidate:
        """The formula with further products, the best first, as long as each pays for itself."""
        products = [product for product in self.grammar.products if is_possible((*one.products, product))]
        products = [product for product in products if product not in one.products]
        if len(one.products) >= longest or not products:
            return one
        _, _, net = self._regressed(one.fitted, products, jointly=False)
        best = int(np.argmax(net))
        least = max(THRESHOLDS.bic_margin, THRESHOLDS.misspecification_share * self._gain(one))
        if net[best] < least:
            return one
        more = self._fitted(one.without, (*one.products, products[best]), one.inclusion)
        pays = is_plausible(more.fitted) and more.score >= one.score + least
        return self._extended(more, longest) if pays else one

    def _validated(self, one: _Candidate) -> Formula | None:
        """The result for a formula that passes all rules; else None."""
        effect = one.fitted.effects[-1]
        selection = self._selection(self.search.cache.converged(one.fitted))
        if one.inclusion < _INCLUDED or any(rule(selection, effect) for rule in _RULES):
            return None
        without = selection.search.without(selection.model, effect)
        mean_squares = [selection.held_out_scores(m).rate_rmse ** 2 for m in (selection.model, without)]
        whole = model_estimate(selection.model, white=selection.model.is_white)
        at = [whole.names.index(f"{effect.key}.{name}") for name in names_of(one.products)]
        estimate = replace(
            whole,
            names=tuple(names_of(one.products)),
            values=whole.values[at],
            covariance=whole.covariance[np.ix_(at, at)],
        )
        return Formula(
            products=one.products,
            sizes=self._sizes(one.products),
            estimate=estimate,
            gain=without.value - selection.model.value,
            price=one.price,
            held_out_nats=selection.held_out_gain(effect),
            held_out_gain=1.0 - mean_squares[0] / mean_squares[1],
            inclusion=one.inclusion,
            nearest=self._nearest(one),
            model=selection.model.model,
            without=without.model,
        )

    def _nearest(self, one: _Candidate) -> str | None:
        """The effect of the catalogue with the most similar response of the innovations."""
        forms = [form for form in without_waves(self.problem.candidates) if not is_signal(form)]
        forms = [form for form in forms if form not in one.without.effects]
        (effect,) = product_effects(self.grammar, one.products[:1])
        found: InnovationRegression = regress(one.without, [effect, *forms], list)
        correlation = np.abs(found.correlation()[0, 1:])
        if not len(correlation) or correlation.max() < _NEAR:
            return None
        return forms[int(np.argmax(correlation))].id


def doubt_stand_ins(problem: SearchProblem, selection: Selection) -> Selection:
    """The ``selection`` without its causes if a formula in their place predicts held-out trials better.

    Only a one-step model that still lacks a torque, or a product of signals, is challenged. The causes are suspects
    then. Waves are no part of the search for formulas, but count among the causes.
    """
    causes = [effect for effect in selection.model.effects if not is_signal(effect)]
    if not causes or selection.multi_step or selection.waves is not None or selection.is_out_of_time:
        return selection
    search = FormulaSearch(problem, selection.model, with_sizes=True)
    is_doubtful = lacks_torque(selection.model.canonical()) or search.lacks_product
    has_waves = len(without_waves(causes)) < len(causes)
    formula = search.rival(selection.model if has_waves else search.model) if is_doubtful else None
    if formula is None:
        return selection
    text = (
        f"A formula of {' and '.join(formula.signals) or 'no signal'} predicts trials that were not fitted better than "
        f"{' and '.join(cause.title for cause in causes)}: not claimed. `rovid discover` prints the formula."
    )
    doubted = replace(selection.with_message(text).ban(*causes), is_beaten=True)
    return drop_likely(doubted, [cause.key for cause in causes])


def units_of(formula: Formula, units: Mapping[str, str]) -> dict[str, str]:
    """Unit of each parameter of a formula."""
    found = dict[str, str]()
    for k, product in enumerate(formula.products, start=1):
        found |= {f"c{k}": product.unit_of_coefficient(units)} | product.units_of_constants(k)
    return {name: found[name] for name in formula.estimate.names}
