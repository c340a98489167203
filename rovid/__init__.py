"""rovid: from an underwater vehicle's trial logs to a dynamic model its owner can defend.

`rovid.open` reads a folder of logs, `rovid.Study.from_frame` a DataFrame or arrays; docs/api.md lists the interface.
"""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

from rovid.core.errors import RovidError

if TYPE_CHECKING:  # `import rovid` must stay instant.
    from rovid.api.study import VehicleStudy as Study

__version__ = "0.4.0"
__all__ = ["RovidError", "Study", "__version__", "open"]


def open(  # noqa: A001 - as in `rovid.open`
    folder: str | PathLike[str], *, axis: str = "yaw", axes: str | None = None, cutoff: float | None = None
) -> Study:
    """Open the logs in ``folder``, which rovid.toml describes. Nothing is written.

    Parameters
    ----------
    folder
        A folder of logs, or one log.
    axis
        The degree of freedom: yaw, roll, pitch, surge, sway or heave.
    axes
        ``planar`` for surge, sway and yaw together; in place of ``axis`` and ``cutoff``.
    cutoff
        Cut-off frequency of the low-pass filter for rates in Hz; None: chosen from the data.

    Raises
    ------
    RovidError
        The folder does not exist, or has no rovid.toml. Logs are read, and checked, when they are first needed.
    """
    from rovid.api.study import open_folder

    return open_folder(folder, axis=axis, axes=axes, cutoff=cutoff)


def __getattr__(name: str) -> object:
    if name == "Study":
        from rovid.api.study import VehicleStudy

        return VehicleStudy
    raise AttributeError(f"module 'rovid' has no attribute {name!r}")
