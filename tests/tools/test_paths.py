"""From logged commands to those that act."""

from __future__ import annotations

import numpy as np
import pytest

from tools.hidden import Hidden
from tools.paths import Path as CommandPath
from tools.paths import acting_path
from tools.simulate import MICRO
from tools.truth import FloatArray


def _path(values: list[float], *, every: float = 1.0, **hidden: Hidden) -> CommandPath:
    instant = (np.arange(len(values)) * every * MICRO).astype(np.int64)
    return acting_path(instant, np.array(values), 0.3, hidden)


def test_polled_commands_act_at_the_next_reading() -> None:
    polled = Hidden(effect="command_delay", form="polled", parameters={"delay": 0.6})
    path = _path([1.0, 2.0, 3.0, 4.0], command_delay=polled)
    assert path.instant.tolist() == [0, 1_200_000, 2_400_000, 3_600_000]
    assert path.value.tolist() == [1.0, 2.0, 3.0, 4.0]
    # Of two commands between readings the later one is read.
    assert _path([1.0, 2.0, 3.0, 4.0], every=0.5, command_delay=polled).value.tolist() == [1.0, 3.0, 4.0]


def test_play_follows_half_its_width_behind() -> None:
    play = Hidden(effect="command_hysteresis", form="play", parameters={"width": 0.4})
    path = _path([0.1, 1.0, 1.5, 1.3, 0.9, 1.2, 1.4], command_hysteresis=play)
    assert path.value == pytest.approx([0.0, 0.8, 1.3, 1.3, 1.1, 1.1, 1.2])


def test_schmitt_starts_late_and_stops_at_the_dead_zone() -> None:
    schmitt = Hidden(effect="command_hysteresis", form="schmitt", parameters={"width": 0.5})
    path = _path([0.7, 0.9, 0.4, 0.2, -0.6, -0.9, -0.5, 0.5], command_hysteresis=schmitt)
    assert path.value == pytest.approx([0.0, 0.9, 0.4, 0.0, 0.0, -0.9, -0.5, 0.5])


def _values(path: CommandPath, *times: float) -> FloatArray:
    begin = np.array([round(time * MICRO) for time in times])
    return path.over(begin, np.zeros(len(begin)))


def test_slew_limit_ramps_through_samples_and_meets_a_new_target() -> None:
    hard = Hidden(effect="slew_limit", form="hard", parameters={"rate": 0.8})
    path = _path([1.0, 2.0, -1.0], slew_limit=hard)
    # 0.8 after a second, on to 1.6 when the target turns round, at it after another 3.25 s.
    assert _values(path, 0.5, 1.0, 2.0, 3.0, 5.25, 6.0) == pytest.approx([0.4, 0.8, 1.6, 0.8, -1.0, -1.0])
    assert _values(_path([0.4, 0.4], slew_limit=hard), 0.25, 0.5, 0.7, 1.5) == pytest.approx([0.2, 0.4, 0.4, 0.4])


def test_soft_start_lets_go_at_once() -> None:
    soft = Hidden(effect="slew_limit", form="soft_start", parameters={"rate": 0.5})
    path = _path([1.0, 0.2, -1.0, 0.0], slew_limit=soft)
    assert _values(path, 0.5, 0.999, 1.0, 2.0, 2.5, 3.0) == pytest.approx([0.25, 0.4995, 0.2, 0.0, -0.25, 0.0])
