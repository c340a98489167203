"""Every format: one file a target, one line here."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from rovid.export import gz_sim, mujoco, plain, python_vehicle_simulator, stonefish, uuv, vrx
from rovid.export.subject import Subject
from rovid.export.target import Target
from rovid.ground.errors import ConfigError, nearest
from rovid.ground.files import Output
from rovid.ground.files.form import export_form

# Name -> (exporter, file written where none is given).
EXPORTERS: dict[str, tuple[Callable[[Subject], Target], str]] = {
    "gz-sim": (gz_sim.export, "gz_sim.sdf"),
    "uuv": (uuv.export, "uuv.xacro"),
    "vrx": (vrx.export, "vrx.sdf"),
    "stonefish": (stonefish.export, "stonefish.scn"),
    "mujoco": (mujoco.export, "mujoco.xml"),
    "ros2": (plain.export_ros2, "ros2.yaml"),
    "matlab": (plain.export_matlab, "rovid.mat"),
    "json": (plain.export_json, "rovid.json"),
    "python-vehicle-simulator": (python_vehicle_simulator.export, "rovid_vehicle.py"),
}


def exporter(name: str, path: Path | None) -> tuple[Callable[[Subject], Target], Output]:
    """The exporter of this format and the file to write.

    Raises
    ------
    ConfigError
        There is no such format.
    """
    if name not in EXPORTERS:
        raise ConfigError(f"is {name!r}. {nearest(name, EXPORTERS)}", where="FORMAT")
    function, default = EXPORTERS[name]
    target = path or Path(default)
    if name == "uuv" and target.suffix in {".yaml", ".yml"}:
        return uuv.export_yaml, Output(target, export_form("uuv as yaml"))
    return function, Output(target, export_form(name))
