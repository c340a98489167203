"""An inertia below the rigid body's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rovid.faults.base import RunsData, examine
from rovid.faults.quick_model import fit_quick_model
from rovid.faults.thrust_unit import DETECTORS, inertia_fault
from rovid.trial.fault import Fault, FaultOverrides
from rovid.trial.vehicle import ThrustCurve, Thruster, Vehicle
from tests.conftest import slow
from tests.faults.days import VEHICLES, day, scaled
from tests.synthetic import LOGGED, VOLTS

UNITS = [(9.80665, "kgf"), (4.44822, "lbf"), (1000.0, "kN")]


def faults(vehicle: str, factor: float, ratio: float, seed: int) -> tuple[Fault, ...]:
    """Faults of a day whose torque is logged too small by ``factor``; total over rigid-body inertia is ``ratio``."""
    runs = []
    for run in day(vehicle, seed):
        torque = run.torque / factor
        filtered = run.rates.filter_held(run.trial, torque)
        runs.append(replace(run, torque=torque, filtered_torque=filtered))
    body = VEHICLES[vehicle][0].inertia / ratio
    known = replace(LOGGED, rigid_body_inertia=body)
    return examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=known), FaultOverrides())[1]


@pytest.mark.parametrize(
    ("vehicle", "factor", "unit", "seed"),
    [
        row
        if row in {("small", 9.80665, "kgf", 0), ("large", 4.44822, "lbf", 0), ("small", 1000.0, "kN", 0)}
        else slow(*row)
        for row in ((vehicle, *unit, seed) for vehicle in VEHICLES for unit in UNITS for seed in range(3))
    ],
)
def test_the_unit_is_named_and_stops(vehicle: str, factor: float, unit: str, seed: int) -> None:
    (fault,) = faults(vehicle, factor, 1.5, seed)
    assert fault.stops
    assert fault.remedy == "none"
    assert unit in fault.text
    assert fault.size == factor


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("ratio", [1.05, 1.5, 4.0])
@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_possible_inertia_gives_nothing(vehicle: str, ratio: float, seed: int) -> None:
    assert not faults(vehicle, 1.0, ratio, seed)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_thrust_that_a_dead_zone_hides_makes_no_inertia_impossible(vehicle: str) -> None:
    """Below half of the largest torque nothing is logged; another shape of the thrust makes the inertia possible."""
    runs = []
    for run in day(vehicle, 0):
        size = np.abs(run.torque)
        torque = np.sign(run.torque) * np.maximum(size - 0.5 * size.max(), 0.0)
        runs.append(replace(run, torque=torque, filtered_torque=run.rates.filter_held(run.trial, torque)))
    known = replace(LOGGED, rigid_body_inertia=VEHICLES[vehicle][0].inertia / 1.05)
    model = fit_quick_model(runs, known)
    assert model is not None
    assert model.inertia < 0.55 * VEHICLES[vehicle][0].inertia
    assert not examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=known), FaultOverrides())[1]


def test_a_fit_is_refused_only_where_its_error_leaves_no_doubt() -> None:
    vehicle = replace(LOGGED, rigid_body_inertia=100.0)
    fault = inertia_fault(60.0, 1.0, vehicle)
    assert fault is not None
    assert fault.stops
    assert fault.size == 2.0
    assert inertia_fault(60.0, 6.0, vehicle) is None
    assert inertia_fault(90.0, 0.1, vehicle) is None
    guessed = Vehicle(
        name="", thrusters=(Thruster(name="a", arm=1.0, curve=None, arm_guessed=True),), rigid_body_inertia=100.0
    )
    assert inertia_fault(10.0, 0.1, guessed) is None


@pytest.mark.parametrize(
    ("ratio", "fault", "size", "causes"),
    [
        (57.2958 * 1.5, "scaled_heading", 57.2958, ["radians that are taken for degrees"]),
        (180.0, "thrust_unit", 100.0, ["an arm in cm", "radians that are taken for degrees"]),
        (1500.0, "thrust_unit", 1000.0, ["an arm in mm", "a mass in t"]),
        (30.0, "thrust_unit", 30.0, ["the unit of thrust"]),
    ],
)
def test_an_inertia_that_no_water_explains_stops(ratio: float, fault: str, size: float, causes: list[str]) -> None:
    """Every unit that explains it is named."""
    vehicle = replace(LOGGED, rigid_body_inertia=100.0)
    found = inertia_fault(100.0 * ratio, 1.0, vehicle)
    assert found is not None
    assert (found.fault, found.stops) == (fault, True)
    assert found.size == pytest.approx(size)
    assert all(cause in found.text for cause in causes)
    assert inertia_fault(100.0 * ratio, 100.0 * ratio, vehicle) is None


@pytest.mark.parametrize(
    ("vehicle", "full", "fault"),
    [
        ("small", 10.0, "unit_mismatch"),
        ("large", 100.0, "thrust_unit"),
        slow("large", 10.0, "unit_mismatch"),
        slow("small", 100.0, "thrust_unit"),
    ],
)
def test_commands_that_use_a_tenth_of_the_curve_are_of_another_unit(vehicle: str, full: float, fault: str) -> None:
    """Volts up to 10 with a curve over percent; a curve a hundred times too weak is another fault."""
    largest = max(float(np.abs(run.torque).max()) for run in day(vehicle, 0))
    command = np.linspace(-100.0, 100.0, 81)
    weak = 1.0 if full < 100.0 else 0.01
    curve = ThrustCurve(command=command, thrust=weak * largest * np.sign(command) * (command / 100.0) ** 2)
    thruster = Thruster(name="fore", arm=1.0, curve=curve)
    runs = []
    for run in day(vehicle, 0):
        commands = full * np.sign(run.torque) * np.sqrt(np.abs(run.torque) / largest)
        torque = thruster.torque(commands)
        filtered = run.rates.filter_held(run.trial, torque)
        trial = replace(run.trial, commands=commands[:, np.newaxis])
        runs.append(replace(run, trial=trial, torque=torque, filtered_torque=filtered))
    known = Vehicle(name="v", thrusters=(thruster,), rigid_body_inertia=VEHICLES[vehicle][0].inertia / 1.5)
    (found,) = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=known), FaultOverrides())[1]
    assert (found.fault, found.stops) == (fault, True)
    assert ("The commands look like volts, the curve like percent." in found.text) == (fault == "unit_mismatch")


def test_a_thruster_with_the_wrong_sign_is_another_explanation() -> None:
    """Two thrusters that push one way each, by mirrored commands; the sign of the second one's arm is wrong."""
    arms = {"fore": 0.4, "aft": 0.35}
    vehicle = Vehicle(
        name="",
        thrusters=tuple(Thruster(name=name, arm=arm, curve=VOLTS) for name, arm in arms.items()),
        rigid_body_inertia=VEHICLES["small"][0].inertia / 1.5,
    )
    runs = []
    for one in day("small", 0):
        command = one.torque / 0.75 / 100.0
        trial = replace(one.trial, commands=np.column_stack((command, -command)))
        torque = vehicle.torque(trial)
        runs.append(replace(one, trial=trial, torque=torque, filtered_torque=one.rates.filter_held(trial, torque)))
    _, (fault,) = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=vehicle), FaultOverrides())
    assert fault.stops
    assert "the sign of yaw_arm or command of aft (with it turned around the inertia is 1." in fault.text


def test_two_vehicles_in_one_folder_are_another_explanation() -> None:
    """The inertia of all logs is below the rigid body's, which belongs to a third vehicle."""
    own = VEHICLES["small"][0]
    names = [run.trial.name for run in day("small", 0)][::2]
    mixed = day("small", 0, dict.fromkeys(names, scaled(own, 1.3, 1.0)), disturbance=0.005)
    vehicle = replace(LOGGED, rigid_body_inertia=2.5 * own.inertia)
    for runs, expected in ((mixed, True), (day("small", 0), False)):
        _, (fault,) = examine(DETECTORS["runs"], RunsData(runs=runs, vehicle=vehicle), FaultOverrides())
        assert ("logs of two vehicles in one folder (" in fault.text) == expected
