"""How much of the held-out error could any model remove? Named causes against a small neural network.

Run ``python -m benchmarks.upper_bound LOGS ...``. Each run in turn is held out. The plain model, the model with the
causes that `rovid diagnose` names, and the plain model with a network of the missing torque are fitted to the other
runs and simulate the held-out one freely. The network knows the rate, the torque, the heading and past values of rate
and torque. The least of the three errors bounds what can be removed from the mean squared error of the rate. With few
runs the network may be worse than the plain model; then the bound is that of the causes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
from scipy import optimize

from rovid.core.array_types import FloatArray
from rovid.core.errors import RovidError
from rovid.effects import Effect, effect_named
from rovid.estimate.dataset import time_constant
from rovid.estimate.maximum_likelihood import fit_likelihood
from rovid.model.model import Model
from rovid.store.study import Study, open_study
from rovid.trial.preprocessing import Run
from rovid.trial.vehicle import Vehicle

LEAST_RUNS = 3  # runs in a folder
HIDDEN = 12  # neurons in the one hidden layer
DECAY = 1e-3  # weight decay, per sample
STEPS = 15  # grid intervals in a time constant of the vehicle
MEMORIES = (0.5, 2.0, 8.0)  # time constants of past values, in time constants of the vehicle
LIMIT = 3.0  # largest input in standard deviations: the network does not extrapolate


@dataclass(frozen=True, kw_only=True)
class Series:
    """A run on a uniform grid: rate in rad/s, torque in N m and angle in rad, (n,) each."""

    time: FloatArray
    step: float
    rate: FloatArray
    torque: FloatArray
    angle: FloatArray

    @classmethod
    def of(cls, run: Run, model: Model, vehicle: Vehicle, step: float) -> Self:
        """The ``run`` at every ``step`` in s; its measured rate is smoothed as in the fits."""
        time, rates, trial = run.trial.time, run.rates, run.trial
        grid = np.arange(rates.time[0], rates.time[-1], step)
        torque = model.torque_input(vehicle, trial).torque
        return cls(
            time=grid,
            step=step,
            rate=np.interp(grid, rates.time[rates.valid], rates.rate[rates.valid]),
            torque=torque[np.searchsorted(time, grid, side="right") - 1],
            angle=np.interp(grid, time[trial.measured], trial.position[trial.measured]),
        )

    def inputs(self, constant: float) -> FloatArray:
        """(n, m) inputs of the network for the motion as measured."""
        pasts = []
        for signal in (self.rate, self.torque):
            for share in MEMORIES:
                decay, past = np.exp(-self.step / (share * constant)), np.empty(len(signal))
                past[0] = signal[0]
                for at in range(1, len(signal)):
                    past[at] = decay * past[at - 1] + (1.0 - decay) * signal[at - 1]
                pasts.append(past)
        return np.column_stack((self.rate, self.torque, np.sin(self.angle), np.cos(self.angle), *pasts))


class Network:
    """A network with one hidden layer for the torque that the plain model misses."""

    def __init__(self, model: Model, series: Sequence[Series], constant: float, seed: int = 1) -> None:
        self._model, self._constant = model, constant
        inputs = np.vstack([one.inputs(constant)[:-1] for one in series])
        target = np.concatenate([
            model.inertia * np.diff(one.rate) / one.step - (one.torque - self._drag(one.rate))[:-1] for one in series
        ])  # fmt: skip
        self._mean, self._spread = inputs.mean(axis=0), inputs.std(axis=0) + 1e-12
        self._size = float(np.std(target)) or 1.0
        normed, wanted = self._normed(inputs), target / self._size
        first = np.random.default_rng(seed).normal(0.0, 0.3, HIDDEN * (normed.shape[1] + 2) + 1)

        def loss(weights: FloatArray) -> tuple[float, FloatArray]:
            output, hidden = self._output(weights, normed)
            error, (_, _, outer, _) = output - wanted, self._split(weights)
            back = error[:, None] * outer * (1.0 - hidden**2)
            gradient = np.concatenate((
                (normed.T @ back).ravel(), back.sum(axis=0), hidden.T @ error, [error.sum()]
            ))  # fmt: skip
            count = len(wanted)
            return float(error @ error / count + DECAY * weights @ weights), 2.0 * (gradient / count + DECAY * weights)

        self._weights = optimize.minimize(loss, first, jac=True, method="L-BFGS-B", options={"maxiter": 500}).x

    def _drag(self, rate: FloatArray) -> FloatArray:
        return np.asarray((self._model.quadratic_drag * np.abs(rate) + self._model.linear_drag) * rate)

    def _normed(self, inputs: FloatArray) -> FloatArray:
        return np.asarray(np.clip((inputs - self._mean) / self._spread, -LIMIT, LIMIT))

    def _split(self, weights: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        width = len(self._mean)
        inner, rest = weights[: width * HIDDEN].reshape(width, HIDDEN), weights[width * HIDDEN :]
        return inner, rest[:HIDDEN], rest[HIDDEN : 2 * HIDDEN], float(rest[-1])

    def _output(self, weights: FloatArray, normed: FloatArray) -> tuple[FloatArray, FloatArray]:
        inner, bias, outer, offset = self._split(weights)
        hidden = np.tanh(normed @ inner + bias)
        return np.asarray(hidden @ outer + offset), hidden

    def simulate(self, series: Series) -> FloatArray:
        """(n,) rate of a free simulation from the first sample."""
        step, count = series.step, len(MEMORIES)
        decay = np.exp(-step / (np.array(MEMORIES) * self._constant))
        rate, angle = np.empty(len(series.rate)), float(series.angle[0])
        rate[0] = series.rate[0]
        past = np.repeat([rate[0], series.torque[0]], count)
        both = np.tile(decay, 2)
        for at in range(len(rate) - 1):
            now, torque = rate[at], series.torque[at]
            inputs = np.concatenate(([now, torque, np.sin(angle), np.cos(angle)], past))
            missing = self._size * float(self._output(self._weights, self._normed(inputs[None]))[0][0])
            acceleration = (torque + missing - self._drag(np.array([now]))[0]) / self._model.inertia
            rate[at + 1] = now + step * acceleration
            angle += step * now
            past = both * past + (1.0 - both) * np.repeat([now, torque], count)
        return rate


def held_out_squares(study: Study, causes: Sequence[Effect]) -> FloatArray:
    """(3,) mean squared error of the rate on held-out runs: plain model, with the causes, with the network."""
    assert study.runs is not None
    runs, vehicle = study.runs.items, study.vehicle
    squares, samples = np.zeros(3), 0
    for held_out in runs:
        others = [run for run in runs if run is not held_out]
        plain, named = (fit_likelihood(others, vehicle, effects).model for effects in ((), tuple(causes)))
        moving = np.concatenate([run.rates.rate[run.rates.valid] for run in others])
        constant = time_constant(plain, float(np.sqrt(np.mean(moving**2))))
        step = constant / STEPS
        target = Series.of(held_out, plain, vehicle, step)
        for at, model in enumerate((plain, named)):
            simulated = model.simulate(held_out.trial, model.torque_input(vehicle, held_out.trial))[0]
            squares[at] += np.sum((np.interp(target.time, held_out.trial.time, simulated) - target.rate) ** 2)
        network = Network(plain, [Series.of(run, plain, vehicle, step) for run in others], constant)
        squares[2] += np.sum((network.simulate(target) - target.rate) ** 2)
        samples += len(target.rate)
    return squares / samples


def main() -> None:
    """Print, for each folder of logs, the held-out errors and the share of the removable error that is removed."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("logs", nargs="+", type=Path)
    for folder in parser.parse_args().logs:
        try:
            study = open_study([folder])
        except RovidError as error:
            print(f"{folder.name:24} {error}", flush=True)
            continue
        if study.runs is None or len(study.runs.items) < LEAST_RUNS:
            print(f"{folder.name:24} too few runs to hold one out", flush=True)
            continue
        causes = [effect_named(finding.effect.key) for finding in study.diagnosis().findings]
        plain, named, network = held_out_squares(study, causes)
        removable = plain - min(named, network)
        share = f"named causes remove {100.0 * (plain - named) / removable:.0f} % of it" if removable > 0.0 else ""
        of_all = f"{100.0 * removable / plain:.0f} % of the mean square can be removed"
        errors = "  ".join(f"{np.sqrt(square):.4g}" for square in (plain, named, network))
        print(f"{folder.name:24} plain, named, network: {errors}   {of_all} {share}")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
