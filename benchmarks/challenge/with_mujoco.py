"""mujoco.sysid: output error of a hinge over short pieces, then the term that the residual torque correlates with."""

from __future__ import annotations

import contextlib
import io
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid

from benchmarks.challenge.regressions import PRIOR, Regression, simulated
from benchmarks.challenge.rules import PARAMETERS, Answer, Campaign, forecast, quantiles, spread
from benchmarks.challenge.terms import columns, library
from benchmarks.peers.with_mujoco import MODEL, set_inertia, set_linear, set_quadratic

_PIECE, _PIECES = 400, 8  # instants of a piece, and pieces that are fitted
_LEAST = 0.3  # correlation above which a term is named


def answer(campaign: Campaign) -> Answer:
    """Fit of the plain model to pieces of the heading, each from its measured start."""
    regression = Regression(campaign)
    data, step = regression.data, regression.data.runs[0].step
    one, quadratic, linear = regression.fit([])[0]
    inertia = 1.0 / max(float(one), 1e-9)
    start = np.array([inertia, max(quadratic * inertia, 1e-3 * inertia), max(linear * inertia, 1e-3 * inertia)])
    spec = mujoco.MjSpec.from_string(MODEL.format(step=step, inertia=start[0], quadratic=start[1], linear=start[2]))
    model = spec.compile()
    parameters = sysid.ParameterDict()
    for value, modifier in zip(start, (set_inertia, set_quadratic, set_linear), strict=True):
        parameters.add(sysid.Parameter(modifier.__name__, value, 0.02 * value, 50.0 * value, modifier=modifier))
    begins = np.concatenate([[0], np.cumsum(data.lengths)])
    pieces = [(k, at) for k, run in enumerate(data.runs)
              for at in range(0, int(np.isfinite(run.heading).sum()) - _PIECE, _PIECE)]  # fmt: skip
    pieces = pieces[:: max(len(pieces) // _PIECES, 1)][:_PIECES] or [(0, 0)]
    sequences = []
    for number, (k, at) in enumerate(pieces):
        run, part = data.runs[k], slice(at, at + _PIECE)
        heading = run.heading[part][np.isfinite(run.heading[part])]
        time = step * np.arange(len(heading))
        first = sysid.create_initial_state(model, heading[:1], data.rate[begins[k] + at : begins[k] + at + 1])
        torque = sysid.TimeSeries(time, run.torque[part][: len(heading), None])
        seen = sysid.TimeSeries.from_names(time, heading[:, None], model, [("yaw", sysid.SignalType.MjStateQPos)])
        sequences.append(
            sysid.ModelSequences(
                f"yaw{number}", spec, f"piece{number}", first, torque, seen, allow_missing_sensors=True
            )
        )
    residual = sysid.build_residual_fn(models_sequences=sequences, resample_true=False)
    with contextlib.redirect_stdout(io.StringIO()):
        found, result = sysid.optimize(parameters, residual, verbose=False)
    plain = np.asarray(found.as_vector(), dtype=float)
    errors = _errors(result, plain)
    names = dict(zip(PARAMETERS, (quantiles(*one) for one in zip(plain.tolist(), errors, strict=True)), strict=True))
    runs = simulated(campaign, data, [], np.zeros(0), plain, regression.scale)
    return {"causes": _causes(regression, plain), "parameters": names, "heading_deg": forecast(campaign, runs)}


def _errors(result: Any, plain: Any) -> list[float]:
    """Standard errors by the Jacobian and the residuals, as if these were white; a tenth where there is none."""
    jacobian = np.asarray(getattr(result, "jac", None))
    if jacobian.ndim != 2 or jacobian.shape[1] != len(plain):
        return [0.1 * float(one) for one in plain]
    # The objective is half the sum of squares, as that of scipy's least squares.
    variance = 2.0 * float(np.ravel(result.extras["objective"])[-1]) / len(jacobian)
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * variance
    return [float(one) for one in np.sqrt(np.maximum(np.diag(covariance), 0.0))]


def _causes(regression: Regression, plain: Any) -> dict[str, float]:
    """The cause whose term correlates best with the torque that the plain model misses."""
    data, rows = regression.data, regression.rows
    inertia, quadratic, linear = plain
    torque = regression.base[:, 0]
    missing = (inertia * data.acceleration + (quadratic * np.abs(data.rate) + linear) * data.rate - torque)[rows]
    best, cause = 0.0, ""
    for name, parts, _ in library(data):
        for column in columns(data, parts, regression.scale).T:
            seen = data.smooth(column)[rows]
            # A constant correlates with nothing: it is its mean over the scatter.
            level = abs(np.mean(missing)) / np.hypot(np.mean(missing), np.std(missing))
            here = level if np.std(seen) < 1e-12 else abs(np.corrcoef(seen, missing)[0, 1])
            best, cause = max((best, cause), (float(here), name))
    return spread(PRIOR | {cause: PRIOR[cause] * 60.0} if best > _LEAST else PRIOR | {"none": 1.5})


__all__ = ["answer"]
