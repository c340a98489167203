"""Compiled filters of plain series: for one model, or for one in each lane."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.jit.simd import LANES
from rovid.model.filter_batch import FilterData, FilterInputs, ParameterBatch
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput

Filter = Callable[[FilterData, FilterInputs, ParameterBatch], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, kw_only=True)
class Log:
    """Measurements of one trial: (n,) s, rad and rad/s, NaN where not measured.

    ``first`` is the initial rate in rad/s and its standard deviation, ``start`` the position at the start in rad.
    """

    time: FloatArray
    angle: FloatArray
    rate: FloatArray | None = None
    first: tuple[float, float] = (0.0, 0.01)
    start: float = 0.0
    known: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        rate = np.full(len(self.time), np.nan) if self.rate is None else self.rate
        object.__setattr__(self, "known", np.column_stack((self.angle, rate)))


def filter_data(*logs: Log) -> FilterData:
    """Concatenate logs. Each instant has a place for both innovations."""
    counts = [len(log.time) for log in logs]
    return FilterData(
        offsets=np.cumsum([0, *counts]),
        time=np.concatenate([log.time for log in logs]),
        rate=np.concatenate([log.known[:, 1] for log in logs]),
        start_position=np.array([log.start for log in logs]),
        initial_rate=np.array([log.first for log in logs]),
        output_index=np.arange(2 * sum(counts)).reshape(-1, 2),
        states=np.zeros((len(logs), 0)),
    )


def filter_batch(
    kernel: Filter,
    logs: Sequence[Log],
    drives: Sequence[TorqueInput],
    models: Sequence[Model],
    noises: Sequence[FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """(LANES, n, 2) innovations of angle and rate, and their variances, for a model in each lane; NaN for none."""
    known = np.concatenate([log.known for log in logs])
    inputs = FilterInputs.stack(drives, [known[:, 0].copy()] * LANES)
    found = kernel(filter_data(*logs), inputs, ParameterBatch.stack(models, noises))
    tables = (np.where(np.isfinite(known), one.reshape(LANES, -1, 2), np.nan) for one in found)
    innovation, variance = tables
    return innovation, variance


def filter_one(
    kernel: Filter, log: Log, drive: TorqueInput, model: Model, noise: Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    """(n, 2) innovations and variances for one model, which is in all lanes."""
    every = filter_batch(kernel, [log], [drive] * LANES, [model] * LANES, [np.array(noise)] * LANES)
    for table in every:
        np.testing.assert_array_equal(table, np.broadcast_to(table[0], table.shape))
    return every[0][0], every[1][0]
