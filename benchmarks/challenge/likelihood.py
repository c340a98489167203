"""A baseline like CTSM-R (Kristensen 2004): likelihood of a continuous-discrete Kalman filter, stepwise BIC.

Of its own make: it shares the library of terms with the regressions, and nothing with rovid.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from benchmarks.challenge.regressions import Regression, odds_by_bic, simulated, weighted
from benchmarks.challenge.rules import NONE, Answer, Campaign, Floats, forecast, quantiles, spread
from benchmarks.challenge.terms import Part, columns, kalman

_TRIED = 8  # candidates of the regression, the best of each cause first, that the filter fits
_SCALE = 3.0  # largest change of a logarithm from its start


class Filter:
    """Negative log-likelihood by logarithms of inertia, drags, disturbance, its time, noise; and the coefficients."""

    def __init__(self, regression: Regression) -> None:
        self.data, self.scale = regression.data, regression.scale
        one, quadratic, linear = regression.fit([])[0]
        inertia = 1.0 / one if one > 0.0 else regression.fit([])[0][0] ** -2 * 1e-3
        self.torque = float(np.std(np.concatenate([run.torque for run in self.data.runs])))
        rate = float(np.std(self.data.rate))
        floor = 0.05 * self.torque
        noise = float(np.median([np.nanstd(np.diff(run.heading, 3)) for run in self.data.runs])) / np.sqrt(20.0)
        self.start = np.log([
            inertia, max(quadratic * inertia, floor / rate**2), max(linear * inertia, floor / rate),
            0.1 * self.torque, 10.0 * self.data.sigma, max(noise, 1e-5),
        ])  # fmt: skip

    def __call__(self, x: Floats, parts: list[Part]) -> float:
        a, b, w = weighted(parts, x[6:] * self.sizes(parts), len(self.data.rate))
        values = np.exp(x[:6])
        total, begin = 0.0, 0
        for run in self.data.runs:
            part = slice(begin, begin + run.time.size)
            begin += run.time.size
            total += kalman(run.heading, run.torque, a[part], b[part], w, run.step, values[:3], values[3:], self.scale,
                            True)[0]  # fmt: skip
        return float(total) if np.isfinite(total) else 1e12

    def sizes(self, parts: list[Part]) -> Floats:
        """Coefficient of each part that makes a tenth of the torque of it."""
        d = self.data
        if not parts:
            return np.zeros(0)
        made = columns(d, parts, self.scale)
        size = np.std(made, axis=0) + np.abs(np.mean(made, axis=0))
        return np.asarray(0.1 * self.torque / np.maximum(size, 1e-12))

    def fit(self, parts: list[Part], start: Floats) -> tuple[Floats, float]:
        """Optimum, and the negative log-likelihood there."""
        first = np.concatenate([start[:6], np.zeros(len(parts))])
        bounds = [(one - _SCALE, one + _SCALE) for one in self.start] + [(-20.0, 20.0)] * len(parts)
        first[:6] = np.clip(first[:6], *np.transpose(bounds[:6]))
        found = minimize(self, first, (parts,), "L-BFGS-B", bounds=bounds, options={"maxiter": 40})
        return np.asarray(found.x), float(found.fun)

    def errors(self, x: Floats, parts: list[Part]) -> Floats:
        """Standard errors by the curvature along each pair of coordinates (finite differences)."""
        step, p = 0.02, len(x)
        hessian = np.zeros((p, p))
        shifts = step * np.eye(p)
        centre = self(x, parts)
        single = [(self(x + one, parts), self(x - one, parts)) for one in shifts]
        for i in range(p):
            hessian[i, i] = (single[i][0] - 2.0 * centre + single[i][1]) / step**2
            for j in range(i):
                both = self(x + shifts[i] + shifts[j], parts)
                hessian[i, j] = hessian[j, i] = (both - single[i][0] - single[j][0] + centre) / step**2
        values, vectors = np.linalg.eigh(hessian)
        return np.asarray(np.sqrt(np.diag((vectors / np.maximum(values, 1e-2)) @ vectors.T)))


def answer(campaign: Campaign) -> Answer:
    """The plain model, then the most promising term of each cause; BIC of the likelihood gives the odds."""
    regression = Regression(campaign)
    likelihood = Filter(regression)
    plain, value = likelihood.fit([], likelihood.start)
    count = sum(int(np.isfinite(run.heading).sum()) for run in likelihood.data.runs)
    fits: list[tuple[str, list[Part], float, Floats]] = [(NONE, [], 2.0 * value, plain)]
    best: dict[str, tuple[list[Part], float]] = {}
    for cause, parts, bic in regression.candidates()[1:]:
        if all(one.column is None for one in parts) and (cause not in best or bic < best[cause][1]):
            best[cause] = (parts, bic)
    for cause in sorted(best, key=lambda name: best[name][1])[:_TRIED]:
        parts = best[cause][0]
        x, value = likelihood.fit(parts, plain)
        fits.append((cause, parts, 2.0 * value + len(parts) * float(np.log(count)), x))
    causes = spread(odds_by_bic([(cause, parts, bic) for cause, parts, bic, _ in fits]), floor=0.15)
    _, parts, _, x = min(fits, key=lambda one: one[2])
    errors = likelihood.errors(x, parts)
    values = np.exp(x[:3])
    sizes = {name: quantiles(float(values[k]), float(values[k] * min(errors[k], 3.0)))
             for k, name in enumerate(("inertia", "quadratic_drag", "linear_drag"))}  # fmt: skip
    runs = simulated(campaign, likelihood.data, parts, x[6:] * likelihood.sizes(parts), values, likelihood.scale)
    return {"causes": causes, "parameters": sizes, "heading_deg": forecast(campaign, runs)}
