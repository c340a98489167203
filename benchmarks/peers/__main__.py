"""Compare `rovid fit` with other tools that fit inertia and drag to the same log of 600 s: time and estimates.

Each tool runs in a separate process, and the time includes reading. The other tools minimise the squared difference of
measured and simulated heading, as is usual. rovid maximises the likelihood of one-step predictions, without a first
guess.
"""

from __future__ import annotations

import argparse
import importlib
import json
import secrets
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchmarks.peers import log
from benchmarks.usage import Usage, measured
from rovid.model.kernels import compile_all, is_compiled
from rovid.store.study import open_study
from tools.programme import Run, multilevel
from tools.trial_day import write_trial_day
from tools.truth import ROSUB, Dynamics

ROOT = Path(__file__).parents[2]
SECONDS = 600.0
# What a peer's script takes from which module; where that is not there the peer is passed over.
PEERS = {
    "lmfit": ("lmfit", "minimize"),
    "iminuit": ("iminuit", "Minuit"),
    "casadi": ("casadi", "nlpsol"),
    "mujoco": ("mujoco.sysid", "optimize"),
}
IMPORTS = "import rovid.estimate.maximum_likelihood, rovid.model.kernels, rovid.store.study"


def is_installed(peer: str) -> bool:
    """Whether all that the script of ``peer`` needs is there."""
    module, name = PEERS[peer]
    try:
        return hasattr(importlib.import_module(module), name)
    except ImportError:
        return False


def write_logs(folder: Path, seed: int) -> Path:
    """A synthetic log with its rovid.toml; the file with the same for the peers, which know torque alone."""
    levels = Run(name="log", pieces=multilevel(SECONDS))
    write_trial_day(folder / "day", seed=seed, formats="csv", campaign=(levels,))
    study = open_study([folder / "day"])
    assert study.runs is not None
    (run,) = study.runs.items
    path = folder / "log.csv"
    log.write(str(path), run.trial.time, run.torque, np.unwrap(run.trial.position))
    return path


def by_rovid(folder: Path) -> tuple[Usage, dict[str, float]]:
    """What ``rovid fit`` takes, and finds."""
    usage = measured([sys.executable, "-m", "rovid", "fit", "day", "-p", "day.toml", "--json"], folder)
    parameters = json.loads(usage.out)["parameters"]
    return usage, {name: parameters[name]["value"] for name in log.NAMES}


def by_peer(peer: str, path: Path) -> tuple[Usage, dict[str, float]]:
    """What the script of ``peer`` takes, and finds."""
    usage = measured([sys.executable, "-m", f"benchmarks.peers.with_{peer}", str(path)], ROOT)
    return usage, json.loads(usage.out)


def row(name: str, usage: Usage, base: Usage, found: Mapping[str, float], truth: Dynamics) -> str:
    """What a tool took, beside rovid, and how far what it found is from the truth."""
    off = ", ".join(f"{key} {100 * (value / getattr(truth, key) - 1):+.2f} %" for key, value in found.items())
    times = usage.processor / base.processor
    return f"{name:14} {usage.processor:6.2f} s ({times:4.2f} x rovid) {usage.megabytes:6.0f} MB  {off}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6))
    seed = parser.parse_args().seed
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = write_logs(folder, seed)
        # All of it: what a fit leaves to a second process would count as the fit's time.
        if not is_compiled():
            compile_all()
        by_rovid(folder)
        base, found = by_rovid(folder)
        print(f"Processor time of a fit to {SECONDS:g} s at 20 Hz, and how far from the truth it ends (seed {seed}):")
        print(row("rovid fit", base, base, found, ROSUB.dynamics))
        alone = measured([sys.executable, "-c", IMPORTS], folder)
        print(row("  its imports", alone, base, {}, ROSUB.dynamics))
        for peer in PEERS:
            if not is_installed(peer):
                print(f"{peer:14} not installed: pip install --group bench")
                continue
            usage, found = by_peer(peer, path)
            print(row(peer, usage, base, found, ROSUB.dynamics))


if __name__ == "__main__":
    main()
