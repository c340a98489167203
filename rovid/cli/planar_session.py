"""The option --axes, and the steps that commands of the coupled model share."""

from __future__ import annotations

from rovid.core.errors import ConfigError


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
