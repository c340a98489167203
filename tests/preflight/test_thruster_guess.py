"""Which columns are commands, by name, by an autopilot's mixer and by a type of vehicle."""

from __future__ import annotations

import numpy as np
import pytest

from rovid.core.array_types import FloatArray
from rovid.preflight.raw_columns import RawColumn, SignalGuess
from rovid.preflight.thruster_guess import GuessHints, ThrusterCommand, command_effects, guess_thrusters
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
def test_usual_names_are_known(names: tuple[str, str]) -> None:
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


def steered(seed: int, *, hand: bool) -> dict[str, RawColumn]:
    """A slow vehicle that an autopilot holds by a noisy compass, against eddies; or one that a ``hand`` steers."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 240.0, 0.1)
    heading, command = np.empty(len(time)), np.empty(len(time))
    asked = np.repeat(rng.uniform(-0.7, 0.7, 40), 60)
    place = rate = thrust = eddy = 0.0
    for k in range(len(time)):
        heading[k] = place + np.radians(0.3) * rng.normal()
        command[k] = asked[k] if hand else np.clip(-1.2 * heading[k] - 6.0 * rate, -0.7, 0.7)
        for _ in range(4):
            thrust += 0.0625 * (command[k] - thrust)
            eddy += -0.0125 * eddy + 0.0012 * rng.normal()
            rate += 0.025 * (0.075 * thrust + eddy - 0.58 * abs(rate) * rate - 0.075 * rate)
            place += 0.025 * rate
    return {
        "heading_deg": RawColumn(source="heading_deg", time=time, values=np.degrees(heading)),
        "yaw_cmd": RawColumn(source="yaw_cmd", time=time, values=command),
    }


@pytest.mark.parametrize("hand", [True, False])
def test_who_steers_does_not_turn_a_sense_round(hand: bool) -> None:
    heading = SignalGuess(source="heading_deg", reason="", unit="deg")
    found = [command_effects({"yaw_cmd": 0.0}, [steered(seed, hand=hand)], heading)["yaw_cmd"] for seed in range(6)]
    ways = [one.direction for one in found]
    assert ways.count(-1) <= (0 if hand else 2), found
    assert ways.count(1) >= 5 * hand


def test_what_tells_of_the_turning_is_shared_out() -> None:
    logs = [steered(1, hand=True)]
    heading = SignalGuess(source="heading_deg", reason="", unit="deg")
    idle = RawColumn(source="idle", time=logs[0]["yaw_cmd"].time, values=np.repeat(RNG.uniform(-1.0, 1.0, 40), 60))
    found = command_effects({"yaw_cmd": 0.0, "idle": 0.0}, [logs[0] | {"idle": idle}], heading)
    assert found["yaw_cmd"].direction == 1
    assert found["idle"].direction == 0
    assert found["yaw_cmd"].explained_share > 10.0 * abs(found["idle"].explained_share)
    assert "standard errors" in found["yaw_cmd"].text


def test_lights_and_what_never_rests_are_no_thrusters() -> None:
    pulses = {"RCOU.C1": held(1300.0, 1700.0), "RCOU.C2": held(1300.0, 1700.0), "RCOU.C10": held(1600.0, 1700.0)}
    lights = {"lights_pwm": held(1100.0, 1900.0), "camera_tilt_pwm": held(1100.0, 1900.0)}
    assert set(of(pulses | lights)) == {"RCOU.C1", "RCOU.C2"}


def test_the_autopilots_own_torque_tells_who_takes_part() -> None:
    one, two, depth = held(-100.0, 100.0), held(-100.0, 100.0), held(-100.0, 100.0)
    outputs = {"RCOU.C1": 1500.0 - one + two, "RCOU.C2": 1500.0 + one + two, "RCOU.C5": 1500.0 + depth}
    found = of({**outputs, "RATE.YOut": one / 400.0})
    assert {source: command.direction for source, command in found.items()} == {
        "RCOU.C1": -1,
        "RCOU.C2": 1,
        "RCOU.C5": 0,
    }


def test_a_type_of_vehicle_tells_sense_and_arm() -> None:
    found = commands(GuessHints(profile=load_preset("heron")), port_cmd=held(), stbd_cmd=held())
    assert {source: command.direction * command.arm for source, command in found.items()} == {
        "port_cmd": 0.378,
        "stbd_cmd": -0.378,
    }


def test_what_was_named_is_taken() -> None:
    assert set(commands(GuessHints(commands=("a", "b")), a=held(), b=held(), port_cmd=held())) == {"a", "b"}


def test_a_demand_of_motion_stands_back_behind_thrusters() -> None:
    assert set(commands(yaw_cmd_norm=held(), pwm1_us=held(1300.0, 1700.0))) == {"pwm1_us"}
    assert set(commands(yaw_cmd_norm=held())) == {"yaw_cmd_norm"}
