"""Compiled loops over samples, which step four models, runs or restarts at a time. They know no files and no units.

The same equations in plain numpy are in `rovid.model.reference`.
"""

from rovid.model.kernels.effect_terms import SCRATCH_ROWS
from rovid.model.kernels.ekf3 import ekf3_innovations
from rovid.model.kernels.ekf5 import ekf5_innovations
from rovid.model.kernels.multi_step import effects_along, predict_multi_step
from rovid.model.kernels.rk4 import advance, simulate, simulate_effects
from rovid.model.kernels.warmup import compile_all, is_compiled, start_compiling
