"""Do the errors of `fit-drag` hold on 2 to 20 holds, whatever the memory of the disturbance?

Run ``python -m benchmarks.holds --draws 300``. Each draw is a vehicle over decades of torque, rate and time constant,
one thruster, and a Gauss-Markov disturbance whose memory is 0.1 to 10 lengths of a hold. rovid reads the files alone.
"""

from __future__ import annotations

import argparse
import math
import secrets
import tempfile
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rovid.core.errors import DataError
from rovid.estimate.steady_drag import NAMES, fit_drag
from rovid.estimate.steady_points import steady_points
from rovid.readers import read_campaign
from rovid.trial.config import find_config, load_config
from rovid.trial.preprocessing import prepare

HOLDS, MEMORIES = (2, 3, 4, 5, 6, 8, 12, 20), (0.1, 0.3, 1.0, 3.0, 10.0)


@dataclass(frozen=True, kw_only=True)
class Draw:
    """What a draw gave: its number of holds, memory in holds, and per drag (estimate - truth) / standard error."""

    holds: int
    memory: float
    z: tuple[float, ...]  #: Empty where rovid refused.
    spread: float  #: Standard error of the quadratic drag over its truth; NaN where refused.


def write_holds(folder: Path, seed: int) -> tuple[int, float, tuple[float, float]]:
    """Write a folder of held commands; the number of holds, the memory in holds, and the two drags."""
    rng = np.random.default_rng(seed)
    count, memory = int(rng.choice(HOLDS)), float(rng.choice(MEMORIES))
    torque, fastest, constant = (10.0 ** rng.uniform((0.0, -1.3, -0.7), (4.0, 0.0, 1.0))).tolist()
    share = float(rng.uniform(0.1, 0.95))  # of the quadratic drag in the largest torque
    drags = share * torque / fastest**2, (1.0 - share) * torque / fastest
    inertia = constant * torque / fastest
    # Transients end within five time constants; the hold is one to ten times as long.
    length = max(5.0 * constant * 10.0 ** rng.uniform(0.3, 1.0), 20.0)
    commands = rng.choice((-1.0, 1.0), count) * rng.uniform(0.3, 1.0, count)
    logs = 1 if rng.random() < 0.7 else count
    size, noise = torque * 10.0 ** rng.uniform(-2.7, -1.0), 10.0 ** rng.uniform(-2.5, -0.7)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rovid.toml").write_text(
        f'[vehicle]\nname = "holds"\nmass = 100.0\nlength = 1.0\nwidth = 1.0\nrigid_body_inertia = {inertia / 1.5!r}\n'
        '[[thrusters]]\nname = "one"\nyaw_arm = 1.0\ncurve = "curve.csv"\ncommand = { csv = "one" }\n'
        '[signals]\ntime = { csv = "time_s" }\nheading = { csv = "heading_deg", unit = "deg" }\n'
    )
    levels = np.linspace(-1.0, 1.0, 201).tolist()
    curve = [f"{u:.2f},{torque * u * abs(u)!r}" for u in levels]
    (folder / "curve.csv").write_text("\n".join(("command,thrust_N", *curve)) + "\n")
    commands = np.round(commands, 2)
    for number, part in enumerate(np.array_split(commands, logs)):
        rows = _log(rng, part, length, (torque, inertia, *drags), (size, memory * length), noise)
        (folder / f"log_{number}.csv").write_text("\n".join(("time_s,one,heading_deg", *rows)) + "\n")
    return count, memory, drags


def _log(
    rng: np.random.Generator,
    commands: np.ndarray,
    length: float,
    vehicle: tuple[float, ...],
    disturbance: tuple[float, float],
    noise: float,
) -> list[str]:
    """Rows of a log; the disturbance has a standard deviation in N m and a memory in s, the heading noise in deg."""
    torque, inertia, quadratic, linear = vehicle
    size, memory = disturbance
    step = min(0.1, 0.05 * inertia / (linear + 2.0 * math.sqrt(quadratic * torque)))
    each = round(0.1 / step)
    step = 0.1 / each
    keep, heading, rate, d = math.exp(-step / memory), float(rng.uniform(0.0, 360.0)), 0.0, float(rng.normal(0, size))
    rows, time = [], 0.0
    for command in commands:
        for _ in range(round(length / 0.1)):
            rows.append(f"{time:.2f},{command:.2f},{(heading + rng.normal(0.0, noise)) % 360.0:.4f}")
            for kick in rng.normal(0.0, size * math.sqrt(1.0 - keep * keep), each):
                push = torque * command * abs(command) + d
                middle = rate + 0.5 * step * (push - quadratic * abs(rate) * rate - linear * rate) / inertia
                rate += step * (push - quadratic * abs(middle) * middle - linear * middle) / inertia
                heading += math.degrees(step * middle)
                d = keep * d + kick
            time += 0.1
    return rows


def drawn(seed: int) -> Draw:
    """What rovid makes of the draw with this ``seed``."""
    with tempfile.TemporaryDirectory() as name:
        count, memory, drags = write_holds(Path(name), seed)
        config = load_config(find_config([Path(name)]))
        runs = prepare(read_campaign([Path(name)], config), config.vehicle)
    try:
        estimate = fit_drag(steady_points(runs.items, config.vehicle)).estimate
    except DataError:
        return Draw(holds=count, memory=memory, z=(), spread=math.nan)
    if estimate.refused:
        return Draw(holds=count, memory=memory, z=(), spread=math.nan)
    z = [(estimate.value(one) - true) / estimate.standard_error(one) for one, true in zip(NAMES, drags, strict=True)]
    return Draw(holds=count, memory=memory, z=tuple(z), spread=estimate.standard_error(NAMES[0]) / drags[0])


def table(draws: Sequence[Draw]) -> str:
    """Shares within two and three standard errors, by number of holds and by memory."""
    lines = ["              draws answered   within 2: DQ, DL   within 3   median error of DQ"]
    groups = [("all", list(draws))]
    groups += [(f"{n} holds", [one for one in draws if one.holds == n]) for n in HOLDS]
    groups += [(f"memory {m:g}", [one for one in draws if one.memory == m]) for m in MEMORIES]
    for name, group in groups:
        answered = [one for one in group if one.z]
        line = f"{name:12} {len(group):6} {len(answered):8}"
        if answered:
            z = np.abs([one.z for one in answered])
            quadratic, linear, far = 100.0 * np.array([*(z <= 2.0).mean(axis=0), (z <= 3.0).mean()])
            spread = 100.0 * float(np.median([one.spread for one in answered]))
            line += f"   {quadratic:5.1f} %, {linear:5.1f} %   {far:6.1f} % {spread:18.1f} %"
        lines.append(line)
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=300)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10**6), help="of the first draw")
    parser.add_argument("--jobs", type=int)
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.draws)
    with ProcessPoolExecutor(arguments.jobs) as pool:
        draws = list(pool.map(drawn, seeds))
    print(f"{arguments.draws} draws from seed {arguments.seed}")
    print(table(draws))


if __name__ == "__main__":
    main()
