"""Drives without a bench curve: what is read, what is refused, and that a fit recovers the truth through each."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import ConfigError
from rovid.effects import effect_named
from rovid.preflight.advice import advise
from rovid.store.study import open_study
from rovid.trial.config import load_config
from rovid.trial.vehicle import ThrustCurve

SIGNALS = '[signals]\ntime = "t"\nheading = "psi"\nsurge_velocity = "u"\n'
MOTOR = '[[thrusters]]\nname = "motor"\ncommand = "x"\n'
CURRENT = f"{MOTOR}torque_constant = 4.0\nmax_command = 6.0\n{SIGNALS}"
PROPELLER = f"{MOTOR}yaw_arm = 0.4\nthrust_constant = 1e-5\nmax_command = 3000\n{SIGNALS}"
RUDDER = f'[[rudders]]\nname = "rudder"\nangle = "x"\ncoefficient = 40.0\n{SIGNALS}'
INERTIA, QUADRATIC, LINEAR = 300.0, 120.0, 15.0  # kg m^2, N m s^2/rad^2, N m s/rad


def torque_of(toml: str, command: float, speed: float) -> float:
    if toml == CURRENT:
        return 4.0 * command
    if toml == PROPELLER:
        return 0.4 * 1e-5 * command * abs(command)
    return 40.0 * speed**2 * float(np.radians(command))


def write(folder: Path, toml: str, size: float) -> Path:
    """A log of 300 s at 10 Hz, simulated in steps of 2 ms, with heading noise of 0.01 deg."""
    rng = np.random.default_rng(11)
    commands, speeds = np.repeat(rng.uniform(-size, size, 60), 50), np.repeat(rng.uniform(0.5, 1.5, 15), 200)
    rate, angle, rows = 0.0, 0.0, []
    for k, (command, speed) in enumerate(zip(commands.tolist(), speeds.tolist(), strict=True)):
        rows.append((0.1 * k, np.degrees(angle) + 0.01 * rng.standard_normal(), command, speed))
        torque = torque_of(toml, command, speed)
        for _ in range(50):
            before = rate
            rate += 0.002 / INERTIA * (torque - QUADRATIC * abs(rate) * rate - LINEAR * rate)
            angle += 0.001 * (before + rate)
    (folder / "rovid.toml").write_text(toml)
    np.savetxt(folder / "run.csv", rows, fmt="%.6f", delimiter=",", header="t,psi,x,u", comments="")
    return folder


@pytest.mark.parametrize(("toml", "size"), [(CURRENT, 5.0), (PROPELLER, 2000.0), (RUDDER, 30.0)])
def test_a_fit_recovers_the_truth(toml: str, size: float, tmp_path: Path) -> None:
    estimate = open_study([write(tmp_path, toml, size)]).likelihood().estimate
    for name, truth in (("inertia", INERTIA), ("quadratic_drag", QUADRATIC), ("linear_drag", LINEAR)):
        # 0.3 %: the simulation's own steps, and the points of the quadratic curve.
        assert estimate.value(name) == pytest.approx(truth, rel=3e-3, abs=4.0 * estimate.standard_error(name))


def test_a_rudder_without_a_coefficient_is_a_guess_of_scale(tmp_path: Path) -> None:
    study = open_study([write(tmp_path, RUDDER, 30.0)])
    (tmp_path / "rovid.toml").write_text(RUDDER.replace("coefficient = 40.0\n", ""))
    free = open_study([tmp_path])
    assert (study.vehicle.assumptions.listing, free.vehicle.assumptions.listing) == ("", "coefficient of rudder")
    assert free.vehicle.assumptions.ratios_hold
    # An inertia without a scale is not compared with that of mass and size.
    for one, kinds in ((study, ["scale"]), (free, [])):
        assert one.runs is not None
        vehicle = replace(one.vehicle, rigid_body_inertia=1e6)
        advice = advise([run.trial for run in one.runs.items], vehicle)
        assert [each.kind for each in advice if each.kind == "scale"] == kinds
    ratios = []
    for one in (study, free):
        estimate = one.likelihood().estimate
        ratios.append(estimate.value("inertia") / estimate.value("quadratic_drag"))
    assert ratios[1] == pytest.approx(ratios[0], rel=1e-4)  # The scale of the torque cancels.


def test_a_changed_coefficient_changes_the_fingerprint(tmp_path: Path) -> None:
    path = tmp_path / "rovid.toml"
    path.write_text(RUDDER)
    before = load_config(path).fingerprint
    path.write_text(RUDDER.replace("40.0", "50.0"))
    assert before.changes(load_config(path).fingerprint) == [
        "coefficient of rudder was 40, with surge_velocity and is 50, with surge_velocity"
    ]


def test_a_quadratic_curve_stays_near_its_parabola() -> None:
    curve = ThrustCurve.proportional(2.0, 50.0, 2)
    command = np.linspace(-50.0, 50.0, 1237)
    assert curve(0.0) == 0.0
    assert np.max(np.abs(curve(command) - 2.0 * command * np.abs(command))) < 2.6e-5 * 5000.0


@pytest.mark.parametrize(
    ("toml", "message"),
    [
        (CURRENT.replace("max_command = 6.0", ""), r"'motor': has torque_constant and no max_command"),
        (CURRENT.replace("max_command", "yaw_arm = 1.0\nmax_command"), "has torque_constant and yaw_arm; one of them"),
        (PROPELLER.replace("max_command", 'curve = "c.csv"\nmax_command'), "has thrust_constant and curve; one of"),
        (PROPELLER.replace("yaw_arm = 0.4", ""), "'motor': has no yaw_arm"),
        (PROPELLER.replace("1e-5", "-1e-5"), "thrust_constant: is -1e-05"),
        (RUDDER.replace("coefficient", "wheelbase = 0.3\ncoefficient"), "has a coefficient, as a rudder, and a"),
        (RUDDER.replace("40.0", "0"), "coefficient: is 0"),
        (RUDDER.replace('angle = "x"', ""), "'rudder': has no angle"),
        (RUDDER.replace('surge_velocity = "u"', ""), "needs the speed surge_velocity, which is not in"),
        (RUDDER.replace("surge_velocity", "north"), r'speed = "NAME"\. `--axes planar` estimates'),
        (RUDDER + 'torque = "n"\n', r"torque: is given in addition to \[\[thrusters\]\]"),
        ('[signals]\nheading = "h"\ntorque = "n"\nyaw_rate_order = "r"\n', "in addition to yaw_rate_order"),
    ],
)
def test_contradictions_are_refused(toml: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "rovid.toml").write_text(toml)
    with pytest.raises(ConfigError, match=message):
        load_config(tmp_path / "rovid.toml")


def test_unequal_friction_of_a_bench_is_a_form_of_an_effect() -> None:
    assert effect_named("coulomb_resistance:unequal").parameters[1].name == "back_torque"
