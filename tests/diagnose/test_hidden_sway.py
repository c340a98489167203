"""Sway that is not logged looks like water that remembers the turn."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rovid.diagnose.build_result import indistinguishable_sway
from rovid.effects import effect_named
from rovid.effects.base import Body, Instant, Scales
from rovid.trial.axis import AXES, YAW, Axis

SCALES = Scales(command=1.0, torque=100.0, rate=0.5, wash=1.0, time=5.0)
# kg m^2: that of one unit of the scale of the inertia.
INERTIA = 1000.0


def data(axis: Axis = YAW, key: str = "", *, logged: bool = False) -> Any:
    run = SimpleNamespace(trial=SimpleNamespace(extras={"sway_velocity": np.zeros(1)} if logged else {}))
    vehicle = SimpleNamespace(thrusters=[SimpleNamespace(scale_key=key)])
    return SimpleNamespace(axis=axis, vehicle=vehicle, runs=[run], scales=SCALES)


def fitted(name: str, *coordinates: float) -> Any:
    """A model with the effect ``name`` at coordinates in units of the scales."""
    return SimpleNamespace(
        effects=[effect_named(name)],
        data=data(),
        model=SimpleNamespace(inertia=INERTIA),
        effect_coordinates=lambda _: np.array(coordinates),
    )


@pytest.mark.parametrize(("one", "is_sway"), [
    (fitted("added_mass_memory", 0.1, 1.2), True),
    (fitted("added_mass_memory:porous", 0.1, 1.2), True),
    (fitted("added_mass_memory", -0.1, 1.2), False),  # sway takes inertia away in fast motion
    (fitted("added_mass_memory", 0.6, 1.2), False),  # no hull has its drag so far from its mass
    (fitted("entrained_swirl", 0.05, 1.5), True),
    (fitted("entrained_swirl", 0.05, 10.0), False),  # no sway lasts so long
    (fitted("oscillatory_drag", 0.3, 1.0), False),
])  # fmt: skip
def test_a_short_and_small_memory_may_be_sway(one: Any, *, is_sway: bool) -> None:
    assert bool(indistinguishable_sway(data(), [one])) == is_sway


@pytest.mark.parametrize("known", [data(logged=True), data(AXES["roll"]), data(key="torque_constant")])
def test_no_sway_is_suspected_where_it_is_logged_or_impossible(known: Any) -> None:
    assert not indistinguishable_sway(known, [fitted("added_mass_memory", 0.1, 1.2)])


def test_a_close_alternative_suffices_and_sway_is_listed_once() -> None:
    swirl, sway = fitted("oscillatory_drag", 0.3, 1.0), fitted("sideslip_moment:turning", 0.1, 1.0)
    memory = fitted("added_mass_memory", 0.1, 1.2)
    assert [effect.id for effect in indistinguishable_sway(data(), [swirl, memory])] == ["sideslip_moment"]
    assert not indistinguishable_sway(data(), [memory, sway])


@pytest.mark.parametrize(("form", "power"), [("", 1), (":porous", 2)])
def test_sway_by_the_coupled_mass_is_a_memory_of_the_turn(form: str, power: int) -> None:
    """Both equations of motion give the same rate, for a linear and for a quadratic drag in sway."""
    inertia, drag, mass, coupled, lateral = 1000.0, 150.0, 2800.0, 400.0, 600.0
    memory = coupled**2 / mass
    # tau, at the reference rate of 0.3 rad/s where the drag is quadratic.
    time_constant = mass / lateral if power == 1 else mass**2 / (lateral * coupled * 0.3)
    term: Any = effect_named(f"added_mass_memory{form}").acts
    body = Body(inertia - memory, 0.0, drag)
    step, rate, sway = 0.004, 0.0, 0.0
    water: tuple[Any, Any] = (0.0, 0.0)
    for number in range(7500):
        torque = 60.0 if number * step % 20.0 < 10.0 else -60.0
        # m22 v' + m23 r' = -d |v|^(n-1) v, m23 v' + I r' = T - D r
        forces = -lateral * abs(sway) ** (power - 1) * sway, torque - drag * rate
        sway_change, change = np.linalg.solve([[mass, coupled], [coupled, inertia]], forces)
        rate, sway = rate + step * change, sway + step * sway_change
        turn, remembered = water
        at = Instant(turn, turn, 0.0, 0.0, torque, 0.0, 0.0, 0.0, body)
        added, flow = getattr(term.torque, "py_func", term.torque)(at, (memory, time_constant), (remembered, 0.0))
        water = turn + step * (torque - drag * turn + added) / body.inertia, remembered + step * flow
        assert water[0] == pytest.approx(rate, abs=2e-4)  # the quickest water is slowed down by two percent
