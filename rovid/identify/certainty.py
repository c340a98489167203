"""How sure the parameters of a likelihood are, where its form is not nature's too."""

from __future__ import annotations

import math

import numpy as np

from rovid.ground.arrays import FloatArray
from rovid.identify.courses import HORIZONS
from rovid.identify.horizons import HorizonLikelihood
from rovid.identify.innovations import BASE, Likelihood
from rovid.model.names import unit_of

# A few steps of a climb.
TRIAL_ITERATIONS = 4
# Runs that tell by their scatter how much the kind of run has to say.
_FEWEST_RUNS = 3
# Of the horizons the middle one, between short and long; their answers are apart from so many joint errors on.
_MIDDLE, _APART = len(HORIZONS) // 2, 3.0


def covariance(likelihood: Likelihood, x: FloatArray, *, sandwich: bool) -> FloatArray:
    """Of all parameters: inverse information, or the sandwich that allows for coloured innovations."""
    # All of them, a drag at its bound too: to take its zero for certain would make the rest look certain.
    here = likelihood.flatter_slopes(x)
    plain = inverse = _inverse(here.matrix.T @ here.matrix)
    if sandwich:
        inverse = _sandwich(plain, likelihood.scores(here, likelihood.records.block))
        by_run = likelihood.scores(here, likelihood.records.trial)
        if len(by_run) >= _FEWEST_RUNS:
            # Each kind of run may ask for parameters of its own, where the model's form is not nature's.
            ratio = np.diag(_sandwich(plain, by_run)) / np.maximum(np.diag(inverse), 1e-300)
            wider = np.sqrt(np.maximum(ratio, 1.0))
            inverse = inverse * np.outer(wider, wider)
        # What has no slope has no scatter of it either, which is no certainty.
        flat = np.asarray(~here.matrix.any(axis=0))
        inverse = np.where(flat | flat[:, np.newaxis], plain, inverse)
    inflated = float(np.median(np.sqrt(np.diag(inverse)[:3] / np.diag(plain)[:3])))
    for at, parameter in enumerate(likelihood.parameters, start=BASE):
        if parameter.stairs and (reach := _reach(likelihood, x, at)) is not None:
            # Stairs have no curvature: how far it goes until the likelihood has fallen says how sure it is, and no
            # surer than the step over which its slopes were taken, for where nature's threshold is in that is not told.
            reach = max(inflated * reach, parameter.step * abs(x[at]) / math.sqrt(3.0))
            factor = np.where(np.arange(len(x)) == at, reach / math.sqrt(inverse[at, at]), 1.0)
            inverse = inverse * np.outer(factor, factor)
    held = likelihood.low == likelihood.high
    inverse = np.where(held | held[:, np.newaxis], 0.0, inverse)
    shown, size = likelihood.of_model(x)
    return np.asarray(inverse[np.ix_(shown, shown)] * np.outer(size, size))


def form_doubt(likelihood: Likelihood, x: FloatArray) -> tuple[FloatArray, list[str]]:
    """(p, p) what is added to the sandwich of all parameters for a form that is not nature's, and what is said of it.

    Predictions miss much the same in every stretch of the logs, which then scatters less than their errors would by
    chance: the information, which counts those, is the least that is not known.

    Short horizons and long ones would ask for the same parameters, were the model right. Half of what they are apart
    beyond chance is how far another choice of horizons might move them.
    """
    names = likelihood.model(x).names
    if not isinstance(likelihood, HorizonLikelihood):
        return np.zeros((len(names), len(names))), []
    scatter = np.diag(covariance(likelihood, x, sandwich=True))
    least = np.diag(covariance(likelihood, x, sandwich=False))
    doubt = np.diag(np.maximum(least - scatter, 0.0))
    horizon = likelihood.records.horizon
    parts = [likelihood.like(likelihood.effects, part) for part in (horizon < _MIDDLE, horizon > _MIDDLE)]
    if min(part.count for part in parts) <= len(x):
        return doubt, []
    answers, variances = [], []
    for part in parts:
        at, _ = part.climb(x, iterations=2 * TRIAL_ITERATIONS)
        answers.append(physical(part, at))
        variances.append(np.diag(covariance(part, at, sandwich=True)))
    short, long = answers
    chance = np.sum(variances, axis=0)
    apart = short - long
    half = 0.5 * np.sign(apart) * np.sqrt(np.maximum(apart**2 - chance, 0.0))
    worst = int(np.argmax(np.abs(apart[:3]) / np.sqrt(np.maximum(chance[:3], 1e-300))))
    if abs(apart[worst]) <= _APART * math.sqrt(chance[worst]):
        return doubt + np.outer(half, half), []
    name, unit = names[worst].replace("_", " "), unit_of(names[worst], likelihood.records.axis)
    said = (
        f"Predictions up to one time constant ahead ask for another {name} ({short[worst]:.3g} {unit}) than those from "
        f"four on ({long[worst]:.3g} {unit}): something is still missing. Where commands answer the motion believe "
        "the short ones. The standard errors include half of the difference."
    )
    return doubt + np.outer(half, half), [said]


def _sandwich(inverse: FloatArray, scores: FloatArray) -> FloatArray:
    scores = scores - scores.mean(axis=0)
    count = len(scores)
    scatter = scores.T @ scores * count / (count - 1)
    return np.asarray(inverse @ scatter @ inverse)


def _reach(likelihood: Likelihood, x: FloatArray, at: int) -> float | None:
    """How far coordinate ``at`` may go, all else held, until half a unit of log-likelihood is lost; None if never."""
    best = likelihood.cost(x)
    reaches = []
    for way in (1.0, -1.0):
        step = way * 1e-4 * max(abs(x[at]), 1e-3)
        while abs(step) < max(abs(x[at]), 1.0):
            moved = x.copy()
            moved[at] += step
            if not likelihood.low[at] <= moved[at] <= likelihood.high[at]:
                break
            if likelihood.cost(moved) > best + 0.5:
                reaches.append(abs(step))
                break
            step *= 1.5
    return max(reaches, default=None)


def physical(likelihood: Likelihood, x: FloatArray) -> FloatArray:
    """All parameters of the model in their units."""
    return likelihood.model(x).values


def _inverse(information: FloatArray) -> FloatArray:
    """Inverse of the information; a direction in which the likelihood is flat gets a large variance."""
    power = np.diag(information)
    size = np.sqrt(np.where(power > 0.0, power, 1.0))
    # Scaled, so that units have no say in what counts as flat.
    scale = np.outer(size, size)
    values, vectors = np.linalg.eigh(information / scale)
    inverse = (vectors / np.maximum(values, 1e-9)) @ vectors.T
    return np.asarray(inverse / scale)
