"""Options of the controller, conditions of the loop, and manoeuvres."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rovid.core.errors import ConfigError, suggestion
from rovid.model.model import Model

# Names of `rovid control --law`.
LAWS = ("model", "ardusub", "ardurover", "px4")
WAVE_PERIOD = 8.0  # s
# Without logs: rad, heading noise of the paper's instrument; rad/s, rate whose drag is the torque in use.
_HEADING_NOISE, _RATE_IN_USE = math.radians(0.01), 0.15
# Torque of current and waves relative to the torque in use.
_ENVIRONMENT = 0.1


@dataclass(frozen=True, kw_only=True)
class ControllerOptions:
    """Options of `rovid control`. Raises ConfigError if an option has an invalid value."""

    kp: float | None = None
    kd: float | None = None
    damping: float = 0.7
    bandwidth: float | None = None
    period: float = 0.1
    delay: float = 0.0
    rate_filter: float | None = None
    law: str = "model"  #: Model-aided PD, or an autopilot of `rovid.control.autopilot.AUTOPILOTS`.
    steps: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        positive = {"--kp": self.kp, "--damping": self.damping, "--bandwidth": self.bandwidth, "--period": self.period}
        for name, value in positive.items():
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise ConfigError(f"is {value:g}; a number above zero was expected.", where=name)
        for name, value in {"--kd": self.kd, "--delay": self.delay, "--rate-filter": self.rate_filter}.items():
            if value is not None and not (math.isfinite(value) and value >= 0.0):
                raise ConfigError(f"is {value:g}; zero or a number above it was expected.", where=name)
        if (self.kp is None) != (self.kd is None):
            raise ConfigError("needs the other gain too.", where="--kp" if self.kd is None else "--kd")
        if self.kp is not None and self.bandwidth is not None:
            raise ConfigError("contradicts --kp and --kd.", where="--bandwidth", mend="Leave one out.")
        if self.law not in LAWS:
            raise ConfigError(f"is {self.law!r}. {suggestion(self.law, LAWS)}", where="--law")
        if self.law != LAWS[0] and (self.steps or self.rate_filter is not None):
            raise ConfigError(
                "is for the model-aided law; an autopilot has its own rate.",
                where="--step" if self.steps else "--rate-filter",
                mend="Leave it out.",
            )
        self.parsed_steps()

    def parsed_steps(self) -> list[tuple[float, float]]:
        """(from, to) in deg of each of ``steps``, to the nearest turn: the controller turns the shorter way."""
        found = []
        for text in self.steps:
            first, _, last = text.partition(":")
            try:
                start, end = float(first), float(last)
                found.append((start, start + math.remainder(end - start, 360.0)))
            except ValueError as error:
                raise ConfigError(
                    f"is {text!r}; two headings in deg were expected, as in 20:120.", where="--step"
                ) from error
        return found


def loop_conditions(
    options: ControllerOptions, model: Model, heading_noise: float | None, torque_in_use: float | None
) -> "LoopConditions":
    """Conditions of the loop; without logs with a heading noise of 0.01 deg and the drag at 0.15 rad/s."""
    if heading_noise is None:
        heading_noise = _HEADING_NOISE
    if torque_in_use is None:
        torque_in_use = model.drag(np.array(_RATE_IN_USE)).item()
    return LoopConditions(
        period=options.period,
        delay=options.delay,
        rate_filter=options.rate_filter,
        heading_noise=heading_noise,
        torque_in_use=torque_in_use,
    )


@dataclass(frozen=True, kw_only=True)
class LoopConditions:
    """Conditions of the loop, from options and logs."""

    #: ``period``, ``delay``: s, sampling period, and delay from a heading to the command that it leads to.
    period: float = 0.1
    delay: float = 0.0
    #: s, time constant of the low pass of the rate; None to choose it with the bandwidth.
    rate_filter: float | None = None
    #: ``heading_noise``, ``torque_in_use``: rad and N m.
    heading_noise: float = 0.0
    torque_in_use: float


@dataclass(frozen=True, kw_only=True)
class HeadingManoeuvre:
    """A run from rest at ``start`` to ``target``, in deg; ``current`` and ``waves`` in N m."""

    name: str
    start: float
    target: float
    current: float = 0.0
    waves: float = 0.0


def paper_runs() -> tuple[HeadingManoeuvre, ...]:
    """The three closed-loop runs of Ramesh et al. 2013."""
    return (
        HeadingManoeuvre(name="90 to 200 deg", start=90.0, target=200.0),
        HeadingManoeuvre(name="20 to 120 deg", start=20.0, target=120.0),
        HeadingManoeuvre(name="hold 120 deg, pushed to 100", start=100.0, target=120.0),
    )


def standard_manoeuvres(steps: Sequence[tuple[float, float]], torque_in_use: float) -> tuple[HeadingManoeuvre, ...]:
    """Runs of the paper, the user's ``steps`` in deg, and holds against current and against waves."""
    torque = _ENVIRONMENT * torque_in_use
    return (
        *paper_runs(),
        *(HeadingManoeuvre(name=f"{a:g} to {b % 360.0:g} deg", start=a, target=b) for a, b in steps),
        HeadingManoeuvre(name="hold 120 deg, current sets in", start=120.0, target=120.0, current=torque),
        HeadingManoeuvre(name="hold 120 deg, waves", start=120.0, target=120.0, waves=torque),
    )
