"""Compiled loops over samples. Nothing here knows of files, units or effects' names."""

from rovid.model.kernels.filter import innovations
from rovid.model.kernels.first_use import begin, compile_now, is_compiled
from rovid.model.kernels.free_run import advance, simulate, simulate_effects
from rovid.model.kernels.prediction import effects_along, predict
from rovid.model.kernels.torque import ROOM
from rovid.model.kernels.wide_filter import innovations_wide

__all__ = [
    "ROOM",
    "advance",
    "begin",
    "compile_now",
    "effects_along",
    "innovations",
    "innovations_wide",
    "is_compiled",
    "predict",
    "simulate",
    "simulate_effects",
]
