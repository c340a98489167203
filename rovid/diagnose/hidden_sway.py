"""Sway that follows the turn and is not logged: it looks like water that remembers the turn.

The sway v of a hull with its centre of mass ahead or astern of the centre of its lateral drag obeys
m22*dv/dt + d22*v = -m23*dr/dt, and its torque on the turn is -m23*dv/dt (Fossen 2011, section 6.5). With
w = r + v*m22/m23 both are the equations of `added_mass_memory`, with Im = m23^2/m22 and τ = m22/d22; a quadratic drag
gives those of its porous form. Without a logged sway no data along the axis distinguish the two. Entrained swirl with a
short memory is close to them.
"""

from collections.abc import Sequence
from types import MappingProxyType

from rovid.effects import Effect, effect_named
from rovid.effects.actuator_inputs import SPEEDS
from rovid.estimate.dataset import FitData
from rovid.estimate.fit_result import FitResult

_SWAY = effect_named("sideslip_moment:turning")
# Longest memory in time constants of the vehicle: sway and yaw of a hull decay within a factor of a few.
_LONGEST = _SWAY.parameters[1].high
# Id -> largest size, of the inertia or of the drag: a centre of mass 0.15 lengths from that of the lateral drag. On a
# slender hull of length L inertia and drag in yaw about that centre are L^2/12 of those in sway, and 0.15^2 is 0.27 of
# 1/12. Of drag, which does not vanish at rest, the share is 0.27/1.27.
_LARGEST = MappingProxyType({"added_mass_memory": 0.27, "entrained_swirl": 0.21})


def indistinguishable_sway(data: FitData, fits: Sequence[FitResult]) -> tuple[Effect, ...]:
    """Sway as a cause, if the last effect of one of ``fits`` is a memory that sway may be; else nothing."""
    vehicle = data.vehicle
    # A motor on a bench does not move sideways.
    turns_alone = vehicle is None or all(one.scale_key == "torque_constant" for one in vehicle.thrusters)
    is_logged = all(SPEEDS[1] in run.trial.extras for run in data.runs)
    is_tried = any(fitted.effects[-1].id == _SWAY.id for fitted in fits)
    if data.axis.name != "yaw" or turns_alone or is_logged or is_tried or not any(map(_may_be_sway, fits)):
        return ()
    return (_SWAY,)


def _may_be_sway(fitted: FitResult) -> bool:
    effect = fitted.effects[-1]
    if effect.id not in _LARGEST:
        return False
    size, time = fitted.effect_coordinates(effect)[:2]
    if effect.parameters[0].scale == "inertia":
        size *= fitted.data.scales.unit_size(effect.parameters[0]) / fitted.model.inertia
    return bool(0.0 < size <= _LARGEST[effect.id] and time <= _LONGEST)
