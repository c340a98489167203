"""The folder of a campaign: what a user would have, and no more."""

from __future__ import annotations

import csv
import datetime as dt
import json
from pathlib import Path

import numpy as np
from mcap.writer import Writer

from tools.hard.campaign import CLOCK, Campaign, Run
from tools.hard.thrust import bench
from tools.hard.vehicles import Thruster, Vehicle


def write_campaign(folder: Path, campaign: Campaign) -> None:
    """Write ``rovid.toml``, bench curves and logs into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    vehicle = campaign.vehicle
    listed = [index for index, one in enumerate(vehicle.thrusters) if one.listed]
    (folder / "rovid.toml").write_text(_configuration(campaign, listed), encoding="utf-8")
    for index in listed:
        _write_curve(folder / f"{_curve_name(vehicle, index)}.csv", vehicle, vehicle.thrusters[index])
    for number, run in enumerate(campaign.runs):
        as_mcap = campaign.format == "mcap" or (campaign.format == "mixed" and number % 2 == 1)
        name = f"run_{number + 1:02d}.{'mcap' if as_mcap else 'csv'}"
        (_write_mcap if as_mcap else _write_csv)(folder / name, campaign, run, listed)


def _curve_name(vehicle: Vehicle, index: int) -> str:
    """One curve serves all thrusters that share their numbers."""
    one = vehicle.thrusters[index]
    numbers = [(other.forward, other.backward, other.zone) for other in vehicle.thrusters]
    first = numbers.index((one.forward, one.backward, one.zone))
    return "curve" if all(n == numbers[0] for i, n in enumerate(numbers) if vehicle.thrusters[i].listed) else (
        f"curve_{vehicle.thrusters[first].name}"
    )  # fmt: skip


def _in_unit(vehicle: Vehicle, command: float) -> float:
    return round(vehicle.neutral + vehicle.span * command, 6)


def _write_curve(path: Path, vehicle: Vehicle, thruster: Thruster) -> None:
    row = thruster.row(0.0)
    points = set(np.linspace(-1.0, 1.0, 41).tolist())
    if not thruster.pod_angle:
        ahead, astern = thruster.zone
        points |= {ahead, -astern}
        points |= set((ahead + (1 - ahead) * np.linspace(0, 0.3, 13)).tolist())
        points |= set((-astern - (1 - astern) * np.linspace(0, 0.3, 13)).tolist())
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(["command", "thrust_N"])
        written = {_in_unit(vehicle, point): bench(point, row) for point in points}
        out.writerows([[command, f"{written[command]:.6g}"] for command in sorted(written)])


def _configuration(campaign: Campaign, listed: list[int]) -> str:
    vehicle, instruments = campaign.vehicle, campaign.instruments
    lines = [
        "[vehicle]", f'name = "{vehicle.name} (simulated)"', f"mass = {vehicle.mass}     # kg",
        f"length = {vehicle.length}    # m", f"width = {vehicle.width}     # m",
        f"rigid_body_inertia = {vehicle.inertia:.4g}    # kg m^2", "",
    ]  # fmt: skip
    for index in listed:
        one = vehicle.thrusters[index]
        lines += [
            "[[thrusters]]", f'name = "{one.name}"', f"yaw_arm = {one.arm:.6g}    # m",
            f'curve = "{_curve_name(vehicle, index)}.csv"    # command in {vehicle.unit}, thrust in N',
            f'command = {{ csv = "{one.name}", mcap = "/commands.{one.name}" }}', "",
        ]  # fmt: skip
    column = "time_s" if campaign.clock == "relative" else "time"
    lines += [
        "[signals]", f'time = {{ csv = "{column}" }}',
        'heading = { csv = "heading_deg", mcap = "/nav.heading_deg", unit = "deg" }',
    ]  # fmt: skip
    if instruments.gyro:
        lines.append('yaw_rate = { csv = "yaw_rate_dps", mcap = "/nav.yaw_rate_dps", unit = "deg/s" }')
    if instruments.speed:
        lines.append('surge_velocity = { csv = "surge_m_s", mcap = "/dvl.surge_m_s", unit = "m/s" }')
        lines.append('sway_velocity = { csv = "sway_m_s", mcap = "/dvl.sway_m_s", unit = "m/s" }')
    return "\n".join(lines) + "\n"


def _clock_of(campaign: Campaign, run: Run) -> float:
    """Epoch of a run's start, with a separate day for each campaign."""
    return CLOCK + 86400.0 * (campaign.seed % 3000) + run.start


def _columns(campaign: Campaign, run: Run, listed: list[int]) -> dict[str, list[str]]:
    """Values as text, in the units of the log."""
    vehicle, log, step = campaign.vehicle, run.log, campaign.instruments.heading_step
    degrees = np.round(np.mod(np.degrees(log.heading), 360.0) / step) * step % 360.0
    columns = {"heading_deg": [f"{value:.4g}" if step >= 0.1 else f"{value:.2f}" for value in degrees]}
    if log.yaw_rate is not None:
        columns["yaw_rate_dps"] = [f"{value:.4f}" for value in np.degrees(log.yaw_rate)]
    for name, values in (("surge_m_s", log.surge), ("sway_m_s", log.sway)):
        if values is not None:
            columns[name] = ["" if np.isnan(value) else f"{value:.3f}" for value in values]
    for index in listed:
        raw = vehicle.neutral + vehicle.span * log.commands[:, index]
        columns[vehicle.thrusters[index].name] = [f"{value:.6g}" for value in raw]
    return columns


def _write_csv(path: Path, campaign: Campaign, run: Run, listed: list[int]) -> None:
    columns = _columns(campaign, run, listed)
    begin = _clock_of(campaign, run)
    if campaign.clock == "relative":
        times = [f"{value:.4f}" for value in run.log.time]
    elif campaign.clock == "epoch":
        times = [f"{begin + value:.4f}" for value in run.log.time]
    else:
        stamp = dt.datetime.fromtimestamp(begin, dt.UTC)
        times = [
            (stamp + dt.timedelta(seconds=float(value))).isoformat(timespec="microseconds") for value in run.log.time
        ]
    name = "time_s" if campaign.clock == "relative" else "time"
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow([name, *columns])
        out.writerows(zip(times, *columns.values(), strict=True))


def _write_mcap(path: Path, campaign: Campaign, run: Run, listed: list[int]) -> None:
    """Messages of JSON: navigation and commands at each row, the DVL where it had a reading."""
    columns = _columns(campaign, run, listed)
    navigation = [name for name in columns if name in {"heading_deg", "yaw_rate_dps"}]
    speeds = [name for name in columns if name in {"surge_m_s", "sway_m_s"}]
    topics = {"/nav": navigation, "/commands": [name for name in columns if name not in {*navigation, *speeds}]}
    if speeds:
        topics["/dvl"] = speeds
    stamps = np.round((_clock_of(campaign, run) + run.log.time) * 1e9).astype(np.int64).tolist()
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, names in topics.items():
            shape = {"type": "object", "properties": {name: {"type": "number"} for name in names}}
            schema = writer.register_schema(topic.strip("/"), "jsonschema", json.dumps(shape).encode())
            channel = writer.register_channel(topic, "json", schema)
            rows = zip(*(columns[name] for name in names), strict=True)
            head = [f'"{name}":' for name in names]
            for stamp, row in zip(stamps, rows, strict=True):
                if "" in row:
                    continue
                data = "{" + ",".join(a + b for a, b in zip(head, row, strict=True)) + "}"
                writer.add_message(channel, log_time=stamp, publish_time=stamp, data=data.encode())
        writer.finish()  # type: ignore[no-untyped-call]  # the library lacks its type
