"""Inputs of the Kalman filters: measurements, and four models with the torque input of each."""

from collections.abc import Sequence
from typing import NamedTuple, Self, TypeVar

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.model.bound_effects import PackedTerms, stack_terms
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput

One = TypeVar("One")


class FilterData(NamedTuple):
    """Measurements of m concatenated trials."""

    offsets: IntArray  #: (m + 1,) index of each trial's first instant, and n.
    #: ``time``, ``rate``: (n,) s, and measured rate in rad/s, NaN where not measured.
    time: FloatArray
    rate: FloatArray
    start_position: FloatArray  #: (m,) rad, the position at the start of each trial.
    initial_rate: FloatArray  #: (m, 2) rate in rad/s at the first instant, and its standard deviation.
    output_index: IntArray  #: (n, 2) places of the innovations of angle and rate in the filter's output; -1 for none.
    states: FloatArray  #: (m, s) the first s states of the terms at the first instant of each trial; others are zero.


class FilterInputs(NamedTuple):
    """Torque inputs and measured angles of the models in the four lanes. Lanes may share either."""

    #: ``torque``, ``timing_moment``, ``impulse_variance``: (d, n) of each distinct torque input, see
    #: `rovid.model.torque_input.TorqueInput`.
    torque: FloatArray
    timing_moment: FloatArray
    impulse_variance: FloatArray
    torque_index: IntArray  #: (LANES,) index of each lane's torque input among the d.
    effect_inputs: FloatArray  #: (b, n, 3) distinct effect inputs.
    input_index: IntArray  #: (LANES,) index of each lane's effect inputs among the b.
    #: (e, n) measured angle in rad without the sensor's deviation; NaN where not measured, in all or none.
    angles: FloatArray
    angle_index: IntArray  #: (LANES,) index of each lane's angles among the e.

    @classmethod
    def stack(cls, torque_inputs: Sequence[TorqueInput], angles: Sequence[FloatArray]) -> Self:
        """From a torque input and (n,) angles for each lane."""
        distinct, torque_index = _distinct(torque_inputs)
        effect_inputs, input_index = _distinct([one.effect_inputs for one in torque_inputs])
        distinct_angles, angle_index = _distinct(angles)
        return cls(
            _stacked([one.torque for one in distinct]),
            _stacked([one.timing_moment for one in distinct]),
            _stacked([one.impulse_variance for one in distinct]),
            torque_index,
            _stacked(effect_inputs),
            input_index,
            _stacked(distinct_angles),
            angle_index,
        )


class ParameterBatch(NamedTuple):
    """Parameters of the models in the four lanes, which have the same terms."""

    body: FloatArray  #: (5, LANES) numbers of each `rovid.effects.base.Body`.
    terms: PackedTerms  #: Terms of all models, with a column of parameters for each.
    #: (4, LANES) standard deviation of the disturbance in N m, its correlation time in s, standard deviations of the
    #: white noise of measured angles in rad and rates in rad/s.
    noise: FloatArray
    #: (3, LANES) root 2 times the standard deviation of the wave torque in N m, its frequency in rad/s and the damping
    #: of its filter; (0, LANES) without a wave.
    wave: FloatArray

    @classmethod
    def stack(cls, models: Sequence[Model], noise: Sequence[FloatArray]) -> Self:
        """From a model and its (4,) noise for each lane."""
        return cls(
            body=np.column_stack([model.body for model in models]),
            terms=stack_terms([model.terms for model in models]),
            noise=np.column_stack(noise),
            wave=np.column_stack([model.wave_parameters for model in models]),
        )


def _distinct(series: Sequence[One]) -> tuple[list[One], IntArray]:
    """The distinct objects among ``series``, and the index of each object among them."""
    objects = {id(one): one for one in series}
    index = {key: at for at, key in enumerate(objects)}
    return list(objects.values()), np.array([index[id(one)] for one in series])


def _stacked(series: Sequence[FloatArray]) -> FloatArray:
    """(s, ...) array; a single one is not copied."""
    return np.ascontiguousarray(series[0])[np.newaxis] if len(series) == 1 else np.stack(series)
