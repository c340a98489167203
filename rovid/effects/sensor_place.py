"""A velocity log or an antenna away from the origin of the vehicle, without its place in rovid.toml."""

from dataclasses import replace

from rovid.effects.base import Effect, EffectParameter, SensorPlace

_AHEAD = EffectParameter(name="x", unit="m", low=-5.0, high=5.0, initial_values=(0.2,), scale="surge/rate")

EFFECT: Effect = Effect(
    id="sensor_place",
    axes=("planar",),
    title="place of the velocity log",
    environmental=True,
    size_count=2,
    parameters=(_AHEAD, replace(_AHEAD, name="y")),
    equation="logged surge velocity = u − y·r, logged sway velocity = v + x·r",
    fingerprint="surge and sway velocity that follow the yaw rate at once",
    experiment="turns on the spot to both sides",
    rivals=("sway_yaw_damping", "current"),
    acts=SensorPlace(("surge_velocity", "sway_velocity")),
)
FORMS: tuple[Effect, ...] = ()
PLANAR_FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="antenna",
        title="place of the antenna",
        equation="logged north = n + x·cos ψ − y·sin ψ, logged east = e + x·sin ψ + y·cos ψ",
        fingerprint="a position that moves on a circle in a turn on the spot",
        acts=SensorPlace(("north", "east")),
    ),
)
