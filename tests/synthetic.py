"""Trials made in memory: a held torque through the model, for tests that need no files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.model.kernels import simulate
from rovid.model.model import Model
from rovid.trial.preprocessing import Run
from rovid.trial.rates import compute_rates
from rovid.trial.trial import Trial
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle

ROSUB = Model(inertia=5057.0, quadratic_drag=3532.0, linear_drag=132.0)
VOLTS = ThrustCurve(command=np.array([-5.0, 5.0]), thrust=np.array([-500.0, 500.0]))
VEHICLE = Vehicle(name="test", thrusters=(Thruster(name="a", arm=1.0, curve=VOLTS),))
LOGGED = Vehicle(name="test", thrusters=(Thruster(name="torque", arm=1.0, curve=None),))


def clock(duration: float, rate: float = 20.0) -> FloatArray:
    return np.arange(round(duration * rate) + 1) / rate


def trial(
    time: FloatArray,
    command: FloatArray,
    heading: FloatArray | None = None,
    *,
    name: str = "log",
    roll: FloatArray | None = None,
    pitch: FloatArray | None = None,
    rate: FloatArray | None = None,
) -> Trial:
    return Trial(
        name=name,
        path=Path(name),
        time=time,
        position=np.zeros(len(time)) if heading is None else heading,
        commands=command[:, None],
        roll=roll,
        pitch=pitch,
        rate=rate,
    )


def run(
    time: FloatArray,
    torque: FloatArray,
    model: Model = ROSUB,
    *,
    cutoff: float = 1.0,
    disturbance: FloatArray | None = None,
    noise: FloatArray | None = None,
) -> Run:
    """What ``prepare`` makes of a log of this torque; ``disturbance`` in N m and heading ``noise`` in rad on top."""
    total = torque if disturbance is None else torque + disturbance
    _, angle = simulate(time, total, model.body, 0.0)
    log = trial(time, torque, angle if noise is None else angle + noise)
    rates = compute_rates(log, cutoff=cutoff)
    return Run(trial=log, torque=torque, rates=rates, filtered_torque=rates.filter_held(log, torque))


def gauss_markov(count: int, period: float, size: float, memory: float, rng: np.random.Generator) -> FloatArray:
    """Coloured disturbance of standard deviation ``size`` and correlation time ``memory`` in s."""
    from scipy.signal import lfilter

    fade = np.exp(-period / memory)
    kicks = rng.normal(0.0, size * np.sqrt(1.0 - fade**2), count)
    kicks[0] = rng.normal(0.0, size)
    return np.asarray(lfilter([1.0], [1.0, -fade], kicks))


def assert_same_trial(one: Trial, other: Trial) -> None:
    for item in fields(one):
        mine, theirs = (getattr(each, item.name) for each in (one, other))
        if isinstance(mine, Mapping):
            mine, theirs = dict(mine), dict(theirs)
        if is_dataclass(mine) and is_dataclass(theirs):
            mine, theirs = vars(mine), vars(theirs)
        np.testing.assert_equal(mine, theirs, item.name)
