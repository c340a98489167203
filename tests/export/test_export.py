"""Each format, read by an independent parser and integrated, equals rovid's model; losses are reported."""

from __future__ import annotations

import json
import math
import re
import runpy
import struct
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from scipy.integrate import solve_ivp
from scipy.io import loadmat

from rovid.core.array_types import FloatArray
from rovid.export import FORMATS
from rovid.export.interface import export_input
from rovid.export.verification import compare_motions, verification_commands
from rovid.store.load import read_parameters
from rovid.trial.config import load_config
from rovid.trial.trial import Trial
from rovid.trial.vehicle import Vehicle
from tests.conftest import SAMPLES, Rovid, run_rovid, write_short_day

# s; commands of the tests' own manoeuvre are held so long, in V.
HOLD = 2.0
COMMANDS = np.repeat([0.0, 1.9, 1.9, 1.2, 0.0, 0.0, -2.0, -2.4, 0.0, 1.0, -1.0, 1.6, -1.7, 0.4, -0.5, 0.0], 4)
ALLOWED = 0.1  # % of the range of the yaw rate: the promise
# Sizes as diagnoses of ROSUB-like vehicles give them.
SIZES: dict[str, dict[str, float]] = {
    "thruster_lag": {"time_constant": 0.8},
    "thruster_lag:command": {"time_constant": 0.8},
    "thruster_lag:rotor": {"time_constant": 0.8},
    "command_delay": {"delay": 0.4},
    "thruster_deadband": {"deadband": 0.2},
    "thruster_deadband:jump": {"deadband": 0.3, "edge": 0.1},
    "thrust_asymmetry": {"reverse_gain": 0.8},
    "thrust_curve_shape": {"exponent": 0.9},
    "thruster_imbalance:aft": {"gain": 0.8},
    "drag_curvature": {"cubic": 2000.0},
    "drag_asymmetry": {"ratio": 1.2},
    "bias_torque": {"torque": 8.0},
    "tether_torsion": {"stiffness": 3.0},
    "coulomb_resistance": {"torque": 6.0, "rate": 0.02},
    "added_mass_memory": {"inertia": 800.0, "time_constant": 2.0},
}
CURVE = ("thruster_deadband", "thrust_asymmetry", "thrust_curve_shape", "thruster_imbalance:aft")
LAGS = ("thruster_lag", "thruster_lag:command")
HELD: dict[str, tuple[str, ...]] = {
    "gz-sim": CURVE,
    "vrx": CURVE,
    "uuv": (*CURVE, *LAGS),
    "mujoco": (*CURVE, "thruster_lag", "command_delay", "drag_curvature", "bias_torque", "tether_torsion"),
    "python-vehicle-simulator": (*CURVE, *LAGS, "drag_curvature", "drag_asymmetry", "bias_torque", "tether_torsion"),
    "mss": (*CURVE, "drag_curvature", "drag_asymmetry", "bias_torque", "tether_torsion"),
    "ros2": tuple(SIZES),
    "matlab": tuple(SIZES),
    "json": tuple(SIZES),
}
Curves = tuple[tuple[FloatArray, FloatArray], ...]


@dataclass(frozen=True, kw_only=True)
class Read:
    """Numbers of a file in its own axes; ``up`` is 1 if its yaw grows with the heading, else -1."""

    inertia: float
    damping: tuple[float, float, float]
    arms: tuple[float, ...]
    curves: Curves
    up: float
    bias: float = 0.0
    stiffness: float = 0.0
    command_lag: float = 0.0
    thrust_lag: float = 0.0
    delay: float = 0.0


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The parameter file of three trials."""
    path = tmp_path_factory.mktemp("fitted") / "parameters.toml"
    write_short_day(path.parent / "day", runs=("hold_03", "hold_05", "sine_40s_a"))
    for command in (["fit-drag", path.parent / "day"], ["fit-inertia"]):
        assert run_rovid(*command, "-p", path).code == 0
    return path


def with_effects(fitted: Path, keys: tuple[str, ...], folder: Path) -> Path:
    document = tomllib.loads(fitted.read_text())
    document["logs"] = [str(fitted.parent / "day")]
    for key in keys:
        for name, value in SIZES[key].items():
            entry = {"value": value, "standard_error": 0.01 * value, "unit": "", "method": "test"}
            document["parameters"][f"{key}.{name}"] = entry
    path = folder / "effects.toml"
    path.write_text(tomli_w.dumps(document))
    return path


def exported(name: str, parameters: Path, folder: Path, suffix: str = ".out") -> tuple[dict[str, Any], Path]:
    file = folder / f"{name}{suffix}"
    return run_rovid("export", name, "-p", parameters, "-o", file, "--json").document, file


def floats(text: str | None) -> FloatArray:
    assert text is not None
    return np.array([float(word) for word in text.split()])


def value(root: ET.Element, path: str) -> float:
    return float(root.findtext(path) or "nan")


def comments(file: Path) -> Curves:
    """Thrust curves in the comments of an SDF, command by command."""
    texts = [element.text or "" for _, element in ET.iterparse(file, events=("comment",))]
    texts = [text for text in texts if " | thrust " in text]
    parts = [text.replace("- -", "--").partition(": command ")[2].partition(" | thrust ") for text in texts]
    return tuple((floats(command), floats(thrust)) for command, _, thrust in parts)


def read_sdf(file: Path) -> Read:
    root = ET.parse(file).getroot()
    model = root.find("model")
    assert model is not None
    link = next(e for e in model.findall("link") if e.get("name") == "base_link")
    plugins = model.findall("plugin")
    water = next(p for p in plugins if "ydrodynamics" in str(p.get("name")))
    # gz-sim adds what it reads, VRX takes it off.
    sign = -1.0 if water.find("nRabsR") is not None else 1.0
    quadratic = value(water, "nRabsR" if sign < 0.0 else "nRR")
    added = sum(float(e.text or 0) for e in link.findall("inertial/fluid_added_mass/rr"))
    arms, bands, limits = [], [], []
    for plugin in plugins:
        if plugin is water:
            continue
        joint = next(e for e in model.findall("joint") if e.get("name") == plugin.findtext("joint_name"))
        child = next(e for e in model.findall("link") if e.get("name") == joint.findtext("child"))
        place, axis = floats(child.findtext("pose"))[:3], floats(joint.findtext("axis/xyz"))
        arms.append(float(np.cross(place, axis)[2]))
        bands.append(float(plugin.findtext("deadband") or 0.0))
        limits.append((value(plugin, "min_thrust_cmd"), value(plugin, "max_thrust_cmd")))
    curves = []
    for (command, thrust), band, (low, high) in zip(comments(file), bands, limits, strict=True):
        fine = np.union1d(command, np.linspace(command[0], command[-1], 50_001))
        given = np.clip(np.interp(fine, command, thrust), low, high)
        curves.append((fine, np.where(np.abs(given) < band, 0.0, given)))
    # VRX's added inertia is positive; gz-sim's would be negative, and is in the fluid instead.
    added += float(water.findtext("nDotR") or 0.0)
    return Read(
        inertia=value(link, "inertial/inertia/izz") + added,
        damping=(sign * value(water, "nR"), sign * quadratic, 0.0),
        arms=tuple(arms),
        curves=tuple(curves),
        up=-1.0,
    )


def read_uuv(file: Path) -> Read:
    root = ET.parse(file).getroot()
    water = root.find(".//hydrodynamic_model")
    inertia = root.find("link/inertial/inertia")
    assert water is not None
    assert inertia is not None
    arms, curves, lags, newtons = [], [], [], False
    for plugin, table in zip(root.findall("gazebo/plugin")[1:], comments(file), strict=True):
        joint = next(e for e in root.findall("joint") if e.get("name") == plugin.findtext("jointName"))
        origin = joint.find("origin")
        assert origin is not None
        (x, _, _), (_, _, yaw) = floats(origin.get("xyz")), floats(origin.get("rpy"))
        arms.append(float(x * math.sin(yaw)))
        # A thruster pushes along its own x axis.
        inputs, outputs = (floats(plugin.findtext(f"conversion/{n}Values")) for n in ("input", "output"))
        newtons = np.array_equal(inputs, outputs)
        curves.append(table if newtons else (inputs, outputs))
        lags.append(float(plugin.findtext("dynamics/timeConstant") or 0.0))
    lag = lags[0]
    return Read(
        inertia=float(inertia.get("izz") or "nan") + floats(water.findtext("added_mass")).reshape(6, 6)[5, 5],
        damping=(-floats(water.findtext("linear_damping"))[5], -floats(water.findtext("quadratic_damping"))[5], 0.0),
        arms=tuple(arms),
        curves=tuple(curves),
        up=-1.0,
        thrust_lag=lag if newtons else 0.0,
        command_lag=0.0 if newtons else lag,
    )


def read_mujoco(file: Path) -> Read:
    root = ET.parse(file).getroot()
    joint, inertial = root.find(".//joint"), root.find(".//inertial")
    assert joint is not None
    assert inertial is not None
    tables = {str(e.get("name")): floats(e.get("data")) for e in root.findall("custom/numeric")}
    actuators = root.findall("actuator/general")
    pushing = [a for a in actuators if a.get("biastype") is None]
    damping = floats(joint.get("damping"))
    return Read(
        inertia=floats(inertial.get("diaginertia"))[2],
        damping=(damping[0], damping[1], damping[2]),
        arms=tuple(float(a.get("gear") or 1.0) for a in pushing),
        curves=tuple((tables[f"{a.get('name')}_command"], tables[f"{a.get('name')}_thrust"]) for a in pushing),
        up=-1.0,
        bias=sum(floats(a.get("biasprm"))[0] for a in actuators if a not in pushing),
        stiffness=float(joint.get("stiffness") or 0.0),
        thrust_lag=float(pushing[0].get("dynprm") or 0.0),
        delay=float(pushing[0].get("delay") or 0.0),
    )


def of_tables(base: Mapping[str, Any], thrusters: list[Mapping[str, Any]]) -> Read:
    return Read(
        inertia=float(base["inertia"]),
        damping=(float(base["linear_drag"]), float(base["quadratic_drag"]), 0.0),
        arms=tuple(float(t["yaw_arm"]) for t in thrusters),
        curves=tuple((np.array(t["command"]), np.array(t["thrust"])) for t in thrusters),
        up=1.0,
    )


def read_ros2(file: Path) -> Read:
    yaml = pytest.importorskip("yaml")
    found = yaml.safe_load(file.read_text())["/**"]["ros__parameters"]
    return of_tables(found, [found[f"thruster_{k}"] for k in range(len(found["thruster_names"]))])


def read_matlab(file: Path) -> Read:
    found = loadmat(str(file), simplify_cells=True)["rovid"]
    return of_tables(found, list(found["thrusters"]))


def read_json(file: Path) -> Read:
    found = json.loads(file.read_text())
    return of_tables({name: entry["value"] for name, entry in found["parameters"].items()}, found["thrusters"])


READERS: dict[str, tuple[Callable[[Path], Read], str]] = {
    "gz-sim": (read_sdf, ".sdf"),
    "vrx": (read_sdf, ".sdf"),
    "uuv": (read_uuv, ".xacro"),
    "mujoco": (read_mujoco, ".xml"),
    "ros2": (read_ros2, ".yaml"),
    "matlab": (read_matlab, ".mat"),
    "json": (read_json, ".json"),
}


def simulated(read: Read, grid: float = HOLD) -> FloatArray:
    """(n,) yaw rate in rovid's sign at the start of each command, by an adaptive integrator."""
    count, inertia = len(read.arms), read.inertia
    linear, quadratic, cubic = read.damping
    state, rates = np.zeros(2 + count), []
    late = read.delay

    def motion(_: float, x: FloatArray, command: float, steady: FloatArray) -> FloatArray:
        r, psi, inner = x[0], x[1], x[2:]
        dx = np.zeros(2 + count)
        if read.thrust_lag > 0.0:
            thrust, dx[2:] = inner, (steady - inner) / read.thrust_lag
        elif read.command_lag > 0.0:
            thrust = np.array([np.interp(u, *curve) for u, curve in zip(inner, read.curves, strict=True)])
            dx[2:] = (command - inner) / read.command_lag
        else:
            thrust = steady
        drag = linear * r + quadratic * abs(r) * r + cubic * r**3
        dx[0] = (float(np.dot(read.arms, thrust)) + read.bias - drag - read.stiffness * psi) / inertia
        dx[1] = r
        return dx

    before = 0.0
    for command in COMMANDS:
        rates.append(state[0])
        for length, acting in ((late, before), (grid - late, command)):
            if length > 0.0:
                steady = np.array([np.interp(acting, *curve) for curve in read.curves])
                done = solve_ivp(motion, (0.0, length), state, args=(acting, steady), rtol=1e-8, atol=1e-10)
                state = done.y[:, -1]
        before = command
    return read.up * np.array(rates)


def rovid_rates(parameters: Path) -> FloatArray:
    """(n,) yaw rate of rovid's model under the commands of the tests."""
    model, vehicle = read_parameters(parameters).model(), sample_vehicle()
    parts = 200  # a log's rate: what acts between samples is then resolved
    commands = np.repeat(COMMANDS, parts)
    time = (HOLD / parts) * np.arange(len(commands), dtype=np.float64)
    trial = Trial.from_commands(time, np.column_stack([commands] * len(vehicle.thrusters)))
    return model.simulate(trial, model.torque_input(vehicle, trial))[0][::parts]


def sample_vehicle() -> Vehicle:
    return load_config(SAMPLES / "rosub_tank" / "rovid.toml").vehicle


def percent(theirs: FloatArray, ours: FloatArray) -> float:
    return float(100.0 * np.max(np.abs(theirs - ours)) / np.ptp(ours))


@pytest.mark.parametrize("name", READERS)
def test_the_file_reproduces_the_motion_of_rovid(name: str, fitted: Path, tmp_path: Path) -> None:
    reader, suffix = READERS[name]
    document, file = exported(name, fitted, tmp_path, suffix)
    assert document["schema"] == "rovid-export/1"
    assert (document["format"], document["file"], document["not_held"]) == (name, str(file), [])
    assert document["mismatch"]["unit"] == "rad/s"
    assert document["mismatch"]["yaw_rate_percent_of_range"] < ALLOWED
    read = reader(file)
    ours = rovid_rates(fitted)
    assert percent(simulated(read), ours) < ALLOWED
    # What would be wrong is seen: a sign of the thrust, of the drag, and an inertia counted twice.
    for wrong in (
        replace(read, arms=tuple(-arm for arm in read.arms)),
        replace(read, up=-read.up),
        replace(read, damping=(-read.damping[0], *read.damping[1:])),
        replace(read, inertia=1.05 * read.inertia),
    ):
        assert percent(simulated(wrong), ours) > 10.0 * ALLOWED


@pytest.mark.parametrize(
    ("name", "key"), [(name, key) for name in ("gz-sim", "vrx", "uuv", "mujoco") for key in HELD[name]]
)
def test_a_kept_effect_acts_in_the_file(name: str, key: str, fitted: Path, tmp_path: Path) -> None:
    reader, suffix = READERS[name]
    parameters = with_effects(fitted, (key,), tmp_path)
    document, file = exported(name, parameters, tmp_path, suffix)
    assert document["not_held"] == []
    assert document["mismatch"]["yaw_rate_percent_of_range"] < ALLOWED
    assert percent(simulated(reader(file)), rovid_rates(parameters)) < ALLOWED


def test_a_sharp_dead_band_is_written_to_the_thruster_plugin(fitted: Path, tmp_path: Path) -> None:
    parameters = with_effects(fitted, ("thruster_deadband:jump",), tmp_path)
    document, file = exported("gz-sim", parameters, tmp_path, ".sdf")
    assert document["not_held"] == []
    assert document["mismatch"]["yaw_rate_percent_of_range"] < ALLOWED
    bands = [float(e.text or 0) for e in ET.parse(file).getroot().iter("deadband")]
    vehicle = sample_vehicle()
    # The dead zone of the bench ends at about 0.3 V on both sides; the weaker direction counts.
    bench = vehicle.thrust(np.array([[0.6, 0.6], [-0.6, -0.6]]))
    assert bands == pytest.approx([float(np.min(np.abs(bench)))] * 2, rel=0.15)


@pytest.mark.parametrize(
    ("name", "key"),
    [
        (name, key)
        for name in ("gz-sim", "vrx", "uuv", "mujoco", "python-vehicle-simulator")
        for key in ("thruster_lag:rotor", "bias_torque", "coulomb_resistance")
        if key not in HELD[name]
    ],
)
def test_a_lost_effect_is_reported_with_its_size(name: str, key: str, fitted: Path, tmp_path: Path) -> None:
    document, _ = exported(name, with_effects(fitted, (key,), tmp_path), tmp_path)
    lost = document["not_held"]
    assert [entry["what"] for entry in lost] == [key]
    assert lost[0]["why"]
    # All that is wrong with the file is what it does not hold.
    whole = document["mismatch"]["yaw_rate_percent_of_range"]
    assert lost[0]["yaw_rate_percent_of_range"] == pytest.approx(whole, abs=ALLOWED)
    assert whole > 5.0 * ALLOWED
    assert document["mismatch_of_what_is_held"]["yaw_rate_percent_of_range"] < ALLOWED


def test_stonefish_reports_the_error_of_its_drag(fitted: Path, tmp_path: Path) -> None:
    document, file = exported("stonefish", fitted, tmp_path, ".scn")
    lost = document["not_held"]
    assert [entry["what"] for entry in lost] == ["quadratic_drag"]
    assert "no |r|*r" in lost[0]["why"]
    told = document["mismatch"]["yaw_rate_percent_of_range"]
    assert lost[0]["yaw_rate_percent_of_range"] == told
    assert ALLOWED < told < 5.0
    root = ET.parse(file).getroot()
    body = root.find("robot/base_link")
    assert body is not None
    attributes = {e.tag: e.attrib for e in body}
    form, friction = box_integrals(floats(attributes["dimensions"]["xyz"]))
    cubic = 0.5 * 1025.0 * floats(attributes["hydrodynamics"]["quadratic_drag"])[2] * form
    linear = 1025.0 * floats(attributes["hydrodynamics"]["viscous_drag"])[2] * friction
    arms, curves = [], []
    for actuator in root.findall("robot/actuator"):
        origin = actuator.find("origin")
        assert origin is not None
        arms.append(float(floats(origin.get("xyz"))[0] * math.sin(floats(origin.get("rpy"))[2])))
        table = [actuator.find(f"thrust_model/{what}") for what in ("input", "output")]
        inputs, outputs = (floats(None if e is None else e.get("value")) for e in table)
        curves.append((inputs, outputs))
    inertia = float(floats(attributes["inertia"]["xyz"])[2])
    read = Read(inertia=inertia, damping=(linear, 0.0, cubic), arms=tuple(arms), curves=tuple(curves), up=1.0)
    assert percent(simulated(read), rovid_rates(fitted)) == pytest.approx(told, abs=1.0)  # percent; its mesh is coarser


def box_integrals(size: FloatArray, cells: int = 200) -> tuple[float, float]:
    """Form drag over r^3 and friction over r of a box turning about z, from the definition, on a fine grid.

    Stonefish's own mesh is coarser, by some percent.
    """
    half = size / 2.0
    form = friction = 0.0
    for axis in (0, 1):
        other = 1 - axis
        area = size[other] * size[2] / cells
        along = (np.arange(cells) + 0.5) / cells * size[other] - half[other]
        reach = np.hypot(along, half[axis])
        # Rate one: the speed is the reach, the normal speed the distance along the face.
        facing = np.maximum(along, 0.0)
        form += 2.0 * float(np.sum(reach**2 * reach * facing * area))
        friction += 2.0 * float(half[axis] ** 2 * area * cells)
    x, y = np.meshgrid(*((np.arange(cells) + 0.5) / cells * size[k] - half[k] for k in (0, 1)))
    friction += 2.0 * float(np.mean(x**2 + y**2)) * size[0] * size[1]
    return form, friction


@pytest.mark.parametrize("keys", [(), HELD["mujoco"][4:], ("thruster_lag",), ("command_delay",)])
def test_mujoco_in_its_own_engine(keys: tuple[str, ...], fitted: Path, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", minversion="3.7")
    parameters = with_effects(fitted, keys, tmp_path)
    document, file = exported("mujoco", parameters, tmp_path, ".xml")
    assert document["not_held"] == []
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    curves = read_mujoco(file).curves
    rates = []
    for command in COMMANDS:
        rates.append(float(data.qvel[0]))
        data.ctrl[: len(curves)] = [np.interp(command, *curve) for curve in curves]
        for _ in range(round(HOLD / model.opt.timestep)):
            mujoco.mj_step(model, data)
    # z is up there.
    ours = rovid_rates(parameters)
    assert percent(-np.array(rates), ours) < ALLOWED
    assert percent(np.array(rates), ours) > 50.0


@pytest.mark.parametrize("keys", [(), *((key,) for key in HELD["mss"])])
def test_the_function_for_mss_holds_its_effects_and_lists_a_lag(
    keys: tuple[str, ...], fitted: Path, tmp_path: Path
) -> None:
    document, file = exported("mss", with_effects(fitted, (*keys, "thruster_lag"), tmp_path), tmp_path, ".m")
    assert [loss["what"] for loss in document["not_held"]] == ["thruster_lag"]
    assert document["mismatch"]["yaw_rate_percent_of_range"] > 5.0 * ALLOWED
    assert document["mismatch_of_what_is_held"]["yaw_rate_percent_of_range"] < ALLOWED
    if not keys:
        # The numbers by their SNAME names: a derivative is minus the parameter.
        numbers = dict(re.findall(r"^(\w+) = ([-+.\de]+);", file.read_text(), re.MULTILINE))
        entries = read_parameters(fitted).entries
        assert float(numbers["Nrr"]) == -entries["quadratic_drag"].value
        assert float(numbers["Iz"]) - float(numbers["Nrdot"]) == pytest.approx(entries["inertia"].value)


@pytest.mark.parametrize("keys", [(), *((key,) for key in HELD["python-vehicle-simulator"])])
def test_the_python_class_in_a_main_loop(keys: tuple[str, ...], fitted: Path, tmp_path: Path) -> None:
    parameters = with_effects(fitted, keys, tmp_path)
    document, file = exported("python-vehicle-simulator", parameters, tmp_path, ".py")
    assert document["not_held"] == []
    space: dict[str, Any] = {}
    exec(compile(file.read_text(), str(file), "exec"), space)  # noqa: S102 - the file under test is a module
    vehicle = space["RovidVehicle"]()
    assert len(vehicle.stepInput(0.0)) == vehicle.dimU == len(vehicle.controls)
    assert {"L", "name", "controlMode", "controlDescription"} <= set(vars(vehicle))
    opposed = space["RovidVehicle"]()
    opposed.thrusters = [(arm * sign, *rest) for sign, (arm, *rest) in zip((1.0, -1.0), opposed.thrusters, strict=True)]
    ahead, astern = opposed.stepInput(20.0)  # Both turn the vehicle the same way.
    assert ahead > 0.0 > astern
    step, rates = 0.02, []
    eta, nu, actual = np.zeros(6), vehicle.nu, vehicle.u_actual
    for command in COMMANDS:
        rates.append(float(nu[5]))
        for _ in range(round(HOLD / step)):
            nu, actual = vehicle.dynamics(eta, nu, actual, np.full(vehicle.dimU, command), step)
            eta[5] += step * nu[5]
    assert percent(np.array(rates), rovid_rates(parameters)) < ALLOWED


def test_formats_with_rovids_equation_keep_every_effect(fitted: Path, tmp_path: Path) -> None:
    keys = tuple(SIZES)
    parameters = with_effects(fitted, keys, tmp_path)
    files = {}
    for name in ("ros2", "matlab", "json"):
        document, files[name] = exported(name, parameters, tmp_path, READERS[name][1])
        assert document["not_held"] == []
        assert document["mismatch"]["yaw_rate_percent_of_range"] == 0.0
    found = json.loads(files["json"].read_text())
    assert {e["key"]: {n: v["value"] for n, v in e["parameters"].items()} for e in found["effects"]} == SIZES
    stored = loadmat(str(files["matlab"]), simplify_cells=True)["rovid"]["effects"]
    assert stored["thruster_lag_rotor"]["time_constant"] == SIZES["thruster_lag:rotor"]["time_constant"]
    assert files["json"].suffix == ".json"


def test_signs_are_those_of_each_simulator(fitted: Path, tmp_path: Path) -> None:
    made = {name: exported(name, fitted, tmp_path, f"_{name}") for name in ("gz-sim", "vrx", "uuv")}
    files = {name: file for name, (_, file) in made.items()}
    text = {name: file.read_text() for name, file in files.items()}
    # Without buoyancy the vehicle sinks: the first note and the file give the volume, of water of 1000 kg/m^3.
    for name, system in (("gz-sim", "Buoyancy system"), ("vrx", "PolyhedraBuoyancyDrag")):
        sinks = made[name][0]["warnings"][0]
        assert "2.604 m^3" in sinks
        assert system in sinks
        assert f"<!-- {sinks} -->" in text[name]
    drag = read_parameters(fitted).entries["quadratic_drag"].value
    assert f"<nRabsR>{-drag:.10g}</nRabsR>" in text["gz-sim"]
    assert "<nDotR>" not in text["gz-sim"]
    assert f"<nRR>{drag:.10g}</nRR>" in text["vrx"]
    assert f"<quadratic_damping>0 0 0 0 0 {-drag:.10g}<" in text["uuv"]
    gz = ET.parse(files["gz-sim"]).getroot()
    assert value(gz, "model/link/inertial/inertia/izz") == pytest.approx(sample_vehicle().rigid_body_inertia or 0.0)
    assert value(gz, "model/link/inertial/fluid_added_mass/rr") > 0.0


@pytest.mark.parametrize("certain", [True, False])
def test_a_constant_torque_is_printed_as_a_trim_that_cancels_it(certain: bool, fitted: Path, tmp_path: Path) -> None:
    parameters = with_effects(fitted, ("bias_torque",), tmp_path)
    if not certain:
        stored = tomllib.loads(parameters.read_text())
        stored["parameters"]["bias_torque.torque"]["standard_error"] = 5.0
        parameters.write_text(tomli_w.dumps(stored))
    document, _ = exported("json", parameters, tmp_path)
    (trim,) = (text for text in document["warnings"] if "trim" in text)
    assert ("do not distinguish this torque from zero" not in trim) == certain
    thrusts = {name: float(size) for name, size in re.findall(r"(\w+) by ([-+][\d.]+) N", trim)}
    assert thrusts.keys() == {thruster.name for thruster in sample_vehicle().thrusters}
    torque = sum(thruster.arm * thrusts[thruster.name] for thruster in sample_vehicle().thrusters)
    assert torque == pytest.approx(-8.0, rel=0.002)  # three digits are printed


def test_uuv_controllers_get_a_yaml(fitted: Path, tmp_path: Path) -> None:
    yaml = pytest.importorskip("yaml")
    _, file = exported("uuv", fitted, tmp_path, ".yaml")
    found, entries = yaml.safe_load(file.read_text()), read_parameters(fitted).entries
    assert found["inertial"]["izz"] + found["Ma"][5][5] == pytest.approx(entries["inertia"].value)
    assert found["quad_damping"][5] == pytest.approx(-entries["quadratic_drag"].value)
    assert found["linear_damping"][5] == pytest.approx(-entries["linear_drag"].value)


@pytest.mark.slow
def test_an_export_without_logs_reports_its_assumptions(fitted: Path, tmp_path: Path) -> None:
    alone = tmp_path / "alone.toml"
    document = tomllib.loads(fitted.read_text()) | {"logs": ["gone"]}
    alone.write_text(tomli_w.dumps(document))
    for name in FORMATS:
        document, _ = exported(name, alone, tmp_path)
        assert any("largest yaw rate of 0.3 rad/s is assumed" in text for text in document["warnings"])
        if name not in {"stonefish", "ardupilot", "px4"}:
            assert document["mismatch"]["yaw_rate_percent_of_range"] < ALLOWED
    document, file = exported("gz-sim", alone, tmp_path)
    assert any("rigid-body inertia is not known" in text for text in document["warnings"])
    assert read_sdf(file).inertia == pytest.approx(read_parameters(fitted).model().inertia)
    alone.write_text(tomli_w.dumps(tomllib.loads(fitted.read_text()) | {"logs": []}))
    document, _ = exported("gz-sim", alone, tmp_path)
    assert any("largest yaw rate of 0.3 rad/s is assumed" in text for text in document["warnings"])


@pytest.mark.parametrize("name", FORMATS)
def test_a_file_with_guessed_values_carries_a_notice(name: str, fitted: Path, tmp_path: Path) -> None:
    document = tomllib.loads(fitted.read_text())
    document["logs"] = []
    document["rests_on"]["guessed"] = ["yaw_arm of --> fore"]
    path = tmp_path / "guessed.toml"
    path.write_text(tomli_w.dumps(document))
    refused = run_rovid("export", name, "-p", path, "-o", tmp_path / "out")
    assert refused.code == 2
    assert "depends on values guessed by rovid init" in refused.err
    file = tmp_path / f"{name}.out"
    assert run_rovid("export", name, "-p", path, "-o", file, "--force").code == 0
    mark = b'"guessed": [' if name == "json" else b"PLACEHOLDERS: arms or thrust curves are guesses."
    assert mark in file.read_bytes()
    # It is known as rovid's own still.
    assert run_rovid("export", name, "-p", path, "-o", file, "--force", "--json").document["guessed"]


AUTOPILOT_NAMES = {
    "ardupilot": {"ATC_ANG_YAW_P", *(f"ATC_RAT_YAW_{key}" for key in ("P", "I", "D", "IMAX", "FLTT", "FLTE", "FLTD"))},
    "px4": {"UUV_YAW_P", "UUV_YAW_D"},
}


@pytest.mark.parametrize("name", AUTOPILOT_NAMES)
def test_an_autopilot_gets_gains_with_their_margins_and_a_trim(name: str, fitted: Path, tmp_path: Path) -> None:
    keys = ("bias_torque", "thruster_lag")
    document, file = exported(name, with_effects(fitted, keys, tmp_path), tmp_path)
    text = file.read_text()
    lines = [line.removeprefix("param set ").replace(",", " ") for line in text.splitlines() if line[0] != "#"]
    found = {line.split()[0]: float(line.split()[1]) for line in lines}
    assert set(found) == AUTOPILOT_NAMES[name]
    assert all(0.0 <= number < 100.0 for number in found.values())
    assert "phase margin" in text
    lost = {one["what"]: one["yaw_rate_percent_of_range"] for one in document["not_held"]}
    assert set(lost) == {"thruster_lag", "quadratic_drag", "linear_drag"}
    assert lost["thruster_lag"] > 1.0
    arms = {one.name: one.arm for one in load_config(fitted.parent / "day" / "rovid.toml").vehicle.thrusters}
    torque = sum(arms[one["thruster"]] * one["thrust"] for one in document["trim"])
    assert torque == pytest.approx(-SIZES["bias_torque"]["torque"])
    assert "Trim of" in text
    assert document["mismatch"]["rms"] is None
    assert document["stability"]["stable"]


def test_ardupilots_sitl_is_answered_by_the_vehicle(fitted: Path, tmp_path: Path) -> None:
    document, file = exported("ardupilot", fitted, tmp_path, ".py")
    assert document["mismatch"]["yaw_rate_percent_of_range"] < ALLOWED
    space = runpy.run_path(str(file), run_name="sitl")
    state = (0.0, 0.0, 0.0, space["VEHICLE"].u_actual)
    assert space["advance"](state, struct.pack("<HHI16H", 1, 50, 0, *[1500] * 16))[1] is None
    for count in range(3000):
        state, answer = space["advance"](state, struct.pack("<HHI16H", 18458, 50, count, 1700, *[1500] * 15))
    motion = json.loads(answer)
    # One thruster at half of its commands, until drag balances it.
    model, fore = (
        read_parameters(fitted).model(),
        load_config(fitted.parent / "day" / "rovid.toml").vehicle.thrusters[0],
    )
    assert fore.curve is not None
    torque = fore.arm * float(np.interp(0.5 * fore.curve.command[-1], fore.curve.command, fore.curve.thrust))
    assert motion["timestamp"] == pytest.approx(60.0)
    assert motion["imu"]["gyro"][2] == pytest.approx(model.steady_rate(torque), rel=1e-3)
    assert abs(motion["attitude"][2]) <= math.pi


def test_the_text_output_is_short(fitted: Path, rovid: Rovid) -> None:
    done = rovid("export", "stonefish", "-p", fitted)
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("stonefish.scn\n")
    assert "% of its range" in done.out
    assert "Not held: quadratic drag DQ" in done.out
    assert Path("stonefish.scn").is_file()


def test_errors_end_with_code_2_and_one_message(fitted: Path, rovid: Rovid, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert rovid("fit-drag", SAMPLES / "rosub_tank", "-p", "drag.toml").code == 0
    for arguments, words in (
        (["gzsim", "-p", fitted], "gz-sim"),
        (["gz-sim", "-p", "drag.toml"], "holds no inertia"),
        (["gz-sim"], "no such parameter file"),
        (["gz-sim", "-p", fitted, "-o", "file/x.sdf"], "cannot be written"),
    ):
        done = rovid("export", *arguments)
        assert (done.code, done.out) == (2, "")
        assert words in done.err
        assert "Traceback" not in done.err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["drag.toml", "file"]


def test_all_formats_share_one_search_of_the_commands(fitted: Path) -> None:
    """The search simulates up to 31 times: for each format again, it took most of the time of a report."""
    subject = export_input(read_parameters(fitted), None)
    assert verification_commands(subject) is verification_commands(subject)


def test_the_mismatch_of_an_unstable_solution_is_finite(fitted: Path) -> None:
    subject = export_input(read_parameters(fitted), None)
    mismatch = compare_motions(subject, np.array([[0.0], [0.1], [0.2]]), np.array([[0.0], [1e200], [-1e200]]))
    assert mismatch.rms["yaw_rate"] == pytest.approx(1e200 * math.sqrt(2.0 / 3.0))
