"""The folder of a campaign: what a user would have, and no more."""

from __future__ import annotations

import datetime as dt
import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mcap.writer import Writer

from tools.wide.campaign import Campaign, Run, deviation
from tools.wide.motion import Floats

_EPOCH = 1_780_000_000.0  # s, when the first campaign's day began


def write_campaign(folder: Path, campaign: Campaign) -> None:
    """Write ``rovid.toml``, bench tables and logs into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    vehicle = campaign.vehicle
    raw = vehicle.rest + vehicle.span * vehicle.commands
    for name, thrusts in zip(vehicle.names, vehicle.thrusts, strict=True):
        rows = [f"{c:.9g},{t:.9g}" for c, t in zip(raw.tolist(), thrusts.tolist(), strict=True)]
        (folder / f"curve_{name}.csv").write_text("\n".join(["command,thrust_N", *rows]) + "\n", encoding="utf-8")
    (folder / "rovid.toml").write_text(_configuration(campaign), encoding="utf-8")
    for number, run in enumerate(campaign.runs):
        rng = np.random.default_rng([campaign.seed, campaign.index, number])
        motion = _motion(campaign, run, rng)
        commands = _commands(campaign, run)
        name = f"run_{number + 1:02d}"
        if campaign.format == "csv":
            _one_table(folder / f"{name}.csv", campaign, run, motion, commands)
        elif campaign.format == "csv_pair":
            _table(folder / f"{name}_nav.csv", campaign, run, run.time, motion)
            _table(folder / f"{name}_thr.csv", campaign, run, run.sent[run.logged], commands)
        else:
            _mcap(folder / f"{name}.mcap", campaign, run, motion, commands)


def _configuration(campaign: Campaign) -> str:
    vehicle = campaign.vehicle
    mcap = campaign.format == "mcap"

    def source(topic: str, name: str) -> str:
        return f'mcap = "/{topic}.{name}"' if mcap else f'csv = "{name}"'

    lines = ["[vehicle]", 'name = "made up"', f"mass = {vehicle.mass:.5g}", f"length = {vehicle.length:.4g}"]
    lines += [f"width = {vehicle.width:.4g}", f"rigid_body_inertia = {vehicle.rigid_inertia:.4g}", ""]
    for name, arm in zip(vehicle.names, vehicle.arms.tolist(), strict=True):
        lines += ["[[thrusters]]", f'name = "{name}"', f"yaw_arm = {arm:.9g}", f'curve = "curve_{name}.csv"']
        lines += [f"command = {{ {source('thrusters', name)} }}", ""]
    lines += ["[signals]"]
    if not mcap:
        lines += ['time = { csv = "time" }']
    lines += [f'heading = {{ {source("nav", "heading_deg")}, unit = "deg" }}']
    if campaign.rate_noise:
        lines += [f'yaw_rate = {{ {source("nav", "yaw_rate")}, unit = "rad/s" }}']
    if campaign.speed:
        lines += [f'surge_velocity = {{ {source("nav", "surge")}, unit = "m/s" }}']
        lines += [f'sway_velocity = {{ {source("nav", "sway")}, unit = "m/s" }}']
    if campaign.voltage:
        lines += [f"supply_voltage = {{ {source('nav', 'voltage')} }}"]
    if campaign.format == "csv_pair":
        lines += ["", "[join]", 'parts = ["nav", "thr"]']
    return "\n".join(lines) + "\n"


def _motion(campaign: Campaign, run: Run, rng: np.random.Generator) -> dict[str, list[str]]:
    """Columns of the motion as text, in the units of the log."""
    psi = run.truth[:, 0]
    measured = psi + deviation(campaign.cause, psi) + rng.normal(0.0, campaign.noise, psi.size)
    decimals = max(math.ceil(-math.log10(math.degrees(campaign.noise))), 0)
    degrees = np.round(np.mod(np.degrees(measured), 360.0), decimals) % 360.0
    columns = {"heading_deg": [f"{value:.{decimals}f}" for value in degrees.tolist()]}
    if campaign.rate_noise:
        rates = run.truth[:, 1] + rng.normal(0.0, campaign.rate_noise, psi.size)
        columns["yaw_rate"] = [f"{value:.5g}" for value in rates.tolist()]
    if campaign.speed:
        for name, column, size in (("surge", 2, campaign.speed), ("sway", 3, campaign.sway)):
            values = run.truth[:, column] + rng.normal(0.0, 0.01 * size, psi.size)
            columns[name] = [f"{value:.5g}" for value in values.tolist()]
    if campaign.voltage:
        grid = run.series_begin + run.series_step * np.arange(run.series.shape[0])
        volts = campaign.voltage * np.interp(run.time, grid, run.series[:, 3])
        columns["voltage"] = [f"{value:.6g}" for value in volts.tolist()]
    return columns


def _commands(campaign: Campaign, run: Run) -> dict[str, list[str]]:
    """Columns of the commands as text, in their unit."""
    vehicle = campaign.vehicle
    raw = vehicle.rest + vehicle.span * run.commands[run.logged]
    return {
        name: [f"{value + 0.0:.{vehicle.decimals}f}" for value in np.round(raw[:, k], vehicle.decimals).tolist()]
        for k, name in enumerate(vehicle.names)
    }


def _stamps(campaign: Campaign, run: Run, time: Floats) -> list[str]:
    """Time column of a table."""
    if campaign.clock == "relative":
        return [f"{value:.5f}" for value in time.tolist()]
    if campaign.clock == "day":
        return [f"{value:.5f}" for value in (100.0 + run.day + time).tolist()]
    begin = _EPOCH + 86400.0 * (campaign.index % 3000) + round(run.day, 3)
    if campaign.clock == "epoch":
        return [f"{value:.5f}" for value in (begin + time).tolist()]
    stamp = dt.datetime.fromtimestamp(begin, dt.UTC)
    return [(stamp + dt.timedelta(seconds=value)).isoformat(timespec="microseconds") for value in time.tolist()]


def _table(path: Path, campaign: Campaign, run: Run, time: Floats, columns: dict[str, list[str]]) -> None:
    rows = zip(_stamps(campaign, run, time), *columns.values(), strict=True)
    lines = [",".join(["time", *columns]), *(",".join(row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _one_table(
    path: Path, campaign: Campaign, run: Run, motion: dict[str, list[str]], commands: dict[str, list[str]]
) -> None:
    """Rows at each reading of the heading and each command; between readings the heading's cell is empty."""
    sent = run.sent[run.logged]
    time = np.union1d(run.time, sent[sent >= 0.0])
    reading = np.full(time.size, -1)
    reading[np.searchsorted(time, run.time)] = np.arange(run.time.size)
    held = np.maximum(np.searchsorted(sent, time + 1e-9, side="right") - 1, 0).tolist()
    columns = {name: [texts[k] if k >= 0 else "" for k in reading.tolist()] for name, texts in motion.items()}
    columns |= {name: [texts[k] for k in held] for name, texts in commands.items()}
    _table(path, campaign, run, time, columns)


def _mcap(
    path: Path, campaign: Campaign, run: Run, motion: dict[str, list[str]], commands: dict[str, list[str]]
) -> None:
    """Messages of JSON: a topic of the navigation, a topic of the commands."""
    begin = _EPOCH + 86400.0 * (campaign.index % 3000) + round(run.day, 3)
    messages: list[tuple[float, str, Sequence[str]]] = []
    for topic, time, columns in (("nav", run.time, motion), ("thrusters", run.sent[run.logged], commands)):
        rows = zip(*columns.values(), strict=True)
        messages += [(stamp, topic, row) for stamp, row in zip(time.tolist(), rows, strict=True)]
    names = {"nav": list(motion), "thrusters": list(commands)}
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = {}
        for topic in names:
            schema = writer.register_schema(topic, "jsonschema", b'{"type": "object"}')
            channels[topic] = writer.register_channel(f"/{topic}", "json", schema)
        for stamp, topic, row in sorted(messages, key=lambda message: message[0]):
            fields = {name: float(value) for name, value in zip(names[topic], row, strict=True)}
            nanoseconds = round((begin + stamp) * 1e5) * 10_000
            writer.add_message(channels[topic], nanoseconds, json.dumps(fields).encode(), nanoseconds)
        writer.finish()  # type: ignore[no-untyped-call]  # the library lacks its type
