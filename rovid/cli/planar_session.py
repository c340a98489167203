"""The option --axes, and the steps that commands of the coupled model share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from rovid.cli import completion
from rovid.core.errors import ConfigError

if TYPE_CHECKING:
    from rovid.store.parameter_file import Parameters


def is_planar(axes: str | None, axis: str | None) -> bool:
    """Whether the coupled model of surge, sway and yaw is wanted.

    Raises
    ------
    ConfigError
        There are no such ``axes``, or a single ``axis`` is given as well.
    """
    from rovid.trial.axis import PLANAR

    if axes is None:
        return False
    if axes != PLANAR.name:
        mend = "Give --axes planar for surge, sway and yaw together, or --axis for one of them."
        raise ConfigError(f"is {axes!r}; planar was expected.", where="--axes", mend=mend)
    if axis is not None:
        mend = "Leave --axis out, or leave --axes out."
        raise ConfigError(f"is given together with --axis {axis}.", where="--axes", mend=mend)
    return True


def refuse_planar(axes: str | None) -> None:
    """Refuse --axes for a command that works along one axis."""
    if axes is not None:
        mend = "Give --axis, or run `rovid fit --axes planar` for surge, sway and yaw together."
        raise ConfigError(f"is {axes!r}, but this command works along one axis.", where="--axes", mend=mend)


def planar_parameters(path: Path | None) -> Parameters:
    """The parameter file of the coupled model, which has to exist.

    Raises
    ------
    ConfigError
        The file holds the parameters of one axis.
    """
    from rovid.store.load import read_parameters
    from rovid.trial.axis import PLANAR

    stored = read_parameters(path or Path(completion.parameter_file(PLANAR.name)))
    if stored.axis is not PLANAR:
        mend = "Run `rovid fit LOGS --axes planar`, or give its file with -p."
        text = f"holds the parameters of {stored.axis.name}; those of surge, sway and yaw together were expected."
        raise ConfigError(text, where=stored.path, mend=mend)
    return stored
