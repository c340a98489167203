"""Compiled loops over samples. Nothing here knows of files, units or effects' names."""

from rovid.model.kernels.effect_terms import ROOM
from rovid.model.kernels.ekf3 import innovations
from rovid.model.kernels.ekf5 import innovations_wide
from rovid.model.kernels.multi_step import effects_along, predict
from rovid.model.kernels.rk4 import advance, simulate, simulate_effects
from rovid.model.kernels.warmup import begin, compile_now, is_compiled

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
