"""The folder of a campaign: what a user would have, and no more."""

from __future__ import annotations

import datetime as dt
import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from mcap.writer import Writer

from tools.planar.campaign import Campaign, Run, current_at
from tools.planar.motion import AZIMUTH, RUDDER, Floats
from tools.planar.sensors import readings

_EPOCH = 1_780_000_000.0  # s, when the first campaign's day began
_COLUMNS = {
    "heading": ("heading_deg", "deg"), "yaw_rate": ("yaw_rate_dps", "deg/s"), "surge_velocity": ("u_m_s", "m/s"),
    "sway_velocity": ("v_m_s", "m/s"), "north": ("north_m", "m"), "east": ("east_m", "m"),
}  # fmt: skip
Table = tuple[Floats, dict[str, list[str]]]


def write_campaign(folder: Path, campaign: Campaign) -> None:
    """Write ``rovid.toml``, bench curves and logs into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    vehicle = campaign.vehicle
    for one, commands, thrusts in zip(vehicle.actuators, vehicle.commands, vehicle.thrusts, strict=True):
        if one.kind != RUDDER:
            rows = [f"{c:.9g},{t:.9g}" for c, t in zip(commands.tolist(), thrusts.tolist(), strict=True)]
            (folder / f"curve_{one.name}.csv").write_text(
                "\n".join(["command,thrust_N", *rows]) + "\n", encoding="utf-8"
            )
    (folder / "rovid.toml").write_text(configuration(campaign), encoding="utf-8")
    for number, run in enumerate(campaign.runs):
        tables = _tables(campaign, run, np.random.default_rng([campaign.seed, campaign.index, number, 3]))
        name = f"run_{number + 1:02d}"
        if campaign.format == "csv":
            _one_table(folder / f"{name}.csv", campaign, run, tables)
        elif campaign.format == "csv_parts":
            for part, (time, columns) in tables.items():
                _table(folder / f"{name}_{part}.csv", _stamps(campaign, run, time), columns)
        else:
            _mcap(folder / f"{name}.mcap", campaign, run, tables)


def configuration(campaign: Campaign) -> str:
    """Text of ``rovid.toml``; every other campaign gives position and direction in place of the shares."""
    vehicle = campaign.vehicle
    mcap = campaign.format == "mcap"

    def source(topic: str, name: str, unit: str = "") -> str:
        place = f'mcap = "/{topic}.{name}"' if mcap else f'csv = "{name}"'
        return f"{{ {place}{f', unit = {chr(34)}{unit}{chr(34)}' if unit else ''} }}"

    lines = ["[vehicle]", f'name = "{vehicle.family} (simulated)"', f"mass = {vehicle.mass:.5g}",
             f"length = {vehicle.length:.4g}", f"width = {vehicle.width:.4g}",
             f"rigid_body_inertia = {vehicle.rigid_inertia:.5g}", ""]  # fmt: skip
    for one in vehicle.actuators:
        lines += ["[[rudders]]" if one.kind == RUDDER else "[[thrusters]]", f'name = "{one.name}"']
        if one.kind == RUDDER:
            lines += [f"position = [{one.x:.6g}, {one.y:.6g}]", f'behind = "{one.behind}"',
                      f"area = {one.area:.5g}", f"angle = {source('commands', one.name, 'deg')}", ""]  # fmt: skip
            continue
        if one.kind == AZIMUTH:
            lines += [f"position = [{one.x:.6g}, {one.y:.6g}]",
                      f"azimuth = {source('commands', f'{one.name}_angle', 'deg')}"]  # fmt: skip
        elif campaign.index % 2:
            lines += [f"position = [{one.x:.9g}, {one.y:.9g}]", f"direction = {math.degrees(one.direction):.9g}"]
        else:
            lines += [f"surge = {one.surge:.9g}", f"sway = {one.sway:.9g}", f"yaw_arm = {one.arm:.9g}"]
        lines += [f'curve = "curve_{one.name}.csv"', f"command = {source('commands', one.name)}", ""]
    lines += ["[signals]", *([] if mcap else ['time = { csv = "time" }'])]
    for sensor in campaign.sensors:
        for signal in sensor.signals:
            column, unit = _COLUMNS[signal]
            lines.append(f"{signal} = {source(sensor.kind, column, unit)}")
    if campaign.format == "csv_parts":
        parts = ", ".join(f'"{name}"' for name in (*(sensor.kind for sensor in campaign.sensors), "commands"))
        lines += ["", "[join]", f"parts = [{parts}]"]
    return "\n".join(lines) + "\n"


def _tables(campaign: Campaign, run: Run, rng: np.random.Generator) -> dict[str, Table]:
    """Stamps (s of the log) and columns of text for each sensor, and for the commands."""
    tables: dict[str, Table] = {}
    for k, sensor in enumerate(campaign.sensors):
        values = readings(sensor, run.truth[k], current_at(campaign, run, k), rng)
        columns = {}
        for j, signal in enumerate(sensor.signals):
            column: Floats = values[:, j]
            if signal == "heading":
                column = np.asarray(np.round(np.mod(np.degrees(column), 360.0), sensor.decimals) % 360.0, dtype=float)
            elif signal == "yaw_rate":
                column = np.degrees(column)
            columns[_COLUMNS[signal][0]] = [f"{value + 0.0:.{sensor.decimals}f}" for value in column.tolist()]
        tables[sensor.kind] = (run.stamps[k], columns)
    logged = run.sent >= run.before - 1e-9
    first = max(int(np.argmax(logged)) - 1, 0)  # the command that is active when the log starts
    time = np.maximum(np.round(run.sent[first:] - run.before, 6), 0.0)
    if time.size > 1 and time[1] <= 1e-9:
        time, first = time[1:], first + 1
    vehicle = campaign.vehicle
    columns = {
        name: [f"{value + 0.0:.{vehicle.decimals[j]}f}" for value in run.commands[first:, j].tolist()]
        for j, name in enumerate(vehicle.channels)
    }
    tables["commands"] = (time, columns)
    return tables


def _stamps(campaign: Campaign, run: Run, time: Floats) -> list[str]:
    """Time column of a table."""
    if campaign.clock == "relative":
        return [f"{value:.5f}" for value in time.tolist()]
    begin = _EPOCH + 86400.0 * (campaign.index % 3000) + round(run.day, 3)
    if campaign.clock == "epoch":
        return [f"{value:.5f}" for value in (begin + time).tolist()]
    stamp = dt.datetime.fromtimestamp(begin, dt.UTC)
    return [(stamp + dt.timedelta(seconds=value)).isoformat(timespec="microseconds") for value in time.tolist()]


def _table(path: Path, stamps: list[str], columns: dict[str, list[str]]) -> None:
    rows = zip(stamps, *columns.values(), strict=True)
    lines = [",".join(["time", *columns]), *(",".join(row) for row in rows)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _one_table(path: Path, campaign: Campaign, run: Run, tables: dict[str, Table]) -> None:
    """A row for each instant of a reading or a command: cells without a reading are empty, commands are held."""
    time = np.unique(np.concatenate([table[0] for table in tables.values()]))
    columns: dict[str, list[str]] = {}
    for name, (stamps, texts) in tables.items():
        if name == "commands":
            place = np.maximum(np.searchsorted(stamps, time + 1e-9, side="right") - 1, 0)
        else:
            place = np.full(time.size, -1)
            place[np.searchsorted(time, stamps)] = np.arange(stamps.size)
        columns |= {key: [values[k] if k >= 0 else "" for k in place.tolist()] for key, values in texts.items()}
    _table(path, _stamps(campaign, run, time), columns)


def _mcap(path: Path, campaign: Campaign, run: Run, tables: dict[str, Table]) -> None:
    """Messages of JSON, a topic for each sensor and one for the commands."""
    begin = _EPOCH + 86400.0 * (campaign.index % 3000) + round(run.day, 3)
    messages: list[tuple[float, str, Sequence[str]]] = []
    for topic, (time, columns) in tables.items():
        rows = zip(*columns.values(), strict=True)
        messages += [(stamp, topic, row) for stamp, row in zip(time.tolist(), rows, strict=True)]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = {}
        for topic in tables:
            schema = writer.register_schema(topic, "jsonschema", b'{"type": "object"}')
            channels[topic] = writer.register_channel(f"/{topic}", "json", schema)
        for stamp, topic, row in sorted(messages, key=lambda message: message[0]):
            fields = {name: float(value) for name, value in zip(tables[topic][1], row, strict=True)}
            nanoseconds = round((begin + stamp) * 1e5) * 10_000
            writer.add_message(channels[topic], nanoseconds, json.dumps(fields).encode(), nanoseconds)
        writer.finish()  # type: ignore[no-untyped-call]  # the library lacks its type
