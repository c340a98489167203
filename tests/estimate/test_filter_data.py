"""The readings of each run, as a filter takes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.effects import effect_named
from rovid.estimate.filter_data import InnovationData
from rovid.signals.preprocessing import Run
from tests import synthetic

TIME = synthetic.clock(120.0)
RUN = synthetic.run(TIME, np.where(TIME < 60.0, 100.0, -100.0))


def readings(run: Run, *, interval: float = 0.0, gyro: bool = False) -> InnovationData:
    return InnovationData([run], synthetic.LOGGED, synthetic.ROSUB, gyro=gyro, interval=interval)


def test_a_quick_look_passes_over_readings_but_for_the_last() -> None:
    every = readings(RUN).run_data[0]
    assert len(every.time) == len(TIME)
    quick = readings(RUN, interval=1.0).run_data[0]
    assert np.diff(quick.time) == pytest.approx(1.0)
    assert quick.time[-1] == TIME[-1]


def test_the_filter_starts_at_the_first_reading_and_is_told_of_the_others() -> None:
    gap = RUN.trial.position.copy()
    gap[100:200] = np.nan
    one = readings(replace(RUN, trial=replace(RUN.trial, position=gap))).run_data[0]
    assert len(one.known_positions) == len(TIME) - 1 - 100
    assert len(one.innovation_times) == len(one.known_positions)


def test_a_gyro_is_looked_at_only_where_it_is_asked_for() -> None:
    noise = 1e-3 * np.random.default_rng(1).normal(size=len(TIME))
    run = replace(RUN, trial=replace(RUN.trial, rate=np.gradient(RUN.trial.position, TIME) + noise))
    assert not len(readings(run).run_data[0].known_rates)
    assert readings(run).gyro_noise == 1.0
    asked = readings(run, gyro=True)
    assert len(asked.run_data[0].known_rates) == len(TIME)
    # Of 2400 differences the size is known to two percent.
    assert asked.gyro_noise == pytest.approx(1e-3, rel=0.1)


def test_where_the_rate_alone_was_measured_a_position_is_known_at_the_start_alone() -> None:
    integrated = replace(RUN.trial, rate=np.gradient(RUN.trial.position, TIME), rate_only=True)
    one = readings(replace(RUN, trial=integrated)).run_data[0]
    assert not len(one.known_positions)
    assert len(one.known_rates) == len(TIME)


def test_headings_are_freed_of_the_same_deviation_once() -> None:
    off, (portion,) = effect_named("heading_deviation"), readings(RUN).chunks
    models = [replace(synthetic.ROSUB, effects=(off,), effect_values=(size, 0.3)) for size in (0.05, 0.05, 0.06)]
    first, same, other = (portion.corrected_angle(model) for model in models)
    assert first is same
    assert not np.array_equal(first.angle, other.angle)
    assert first.gain is not None
    plain = portion.corrected_angle(synthetic.ROSUB)
    assert plain.angle is portion.corrected_angle(synthetic.ROSUB).angle
    assert plain.gain is None
