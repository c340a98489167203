"""Closed-loop runs to be drawn: the steps of the founding paper, without noise and disturbance."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rovid.control.allocation import allocate
from rovid.control.design import Control, duration, paper_runs, unaided
from rovid.control.loop import Course, Plant, run_closed
from rovid.vehicle import Thruster, Vehicle


def courses_of(control: Control, vehicle: Vehicle) -> dict[str, dict[str, Course]]:
    """Name of each step -> what controller and plant are -> the run."""
    model, law, delay = control.model, control.law, control.setting.delay
    # As for the design: where no thrusters are known the torque itself is commanded.
    if not vehicle.thrusters:
        vehicle = replace(vehicle, thrusters=(Thruster(name="torque", arm=1.0, curve=None),))
    bare = replace(model, effects=(), effect_values=())
    bench = allocate(vehicle, bare)
    plain = replace(law, hold=(0.0,) * len(law.hold), lowest=bench.lowest, highest=bench.highest)
    if model.effects:
        ways = {
            "aid of drag and effects": (law, control.allocation, model),
            "aid of drag alone": (plain, bench, model),
            "the same without effects": (plain, bench, bare),
        }
    else:
        ways = {"aided by the model": (plain, bench, bare), "PD alone": (unaided(plain), bench, bare)}
    samples = math.ceil(duration(law, model) / law.period)
    return {
        run.name: {
            way: run_closed(
                controller,
                inverse,
                Plant(model=acting, vehicle=vehicle, delay=delay),
                np.full(samples, math.radians(run.wanted)),
                math.radians(run.start),
            )
            for way, (controller, inverse, acting) in ways.items()
        }
        for run in paper_runs()
    }
