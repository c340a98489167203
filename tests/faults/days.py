"""Days of logs made in memory: holds, sines, steps and random commands of a small and a large vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.model.model import Model
from rovid.trial.preprocessing import Run
from tests.synthetic import clock, gauss_markov, run

SMALL = Model(inertia=0.6, quadratic_drag=1.5, linear_drag=0.3)
LARGE = Model(inertia=5057.0, quadratic_drag=3532.0, linear_drag=132.0)
VEHICLES = {"small": (SMALL, 1.2), "large": (LARGE, 280.0)}


def scaled(model: Model, inertia: float, drag: float) -> Model:
    """``model`` with these factors on its inertia and on its drags."""
    return Model(
        inertia=inertia * model.inertia,
        quadratic_drag=drag * model.quadratic_drag,
        linear_drag=drag * model.linear_drag,
    )


def programme(time_constant: float, rng: np.random.Generator) -> dict[str, tuple[float, FloatArray]]:
    """Name -> interval in s and relative torque of each log, at 20 samples per time constant, at most 20 Hz."""
    interval = max(time_constant / 20.0, 0.05)
    found = dict[str, tuple[float, FloatArray]]()
    time = clock(40.0 * time_constant, 1.0 / interval)
    for number, level in enumerate((0.4, 0.7, 1.0, -0.5, -0.9)):
        on = (time > 3.0 * time_constant) & (time < 25.0 * time_constant)
        found[f"hold_{number}.csv"] = interval, np.where(on, level, 0.0)
    phase = 2.0 * np.pi * time / time_constant
    for number, periods in enumerate((2.5, 5.0, 8.0)):
        found[f"sine_{number}.csv"] = (interval, (0.6 + 0.2 * number) * np.sin(phase / periods))
    levels = rng.choice([-1.0, -0.5, 0.0, 0.5, 1.0], len(time))
    found["steps.csv"] = interval, levels[(time // (4.0 * time_constant)).astype(int)]
    found["random.csv"] = interval, levels[(time // time_constant).astype(int)]
    return found


def day(
    vehicle: str,
    seed: int,
    others: dict[str, Model] | None = None,
    *,
    disturbance: float = 0.02,
    still: str = "",
    thrust: dict[str, float] | None = None,
    off: str = "",
    off_from: float = 0.5,
    off_until: float = 1.0,
) -> list[Run]:
    """Runs of a day; ``others``: log -> model of another vehicle; ``still``: a log without motion.

    ``off``: a log in which the thrusters do not push between these shares of its length.

    ``disturbance``: share of the full torque, with a memory of two time constants. ``thrust``: log -> factor of its
    torque.
    """
    rng = np.random.default_rng(seed)
    model, full = VEHICLES[vehicle]
    rate = np.sqrt(full / model.quadratic_drag)
    tau = model.inertia / (model.quadratic_drag * rate + model.linear_drag)
    runs = []
    for number, (name, (interval, planned)) in enumerate(programme(tau, rng).items()):
        torque = (thrust or {}).get(name, 1.0) * planned
        time = interval * np.arange(len(torque), dtype=np.float64)
        own = gauss_markov(len(time), interval, disturbance * full, 2.0 * tau, rng)
        own -= full * torque * ((name == off) & (time > off_from * time[-1]) & (time <= off_until * time[-1]))
        noise = rng.normal(0.0, np.deg2rad(0.05), len(time))
        cutoff = min(2.0 / tau, 0.19 / interval)
        one = run(time, full * torque, (others or {}).get(name, model), cutoff=cutoff, disturbance=own, noise=noise)
        if name == still:
            at_rest = scaled(model, 1e6, 1e6)
            one = run(time, full * torque, at_rest, cutoff=cutoff, noise=noise)
        runs.append(replace(one, trial=replace(one.trial, name=name, campaign_time=1000.0 * number)))
    return runs
