"""Reasons to doubt causes that passed all tests, and causes that one of two criteria names alone."""

from collections.abc import Sequence

from rovid.diagnose.result import Finding
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects.base import Coupling, WaterCurrent
from rovid.planar.dataset import PlanarData
from rovid.planar.free_runs import misses_much
from rovid.planar.optimum import PlanarOptimum


def formless(model: PlanarOptimum, data: PlanarData, tested: Sequence[Finding]) -> list[Finding]:
    """Couplings in a model that misses much: one of another form may fit as well as the true one.

    A current that wanders whitens the innovations whatever the model misses.
    """
    wandering = [one for one in tested if isinstance(one.effect.acts, WaterCurrent) and one.effect.acts.wanders]
    found = [one for one in tested if isinstance(one.effect.acts, Coupling) or one in wandering]
    return found if found and (model.is_multi_step or misses_much(model, data, whitened=bool(wandering))) else []


def contradicted(tested: Sequence[Finding], likelier: Sequence[Finding]) -> list[Finding]:
    """Causes by free-running simulations that contradict the likelihood.

    It names other causes, and the logs distinguish them.
    """
    named = {one.effect.id for one in likelier}
    pairs = [(one, {one.effect.id, *(e.id for e in one.indistinguishable)}) for one in tested]
    return [one for one, own in pairs if named and named.isdisjoint(own)]


def likelier_suspects(tested: Sequence[Finding], likelier: Sequence[Finding]) -> list[Finding]:
    """Causes by the likelihood that remain suspects where free-running simulations name other causes, or none."""
    if not tested:
        return [one for one in likelier if one.held_out_gain > THRESHOLDS.min_held_out_gain]
    known = {one.effect.id for one in tested}
    return [one for one in likelier if one.effect.id not in known and contradicted(tested, likelier)]


def outweighed(tested: Sequence[Finding], rejected: Sequence[Finding]) -> list[tuple[Finding, Finding]]:
    """Pairs of a cause and a ``rejected`` cause that explains the logs better.

    If the gate rejects a true cause, another cause takes its place.
    """
    pairs = [(one, other) for one in tested for other in rejected if other.effect.id != one.effect.id]
    better = {
        one.effect.id: (one, other)
        for one, other in pairs
        if other.bic_gain > one.bic_gain and other.held_out_gain > one.held_out_gain
    }
    return list(better.values())
