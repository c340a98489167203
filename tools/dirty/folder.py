"""Folders: a campaign with at most one fault, as files, and its truth."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from tools.dirty import clock_faults, run_faults, signal_faults
from tools.dirty.campaign import Campaign, Damage, draw_campaign
from tools.dirty.vehicle import draw_vehicle
from tools.dirty.writers import WRITERS, log_name, write_campaign

FORMATS = tuple(WRITERS)
_TOPICS = ("csv_pair", "json", "ros2", "db3", "bin", "ulg")  # commands have stamps of their own

# Fault -> (what does the damage, formats in which this damage can occur).
_ALL: Mapping[str, tuple[Callable[[Campaign], Damage], tuple[str, ...]]] = {
    "lost_rows": (clock_faults.lost_rows, FORMATS),
    "repeated_stamps": (clock_faults.repeated_stamps, FORMATS),
    "clock_step": (clock_faults.clock_step, FORMATS),
    "wild_stamp": (clock_faults.wild_stamp, FORMATS),
    "arrival_bursts": (clock_faults.arrival_bursts, FORMATS),
    "clocks_apart": (clock_faults.clocks_apart, _TOPICS),
    "heading_step": (signal_faults.heading_step, FORMATS),
    "heading_gaps": (clock_faults.heading_gaps, FORMATS),
    "stale_commands": (clock_faults.stale_commands, FORMATS),
    "absent_zero": (signal_faults.absent_zero, ("json",)),
    "sentinel_command": (signal_faults.sentinel_command, ("csv", "csv_pair", "ros2", "db3", "bin", "ulg")),
    "unit_mismatch": (signal_faults.unit_mismatch, FORMATS),
    "thrust_unit": (signal_faults.thrust_unit, FORMATS),
    "scaled_heading": (signal_faults.scaled_heading, ("csv", "csv_pair", "json", "ros2", "db3", "bin")),
    "saturated_sensor": (signal_faults.saturated_sensor, FORMATS),
    "foreign_log": (run_faults.foreign_log, FORMATS),
    "no_response": (run_faults.no_response, FORMATS),
    "same_run_twice": (run_faults.same_run_twice, FORMATS),
    "two_sources": (signal_faults.two_sources, FORMATS),
    "several_releases": (run_faults.several_releases, FORMATS),
    "idle_ends": (run_faults.idle_ends, FORMATS),
}
FAULTS = tuple(_ALL)
_NONE = 0.15  # share of folders without a fault, where the fault is drawn


def draw_folder(
    seed: int, number: int, fault: str | None = "any", hidden: str | None = None, form: str | None = None
) -> tuple[Campaign, dict[str, Any]]:
    """Draw one campaign and its entry in truth.json.

    Parameters
    ----------
    fault
        An id of FAULTS, None for undamaged logs, "any" for a random choice.
    hidden
        An effect of HIDDEN that acts as well.
    form
        A format of FORMATS; a random one by default.
    """
    rng = np.random.default_rng([seed, number, zlib.crc32(str(fault).encode())])
    if fault == "any":
        fault = None if rng.random() < _NONE else str(rng.choice(FAULTS))
    if form is None:
        form = str(rng.choice(_ALL[fault][1] if fault else FORMATS))
    units = {"bin": ["us"], "ulg": ["1"]}.get(form, ["V", "percent", "us", "1"])
    if fault == "absent_zero":
        units.remove("us")
    vehicle = draw_vehicle(rng, str(rng.choice(units)), hidden)
    campaign = draw_campaign(rng, form, vehicle)
    damage = _ALL[fault][0](campaign) if fault else Damage(logs=())
    truth = {
        "fault": fault,
        "logs": [log_name(campaign, name) for name in damage.logs],
        "at": list(damage.at),
        "size": damage.size if fault else None,
        "unit": damage.unit or None,
        "note": damage.note or None,
        "inertia": vehicle.inertia,
        "quadratic_drag": vehicle.quadratic_drag,
        "linear_drag": vehicle.linear_drag,
        "time_constant": vehicle.time_constant,
        "format": form,
        "hidden": hidden,
        "hidden_size": {
            "thruster_lag": vehicle.lag,
            "bias_torque": vehicle.bias,
            "reverse_gain": vehicle.reverse_gain,
        }.get(hidden or ""),
        "rate_hz": campaign.rate_hz,
        "command_hz": campaign.command_hz,
        "runs": {log_name(campaign, log.name): log.kind for log in campaign.logs},
    }
    return campaign, truth


def write_folder(
    folder: Path, seed: int, number: int, fault: str | None = "any", hidden: str | None = None, form: str | None = None
) -> dict[str, Any]:
    """Draw one campaign, write its files to ``folder``, and return its truth."""
    campaign, truth = draw_folder(seed, number, fault, hidden, form)
    write_campaign(campaign, folder)
    return truth
