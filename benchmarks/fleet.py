"""A fleet on one core, on all, on a Dask cluster of this machine, and killed again and again: time, memory, the table.

Run ``python -m benchmarks.fleet --campaigns 200``. Campaigns of three runs each, of every vehicle in turn, with a
slow thruster in every fourth. Whatever way they are diagnosed, table and page have to be the same to the byte.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import secrets
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rovid.core.threads import CORES_VARIABLE, core_count
from tools.cases import Case, all_cases
from tools.programme import campaign_for
from tools.trial_day import write_trial_day
from tools.truth import VEHICLES, Truth

RUNS = 3
HIDDEN = "thruster_lag-first_order-strong"
KILLS = 5
CLUSTER = """
import sys
from distributed import LocalCluster
if __name__ == "__main__":
    with LocalCluster(n_workers=int(sys.argv[1]), threads_per_worker=1, dashboard_address=None) as cluster:
        print(cluster.scheduler_address, flush=True)
        sys.stdin.read()
"""
_LOOK = 0.2  # s between looks at a process's memory


@dataclass(frozen=True, kw_only=True)
class Ran:
    """What one way took: s, MB of the fleet's own process at its peak (None where the system does not tell)."""

    seconds: float
    megabytes: float | None
    document: dict[str, Any]


def write_fleet(folder: Path, campaigns: int, seed: int) -> None:
    """So many campaigns in ``folder``."""
    for number in range(campaigns):
        vehicle = VEHICLES[number % len(VEHICLES)]
        truth = _hidden(vehicle).of(vehicle) if number % 4 == 3 else vehicle
        programme, rng = campaign_for(truth), np.random.default_rng([seed, number])
        chosen = sorted(rng.choice(len(programme), RUNS, replace=False).tolist())
        runs = [programme[place] for place in chosen]
        named = replace(truth, name=f"{truth.name} {number % 12}")
        write_trial_day(folder / f"campaign_{number:04d}", seed=seed + number, truth=named, campaign=runs)


def _hidden(vehicle: Truth) -> Case:
    return next(case for case in all_cases(vehicle) if case.name == HIDDEN)


def command(fleet: Sequence[Path], out: Path, *more: str) -> list[str]:
    return [sys.executable, "-m", "rovid", "fleet", *map(str, fleet), "-o", str(out), "--json", *more]


def ran(fleet: Sequence[Path], out: Path, *more: str, share: int | None = None) -> Ran:
    """The fleet of such folders by one command, on so many of the cores."""
    environment = os.environ if share is None else os.environ | {CORES_VARIABLE: str(share)}
    begun = time.monotonic()
    with (
        tempfile.TemporaryFile("w+") as said,
        subprocess.Popen(command(fleet, out, *more), stdout=said, env=environment) as process,
    ):
        peak = _Peak(process)
        if process.wait():
            raise RuntimeError(f"rovid fleet ended with {process.returncode}")
        said.seek(0)
        return Ran(seconds=time.monotonic() - begun, megabytes=peak.megabytes, document=json.load(said))


class _Peak:
    """The most memory that a process has had, looked at as long as it runs."""

    def __init__(self, process: subprocess.Popen[Any]) -> None:
        self.megabytes: float | None = None
        self._status = Path(f"/proc/{process.pid}/status")
        threading.Thread(target=self._watch, args=[process], daemon=True).start()

    def _watch(self, process: subprocess.Popen[Any]) -> None:
        while process.poll() is None:
            with contextlib.suppress(OSError):
                for line in self._status.read_text().splitlines():
                    if line.startswith("VmHWM:"):
                        self.megabytes = int(line.split()[1]) / 1024
            time.sleep(_LOOK)


@contextlib.contextmanager
def cluster(workers: int) -> Iterator[str]:
    """The address of a Dask cluster of so many workers of this machine."""
    with subprocess.Popen(
        [sys.executable, "-c", CLUSTER, str(workers)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip()
        process.communicate("")


def killed(fleet: Sequence[Path], out: Path, seconds: float) -> None:
    """Begin, be killed, begin again: `KILLS` times, within about ``seconds`` in all."""
    for _ in range(KILLS):
        with subprocess.Popen(command(fleet, out), stdout=subprocess.DEVNULL) as process:
            time.sleep(seconds / (KILLS + 1))
            process.kill()
        print(f"killed with {len(list(out.rglob('campaigns/*.json')))} campaigns done", flush=True)


def same(one: Path, other: Path) -> bool:
    """Whether table and page are the same to the byte."""
    return all((one / name).read_bytes() == (other / name).read_bytes() for name in ("fleet.parquet", "index.html"))


def memory(each: Ran) -> str:
    """The fleet's own peak, and those of the campaigns' processes."""
    peaks = [one["peak_memory_bytes"] / 2**20 for one in each.document["campaigns"] if one["peak_memory_bytes"]]
    own = "?" if each.megabytes is None else f"{each.megabytes:.0f}"
    fourth = max(len(peaks) // 4, 1)
    late = np.median(peaks[-fourth:]) / np.median(peaks[:fourth])
    return (
        f"memory: the fleet's process {own} MB; its campaigns' {np.median(peaks):.0f} MB, {max(peaks):.0f} at most, "
        f"the last fourth {late:.2f} times the first"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--campaigns", type=int, default=200)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6))
    options = parser.parse_args(arguments)
    print(f"{options.campaigns} campaigns, seed {options.seed}, {core_count()} cores", flush=True)
    with tempfile.TemporaryDirectory() as name:
        room = Path(name)
        write_fleet(room / "fleet", options.campaigns, options.seed)
        fleet = sorted((room / "fleet").iterdir())
        every = ran(fleet, room / "all")
        verdicts = [one["verdict"] for one in every.document["campaigns"]]
        counts = ", ".join(f"{verdicts.count(verdict)} {verdict}" for verdict in sorted(set(map(str, verdicts))))
        print(f"all cores: {every.seconds:.0f} s; {counts}\n{memory(every)}", flush=True)
        tenth = ran(fleet[::10], room / "tenth")
        print(f"of a tenth of them: {memory(tenth)}", flush=True)
        one = ran(fleet, room / "one", share=1)
        times, alike = one.seconds / every.seconds, same(room / "all", room / "one")
        print(f"one core: {one.seconds:.0f} s, {times:.2f} times as long; same: {alike}", flush=True)
        with cluster(core_count()) as address:
            on_cluster = ran(fleet, room / "cluster", "--cluster", address)
        alike = same(room / "all", room / "cluster")
        print(f"Dask, {core_count()} workers: {on_cluster.seconds:.0f} s; same: {alike}", flush=True)
        killed(fleet, room / "killed", every.seconds)
        rest = ran(fleet, room / "killed")
        alike = same(room / "all", room / "killed")
        print(f"resumed: {rest.document['diagnosed_anew']} anew, {rest.seconds:.0f} s; same: {alike}")


if __name__ == "__main__":
    main()
