"""`rovid --help` against starting Python alone."""

from __future__ import annotations

import statistics
import subprocess
import sys
import time
from pathlib import Path


def seconds(command: list[str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return time.perf_counter() - start


def main() -> None:
    rovid = str(Path(sys.executable).with_name("rovid"))
    pairs = [(seconds([rovid, "--help"]), seconds([sys.executable, "-c", "pass"])) for _ in range(11)]
    ours, bare = (statistics.median(column) for column in zip(*pairs, strict=True))
    print(f"rovid --help: {ours:.2f} s (limit 0.3), bare Python {bare:.3f} s, ratio {ours / bare:.1f}")


if __name__ == "__main__":
    main()
