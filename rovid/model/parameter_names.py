"""Names and units of a model's parameters."""

from collections.abc import Iterable

from rovid.effects import effect_named, restoring_effect
from rovid.trial.axis import YAW, Axis

# Parameters of the base model -> unit in yaw.
UNITS = {"inertia": "kg m^2", "quadratic_drag": "N m s^2/rad^2", "linear_drag": "N m s/rad"}
# Parameters of the planar model's base -> unit. docs/planar.md.
PLANAR_UNITS = {
    "surge.inertia": "kg",
    "sway.inertia": "kg",
    "yaw.inertia": "kg m^2",
    "sway_yaw.inertia": "kg m",
    "surge.linear_drag": "N s/m",
    "sway.linear_drag": "N s/m",
    "yaw.linear_drag": "N m s",
    "surge.quadratic_drag": "N s^2/m^2",
    "sway.quadratic_drag": "N s^2/m^2",
    "yaw.quadratic_drag": "N m s^2",
}
# Parameters of a rudder, ``rudder.NAME.lift``: last word -> unit.
RUDDER_UNITS = {
    "lift": "N s^2/m^2",
    "slipstream": "m^2/(N s^2)",
    "resistance": "1",
    "straightening": "1",
    "asymmetry": "1",
    "stall": "rad",
}
_RUDDER = "rudder."


def base_names(axis: Axis) -> tuple[str, ...]:
    """Names of the base model's parameters along ``axis``, as in the parameter file and in JSON."""
    restoring = restoring_effect(axis)
    return (*UNITS, *(parameter.name for parameter in (restoring.parameters if restoring else ())))


def unit_of(name: str, axis: Axis = YAW) -> str:
    """Unit along ``axis`` of a parameter, such as ``inertia`` or ``thruster_lag.time_constant``.

    Raises ConfigError if there is no such effect.
    """
    key, _, parameter = name.rpartition(".")
    if name in UNITS:
        return axis.unit(UNITS[name])
    if name in PLANAR_UNITS:
        return PLANAR_UNITS[name]
    if name.startswith(_RUDDER):
        return RUDDER_UNITS[parameter]
    effect = effect_named(key) if key else restoring_effect(axis)
    unit = next((p.unit for p in (effect.parameters if effect else ()) if p.name == parameter), "")
    return unit if parameter.endswith("frequency") else axis.unit(unit)


def effect_ids(names: Iterable[str]) -> list[str]:
    """Keys of the effects in parameter names, without repetition."""
    of_effects = (name for name in names if "." in name and not is_planar_base(name))
    return list(dict.fromkeys(name.rpartition(".")[0] for name in of_effects))


def is_planar_base(name: str) -> bool:
    """Whether ``name`` is a parameter of the planar model's base, or of a rudder."""
    return name in PLANAR_UNITS or name.startswith(_RUDDER)


def without_form(name: str) -> str:
    """Parameter name without the form of the effect."""
    key, dot, parameter = name.rpartition(".")
    return key.partition(":")[0] + dot + parameter
