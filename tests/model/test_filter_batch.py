"""Batches of models as inputs of a filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rovid.effects import effect_named
from rovid.effects.base import TERM_PARAMETERS
from rovid.jit.simd import LANES
from rovid.model.filter_batch import FilterInputs, ParameterBatch
from rovid.model.model import Model
from rovid.model.torque_input import TorqueInput

TORQUES = [np.arange(5.0), np.ones(5)]
DRIVES = [TorqueInput.held(torque, impulse_variance=2.0 * torque) for torque in TORQUES]
ANGLES = [np.zeros(5), np.linspace(0.0, 1.0, 5)]
PLAIN = Model(inertia=5057.0, quadratic_drag=3532.0, linear_drag=132.0)
SWIRL, WAVE = effect_named("entrained_swirl"), effect_named("wave_torque")


def test_shared_inputs_are_stored_once() -> None:
    first, second = DRIVES
    driven = FilterInputs.stack([first, second, first, second], [ANGLES[0], ANGLES[0], ANGLES[1], ANGLES[0]])
    assert driven.torque_index.tolist() == [0, 1, 0, 1]
    assert driven.angle_index.tolist() == [0, 0, 1, 0]
    for name in ("torque", "timing_moment", "impulse_variance"):
        np.testing.assert_array_equal(getattr(driven, name), np.stack([getattr(one, name) for one in DRIVES]))
    # Neither of them tells effects anything besides.
    assert driven.effect_inputs.shape == (1, 5, 3)
    assert not driven.input_index.any()
    telling = TorqueInput.held(TORQUES[1], effect_inputs=np.ones((5, 3)))
    assert FilterInputs.stack([first, telling], ANGLES).input_index.tolist() == [0, 1]
    np.testing.assert_array_equal(driven.angles, np.stack(ANGLES))


def test_a_single_input_is_not_copied() -> None:
    driven = FilterInputs.stack([DRIVES[0]] * LANES, [ANGLES[0]] * LANES)
    assert np.shares_memory(driven.torque, TORQUES[0])
    assert np.shares_memory(driven.angles, ANGLES[0])
    assert driven.torque.shape == driven.angles.shape == (1, 5)
    assert not driven.torque_index.any()


def test_each_model_has_a_column_of_parameters() -> None:
    models = [
        Model(
            inertia=5000.0 + number,
            quadratic_drag=3000.0 - number,
            linear_drag=100.0,
            effects=(SWIRL, WAVE),
            effect_values=(0.1 * number, 20.0 + number, 30.0, 0.5 + number, 0.1),
        )
        for number in range(LANES)
    ]
    noise = [np.array([3.0, 4.0, 1e-3, 1.0 + number]) for number in range(LANES)]
    batch = ParameterBatch.stack(models, noise)
    assert batch.body.shape == (5, LANES)
    assert batch.terms.parameters.shape == (TERM_PARAMETERS, LANES)
    for number, model in enumerate(models):
        assert batch.body[:, number].tolist() == list(model.body)
        assert batch.terms.parameters[:2, number].tolist() == list(model.effect_values[:2])
        assert batch.noise[:, number].tolist() == noise[number].tolist()
        assert batch.wave[:, number].tolist() == list(model.effect_values[2:])
    # The fastest of all states sets the steps of all lanes.
    assert batch.terms.fastest == max(model.terms.fastest for model in models)
    assert batch.terms.kinds.tolist() == models[0].terms.kinds.tolist()


def test_without_a_wave_there_are_no_wave_rows() -> None:
    models = [replace(PLAIN, inertia=5000.0 + number) for number in range(LANES)]
    batch = ParameterBatch.stack(models, [np.ones(4)] * LANES)
    assert batch.wave.shape == (0, LANES)
    assert batch.terms.parameters.shape == (0, LANES)


def test_all_arrays_of_a_batch_are_contiguous() -> None:
    """As a register is read from it."""
    batch = ParameterBatch.stack([PLAIN] * LANES, [np.ones(4)] * LANES)
    for table in (batch.body, batch.noise, batch.wave, batch.terms.parameters, PLAIN.terms.parameters):
        assert table.flags.c_contiguous
