"""Guess of thruster commands by name, by the autopilot's mixer and by type of vehicle."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.preflight.raw_columns import RawColumn
from rovid.preflight.thruster_guess import GuessHints, ThrusterCommand, guess_thrusters
from rovid.trial.vehicle_presets import load_preset

TIME = np.arange(0.0, 60.0, 0.1)
RNG = np.random.default_rng(5)


def held(low: float = -1.0, high: float = 1.0) -> FloatArray:
    return np.repeat(RNG.uniform(low, high, 20), 30)


def commands(wanted: GuessHints | None = None, **columns: FloatArray) -> dict[str, ThrusterCommand]:
    return of({name.replace("__", "."): values for name, values in columns.items()}, wanted)


def of(columns: dict[str, FloatArray], wanted: GuessHints | None = None) -> dict[str, ThrusterCommand]:
    log = {name: RawColumn(source=name, time=TIME, values=values) for name, values in columns.items()}
    found = guess_thrusters({name: [seen] for name, seen in log.items()}, [log], None, wanted or GuessHints())
    return {one.source: one for one in found}


@pytest.mark.parametrize(
    "names",
    [
        ("port", "stbd"), ("T1", "T2"), ("u1", "u2"), ("M1", "M2"), ("port_rpm", "starboard_rpm"), ("thr_1", "thr_2"),
        ("Schub links", "Schub rechts"), ("moteur_bâbord", "moteur_tribord"), ("fore_V", "aft_V"), ("left", "right"),
        ("RCIN.C1", "RCIN.C2"), ("ch1_us", "ch2_us"), ("Bugstrahlruder", "Heckstrahlruder"),
        ("Bugstrahl", "Heckstrahl"),
        ("Drehzahl Backbord", "Drehzahl Steuerbord"), ("propulseur étrave", "propulseur poupe"),
        ("tension_bâbord", "tension_tribord"), ("baugthruster", "hekkthruster"), ("elica_sinistra", "elica_dritta"),
        ("hélice babor", "hélice estribor"),
    ],
)  # fmt: skip
def test_common_names_are_recognised(names: tuple[str, str]) -> None:
    rates = {"thr.taux_de_giration_dps": held(), "thr.drehrate_dps": held(), "thr.lacet (°/s)": held()}
    other = {
        **rates,
        "thr.lacet_deg": held(),
        "thr.compass_rad": held(),
        "t": TIME,
        "port_temp": held(),
        "stbd_current": held(),
        "port_amps_A": held(),
        "depth": held(),
    }
    assert set(of({**other, names[0]: held(), names[1]: held()})) == set(names)


def test_lights_and_outputs_without_a_neutral_value_are_no_thrusters() -> None:
    pulses = {"RCOU.C1": held(1300.0, 1700.0), "RCOU.C2": held(1300.0, 1700.0), "RCOU.C10": held(1600.0, 1700.0)}
    lights = {"lights_pwm": held(1100.0, 1900.0), "camera_tilt_pwm": held(1100.0, 1900.0)}
    assert set(of(pulses | lights)) == {"RCOU.C1", "RCOU.C2"}


def test_the_yaw_demand_of_the_autopilot_determines_the_directions() -> None:
    one, two, depth = held(-100.0, 100.0), held(-100.0, 100.0), held(-100.0, 100.0)
    outputs = {"RCOU.C1": 1500.0 - one + two, "RCOU.C2": 1500.0 + one + two, "RCOU.C5": 1500.0 + depth}
    found = of({**outputs, "RATE.YOut": one / 400.0})
    assert {source: command.direction for source, command in found.items()} == {
        "RCOU.C1": -1,
        "RCOU.C2": 1,
        "RCOU.C5": 0,
    }


def test_a_type_of_vehicle_determines_direction_and_arm() -> None:
    found = commands(GuessHints(profile=load_preset("heron")), port_cmd=held(), stbd_cmd=held())
    assert {source: command.direction * command.arm for source, command in found.items()} == {
        "port_cmd": 0.378,
        "stbd_cmd": -0.378,
    }


def test_named_commands_are_used() -> None:
    assert set(commands(GuessHints(commands=("a", "b")), a=held(), b=held(), port_cmd=held())) == {"a", "b"}


def test_thruster_commands_are_preferred_to_motion_commands() -> None:
    assert set(commands(yaw_cmd_norm=held(), pwm1_us=held(1300.0, 1700.0))) == {"pwm1_us"}
    assert set(commands(yaw_cmd_norm=held())) == {"yaw_cmd_norm"}
