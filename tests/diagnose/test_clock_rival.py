"""A clock offset is a fault of joined logs, not a cause."""

from __future__ import annotations

import numpy as np

from rovid.effects.clock_offset import mean_shifted
from rovid.signals.shift import shift_commands
from tests.synthetic import clock, trial


def test_moving_commands_there_and_back_restores_them() -> None:
    time = clock(60.0)
    command = np.sign(np.random.default_rng(1).normal(size=61))[np.minimum(time.astype(int), 60)]
    log = trial(time, command, np.sin(0.3 * time))
    back = shift_commands(shift_commands(log, 0.53), -0.53)
    middle = time[40:-40] + 0.01
    start = log.time[-1] - back.time[-1]
    for one, origin in ((log, 0.0), (back, start)):
        at = np.searchsorted(one.time, middle - origin, side="right") - 1
        np.testing.assert_array_equal(one.commands[at, 0] if one is log else command[40:-40], command[40:-40])
    assert np.isfinite(back.position).sum() >= len(time) - 12


def test_a_held_value_is_moved_by_its_delay() -> None:
    time, values = np.arange(0.0, 10.0, 0.5), np.zeros(20)
    values[8:] = 2.0  # from 4 s on
    early, late = mean_shifted(time, values, -1.0), mean_shifted(time, values, 0.75)
    np.testing.assert_allclose(early, np.where(time >= 3.0, 2.0, 0.0))
    np.testing.assert_allclose(late[8:11], [0.0, 1.0, 2.0])
