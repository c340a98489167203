"""Places of a velocity log and of an antenna that rovid.toml leaves out: estimates, and the entries that give them."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rovid.core.formatting import plus_minus, round_to_error
from rovid.diagnose.thresholds import THRESHOLDS
from rovid.effects import Effect
from rovid.effects.base import SensorPlace
from rovid.estimate.estimate import Estimate
from rovid.estimate.fisher_information import inverse_information
from rovid.planar.dataset import PlanarData
from rovid.planar.effect_fits import planar_candidates
from rovid.planar.optimum import PlanarOptimum


def place_entries(estimate: Estimate, effects: tuple[Effect, ...], gain: float = 0.0) -> Iterator[str]:
    """For each place among ``effects`` in the ``estimate``, the entry of rovid.toml; with a ``gain`` as a proposal."""
    for effect in effects:
        if not isinstance(effect.acts, SensorPlace):
            continue
        pairs = [(estimate.value(name), estimate.standard_error(name)) for name in effect.parameter_names]
        (ahead, starboard), (x, y) = (([*(one(*pair) for pair in pairs)]) for one in (plus_minus, round_to_error))
        words = effect.title.removeprefix("place of the ")
        begin = f"The log-likelihood grows by {gain:.0f} with the {words}" if gain else f"The model has the {words}"
        test = " `rovid diagnose --axes planar` compares this with other causes." if gain else ""
        yield (
            f"{begin} {ahead} m ahead and {starboard} m to starboard of the origin. Measure its place, and write "
            f"position = [{x}, {y}] at {' and '.join(effect.acts.sensors)} in [signals] of rovid.toml.{test}"
        )


def proposed_places(best: PlanarOptimum, data: PlanarData) -> Iterator[str]:
    """Entries of rovid.toml for places that would improve a fit which misses something."""
    has_place = any(isinstance(effect.acts, SensorPlace) for effect in best.effects)
    if has_place or best.likelihood.grid.yaw_only or (best.is_white and not best.limited.any()):
        return
    likelihood = replace(best.likelihood, free_runs=None)
    penalty = 0.5 * math.log(float(best.likelihood.grid.used.sum()))
    for effect in planar_candidates(data):
        if not isinstance(effect.acts, SensorPlace):
            continue
        count, at = len(effect.parameters), best.coordinates.noise_begin
        needed = THRESHOLDS.bic_margin + penalty * count
        extended = likelihood.with_coordinates(best.coordinates.with_effect(effect))
        gradient, information = extended.equations(np.insert(best.x, at, np.zeros(count)))
        rest = np.delete(np.arange(len(gradient)), range(at, at + count))
        with_place, without = (
            0.5 * float(gradient[own] @ inverse_information(information[np.ix_(own, own)]) @ gradient[own])
            for own in (np.arange(len(gradient)), rest)
        )
        if with_place - without < needed:
            continue
        plain = PlanarOptimum.fit(likelihood, best.x) if best.is_multi_step else best
        placed = plain.with_effect(effect)
        # Where each disturbance stays at its limit, the place stands for something else that the model misses.
        explains = placed.is_white or placed.limited.sum() < plain.limited.sum()
        if explains and plain.value - placed.value > needed:
            yield from place_entries(placed.effect_estimate(effect), (effect,), plain.value - placed.value)
