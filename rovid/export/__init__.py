"""The parameters in a simulator's own format, checked by re-simulation: one file a target, one line here."""

from __future__ import annotations

from collections.abc import Mapping

# Format -> file written where none is given, in the order in which formats are listed everywhere. The exporter is the
# file of the format's name, with underscores; nothing here may be slow to import, for the Tab key does.
FORMATS: Mapping[str, str] = {
    "gz-sim": "gz_sim.sdf",
    "uuv": "uuv.xacro",
    "vrx": "vrx.sdf",
    "stonefish": "stonefish.scn",
    "mujoco": "mujoco.xml",
    "ros2": "ros2.yaml",
    "matlab": "rovid.mat",
    "json": "rovid.json",
    "python-vehicle-simulator": "rovid_vehicle.py",
}
# What they are called besides -> format.
ALIASES: Mapping[str, str] = {
    "gazebo": "gz-sim",
    "ignition": "gz-sim",
    "sdf": "gz-sim",
    "uuv_simulator": "uuv",
    "xacro": "uuv",
    "virtual_robotx": "vrx",
    "mjcf": "mujoco",
    "yaml": "ros2",
    "simulink": "matlab",
    "octave": "matlab",
    "mat": "matlab",
    "fossen": "python-vehicle-simulator",
    "python": "python-vehicle-simulator",
}
