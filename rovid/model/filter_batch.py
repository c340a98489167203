"""What a filter is given: what was logged, and several models side by side with what drives each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self, TypeVar

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.model.model import Model
from rovid.model.packed_terms import PackedTerms, stack_terms
from rovid.model.torque_input import TorqueInput

One = TypeVar("One")


class FilterData(NamedTuple):
    """Readings of several trials, one after the other.

    Attributes
    ----------
    begins
        (m + 1,) where each begins, and the end of the last.
    time, rate
        (n,) s, and the measured rate in rad/s; NaN where not measured.
    start
        (m,) rad, the position at the start of each trial.
    first
        (m, 2) rate in rad/s at the first instant and its standard deviation.
    row
        (n, 2) where the innovation of the angle and that of the rate at each instant are put; -1 for nowhere.
    """

    begins: IntArray
    time: FloatArray
    rate: FloatArray
    start: FloatArray
    first: FloatArray
    row: IntArray


class FilterInputs(NamedTuple):
    """What drives models side by side, and the angles that they go by; lanes may share either.

    Attributes
    ----------
    torque, moment, scatter
        (d, n) of each of several drives, from each instant to the next, see `rovid.model.torque_input.Drive`.
    drive
        (LANES,) which of them drives each lane.
    beside
        (b, n, 3) what effects are told beside the torque.
    told
        (LANES,) which of these each lane is told.
    angles
        (e, n) measured angle in rad without the instrument's deviation; NaN where not measured, in all or none.
    angle
        (LANES,) which of these each lane goes by.
    """

    torque: FloatArray
    moment: FloatArray
    scatter: FloatArray
    drive: IntArray
    beside: FloatArray
    told: IntArray
    angles: FloatArray
    angle: IntArray

    @classmethod
    def stack(cls, drives: Sequence[TorqueInput], angles: Sequence[FloatArray]) -> Self:
        """Of a drive and (n,) angles for each lane."""
        distinct, drive = _distinct(drives)
        beside, told = _distinct([one.effect_inputs for one in drives])
        seen, angle = _distinct(angles)
        return cls(
            _stacked([one.torque for one in distinct]),
            _stacked([one.timing_moment for one in distinct]),
            _stacked([one.impulse_variance for one in distinct]),
            drive,
            _stacked(beside),
            told,
            _stacked(seen),
            angle,
        )


class ParameterBatch(NamedTuple):
    """Models of the same terms side by side.

    Attributes
    ----------
    body
        (5, LANES) the numbers of each `rovid.effects.base.Body`.
    terms
        `rovid.model.packed_terms.Terms`, a column of the parameters for each.
    noise
        (4, LANES) standard deviation of the disturbance in N m, its correlation time in s, standard deviation of the
        white noise of a measured angle in rad and of a measured rate in rad/s.
    wave
        (3, LANES) root 2 times the standard deviation of the wave in N m, its frequency in rad/s and the damping of
        its filter; (0, LANES) where there is none.
    """

    body: FloatArray
    terms: PackedTerms
    noise: FloatArray
    wave: FloatArray

    @classmethod
    def stack(cls, models: Sequence[Model], noise: Sequence[FloatArray]) -> Self:
        """Of a model and its (4,) noise for each lane."""
        return cls(
            body=np.column_stack([model.body for model in models]),
            terms=stack_terms([model.terms for model in models]),
            noise=np.column_stack(noise),
            wave=np.column_stack([model.wave_parameters for model in models]),
        )


def _distinct(series: Sequence[One]) -> tuple[list[One], IntArray]:
    """Each of ``series`` once, and which of these each is."""
    every = {id(one): one for one in series}
    number = {key: at for at, key in enumerate(every)}
    return list(every.values()), np.array([number[id(one)] for one in series])


def _stacked(series: Sequence[FloatArray]) -> FloatArray:
    """(s, ...) without a copy of what is alone."""
    return np.ascontiguousarray(series[0])[np.newaxis] if len(series) == 1 else np.stack(series)
