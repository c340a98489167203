"""What was commanded in several trials drives each as if it were alone."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

from rovid.effects import Effect
from rovid.ground.arrays import IntArray
from rovid.model.commanded import Commanded
from rovid.model.model import Model
from tests.effects.test_effects import EVERY, VEHICLE, logs, numbers

LOGS = logs()
STEPS = [np.arange(first, len(log.time) - last, 7) for log, first, last in zip(LOGS, (0, 3, 1), (0, 5, 2), strict=True)]


@pytest.mark.parametrize(("parts", "at"), [(1, None), (1, STEPS), (4, None), (4, STEPS)])
@pytest.mark.parametrize("effect", EVERY, ids=lambda effect: effect.key)
def test_trials_together_are_driven_as_each_by_itself(effect: Effect, parts: int, at: list[IntArray] | None) -> None:
    values = tuple(numbers(effect, start=True).tolist())
    model = Model(inertia=5e3, quadratic_drag=3e3, linear_drag=1e2, effects=(effect,), effect_values=values)
    given = Commanded.of(VEHICLE, LOGS, parts)
    together = model.drivetrain.driven(given, None if at is None else given.between(at)).by_trial
    for number, found in enumerate(together):
        one = Commanded.of(VEHICLE, [LOGS[number]], parts)
        alone = model.drivetrain.driven(one, None if at is None else one.between([at[number]]))
        assert len(found.torque) == len(LOGS[number].time if at is None else at[number])
        for name in ("torque", "moment", "beside", "scatter"):
            # Sums over thrusters may be rounded otherwise.
            np.testing.assert_allclose(getattr(found, name), getattr(alone, name), rtol=1e-12, atol=1e-9)


def test_what_was_commanded_is_there_once_as_long_as_anybody_has_it() -> None:
    first = Commanded.of(VEHICLE, LOGS)
    assert Commanded.of(VEHICLE, LOGS) is first
    others = [Commanded.of(VEHICLE, LOGS[:2]), Commanded.of(VEHICLE, LOGS, 4), Commanded.of(VEHICLE, LOGS[::-1])]
    assert all(other is not first for other in others)
    gone = weakref.ref(first)
    del first
    gc.collect()
    assert gone() is None
