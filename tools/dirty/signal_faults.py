"""Faults of values: heading, commands and units."""

from __future__ import annotations

import numpy as np

from tools.dirty.campaign import MILLI, Campaign, Damage
from tools.dirty.clock_faults import some
from tools.dirty.vehicle import UNITS, log_uniform


def heading_step(campaign: Campaign) -> Damage:
    """The heading jumps by 3 to 180 deg and stays."""
    rng, logs = campaign.rng, some(campaign)
    most = np.degrees(campaign.vehicle.full_rate) / campaign.rate_hz  # deg between two readings
    size = float(rng.choice([-1.0, 1.0]) * log_uniform(rng, max(3.0, most, 12.0 * campaign.noise), 175.0))
    at = []
    for log in logs:
        instants, heading = log.motion.instants, log.motion.columns["heading"]
        instant = float(rng.uniform(0.1, 0.9) * instants[-1])
        at.append(round(float(instants[np.searchsorted(instants, instant)]) - log.start, MILLI))
        log.motion = log.motion.changed(heading=campaign.wrapped(heading + size * (instants >= instant)))
    return Damage(logs=tuple(log.name for log in logs), at=tuple(at), size=size, unit="deg")


def absent_zero(campaign: Campaign) -> Damage:
    """JSON messages lack the fields that are zero."""
    campaign.zeros_absent = True
    zero = [np.column_stack([*log.thrust.columns.values()]) == 0.0 for log in campaign.logs]
    names = tuple(log.name for log, where in zip(campaign.logs, zero, strict=True) if where.any())
    return Damage(logs=names, size=float(np.mean([where.mean() for where in zero])), unit="1")


def sentinel_command(campaign: Campaign) -> Damage:
    """Commands of 0 us, 65535 us or NaN while the thrusters are disarmed."""
    rng, unit = campaign.rng, campaign.vehicle.unit
    rest = UNITS[unit][0]
    size = float(rng.choice([0.0, 65535.0])) if unit == "us" else float("nan")
    campaign.absent_command = "nan"
    names = []
    for log in campaign.logs:
        off = (np.column_stack([*log.thrust.columns.values()]) == rest).all(axis=1)
        if off.any():
            log.thrust = log.thrust.changed(**{n: np.where(off, size, v) for n, v in log.thrust.columns.items()})
            names.append(log.name)
    return Damage(logs=tuple(names), size=size if size == size else -1.0, unit=unit, note=f"{size:g}")  # noqa: PLR0124


def unit_mismatch(campaign: Campaign) -> Damage:
    """The thrust curves are in another unit than the commands."""
    unit = campaign.vehicle.unit
    rest, span, _ = UNITS[unit]
    others = {"V": ["percent"], "percent": ["V", "1"], "us": ["1", "percent"], "1": ["us", "percent"]}[unit]
    other = str(campaign.rng.choice(others))
    other_rest, other_span, decimals = UNITS[other]
    campaign.curves = [
        (np.round(other_rest + other_span * (command - rest) / span, decimals + 2), thrust)
        for command, thrust in campaign.curves
    ]
    note = f"commands in {unit}, curves in {other}"
    return Damage(logs=(), size=span / other_span, unit=unit, note=note)


def thrust_unit(campaign: Campaign) -> Damage:
    """The thrust curves are in kgf or lbf, called N."""
    factor, unit = (9.80665, "kgf") if campaign.rng.random() < 0.5 else (4.4482216, "lbf")
    campaign.curves = [(command, thrust / factor) for command, thrust in campaign.curves]
    return Damage(logs=(), size=factor, unit=unit)


def scaled_heading(campaign: Campaign) -> Damage:
    """The heading is in another unit than rovid.toml states: half degrees, gon, or radians; or degrees called rad."""
    kinds = {"half": 0.5, "gon": 400.0 / 360.0, "rad called deg": np.pi / 180.0}
    if campaign.format != "ulg":
        kinds["deg called rad"] = 180.0 / np.pi
    kind = str(campaign.rng.choice(list(kinds)))
    factor = kinds[kind] if kind != "deg called rad" else 1.0
    for log in campaign.logs:
        log.motion = log.motion.changed(heading=log.motion.columns["heading"] * factor)
    if kind == "deg called rad":
        campaign.heading_unit = "rad"
    return Damage(logs=(), size=float(kinds[kind]), unit="1", note=kind)


def saturated_sensor(campaign: Campaign) -> Damage:
    """The heading, or the yaw rate where one is logged, is clipped."""
    rng, logs = campaign.rng, some(campaign)
    if campaign.with_rate and rng.random() < 0.5:
        limit = float(rng.uniform(0.35, 0.7) * np.degrees(campaign.vehicle.full_rate))
        for log in logs:
            log.motion = log.motion.changed(rate=log.motion.columns["rate"].clip(-limit, limit))
        names = [log.name for log in logs if np.any(np.abs(log.motion.columns["rate"]) >= limit)]
        return Damage(logs=tuple(names), size=limit, unit="deg/s", note="rate")
    limit = float(np.quantile(np.abs(logs[0].motion.columns["heading"]), rng.uniform(0.6, 0.95)))
    names = []
    for log in logs:
        heading = log.motion.columns["heading"]
        if 0.03 < np.mean(np.abs(heading) > limit) < 0.6:  # a log that is clipped throughout holds no motion
            log.motion = log.motion.changed(heading=heading.clip(-limit, limit))
            names.append(log.name)
    return Damage(logs=tuple(names), size=limit, unit="deg", note="heading")


def two_sources(campaign: Campaign) -> Damage:
    """A second compass of another zero speaks in the same signal."""
    rng, logs = campaign.rng, some(campaign)
    turned = float(rng.choice([-1.0, 1.0]) * log_uniform(rng, max(2.0, 12.0 * campaign.noise), 40.0))
    share = float(rng.uniform(0.25, 0.5))
    regular = bool(rng.random() < 0.5)
    for log in logs:
        heading = log.motion.columns["heading"]
        second = np.arange(len(heading)) % 2 == 1 if regular else rng.random(len(heading)) < share
        other = heading + turned + rng.normal(0.0, campaign.noise, len(heading))
        log.motion = log.motion.changed(heading=campaign.wrapped(np.where(second, other, heading)))
    note = "every second reading" if regular else f"{share:.2f} of the readings"
    return Damage(logs=tuple(log.name for log in logs), size=turned, unit="deg", note=note)
