"""Sister vehicles told by each other: every estimate drawn towards the fleet's mean by as much as it is vague.

An estimate y with standard error s, of campaign i of vehicle v, is

    y = m + a_v + b_i + e,   a_v ~ N(0, between²), b_i ~ N(0, within²), e ~ N(0, s²)

with m flat. Both scatters are integrated over (flat in the standard deviation, Gelman 2006, Bayesian Analysis 1:515),
so that a fleet of few is not taken for more alike than it is known to be.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.fleet.results import Fleet, ParameterValue

# Campaigns that have the parameter; of fewer nobody knows how they scatter.
LEAST = 4
# Scatters that are tried, in standard deviations of the estimates: from none to far more than there is.
_SCATTERS = np.concatenate(([0.0], np.geomspace(0.01, 4.0, 48)))
# A positive parameter is taken by its logarithm where each is known to a third of itself.
_KNOWN = 3.0


@dataclass(frozen=True, kw_only=True)
class ShrunkParameter:
    """A parameter over the fleet.

    Attributes
    ----------
    logarithmic
        Whether the scatters are relative: of the logarithm.
    mean
        Of the fleet, with its standard error.
    between, within
        Scatter of the vehicles about the mean, and of a vehicle's campaigns about their own; standard deviations.
    values
        Campaign -> what it is by itself and by the others.
    """

    name: str
    logarithmic: bool
    mean: ParameterValue
    between: float
    within: float
    values: Mapping[str, ParameterValue]


def shrink(fleet: Fleet) -> tuple[ShrunkParameter, ...]:
    """Each parameter that `LEAST` campaigns or more have."""
    return tuple(one for name in fleet.parameters if (one := _shrunk(fleet, name)) is not None)


def _shrunk(fleet: Fleet, name: str) -> ShrunkParameter | None:
    known = {
        record.campaign: (vehicle, fleet.values[record.campaign][name])
        for vehicle, records in fleet.vehicles.items()
        for record in records
        if name in fleet.values[record.campaign] and fleet.values[record.campaign][name].is_comparable
    }
    unit = fleet.units[name]
    if len(known) < LEAST or not unit:
        return None
    values = np.array([one.value for _, one in known.values()])
    errors = np.array([one.error for _, one in known.values()])
    vehicles = np.unique([vehicle for vehicle, _ in known.values()], return_inverse=True)[1]
    logarithmic = bool((values > _KNOWN * errors).all())
    if logarithmic:
        values, errors = np.log(values), errors / values
    scale = float(np.std(values)) or float(np.median(errors))
    found = _posterior(values / scale, errors / scale, vehicles)
    centre, doubt, mean, between, within = (scale * each for each in found)

    def back(value: float, error: float) -> ParameterValue:
        return (
            ParameterValue(math.exp(value), math.exp(value) * error, unit)
            if logarithmic
            else ParameterValue(value, error, unit)
        )

    return ShrunkParameter(
        name=name,
        logarithmic=logarithmic,
        mean=back(float(mean[0]), float(mean[1])),
        between=float(between),
        within=float(within),
        values={campaign: back(float(c), float(d)) for campaign, c, d in zip(known, centre, doubt, strict=True)},
    )


def _posterior(
    y: FloatArray, s: FloatArray, vehicle: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """(n,) means and (n,) standard deviations of what y (n,) measures, the (2,) fleet's, and both scatters."""
    widths = np.gradient(_SCATTERS)
    one_vehicle = vehicle.max() == 0
    tried = [
        (between, within, wide * broad)
        for between, wide in ([(0.0, 1.0)] if one_vehicle else zip(_SCATTERS, widths, strict=True))
        for within, broad in zip(_SCATTERS, widths, strict=True)
    ]
    likelihoods, results = [], []
    for between, within, weight in tried:
        likelihood, centre, variance, mean, of_mean = _given(y, s, vehicle, between**2, within**2)
        likelihoods.append(likelihood + math.log(weight))
        results.append(np.concatenate((centre, variance + centre**2, [mean, of_mean + mean**2, between, within])))
    chance = np.exp(np.array(likelihoods) - max(likelihoods))
    average = (chance / chance.sum()) @ np.stack(results)
    n = len(y)
    centre, square, (mean, mean_square, between, within) = average[:n], average[n : 2 * n], average[2 * n :]
    spread = np.sqrt(np.maximum(square - centre**2, 0.0))
    of_fleet = np.array([mean, math.sqrt(max(mean_square - mean**2, 0.0))])
    return centre, spread, of_fleet, np.asarray(between), np.asarray(within)


def _given(
    y: FloatArray, s: FloatArray, vehicle: IntArray, between: float, within: float
) -> tuple[float, FloatArray, FloatArray, float, float]:
    """Log-likelihood of two variances; means and variances of what y measures, and of the fleet's mean."""
    d = s**2 + within
    p, q = np.bincount(vehicle, 1.0 / d), np.bincount(vehicle, y / d)
    k = 1.0 + between * p
    precision = float(np.sum(p / k))
    mean = float(np.sum(q / k)) / precision
    misfit = np.sum(y**2 / d) - np.sum(between * q**2 / k) - precision * mean**2
    likelihood = -0.5 * float(np.sum(np.log(d)) + np.sum(np.log(k)) + math.log(precision) + misfit)
    # Each vehicle's own mean, then each campaign's own value.
    own = ((between * q + mean) / k)[vehicle]
    doubt = (between / k + 1.0 / (precision * k**2))[vehicle]
    share = s**2 / d
    return likelihood, (1.0 - share) * y + share * own, within * share + share**2 * doubt, mean, 1.0 / precision
