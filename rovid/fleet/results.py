"""Results of all campaigns by vehicle and date, outliers, and empirical Bayes means of sister vehicles.

An estimate y with standard error s, of campaign i of vehicle v, is

    y = m + a_v + b_i + e,   a_v ~ N(0, between²), b_i ~ N(0, within²), e ~ N(0, s²)

with m flat. Both scatters are integrated over, with a flat prior of the standard deviation (Gelman 2006, Bayesian
Analysis 1:515). A few campaigns therefore do not imply that the vehicles are alike.
"""

import itertools
import math
import re
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rovid.core.array_types import FloatArray, IntArray
from rovid.fleet.campaigns import CampaignRecord
from rovid.model.parameter_names import base_names
from rovid.trial.axis import axis_named

# Ratio of the vehicles' medians above which vehicles are compared only with themselves; a decision.
UNLIKE = 3.0
# Minimum number of campaigns with the parameter for an outlier test.
MIN_SISTERS = 5
# Robust standard deviations beyond which a campaign is an outlier (Iglewicz and Hoaglin 1993).
LIMIT = 3.5
# Standard deviation of a normal distribution over its median absolute deviation.
_NORMAL = 1.4826
RULE = (
    f"A campaign is an outlier if its parameter lies more than {LIMIT:g} times √(S² + s²) from the fleet's median. "
    f"S is {_NORMAL} times the median absolute deviation, s is the campaign's own standard error. Parameters that are "
    f"positive in all campaigns are compared by their logarithms. The test needs at least {MIN_SISTERS} campaigns with "
    f"the parameter. If the vehicles' medians differ by more than a factor of {UNLIKE:g}, each vehicle is compared "
    "with itself only."
)


@dataclass(frozen=True)
class ParameterValue:
    """A parameter in one campaign."""

    value: float
    error: float  # Standard error; NaN if unknown
    unit: str
    placeholder: bool = False  # Whether the value depends on a guessed arm or thrust curve

    @property
    def is_comparable(self) -> bool:
        """Whether the value can be compared with other campaigns."""
        return self.error > 0.0 and not self.placeholder


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """The records of all campaigns, sorted by name."""

    axis: str
    records: tuple[CampaignRecord, ...]

    @cached_property
    def values(self) -> Mapping[str, Mapping[str, ParameterValue]]:
        """Campaign -> parameter -> value in the final model: with the causes found, or the plain model."""
        return {record.campaign: _values(record) for record in self.records}

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of all parameters: the plain model's first, then the effects' by name."""
        known = {name for values in self.values.values() for name in values}
        plain = [name for name in base_names(axis_named(self.axis)) if name in known]
        return (*plain, *sorted(known.difference(plain)))

    @cached_property
    def units(self) -> Mapping[str, str]:
        """Parameter -> unit; empty where the campaigns have different units."""
        units: dict[str, str] = {}
        for values in self.values.values():
            for name, parameter in values.items():
                if units.setdefault(name, parameter.unit) != parameter.unit:
                    units[name] = ""
        return units

    @cached_property
    def vehicles(self) -> Mapping[str, tuple[CampaignRecord, ...]]:
        """Vehicle -> its diagnosed campaigns by date, those without a date last."""
        done = sorted(self.done, key=lambda record: (record.start is None, record.start or 0.0, record.campaign))
        vehicles: dict[str, list[CampaignRecord]] = {}
        for record in done:
            vehicles.setdefault(record.vehicle or "", []).append(record)
        return {name: tuple(vehicles[name]) for name in sorted(vehicles, key=_natural_order)}

    def campaigns_with(self, name: str) -> Mapping[str, list[tuple[CampaignRecord, ParameterValue]]]:
        """Vehicle -> its campaigns that have the parameter, by date, with its value."""
        groups: dict[str, list[tuple[CampaignRecord, ParameterValue]]] = {}
        for vehicle, records in self.vehicles.items():
            for record in records:
                if name in self.values[record.campaign]:
                    groups.setdefault(vehicle, []).append((record, self.values[record.campaign][name]))
        return groups

    def dissimilar_medians(self, name: str) -> Mapping[str, float]:
        """Vehicle -> median of the parameter if the medians differ by more than `UNLIKE`; else empty."""
        groups = self.campaigns_with(name)
        medians = {vehicle: median_of(value for _, value in known) for vehicle, known in groups.items()}
        sizes = list(map(abs, medians.values()))
        if sizes and min(sizes) > 0.0 and max(sizes) > UNLIKE * min(sizes):
            return medians
        return {}

    @property
    def starts(self) -> list[float]:
        """Dates of the diagnosed campaigns that have one, in s since 1970, the earliest first."""
        return sorted(record.start for record in self.done if record.start is not None)

    @property
    def done(self) -> tuple[CampaignRecord, ...]:
        """Campaigns with a diagnosis."""
        return tuple(record for record in self.records if record.diagnosis is not None)

    @property
    def failed(self) -> tuple[CampaignRecord, ...]:
        """Campaigns without a diagnosis."""
        return tuple(record for record in self.records if record.diagnosis is None)


def median_of(values: Iterable[ParameterValue]) -> float:
    """Median of the comparable values, or of all values if none is comparable."""
    known = list(values)
    return statistics.median(value.value for value in [one for one in known if one.is_comparable] or known)


def causes(record: CampaignRecord, kind: str) -> list[str]:
    """Ids of the "findings" or the "suspects" of a campaign."""
    return [str(finding["effect"]) for finding in (record.diagnosis or {}).get(kind, ())]


def verdict(record: CampaignRecord) -> str | None:
    """Verdict of the diagnosis; None without a diagnosis."""
    return None if record.diagnosis is None else str(record.diagnosis["verdict"])


def guessed(record: CampaignRecord) -> list[str]:
    """Names of the vehicle's properties that `rovid init` guessed."""
    return [] if record.diagnosis is None else list(record.diagnosis["guessed"])


def _natural_order(name: str) -> list[tuple[int, str]]:
    """Sort key with numbers in numeric order: 2 before 10."""
    return [(int(part), "") if part.isdecimal() else (0, part) for part in re.split(r"(\d+)", name)]


def _values(record: CampaignRecord) -> dict[str, ParameterValue]:
    diagnosis = record.diagnosis or {}
    side = diagnosis.get("extended") or diagnosis.get("base") or {"parameters": {}}
    values = {}
    for name, entry in side["parameters"].items():
        if entry["value"] is not None:
            error = math.nan if entry["standard_error"] is None else entry["standard_error"]
            values[name] = ParameterValue(entry["value"], error, entry["unit"], entry.get("placeholder", False))
    return values


@dataclass(frozen=True, kw_only=True)
class Outlier:
    """A parameter far from the fleet's median; ``distance`` is signed, in robust standard deviations."""

    campaign: str
    vehicle: str
    name: str
    value: ParameterValue
    median: float
    distance: float


def outliers(fleet: Fleet) -> list[Outlier]:
    """All outliers by `RULE`, the farthest first."""
    found: list[Outlier] = []
    for name in fleet.parameters:
        groups = fleet.campaigns_with(name).values()
        comparable = [[(record, value) for record, value in known if value.is_comparable] for known in groups]
        if not fleet.dissimilar_medians(name):
            comparable = [list(itertools.chain.from_iterable(comparable))]
        for group in comparable:
            found += _outliers_among(group, name)
    return sorted(found, key=lambda outlier: (-abs(outlier.distance), outlier.campaign, outlier.name))


def _outliers_among(group: Sequence[tuple[CampaignRecord, ParameterValue]], name: str) -> Iterator[Outlier]:
    if len(group) < MIN_SISTERS:
        return
    values = np.array([value.value for _, value in group])
    errors = np.array([value.error for _, value in group])
    median = float(np.median(values))
    if (values > 0.0).all():
        values, errors = np.log(values), errors / values
    deviations = values - np.median(values)
    scatter = _NORMAL * float(np.median(np.abs(deviations)))
    distances = deviations / np.sqrt(scatter**2 + errors**2)
    for (record, value), distance in zip(group, distances.tolist(), strict=True):
        if abs(distance) > LIMIT:
            place = {"campaign": record.campaign, "vehicle": record.vehicle or "", "name": name}
            yield Outlier(**place, value=value, median=median, distance=distance)


# Minimum number of campaigns with the parameter; fewer do not determine the scatter.
MIN_SHRUNK = 4
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
    """Shrunk values of each parameter that at least `MIN_SHRUNK` campaigns have."""
    return tuple(filter(None, (_shrink(fleet, name) for name in fleet.parameters)))


def _shrink(fleet: Fleet, name: str) -> ShrunkParameter | None:
    known, unit = dict[str, tuple[str, ParameterValue]](), fleet.units[name]
    for vehicle, campaigns in fleet.campaigns_with(name).items():
        known |= {record.campaign: (vehicle, value) for record, value in campaigns if value.is_comparable}
    if len(known) < MIN_SHRUNK or not unit:
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
