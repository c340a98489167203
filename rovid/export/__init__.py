"""Export of the parameters in the formats of simulators, verified by re-simulation; list of the formats."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple


class ExportFormat(NamedTuple):
    """Module of the exporter, file that it writes by default, and name of the exporter in the module.

    ``planar`` has module and name of the exporter of surge, sway and yaw together; ``other`` the exporters in the first
    module for files with other suffixes.
    """

    module: str
    file: str
    function: str = "export"
    planar: tuple[str, str] | None = None
    other: Mapping[str, str] = MappingProxyType({})


# Formats in the order of all lists. Shell completion imports this module, which therefore imports no exporter.
FORMATS: Mapping[str, ExportFormat] = {
    "gz-sim": ExportFormat("gazebo", "gz_sim.sdf", "export_gz_sim", ("planar_gazebo", "export_gz_sim")),
    "uuv": ExportFormat(
        "uuv",
        "uuv.xacro",
        planar=("planar_gazebo", "export_uuv"),
        other={".yaml": "export_yaml", ".yml": "export_yaml"},
    ),
    "vrx": ExportFormat("gazebo", "vrx.sdf", "export_vrx", ("planar_gazebo", "export_vrx")),
    "stonefish": ExportFormat("stonefish", "stonefish.scn"),
    "mujoco": ExportFormat("mujoco", "mujoco.xml", planar=("mujoco", "export_planar")),
    "ros2": ExportFormat("rovid_equation", "ros2.yaml", "export_ros2", ("rovid_equation", "export_planar_ros2")),
    "matlab": ExportFormat("rovid_equation", "rovid.mat", "export_matlab", ("rovid_equation", "export_planar_matlab")),
    "json": ExportFormat("rovid_equation", "rovid.json", "export_json", ("rovid_equation", "export_planar_json")),
    "python-vehicle-simulator": ExportFormat(
        "python_vehicle_simulator", "rovid_vehicle.py", planar=("python_vehicle_simulator", "export_planar")
    ),
    "mss": ExportFormat("mss", "rovid_vehicle.m", planar=("mss", "export_planar")),
    "ardupilot": ExportFormat("autopilots", "ardupilot.parm", "export_ardupilot", other={".py": "export_sitl"}),
    "px4": ExportFormat("autopilots", "px4.txt", "export_px4"),
}
# Other names -> format.
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
    "ardusub": "ardupilot",
    "ardurover": "ardupilot",
    "sitl": "ardupilot",
    "marine-systems-simulator": "mss",
    "fossen": "python-vehicle-simulator",
    "python": "python-vehicle-simulator",
}
