"""Held-out gate of the planar diagnosis: which causes of a model pass, and which are never claimed."""

from collections.abc import Callable, Collection, Mapping, Sequence

from rovid.diagnose.candidate_fits import Challenger
from rovid.diagnose.cross_validation import certain_growth
from rovid.diagnose.evidence import posterior_probability, probability_not_a_stand_in, recalibrated, size_in_errors
from rovid.diagnose.result import Finding, OtherCause
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.model.simulation import HORIZONS
from rovid.planar.held_out import HeldOut, Parts, held_out, noise_floors
from rovid.planar.model import AXIS_SPEEDS
from rovid.planar.optimum import PlanarOptimum
from rovid.planar.search import PlanarSearch

_WORSENED = "With {}, {}: it is not established."


class Gate:
    """Held-out predictions of models, computed once."""

    def __init__(self, search: PlanarSearch, parts: Parts) -> None:
        self.search, self.parts = search, parts
        self._known: dict[frozenset[str], tuple[PlanarOptimum, HeldOut]] = {}

    def held_out(self, fitted: PlanarOptimum) -> HeldOut:
        """Held-out predictions of a model."""
        key = frozenset(effect.key for effect in fitted.effects)
        known = self._known.get(key)
        if known is None or known[0] is not fitted:
            known = self._known[key] = fitted, held_out(self.parts, fitted, self.search.line(fitted))
        return known[1]

    def tested(self, model: PlanarOptimum, effect: Effect) -> tuple[Finding, dict[str, float]]:
        """What the tests say of one ``effect`` of the ``model``, and by how much it makes errors larger.

        The estimate is that of the search. The growth of each held-out error is certain; see `certain_growth`.
        """
        search = self.search
        rest = search.polish(search.without(model, effect))
        gain, bic_gain = rest.value - model.value, search.score(model) - search.score(rest)
        with_it, without = self.held_out(model), self.held_out(rest)
        held_out_gain = with_it.log_likelihood - without.log_likelihood
        estimate = model.effect_estimate(effect)
        errors = size_in_errors(effect, estimate.values, estimate.covariance, model.coordinates.sizes.effects)
        # Other causes in the place of ``effect``, best first.
        found: dict[str, OtherCause] = {}
        for one in search.replacements(model, effect):
            other = one.effects[-1]
            if other.id != effect.id and not search.is_banned(one):
                found.setdefault(other.id, OtherCause(other, search.score(one) - search.score(rest)))
        others = tuple(found.values())
        close = bic_gain - THRESHOLDS.tie(max(bic_gain, 0.0))
        equivalent = tuple(one.effect for one in others if one.bic_gain > close)
        # Correlated innovations count as fewer: by the sandwich errors, the gain is half the square of the distance.
        robust = bic_gain if model.is_white else min(bic_gain, 0.5 * errors**2)
        gains = {effect.id: robust} | {one.effect.id: one.bic_gain + robust - bic_gain for one in others}
        cap = probability_not_a_stand_in(held_out_gain, robust, white=model.is_white)
        names = [effect.id, *(one.id for one in equivalent)]
        probability = recalibrated(
            posterior_probability(gains, names, search.causes_tried, cap=cap), white=model.is_white
        )
        finding = Finding(
            effect=effect,
            estimate=estimate,
            gain=gain,
            bic_gain=bic_gain,
            held_out_gain=held_out_gain,
            standard_errors=errors,
            probability=min(probability, THRESHOLDS.max_probability),
            alternatives=others,
            indistinguishable=equivalent,
            white=model.is_white,
        )
        pairs = zip(with_it.by_part.T[:3], without.by_part.T[:3], strict=True)
        growths = [certain_growth(own[:, None], other[:, None]) for own, other in pairs]
        growths.append(certain_growth(with_it.by_part[:, 3:], without.by_part[:, 3:]))
        return finding, dict(zip((*AXIS_SPEEDS, "heading"), growths, strict=True))

    def established(
        self, model: PlanarOptimum, tested: Sequence[Finding], sure: Sequence[Finding]
    ) -> tuple[list[Finding], PlanarOptimum, list[str]]:
        """The ``sure`` ones of the ``tested`` causes that make no held-out error larger; their model; messages."""
        found, messages = list[Finding](), list[str]()
        for one in tested:
            rest = self.search.polish(self.search.without(model, one.effect))
            worse = self._worsened(model, rest) if one in sure else ""
            if one in sure and not worse:
                found.append(one)
                continue
            model = rest
            messages += [_WORSENED.format(one.effect.title, worse)] if worse else []
        if found and (worse := self._worsened(model, self.search.base)):
            messages.append(_WORSENED.format(" and ".join(one.effect.title for one in found), worse))
            return [], self.search.base, messages
        return found, model, messages

    def _worsened(self, model: PlanarOptimum, other: PlanarOptimum) -> str:
        if model is other:
            return ""
        return worsened(self.held_out(model), self.held_out(other), lambda: noise_floors(self.parts, model))


def challengers(search: PlanarSearch, model: PlanarOptimum) -> tuple[Challenger, ...]:
    """Other fitted sets of causes, the closest to the ``model`` first."""
    found, own = [], {effect.key for effect in model.effects}
    for fitted in search.fits.values():
        if search.causes(fitted) and {effect.key for effect in fitted.effects} != own:
            gain = model.value - fitted.value
            found.append(Challenger(search.causes(fitted), gain, gain - (search.score(fitted) - search.score(model))))
    found.sort(key=lambda one: -one.score_difference)
    shown: dict[Collection[str], Challenger] = {}
    for one in found:
        shown.setdefault(frozenset(one.causes), one)
    return tuple(shown.values())[: THRESHOLDS.challengers_shown]


def worsened(own: HeldOut, other: HeldOut, floors: Callable[[], HeldOut]) -> str:
    """The held-out error of yaw rate or heading that is larger than with an ``other`` model, as text; empty if none.

    An error within the ``floors`` of a perfect model, that is larger by chance only, does not count.
    """
    names = {AXIS_SPEEDS.index("yaw_rate"): "the yaw rate"}
    names |= {len(AXIS_SPEEDS) + at: f"the heading after {horizon:g} s" for at, horizon in enumerate(HORIZONS)}
    errors, without = own.errors, other.errors
    growths = {at: errors[at] / without[at] - 1.0 for at in names if without[at] > 0.0}
    for at in sorted(growths, key=lambda one: -growths[one]):
        if growths[at] <= THRESHOLDS.held_out_growth:
            break
        by_chance = not certain_growth(own.by_part[:, [at]], other.by_part[:, [at]])
        if not by_chance or errors[at] > floors().errors[at]:
            return f"the held-out error of {names[at]} is {100.0 * growths[at]:.0f} % larger"
    return ""


def is_at_bound(fitted: PlanarOptimum, effect: Effect) -> bool:
    """Whether a parameter of ``effect`` is at a bound that is not its neutral value."""
    for value, parameter in zip(fitted.x[fitted.place(effect)].tolist(), effect.parameters, strict=True):
        span = 1e-3 * (parameter.high - parameter.low)
        for bound in (parameter.low, parameter.high):
            if abs(value - bound) <= min(span, 1e-3 * max(abs(bound), 1e-3)) and bound != parameter.neutral:
                return True
    return False


def _rejection(fitted: PlanarOptimum, tested: Finding, growths: Mapping[str, float]) -> str:
    """Why a cause is never claimed; empty where it passes."""
    if tested.held_out_gain <= THRESHOLDS.min_held_out_gain:
        return f"fits these logs but predicts held-out parts worse (log-likelihood {tested.held_out_gain:.1f})"
    if is_at_bound(fitted, tested.effect):
        return "would be larger than is physically plausible"
    if tested.standard_errors < THRESHOLDS.min_standard_errors:
        return f"differs from nothing by only {tested.standard_errors:.1f} standard errors"
    name, growth = max(growths.items(), key=lambda one: one[1])
    if growth > THRESHOLDS.held_out_growth:
        return f"makes the errors of held-out simulations of the {name.replace('_', ' ')} {100.0 * growth:.0f} % larger"
    if tested.probability < THRESHOLDS.likely:
        return "is possible, but not established"
    return ""


def validated(
    search: PlanarSearch, gate: Gate, model: PlanarOptimum
) -> tuple[PlanarOptimum, list[Finding], list[tuple[str, str]]]:
    """The model with causes that pass the gate, their tests, and the id and a message for each rejection."""
    messages: list[tuple[str, str]] = []
    for _ in range(THRESHOLDS.max_rejections):
        tested = [gate.tested(model, effect) for effect in search.causes(model)]
        tested.sort(key=lambda one: one[0].bic_gain)
        failed = next(((one, why) for one, growths in tested if (why := _rejection(model, one, growths))), None)
        if failed is None:
            return model, [one for one, _ in tested], messages
        one, why = failed
        messages.append((one.effect.id, f"{one.effect.title} {why}: it is not claimed."))
        search.banned.add(one.effect.key)
        rest = search.without(model, one.effect)
        model = rest if search.budget.is_late else search.challenged(search.run(search.polish(rest)))
    for effect in search.causes(model):
        if why := _rejection(model, *gate.tested(model, effect)):
            messages.append((effect.id, f"{effect.title} {why}: it is not claimed."))
            model = search.polish(search.without(model, effect))
    return model, [gate.tested(model, effect)[0] for effect in search.causes(model)], messages
