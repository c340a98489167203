"""Export of the parameters in the formats of simulators, verified by re-simulation; list of the formats."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple


class ExportFormat(NamedTuple):
    """Module of the exporter, file that it writes by default, and names of the exporters in the module.

    ``planar`` exports surge, sway and yaw together, ``other`` files with other suffixes.
    """

    module: str
    file: str
    function: str = "export"
    planar: str = ""
    other: Mapping[str, str] = MappingProxyType({})


# Formats in the order of all lists. Shell completion imports this module, which therefore imports no exporter.
FORMATS: Mapping[str, ExportFormat] = {
    "gz-sim": ExportFormat("gazebo", "gz_sim.sdf", "export_gz_sim", "export_planar_gz_sim"),
    "uuv": ExportFormat(
        "gazebo",
        "uuv.xacro",
        "export_uuv",
        "export_planar_uuv",
        other={".yaml": "export_uuv_yaml", ".yml": "export_uuv_yaml"},
    ),
    "vrx": ExportFormat("gazebo", "vrx.sdf", "export_vrx", "export_planar_vrx"),
    "stonefish": ExportFormat("rigid_body_engines", "stonefish.scn", "export_stonefish"),
    "mujoco": ExportFormat("rigid_body_engines", "mujoco.xml", "export_mujoco", "export_planar_mujoco"),
    "ros2": ExportFormat("rovid_equation", "ros2.yaml", "export_ros2", "export_planar_ros2"),
    "matlab": ExportFormat("rovid_equation", "rovid.mat", "export_matlab", "export_planar_matlab"),
    "json": ExportFormat("rovid_equation", "rovid.json", "export_json", "export_planar_json"),
    "python-vehicle-simulator": ExportFormat("fossen", "rovid_vehicle.py", "export_module", "export_planar_module"),
    "mss": ExportFormat("fossen", "rovid_vehicle.m", "export_mss", "export_planar_mss"),
    "ardupilot": ExportFormat("autopilots", "ardupilot.parm", "export_ardupilot", other={".py": "export_sitl"}),
    "px4": ExportFormat("autopilots", "px4.txt", "export_px4"),
}
# Other names -> format.
ALIASES: Mapping[str, str] = {
    **dict.fromkeys(("gazebo", "ignition", "sdf"), "gz-sim"),
    **dict.fromkeys(("uuv_simulator", "xacro"), "uuv"),
    "virtual_robotx": "vrx",
    "mjcf": "mujoco",
    "yaml": "ros2",
    **dict.fromkeys(("simulink", "octave", "mat"), "matlab"),
    **dict.fromkeys(("ardusub", "ardurover", "sitl"), "ardupilot"),
    "marine-systems-simulator": "mss",
    **dict.fromkeys(("fossen", "python"), "python-vehicle-simulator"),
}
