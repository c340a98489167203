"""Each format of the coupled model, read by an independent parser and integrated, equals rovid's model."""

from __future__ import annotations

import io
import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
import yaml
from scipy.integrate import solve_ivp
from scipy.io import loadmat

from rovid.core.array_types import FloatArray
from rovid.core.errors import ConfigError
from rovid.effects import effect_named
from rovid.export import FORMATS
from rovid.export.planar_input import PlanarInput
from rovid.export.verification import (
    VerifiedExport,
    load_exporter,
    select_exporter,
    verification_commands,
    verified_export,
)
from rovid.model.bound_effects import BoundEffect
from rovid.planar.model import BASE_NAMES, SNAME, PlanarModel, RudderModel
from rovid.trial.vehicle import Rudder, ThrustCurve, Thruster, Vehicle
from tests.conftest import run_rovid

# Inertias of surge, sway, yaw, and their coupling; linear and quadratic drags.
BASE = np.array([130.0, 200.0, 22.0, 12.0, 20.0, 40.0, 8.0, 60.0, 180.0, 15.0])
ENVELOPE = np.array([1.0, 0.5, 0.8])
SIZES: Mapping[str, tuple[float, ...]] = {
    "sway_yaw_damping": (6.0, -4.0),
    "sway_yaw_damping:lift": (15.0, 9.0),
    "speed_dependent_damping:planar": (10.0, 20.0),
    "speed_dependent_damping:planar_quadratic": (10.0, 20.0),
    "cross_flow_drag": (30.0, 1.5),
    "cross_flow_drag:off_centre": (30.0, 1.5, 0.3),
    "current": (0.15, 0.7),
    "bias_torque:planar": (1.0, -0.5, 0.3),
    "thruster_lag": (0.4,),
    "thrust_asymmetry": (0.8,),
}
GZ = {"sway_yaw_damping", "sway_yaw_damping:lift", "speed_dependent_damping:planar", "thrust_asymmetry"}
HELD: Mapping[str, set[str]] = {
    "gz-sim": GZ,
    "vrx": {"thrust_asymmetry"},
    "uuv": {"sway_yaw_damping", "current", "thruster_lag", "thrust_asymmetry"},
    "python-vehicle-simulator": set(SIZES),
    "mss": set(SIZES) - {"thruster_lag"},
    "json": set(SIZES),
    "ros2": set(SIZES),
    "matlab": set(SIZES),
}
# % of the range of each velocity. uuv_simulator's filter and step are late by some milliseconds.
ALLOWED = {"uuv": 0.5}
PROMISE = 0.15


def vehicle() -> Vehicle:
    curve = ThrustCurve(command=np.array([-1.0, -0.1, 0.1, 1.0]), thrust=np.array([-40.0, 0.0, 0.0, 60.0]))
    levers = {"port": (1.0, 0.0, 0.3), "starboard": (1.0, 0.0, -0.3), "bow": (0.0, 1.0, 0.2)}
    thrusters = tuple(
        Thruster(name=name, surge_share=surge, sway_share=sway, arm=arm, curve=curve)
        for name, (surge, sway, arm) in levers.items()
    )
    return Vehicle(name="box", thrusters=thrusters, mass=100.0, rigid_body_inertia=10.0, planar=True)


def subject(*keys: str) -> PlanarInput:
    effects = tuple(BoundEffect(effect_named(key), np.array(SIZES[key])) for key in keys)
    return PlanarInput(
        model=PlanarModel(base=BASE, effects=effects),
        vehicle=vehicle(),
        entries={},
        envelope=ENVELOPE,
        commands=np.array([[-1.0, 1.0]] * 3),
    )


def exported(name: str, *keys: str) -> VerifiedExport:
    exporter = load_exporter(name, planar=True)
    return verified_export(exporter, subject(*keys))


@pytest.mark.parametrize("name", HELD)
def test_rovid_replaces_its_own_export(name: str, tmp_path: Path) -> None:
    exporter, output = select_exporter(name, tmp_path / "model", planar=True)
    content = exporter(subject()).content
    output.path.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert output.signature.matches(output.path)


def test_topics_and_the_model_of_gazebo_have_a_name_that_ros_allows() -> None:
    one = subject()
    made = load_exporter("gz-sim", planar=True)(replace(one, vehicle=replace(one.vehicle, name="Nord 2, tank (wide)")))
    (note,) = (text for text in made.notes if "newtons" in text)
    assert "/model/Nord_2_tank_wide/joint/port_joint/cmd_thrust, /model/Nord_2_tank_wide/joint/starboard" in note
    assert '<model name="Nord_2_tank_wide">' in str(made.content)


@pytest.mark.slow
@pytest.mark.parametrize("name", HELD)
def test_a_format_reproduces_the_motion_with_all_that_it_holds(name: str) -> None:
    # One effect of each kind at once: those that exclude each other in a model are added all the same.
    made = exported(name, *HELD[name])
    assert made.losses == ()
    allowed = ALLOWED.get(name, PROMISE)
    assert made.mismatch.largest < allowed
    assert made.mismatch == made.kept_mismatch
    assert made.stability.stable


@pytest.mark.slow
@pytest.mark.parametrize("name", HELD)
def test_what_a_format_lacks_is_listed_with_its_size(name: str) -> None:
    lacking = sorted(set(SIZES) - HELD[name] - {"current"})
    made = exported(name, *lacking)
    assert [loss.what for loss in made.losses] == lacking
    if lacking:
        assert all(max(loss.percent_of_range.values()) > 1.0 for loss in made.losses)
        assert made.mismatch.largest > 1.0
    assert made.kept_mismatch.largest < ALLOWED.get(name, PROMISE)


def floats(text: str | None) -> FloatArray:
    assert text is not None
    return np.array([float(word) for word in text.split()])


def integrate(mass: FloatArray, force: Any, seconds: float) -> FloatArray:
    """(3,) velocities after ``seconds`` under ``force(nu)``, Coriolis forces of ``mass`` included."""

    def slope(_: float, nu: FloatArray) -> FloatArray:
        p = mass @ nu
        turning = np.array([-p[1] * nu[2], p[0] * nu[2], p[1] * nu[0] - p[0] * nu[1]])
        return np.asarray(np.linalg.solve(mass, force(nu) - turning))

    return np.asarray(solve_ivp(slope, (0.0, seconds), np.zeros(3), rtol=1e-9, atol=1e-11).y[:, -1])


def rovid_after(seconds: float, commands: FloatArray, given: PlanarInput) -> FloatArray:
    held = np.tile(commands, (round(10.0 * seconds) + 1, 1))
    return np.asarray(given.motion(given.model, held)[-1])


COMMANDS = np.array([1.0, 0.3, -0.6])


def thrust_of(comment_tables: list[tuple[FloatArray, FloatArray]]) -> FloatArray:
    return np.array([np.interp(u, *table) for u, table in zip(COMMANDS, comment_tables, strict=True)])


def tables_in(content: str) -> list[tuple[FloatArray, FloatArray]]:
    texts = [part.split("-->")[0] for part in content.split("<!-- ")[1:]]
    texts = [text.replace("- -", "--") for text in texts if " | thrust " in text]
    parts = [text.partition(": command ")[2].partition(" | thrust ") for text in texts]
    return [(floats(command), floats(thrust)) for command, _, thrust in parts]


def test_the_sdf_of_gz_sim_is_the_model_in_flu_axes() -> None:
    keys = ("sway_yaw_damping", "sway_yaw_damping:lift")
    content = exported("gz-sim", *keys).content
    assert isinstance(content, str)
    model = ET.fromstring(content).find("model")
    assert model is not None
    link = next(e for e in model.findall("link") if e.get("name") == "base_link")
    fluid = {e.tag: float(e.text or "nan") for e in link.findall("inertial/fluid_added_mass/*")}
    body = float(link.findtext("inertial/mass") or "nan")
    assert body == 100.0
    izz = float(link.findtext("inertial/inertia/izz") or "nan")
    mass = np.array(
        [[body + fluid["xx"], 0.0, 0.0], [0.0, body + fluid["yy"], fluid["yr"]], [0.0, fluid["yr"], izz + fluid["rr"]]]
    )
    plugin = next(p for p in model.findall("plugin") if "Hydrodynamics" in str(p.get("name")))
    terms = {e.tag: float(e.text or "nan") for e in plugin if e.tag != "link_name"}
    assert {"xU", "yV", "nR", "yR", "nV", "xUabsU", "yVabsV", "nRabsR", "yRabsU", "nVabsU"} == terms.keys()
    index = {"x": 0, "y": 1, "n": 2, "U": 0, "V": 1, "R": 2}
    push = np.zeros(3)
    joints = {str(e.get("name")): e for e in model.findall("joint")}
    thrusts = thrust_of(tables_in(content))
    for thrust, other in zip(thrusts, [p for p in model.findall("plugin") if p is not plugin], strict=True):
        joint = joints[str(other.findtext("joint_name"))]
        child = next(e for e in model.findall("link") if e.get("name") == joint.findtext("child"))
        place, axis = floats(child.findtext("pose"))[:3], floats(joint.findtext("axis/xyz"))
        push += thrust * np.array([axis[0], axis[1], np.cross(place, axis)[2]])

    def force(nu: FloatArray) -> FloatArray:
        total = push.copy()
        for name, value in terms.items():
            size = abs(nu[index[name[-1]]]) if "abs" in name else 1.0
            total[index[name[0]]] += value * size * nu[index[name[1]]]
        return total

    theirs = integrate(mass, force, 4.0)
    ours = rovid_after(4.0, COMMANDS, subject(*keys))
    assert theirs * np.array([1.0, -1.0, -1.0]) == pytest.approx(ours, rel=2e-4, abs=1e-5)  # rovid's step
    # A wrong sign of one cross term, or an added mass that counts twice, shows.
    for change in ({"nV": -terms["nV"]}, {"yRabsU": 0.0}):
        kept = dict(terms)
        terms.update(change)
        assert np.max(np.abs(integrate(mass, force, 4.0) - theirs)) > 1e-3
        terms.update(kept)


@pytest.mark.slow
def test_the_xacro_of_uuv_holds_the_matrices() -> None:
    content = exported("uuv", "sway_yaw_damping").content
    assert isinstance(content, str)
    root = ET.fromstring(content.replace("xacro:", ""))
    water, mass = root.find(".//hydrodynamic_model"), root.find("link/inertial/mass")
    inertia = root.find("link/inertial/inertia")
    assert water is not None
    assert mass is not None
    assert inertia is not None
    chosen = np.ix_((0, 1, 5), (0, 1, 5))
    body = np.diag([float(mass.get("value") or "nan")] * 2 + [float(inertia.get("izz") or "nan")])
    added = floats(water.findtext("added_mass")).reshape(6, 6)[chosen]
    assert body + added == pytest.approx(subject().model.mass_matrix)
    damping = floats(water.findtext("linear_damping")).reshape(6, 6)[chosen]
    assert damping == pytest.approx(-np.array([[20.0, 0.0, 0.0], [0.0, 40.0, -4.0], [0.0, 6.0, 8.0]]))
    assert floats(water.findtext("quadratic_damping"))[[0, 1, 5]] == pytest.approx([-60.0, -180.0, -15.0])


def test_the_engine_of_mujoco_follows_the_equation_of_the_file() -> None:
    mujoco = pytest.importorskip("mujoco")
    exporter = load_exporter("mujoco", planar=True)
    given = subject("bias_torque:planar", "thruster_lag")
    result = exporter(given)
    assert isinstance(result.content, str)
    engine = mujoco.MjModel.from_xml_string(result.content)
    state = mujoco.MjData(engine)
    commands = verification_commands(given)
    theirs = []
    for command in commands:
        turn = state.qpos[2]
        east, north, rate = state.qvel
        ahead, side = math.cos(turn) * east + math.sin(turn) * north, -math.sin(turn) * east + math.cos(turn) * north
        theirs.append((ahead, -side, -rate))
        for unit in given.units:
            at = [one.name for one in given.vehicle.thrusters].index(unit.curve.name)
            state.ctrl[engine.actuator(unit.curve.identifier).id] = unit.curve(command[at])
        for _ in range(50):
            mujoco.mj_step(engine, state)
    assert result.simulate is not None
    ours = result.simulate(commands)
    errors = np.max(np.abs(np.array(theirs) - ours), axis=0) / np.ptp(ours, axis=0)
    assert np.all(errors < 2e-3)


def test_mujoco_says_that_a_body_has_one_mass() -> None:
    made = exported("mujoco")
    assert "surge.inertia, sway.inertia" in [loss.what for loss in made.losses]
    assert made.mismatch.largest > 1.0


@pytest.mark.slow
def test_rudders_and_azimuth_angles_are_listed_where_they_are_lost() -> None:
    given = subject()
    port, *others = given.vehicle.thrusters
    angle = Thruster(name="port.azimuth", arm=0.0, curve=None, turns="port")
    rudder = Thruster(name="rudder", arm=0.0, curve=None, rudder=Rudder(position=(-0.7, 0.0)))
    turned = replace(port, position=(-0.6, 0.3), arm=-0.3)
    given = replace(
        given,
        vehicle=replace(given.vehicle, thrusters=(turned, *others, angle, rudder)),
        model=replace(given.model, rudders=(RudderModel(name="rudder", position=(-0.7, 0.0), lift=40.0),)),
        commands=np.array([[-1.0, 1.0]] * 3 + [[-0.6, 0.6]] * 2),
    )
    exporter = load_exporter("gz-sim", planar=True)
    made = verified_export(exporter, given)
    assert [loss.what for loss in made.losses] == ["port.azimuth", "rudder"]
    assert all(max(loss.percent_of_range.values()) > 1.0 for loss in made.losses)
    assert made.kept_mismatch.largest < PROMISE
    for name in ("json", "ros2", "matlab"):
        exporter = load_exporter(name, planar=True)
        made = verified_export(exporter, given)
        assert made.losses == ()
        if name == "ros2":
            written = yaml.safe_load(made.content)["/**"]["ros__parameters"]
            held, azimuth = written["rudder_0"], written["thruster_0"]
        elif name == "json":
            written = json.loads(made.content)
            held, azimuth = written["rudders"][0], written["thrusters"][0]
        else:
            assert isinstance(made.content, bytes)
            stream: Any = io.BytesIO(made.content)
            written = loadmat(stream, simplify_cells=True)["rovid"]
            held, azimuth = written["rudders"], written["thrusters"][0]
        assert (held["name"], held["lift"], list(held["position"])) == ("rudder", 40.0, [-0.7, 0.0])
        assert (azimuth["azimuth"], list(azimuth["position"])) == ("port.azimuth", [-0.6, 0.3])


def test_tables_hold_every_parameter() -> None:
    given = subject("cross_flow_drag", "current")
    names, values = given.model.names, given.model.values.tolist()
    content = exported("json", "cross_flow_drag", "current").content
    document = json.loads(content)
    assert {name: one["value"] for name, one in document["parameters"].items()} == dict(zip(names, values, strict=True))
    assert {name: document["parameters"][name]["sname"] for name in BASE_NAMES} == SNAME
    assert np.array(document["mass_matrix"]) == pytest.approx(given.model.mass_matrix)


def test_a_format_that_cannot_hold_the_model_is_refused() -> None:
    assert {name for name, form in FORMATS.items() if not form.planar} == {"stonefish", "ardupilot", "px4"}
    with pytest.raises(ConfigError, match="cannot hold surge, sway and yaw together"):
        load_exporter("stonefish", planar=True)
    with pytest.raises(ConfigError, match="mujoco"):
        load_exporter("mjcf", planar=True)


def parameter_file(folder: Path) -> Path:
    units = ("kg", "kg", "kg m^2", "kg m", *["N s/m"] * 2, "N m s/rad", *["N s^2/m^2"] * 2, "N m s^2/rad^2")
    entries = {
        name: {"value": value, "standard_error": 0.01 * value, "unit": unit, "method": "test"}
        for name, value, unit in zip(BASE_NAMES, BASE.tolist(), units, strict=True)
    }
    matrix = np.diag((0.01 * BASE) ** 2).tolist()
    document = {
        "schema": "rovid-parameters/1",
        "vehicle": "box",
        "axis": "planar",
        "logs": [],
        "parameters": entries,
        "covariance": {"names": list(BASE_NAMES), "matrix": matrix},
        "sources": [],
    }
    path = folder / "parameters_planar.toml"
    path.write_text(tomli_w.dumps(document))
    return path


def test_the_command_writes_the_file_and_the_verdict(tmp_path: Path) -> None:
    file = tmp_path / "rovid.mat"
    parameters = parameter_file(tmp_path)
    command = ("export", "matlab", "--axes", "planar", "-p", parameters, "-o", file)
    document = run_rovid(*command, "--json").document
    assert document["schema"] == "rovid-export/1"
    assert document["stability"]["stable"] is True
    assert document["stability"]["largest_stable_step"] >= document["stability"]["step"]
    assert document["mismatch"]["surge_velocity_percent_of_range"] == 0.0
    read = loadmat(str(file), simplify_cells=True)["rovid"]
    assert read["M"] == pytest.approx(subject().model.mass_matrix)
    shown = run_rovid(*command)
    assert shown.code == 0
    assert "Stability: Stable at" in shown.out
    refused = run_rovid("export", "stonefish", "--axes", "planar", "-p", parameters)
    assert refused.code == 2
