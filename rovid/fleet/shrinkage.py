"""Hierarchical (empirical Bayes) means of sister vehicles: each estimate is shrunk towards the fleet's mean.

An estimate y with standard error s, of campaign i of vehicle v, is

    y = m + a_v + b_i + e,   a_v ~ N(0, between²), b_i ~ N(0, within²), e ~ N(0, s²)

with m flat. Both scatters are integrated over, with a flat prior of the standard deviation (Gelman 2006, Bayesian
Analysis 1:515). A few campaigns therefore do not imply that the vehicles are alike.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.fleet.results import Fleet, ParameterValue

# Minimum number of campaigns with the parameter; fewer do not determine the scatter.
LEAST = 4
# Grid of scatters, in standard deviations of the estimates, from none to far more than the data show.
_SCATTERS = np.concatenate(([0.0], np.geomspace(0.01, 4.0, 48)))
# Standard errors from zero above which a positive parameter is treated by its logarithm.
_FROM_ZERO = 3.0


@dataclass(frozen=True, kw_only=True)
class ShrunkParameter:
    """A parameter over the fleet."""

    name: str
    logarithmic: bool  # Whether the scatters are relative (of the logarithm)
    mean: ParameterValue  # Fleet mean with its standard error
    # between, within: standard deviation between vehicles, and between the campaigns of one vehicle
    between: float
    within: float
    values: Mapping[str, ParameterValue]  # Campaign -> shrunk value


def shrink(fleet: Fleet) -> tuple[ShrunkParameter, ...]:
    """Shrunk values of each parameter that at least `LEAST` campaigns have."""
    results = [_shrink(fleet, name) for name in fleet.parameters]
    return tuple(result for result in results if result is not None)


def _shrink(fleet: Fleet, name: str) -> ShrunkParameter | None:
    known = {
        record.campaign: (vehicle, value)
        for vehicle, campaigns in fleet.campaigns_with(name).items()
        for record, value in campaigns
        if value.is_comparable
    }
    unit = fleet.units[name]
    if len(known) < LEAST or not unit:
        return None
    values = np.array([value.value for _, value in known.values()])
    errors = np.array([value.error for _, value in known.values()])
    vehicles = np.unique([vehicle for vehicle, _ in known.values()], return_inverse=True)[1]
    logarithmic = bool((values > _FROM_ZERO * errors).all())
    if logarithmic:
        values, errors = np.log(values), errors / values
    scale = float(np.std(values)) or float(np.median(errors))
    posterior = _posterior(values / scale, errors / scale, vehicles)
    centres, deviations, mean, between, within = (scale * each for each in posterior)

    def rescaled(value: float, error: float) -> ParameterValue:
        if logarithmic:
            return ParameterValue(math.exp(value), math.exp(value) * error, unit)
        return ParameterValue(value, error, unit)

    return ShrunkParameter(
        name=name,
        logarithmic=logarithmic,
        mean=rescaled(float(mean[0]), float(mean[1])),
        between=float(between),
        within=float(within),
        values=dict(zip(known, map(rescaled, centres.tolist(), deviations.tolist()), strict=True)),
    )


def _posterior(
    y: FloatArray, s: FloatArray, vehicle: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """(n,) posterior means and (n,) standard deviations of the true values, (2,) fleet mean, both scatters."""
    widths = np.gradient(_SCATTERS)
    between_grid = list(zip(_SCATTERS, widths, strict=True))
    if vehicle.max() == 0:  # A single vehicle does not determine the scatter between vehicles.
        between_grid = [(0.0, 1.0)]
    log_weights, moments = [], []
    for between, between_width in between_grid:
        for within, within_width in zip(_SCATTERS, widths, strict=True):
            likelihood, centre, variance, mean, mean_variance = _conditional(y, s, vehicle, between**2, within**2)
            log_weights.append(likelihood + math.log(between_width * within_width))
            fleet = [mean, mean_variance + mean**2, between, within]
            moments.append(np.concatenate((centre, variance + centre**2, fleet)))
    weights = np.exp(np.array(log_weights) - max(log_weights))
    average = (weights / weights.sum()) @ np.stack(moments)
    n = len(y)
    centre, square, (mean, mean_square, between, within) = average[:n], average[n : 2 * n], average[2 * n :]
    deviation = np.sqrt(np.maximum(square - centre**2, 0.0))
    fleet_mean = np.array([mean, math.sqrt(max(mean_square - mean**2, 0.0))])
    return centre, deviation, fleet_mean, np.asarray(between), np.asarray(within)


def _conditional(
    y: FloatArray, s: FloatArray, vehicle: IntArray, between: float, within: float
) -> tuple[float, FloatArray, FloatArray, float, float]:
    """Log-likelihood of the variances; means and variances of the true values and of the fleet's mean given both."""
    d = s**2 + within
    p, q = np.bincount(vehicle, 1.0 / d), np.bincount(vehicle, y / d)
    k = 1.0 + between * p
    precision = float(np.sum(p / k))
    mean = float(np.sum(q / k)) / precision
    misfit = np.sum(y**2 / d) - np.sum(between * q**2 / k) - precision * mean**2
    likelihood = -0.5 * float(np.sum(np.log(d)) + np.sum(np.log(k)) + math.log(precision) + misfit)
    # Each vehicle's mean, then each campaign's value.
    vehicle_mean = ((between * q + mean) / k)[vehicle]
    vehicle_variance = (between / k + 1.0 / (precision * k**2))[vehicle]
    share = s**2 / d
    values = (1.0 - share) * y + share * vehicle_mean
    return likelihood, values, within * share + share**2 * vehicle_variance, mean, 1.0 / precision
