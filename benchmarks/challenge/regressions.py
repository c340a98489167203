"""Baselines on the equation error: BIC over the library, a sparse regression (SINDy), and the data-free prior.

I dr/dt + DQ |r| r + DL r = T + sum of terms is divided by I, and both sides go through one filter.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from benchmarks.challenge.rules import LABELS, NONE, OTHER, PARAMETERS, Answer, Campaign, Floats, forecast, quantiles
from benchmarks.challenge.rules import spread as spread_odds
from benchmarks.challenge.terms import STATE, Data, Part, columns, data_of, kalman, library

# Odds before a look at the data: a quarter of the campaigns have no cause, the others are spread over the list.
PRIOR = {label: 0.75 / (len(LABELS) - 1) for label in LABELS} | {NONE: 0.25}
_SURE = 0.9  # of a method that gives a name and no probability
_THRESHOLD = 0.1  # of the torque in use, below which a term of the sparse regression is dropped


def prior(campaign: Campaign) -> Answer:
    """The odds of the rules, the description's size of the inertia, and a turn that goes on: no look at the motion."""
    vehicle = campaign.description["vehicle"]
    size = vehicle["mass"] * (vehicle["length"] ** 2 + vehicle["width"] ** 2) / 12.0 * 1.6
    last = campaign.runs[-1]
    known = np.isfinite(last.heading)
    slope = float(np.ptp(last.heading[known]) / np.ptp(last.time[known]))
    ahead = np.degrees(slope) * (campaign.asked - campaign.cut)
    sizes = dict(zip(PARAMETERS, [quantiles(size, 0.5 * size)] * 3, strict=True))
    return {"causes": PRIOR, "parameters": sizes, "heading_deg": [sorted((one * np.linspace(-1, 1, 5)).tolist())
                                                                  for one in ahead]}  # fmt: skip


class Regression:
    """Least squares of the smoothed acceleration on the torques over the inertia."""

    def __init__(self, campaign: Campaign) -> None:
        self.data = data_of(campaign)
        d = self.data
        self.scale = 0.1 * float(np.std(d.rate[d.used]))
        torque = d.smooth(np.concatenate([run.torque for run in d.runs]))
        self.base = np.column_stack([torque, -np.abs(d.rate) * d.rate, -d.rate])
        # Neighbours share their noise: a row for every three widths of the filter.
        places = np.flatnonzero(d.used)
        self.rows = places[:: max(int(3.0 * d.sigma / d.runs[0].step), 1)]

    def fit(self, parts: list[Part]) -> tuple[Floats, Floats, float, float]:
        """Coefficients, their covariance, variance of the residual, and number of independent residuals."""
        x = self.base
        if parts:
            made = columns(self.data, parts, self.scale)
            smooth = [made[:, k] if one.column is not None else self.data.smooth(made[:, k])
                      for k, one in enumerate(parts)]  # fmt: skip
            x = np.column_stack([x, *smooth])
        x, y = x[self.rows], self.data.acceleration[self.rows]
        size = np.maximum(np.linalg.norm(x, axis=0), 1e-12)
        found = np.linalg.lstsq(x / size, y, rcond=1e-8)[0] / size
        rest = y - x @ found
        correlation = float(np.clip(np.corrcoef(rest[1:], rest[:-1])[0, 1], 0.0, 0.95)) if len(rest) > 3 else 0.0
        count = max(len(y) * (1.0 - correlation) / (1.0 + correlation), 5.0)
        variance = float(np.mean(rest**2)) + 1e-300
        inverse = np.linalg.pinv((x / size).T @ (x / size)) / np.outer(size, size)
        return found, inverse * variance * len(y) / count, variance, count

    def candidates(self) -> list[tuple[str, list[Part], float]]:
        """(cause, parts, BIC) of each candidate, the plain model first."""
        tried = [(NONE, list[Part](), 0), *library(self.data)]
        fits = [self.fit(parts) for _, parts, _ in tried]
        # One number of independent residuals for all: that of the best fit, which leaves the least structure in them.
        count = min(fits, key=lambda one: one[2])[3]
        return [
            (cause, parts, count * float(np.log(variance)) + (len(found) + nonlinear) * float(np.log(count)))
            for (cause, parts, nonlinear), (found, _, variance, _) in zip(tried, fits, strict=True)
        ]

    def sizes(self, parts: list[Part]) -> dict[str, list[float]]:
        """Quantiles of inertia and drags, from the ratios that are estimated."""
        found, covariance, _, _ = self.fit(parts)
        one = max(float(found[0]), 1e-12)
        errors = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        result = {"inertia": quantiles(1.0 / one, float(errors[0]) / one**2)}
        for place, name in ((1, "quadratic_drag"), (2, "linear_drag")):
            slope = np.zeros(len(found))
            slope[0], slope[place] = -found[place] / one**2, 1.0 / one
            result[name] = quantiles(float(found[place]) / one, max(float(slope @ covariance @ slope), 0.0) ** 0.5)
        return result

    def turns(self, campaign: Campaign, parts: list[Part]) -> list[list[float]]:
        """Forecast by a free simulation with the parts that can be simulated."""
        able = [] if any(one.column is not None for one in parts) else parts
        found = self.fit(able)[0]
        inertia = 1.0 / max(float(found[0]), 1e-12)
        plain = np.array([inertia, max(found[1], 0.0) * inertia, max(found[2], 0.0) * inertia])
        return forecast(campaign, simulated(campaign, self.data, able, found[3:] * inertia, plain, self.scale))


def weighted(parts: list[Part], coefficients: Floats, count: int) -> tuple[Floats, Floats, Floats]:
    """Sums of a (N,), b (N,) and weights (STATE,) over the coefficients."""
    a, b, w = np.zeros(count), np.zeros(count), np.zeros(STATE)
    for one, size in zip(parts, coefficients, strict=True):
        a, b, w = a + size * one.a, b + size * one.b, w + size * one.w
    return a, b, w


def simulated(
    campaign: Campaign, data: Data, parts: list[Part], coefficients: Floats, plain: Floats, scale: float
) -> list[Floats]:
    """Free simulation of each run (n,) at its own instants, from rest at its first heading."""
    a, b, w = weighted(parts, coefficients, len(data.rate))
    edges, result = np.concatenate([[0], np.cumsum(data.lengths)]), []
    for k, run in enumerate(data.runs):
        part = slice(edges[k], edges[k + 1])
        _, heading = kalman(run.heading, run.torque, a[part], b[part], w, run.step, plain, np.array([1.0, 1.0, 1.0]),
                            scale, False)  # fmt: skip
        result.append(np.interp(campaign.runs[k].time, run.time, heading))
    return result


def odds_by_bic(candidates: list[tuple[str, list[Part], float]]) -> dict[str, float]:
    """Posterior odds of each cause by its best BIC, with the prior; what the library lacks has its prior alone."""
    best: dict[str, float] = {}
    for cause, _, bic in candidates:
        best[cause] = min(best.get(cause, float("inf")), bic)
    least = min(best.values())
    return {cause: PRIOR[cause] * float(np.exp(-0.5 * min(bic - least, 600.0))) for cause, bic in best.items()}


def stepwise(campaign: Campaign) -> Answer:
    """BIC of each term alone, for the rules allow one cause: the first step of a stepwise regression."""
    regression = Regression(campaign)
    candidates = regression.candidates()
    parts = min(candidates, key=lambda one: one[2])[1]
    causes = spread_odds(odds_by_bic(candidates), floor=0.2)
    return {"causes": causes, "parameters": regression.sizes(parts), "heading_deg": regression.turns(campaign, parts)}


def sindy(campaign: Campaign) -> Answer:
    """Sparse regression over one column a term (Brunton 2016): the largest term that survives is the cause."""
    regression = Regression(campaign)
    # One candidate of each cause, the best alone; otherwise the columns are copies of each other.
    best: dict[str, tuple[list[Part], float]] = {}
    for cause, parts, bic in regression.candidates()[1:]:
        if cause not in best or bic < best[cause][1]:
            best[cause] = (parts, bic)
    owners = [cause for cause, (parts, _) in best.items() for _ in parts]
    parts = [one for each, _ in best.values() for one in each]
    made = columns(regression.data, parts, regression.scale)
    smooth = np.column_stack([regression.base, *(regression.data.smooth(one) for one in made.T)])[regression.rows]
    size = np.maximum(np.sqrt(np.mean(smooth**2, axis=0)), 1e-12)
    found = sparse(smooth / size, regression.data.acceleration[regression.rows])
    contribution: dict[str, float] = {}
    for owner, one in zip(owners, np.abs(found[3:]), strict=True):
        contribution[owner] = contribution.get(owner, 0.0) + float(one)
    cause = max(contribution, key=lambda name: contribution[name])
    sure = contribution[cause] > 0.0
    odds = PRIOR | ({cause: PRIOR[cause] * 60.0} if sure else {NONE: PRIOR[NONE] * 6.0})
    kept = best[cause][0] if sure else []
    return {"causes": spread_odds(odds), "parameters": regression.sizes(kept),
            "heading_deg": regression.turns(campaign, kept)}  # fmt: skip


def sparse(x: Floats, y: Floats) -> Floats:
    """Sequentially thresholded least squares, by pysindy where it is installed; the plain terms always stay."""
    threshold = _THRESHOLD * float(np.std(y))
    try:
        stlsq: Any = importlib.import_module("pysindy.optimizers").STLSQ
    except ImportError:
        found = np.linalg.lstsq(x, y, rcond=None)[0]
        for _ in range(10):
            keep = np.abs(found) >= threshold
            keep[:3] = True
            found = np.zeros(x.shape[1])
            found[keep] = np.linalg.lstsq(x[:, keep], y, rcond=None)[0]
        return np.asarray(found)
    optimizer = stlsq(threshold=threshold, alpha=1e-6)
    optimizer.fit(x, y[:, None])
    return np.asarray(optimizer.coef_[0])


__all__ = ["OTHER", "PRIOR", "Regression", "odds_by_bic", "prior", "simulated", "sindy", "stepwise", "weighted"]
