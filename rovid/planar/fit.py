"""Fit of the planar model to runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.effects import Effect
from rovid.estimate.estimate import Estimate
from rovid.planar.model import PlanarModel


@dataclass(frozen=True, kw_only=True)
class Undetermined:
    """A combination of parameters that the data do not determine."""

    combination: Mapping[str, float]  #: Parameter -> its share, in relative changes; the largest is 1.
    text: str  #: A sentence for people.


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarFit:
    """A planar model with its uncertainty."""

    model: PlanarModel
    estimate: Estimate  #: Refused parameters have a value here that must not be printed.
    log_likelihood: float
    undetermined: tuple[Undetermined, ...] = ()
    noise: Mapping[str, float]  #: Sensor -> standard deviation of its white noise, SI and rad.
    #: Axis (surge, sway, yaw) -> standard deviation in N or N m, and correlation time in s, of the disturbance.
    disturbance: Mapping[str, tuple[float, float]]
    at_limit: tuple[str, ...] = ()  #: Axes with a disturbance at its upper limit.
    white: bool = True  #: Whether the normalised innovations are white.
    multi_step: bool = False  #: Whether multi-step predictions were fitted instead of innovations.
    #: Sensor -> R^2 of the free-running simulation.
    free_run_r2: Mapping[str, float]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Full sentences."""
        return self.estimate.warnings


def fit_planar(data: Any, effects: Sequence[Effect] = ()) -> PlanarFit:
    """Estimate the base model and ``effects`` from the innovations of an extended Kalman filter.

    Raises
    ------
    DataError
        The vehicle was not excited, or no sensor measures its motion.
    """
    raise NotImplementedError


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanarMotion:
    """Free-running simulation of a run at the instants of its ``time``."""

    time: FloatArray  #: (n,) s.
    heading: FloatArray  #: (n,) rad.
    #: ``surge_velocity``, ``sway_velocity``: (n,) m/s over ground, in body axes; ``yaw_rate``: (n,) rad/s.
    surge_velocity: FloatArray
    sway_velocity: FloatArray
    yaw_rate: FloatArray
    #: ``north``, ``east``: (n,) m.
    north: FloatArray
    east: FloatArray


def simulate_planar(model: PlanarModel, run: Any, start: FloatArray | None = None) -> PlanarMotion:
    """Free-running simulation of ``run`` from its smoothed first state, or from (6,) ``start``.

    ``start`` is heading, u, v through the water, r, north, east in SI and rad.
    """
    raise NotImplementedError


def sensor_values(motion: PlanarMotion, sensor: str) -> FloatArray:
    """(n,) noise-free values of a ``sensor``, by its name."""
    return np.asarray(getattr(motion, sensor))
