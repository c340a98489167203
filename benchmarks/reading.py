"""How fast are the readers, and how much memory do they take?

Ten-hour logs against the library underneath each reader, as the median ratio of alternated runs:
CSV to a Trial against `pandas.read_csv` of the same columns; JSON MCAP to a Trial against bare iteration of the
same topics by the mcap library. Then the peak memory of reading a large MCAP full of camera images.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from rovid.readers import read_log
from rovid.trial.config import load_config

TOML = """
[[thrusters]]
name = "fore"
yaw_arm = 0.43
curve = "curve.csv"
command = { csv = "fore_V", mcap = "/thrusters/fore.data" }
[[thrusters]]
name = "aft"
yaw_arm = 0.43
curve = "curve.csv"
command = { csv = "aft_V", mcap = "/thrusters/aft.data" }
[signals]
time = { csv = "time_s", mcap = "header" }
heading = { csv = "heading_deg", mcap = "/phins/heading.data", unit = "deg" }
"""
TOPICS = ("/phins/heading", "/thrusters/fore", "/thrusters/aft")
COLUMNS = ("time_s", "heading_deg", "fore_V", "aft_V")
RATE = 20.0
EPOCH = 1_767_787_200_000_000_000
# Read in a process of its own: VmHWM is its own peak, where ru_maxrss would take over its parent's.
MEASURE = """
import sys
from pathlib import Path
from rovid.trial.config import load_config
from rovid.readers import read_log
trial = read_log(Path(sys.argv[1]), load_config(Path(sys.argv[2])))
status = Path("/proc/self/status").read_text()
print(int(status.split("VmHWM:")[1].split()[0]) / 1024, int(trial.measured.sum()))
"""


def signals(hours: float) -> dict[str, np.ndarray]:
    """A vehicle that turns to and fro, as it would be logged."""
    time_s = np.arange(round(hours * 3600.0 * RATE)) / RATE
    noise = np.random.default_rng(1)
    heading = 360.0 * np.sin(time_s / 60.0) + time_s + noise.normal(0.0, 0.01, len(time_s))
    command = 1.5 * np.sin(time_s / 40.0)
    return {
        "time_s": time_s.round(3),
        "heading_deg": (heading % 360.0).round(3),
        "fore_V": command.round(4),
        "aft_V": (-command).round(4),
        "depth_m": noise.normal(5.0, 0.1, len(time_s)).round(3),
        "roll_deg": noise.normal(0.0, 0.1, len(time_s)).round(3),
    }


def start(path: Path, topics: tuple[str, ...], **options: object) -> tuple[Writer, list[int]]:
    writer = Writer(str(path), **options)  # type: ignore[arg-type]  # passed through
    writer.start()
    return writer, [writer.register_channel(topic, "json", 0) for topic in topics]


def payload(value: float, ns: int) -> bytes:
    stamp = {"sec": ns // 10**9, "nanosec": ns % 10**9}
    return json.dumps({"header": {"stamp": stamp, "frame_id": "base"}, "data": float(value)}).encode()


def write_mcap(path: Path, columns: dict[str, np.ndarray]) -> None:
    writer, channels = start(path, TOPICS)
    rows = zip(*(columns[name].tolist() for name in COLUMNS), strict=True)
    for seconds, *values in rows:
        ns = EPOCH + round(seconds * 1e9)
        for channel, value in zip(channels, values, strict=True):
            writer.add_message(channel, ns, payload(value, ns), ns)
    writer.finish()  # type: ignore[no-untyped-call]  # the library leaves its annotation out


def write_images(path: Path, gigabytes: float, *, chunked: bool) -> None:
    """Camera images of 1 to 4 MB at 5 Hz that nobody asked for, among heading and commands."""
    writer, channels = start(
        path, (*TOPICS, "/camera"), compression=CompressionType.NONE, use_chunking=chunked, chunk_size=4 << 20
    )
    image = np.random.default_rng(2).bytes(4 << 20)
    written, k = 0, 0
    while written < gigabytes * 1e9:
        ns = EPOCH + k * 50_000_000
        for channel, value in zip(channels[:3], (k * 0.3 % 360.0, 1.0 + k // 1000, -1.0), strict=True):
            writer.add_message(channel, ns, payload(value, ns), ns)
        if k % 4 == 0:
            size = (1 + k // 4 % 4) << 20
            writer.add_message(channels[3], ns, image[:size], ns)
            written += size
        k += 1
    writer.finish()  # type: ignore[no-untyped-call]  # as above


def iterate(path: Path) -> None:
    with path.open("rb") as file:
        for _ in make_reader(file).iter_messages(list(TOPICS)):
            pass


def ratio(ours: Callable[[], object], theirs: Callable[[], object], runs: int) -> tuple[float, float, float]:
    """(our median s, their median s, median ratio) of alternated runs."""
    pairs = [(timed(ours), timed(theirs)) for _ in range(runs)]
    mine, other = (statistics.median(column) for column in zip(*pairs, strict=True))
    return mine, other, statistics.median(a / b for a, b in pairs)


def timed(action: Callable[[], object]) -> float:
    begun = time.perf_counter()
    action()
    return time.perf_counter() - begun


def show(name: str, result: tuple[float, float, float], limit: float) -> None:
    print(f"{name:42} {result[0]:8.3f} s  against {result[1]:8.3f} s: ratio {result[2]:.2f} (at most {limit})")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=10.0, help="length of the logs")
    parser.add_argument("--gigabytes", type=float, default=2.0, help="size of the recording with images")
    parser.add_argument("--runs", type=int, default=3, help="alternated runs of MCAP; CSV takes seven times as many")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "rovid.toml").write_text(TOML)
        (folder / "curve.csv").write_text("command,thrust_N\n-5,-100\n5,100\n")
        config = load_config(folder / "rovid.toml")
        columns = signals(arguments.hours)
        log = folder / "log.csv"
        pd.DataFrame(columns).to_csv(log, index=False)
        result = ratio(
            lambda: read_log(log, config), lambda: pd.read_csv(log, usecols=list(COLUMNS)), 7 * arguments.runs
        )
        show("CSV to Trial, against pandas", result, 1.5)
        recording = folder / "log.mcap"
        write_mcap(recording, columns)
        result = ratio(lambda: read_log(recording, config), lambda: iterate(recording), arguments.runs)
        show("JSON MCAP to Trial, against bare iteration", result, 1.3)
        for chunked in (True, False):
            images = folder / "images.mcap"
            write_images(images, arguments.gigabytes, chunked=chunked)
            command = [sys.executable, "-c", MEASURE, str(images), str(config.path)]
            begun = time.perf_counter()
            peak, count = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
            print(
                f"{images.stat().st_size / 1e9:.2f} GB of images, {'chunked' if chunked else 'unchunked'}: peak "
                f"{float(peak):.0f} MB (at most 400), {count} headings, {time.perf_counter() - begun:.1f} s"
            )
            images.unlink()


if __name__ == "__main__":
    main()
