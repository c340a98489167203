"""Campaigns with a cause that no catalogue has: ten laws, two vehicles, slow signals that are logged with every run.

Run ``python -m tools.beyond OUT --cause magnus --seed 1``. OUT/logs has the runs to diagnose, OUT/held_out three
further runs of the same days, and OUT/truth.json the cause with the rates in rad/s that it gives without disturbance.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tools.truth import FloatArray

GRAVITY = 9.81
DAY = 86_400.0  # s
_BEGUN = 1_788_254_400.0  # s since the epoch, of the first run
_SUBSTEPS = 10  # steps of integration between two headings
HELD_OUT = 3  # runs
_LEAD = 4.0  # s without command before each run


@dataclass(frozen=True, kw_only=True)
class Craft:
    """Vehicle; ``torque`` in N m and ``rate`` in rad/s are those of the middling command of 0.5 on both thrusters.

    ``settling`` in s is the time constant there. The thrust of each thruster is that of a square law.
    """

    name: str
    torque: float
    rate: float
    settling: float
    arm: float
    sampling: float  # Hz
    heading_noise: float  # deg

    @property
    def quadratic(self) -> float:
        """Nine tenths of the drag at the middling rate, in N m s^2/rad^2."""
        return 0.9 * self.torque / self.rate**2

    @property
    def linear(self) -> float:
        """The other tenth, in N m s/rad."""
        return 0.1 * self.torque / self.rate

    @property
    def inertia(self) -> float:
        """Inertia in kg m^2 that gives the settling time."""
        return self.settling * (2.0 * self.quadratic * self.rate + self.linear)

    @property
    def full_thrust(self) -> float:
        """Thrust in N of one thruster at a command of 1."""
        return self.torque / (2.0 * self.arm * 0.25)


CRAFT = (
    Craft(name="survey", torque=85.0, rate=0.22, settling=3.0, arm=0.55, sampling=5.0, heading_noise=0.02),
    Craft(name="light", torque=4.0, rate=0.6, settling=0.8, arm=0.2, sampling=10.0, heading_noise=0.03),
)

# Signal -> (unit in the column's name, mean, swing, noise, periods in settling times); angles in deg.
SIGNALS: Mapping[str, tuple[str, float, float, float, tuple[float, ...]]] = {
    "roll": ("deg", 0.3, 3.0, 0.02, (6.0, 11.0, 19.0)),
    "pitch": ("deg", -0.8, 1.5, 0.02, (7.0, 13.0, 23.0)),
    "surge_velocity": ("m_s", 0.3, 0.3, 0.003, (13.0, 21.0, 43.0)),
    "sway_velocity": ("m_s", 0.0, 0.2, 0.003, (9.0, 17.0, 37.0)),
    "depth": ("m", 20.0, 3.0, 0.01, (31.0, 53.0)),
    "water_temperature": ("C", 10.0, 4.0, 0.01, (41.0, 67.0)),
}


@dataclass(kw_only=True)
class Now:
    """The motion at one instant of the integration; ``memory`` keeps what a law needs from step to step."""

    craft: Craft
    step: float
    day: float
    rate: float = 0.0
    acceleration: float = 0.0
    thrust: tuple[float, ...] = ()
    signal: Mapping[str, float] = field(default_factory=dict)
    bend: float = 0.0  # rad, of the compass against the vehicle
    memory: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def drag(self) -> float:
        """Quadratic drag in N m."""
        return self.craft.quadratic * abs(self.rate) * self.rate

    def oscillator(self, frequency: float, damping: float, drive: float) -> float:
        """Displacement of a driven oscillator, after this step."""
        place, speed = self.memory
        speed += self.step * (drive - frequency**2 * place - 2.0 * damping * frequency * speed)
        self.memory = [place + self.step * speed, speed]
        return self.memory[0]


Law = Callable[[Now], float]


def keulegan_carpenter(now: Now) -> float:
    """Drag with a hump at 0.8 rad swept since the last reversal."""
    swept, side = now.memory
    swept = swept + abs(now.rate) * now.step if now.rate * side > 0.0 else 0.0
    now.memory = [swept, math.copysign(1.0, now.rate)]
    return -0.7 * now.drag() * swept / 0.8 * math.exp(1.0 - swept / 0.8)


def magnus(now: Now) -> float:
    """Lift of the turning hull in a sideways flow."""
    return 1.5 * now.craft.torque / now.craft.rate * now.rate * now.signal["sway_velocity"]


def interference(now: Now) -> float:
    """The jet of the fore thruster in forward thrust takes thrust from the aft one, up to all of it."""
    fore, aft = now.thrust
    loss = min(0.35 * math.sqrt(max(fore, 0.0) * abs(aft)), abs(aft))
    return -now.craft.arm * math.copysign(loss, aft)


def cavitation(now: Now) -> float:
    """Beyond a knee at 0.45 of the full command a thruster gains only half as much."""
    knee = 0.45**2 * now.craft.full_thrust
    return -now.craft.arm * sum(0.5 * math.copysign(max(abs(one) - knee, 0.0), one) for one in now.thrust)


def coanda(now: Now) -> float:
    """A jet astern clings to the hull of a vehicle under way."""
    speed = now.signal["surge_velocity"]
    lost = 0.45 * speed**2 / (speed**2 + 0.3**2)
    return -now.craft.arm * lost * sum(max(one, 0.0) for one in now.thrust)


def bilge(now: Now) -> float:
    """Water across a bilge ahead of the middle: its slope follows roll and the turning of the bow."""
    frequency = 4.0 / now.craft.settling
    lever, roll = now.craft.arm, now.signal["roll"]
    place = now.oscillator(frequency, 0.15, -GRAVITY * roll - lever * now.acceleration)
    weight = 0.2 * now.craft.torque / (GRAVITY * math.radians(3.0) * lever)  # kg
    return lever * weight * frequency**2 * place


def mast(now: Now) -> float:
    """No torque: the compass swings on a soft mast."""
    now.bend = now.oscillator(5.0 / now.craft.settling, 0.1, -now.acceleration)
    return 0.0


def seals(now: Now) -> float:
    """Dry friction of a turntable, more in cold water."""
    size = 0.12 * now.craft.torque * (1.0 + 0.12 * (10.0 - now.signal["water_temperature"]))
    return -size * math.tanh(now.rate / (0.05 * now.craft.rate))


def fouling(now: Now) -> float:
    """Drag of a hull that is overgrown, by 8 % a day."""
    return -0.08 * now.day * now.drag()


def ballast(now: Now) -> float:
    """Ballast slides beyond 1.5 deg of roll and is at its stop at 4.5 deg."""
    roll = math.degrees(now.signal["roll"])
    return 0.35 * now.craft.torque * math.copysign(min(max(abs(roll) - 1.5, 0.0) / 3.0, 1.0), roll)


@dataclass(frozen=True)
class Cause:
    """``drivers``: signals that the law depends on. ``akin``: effects, or forms of them, that truly say the same."""

    law: Law
    drivers: tuple[str, ...]
    akin: tuple[str, ...] = ()


CAUSES: Mapping[str, Cause] = {
    "keulegan_carpenter": Cause(keulegan_carpenter, ("rate",), ("oscillatory_drag",)),
    "magnus": Cause(magnus, ("rate", "sway_velocity")),
    "interference": Cause(interference, ("thrust",), ("thruster_imbalance", "supply_sag:others")),
    "cavitation": Cause(cavitation, ("thrust",), ("thrust_curve_shape",)),
    "coanda": Cause(coanda, ("thrust", "surge_velocity")),
    "bilge": Cause(bilge, ("roll",)),
    "mast": Cause(mast, ("rate",)),
    "seals": Cause(seals, ("rate", "water_temperature"), ("coulomb_resistance",)),
    "fouling": Cause(fouling, ("rate",)),
    "ballast": Cause(ballast, ("roll",)),
    "nothing": Cause(lambda _: 0.0, ()),
}


def programme(craft: Craft, rng: np.random.Generator) -> list[list[tuple[float, float, float]]]:
    """Of each run the pieces (seconds, command fore, command aft); the last `HELD_OUT` are not to be fitted."""
    pace = craft.settling

    def levels(count: int, low: float, high: float) -> list[tuple[float, float, float]]:
        drawn = rng.uniform(low, high, count)
        return [(pace * rng.uniform(3.0, 12.0), one, one) for one in drawn]

    def apart(count: int) -> list[tuple[float, float, float]]:
        return [(pace * rng.uniform(4.0, 9.0), *rng.uniform(-0.7, 0.7, 2)) for _ in range(count)]

    def wave(top: float, period: float) -> list[tuple[float, float, float]]:
        time = np.arange(0.0, 5.0 * period, 0.5 * pace) * pace
        pushes = top * np.sin(2.0 * math.pi * time / (period * pace))
        return [(0.5 * pace, push, push) for push in pushes.tolist()]

    fitted = [
        [(30.0 * pace, 0.5, 0.5), (12.0 * pace, 0.0, 0.0)],
        [(30.0 * pace, -0.55, -0.55), (12.0 * pace, 0.0, 0.0)],
        [(10.0 * pace, one, one) for one in (0.3, 0.45, 0.6, 0.7, -0.3, -0.5, -0.7)],
        levels(8, -0.7, 0.7),
        wave(0.6, 12.0),
        apart(8),
        [(18.0 * pace, 0.6, 0.0), (18.0 * pace, -0.6, 0.0), (18.0 * pace, 0.0, 0.6), (18.0 * pace, 0.0, -0.6)],
    ]
    return [*fitted, levels(9, -0.7, 0.7), wave(0.5, 9.0), apart(9)]


def course(rng: np.random.Generator, name: str, craft: Craft) -> Callable[[FloatArray], FloatArray]:
    """A slow signal through one run, in the unit of its column."""
    _, mean, swing, _, periods = SIGNALS[name]
    frequency = 2.0 * math.pi / (np.array(periods) * craft.settling * rng.uniform(0.85, 1.15, len(periods)))
    phase = rng.uniform(0.0, 2.0 * math.pi, len(periods))
    part = swing * math.sqrt(2.0 / len(periods)) / 1.5
    return lambda time: mean + part * np.sin(np.outer(time, frequency) + phase).sum(axis=1)


def motion(
    now: Now, law: Law, commands: FloatArray, signals: Mapping[str, FloatArray], disturbance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """(true rates, shown headings) at each step, from rest."""
    craft, heading = now.craft, 0.0
    rates, shown = np.empty(len(commands)), np.empty(len(commands))
    names = tuple(signals)
    rows = np.column_stack([signals[name] for name in names]).tolist()
    thrusts = (craft.full_thrust * commands * np.abs(commands)).tolist()
    for k, (row, thrust) in enumerate(zip(rows, thrusts, strict=True)):
        rates[k], shown[k] = now.rate, heading + now.bend
        now.signal, now.thrust = dict(zip(names, row, strict=True)), tuple(thrust)
        torque = craft.arm * sum(thrust) + law(now) + disturbance[k]
        now.acceleration = (torque - now.drag() - craft.linear * now.rate) / craft.inertia
        now.rate += now.step * now.acceleration
        heading += now.step * now.rate
    return rates, shown


def wandering(count: int, step: float, craft: Craft, rng: np.random.Generator) -> FloatArray:
    """First-order Gauss-Markov torque in N m, 2 % of the middling torque, with the settling time."""
    decay = math.exp(-step / craft.settling)
    path = np.zeros(count)
    for k, kick in enumerate(rng.normal(0.0, 0.02 * craft.torque * math.sqrt(1.0 - decay**2), count - 1)):
        path[k + 1] = decay * path[k] + kick
    return path


def write(folder: Path, cause: str, seed: int) -> None:
    """Write the campaign of ``cause``; the vehicle, the programme, the signals and all noise are drawn by ``seed``."""
    rng = np.random.default_rng([seed, 56])
    craft = CRAFT[seed % len(CRAFT)]
    runs = programme(craft, rng)
    calm: dict[str, list[float]] = {}
    for number, pieces in enumerate(runs):
        held_out = number >= len(runs) - HELD_OUT
        step = 1.0 / craft.sampling / _SUBSTEPS
        ends = np.cumsum([_LEAD, *(piece[0] for piece in pieces)])
        instants = np.arange(0.0, ends[-1], step)
        given = np.vstack([(0.0, 0.0), [piece[1:] for piece in pieces]])
        sampled = np.floor(instants * craft.sampling + 1e-6) / craft.sampling  # commands change with the samples
        commands = np.round(given[np.searchsorted(ends[:-1], sampled, side="right")], 4)
        raw = {name: course(rng, name, craft)(instants) for name in SIGNALS}
        inside = {name: np.radians(raw[name]) if SIGNALS[name][0] == "deg" else raw[name] for name in raw}
        # One run a day; those held out are spread over the days.
        day = float(2 * (number - len(runs) + HELD_OUT) + 1 if held_out else number)
        disturbance = wandering(len(instants), step, craft, rng)

        def run(torque: FloatArray, day: float = day, step: float = step) -> tuple[FloatArray, FloatArray]:
            return motion(Now(craft=craft, step=step, day=day), CAUSES[cause].law, commands, inside, torque)  # noqa: B023

        _, shown = run(disturbance)
        kept = slice(None, None, _SUBSTEPS)
        columns = {
            "time_s": _BEGUN + DAY * day + 1200.0 * number + np.round(instants[kept], 3),
            "fore_cmd": commands[kept, 0],
            "aft_cmd": commands[kept, 1],
            "heading_deg": (
                np.degrees(shown[kept] + rng.uniform(0.0, 6.28))
                + rng.normal(0.0, craft.heading_noise, len(shown[kept]))
            )
            % 360.0,
        }
        for name, (unit, _, _, noise, _) in SIGNALS.items():
            columns[f"{name}_{unit}"] = raw[name][kept] + rng.normal(0.0, noise, len(shown[kept]))
        place = folder / ("held_out" if held_out else "logs")
        place.mkdir(parents=True, exist_ok=True)
        table(place / f"run_{number + 1:02}.csv", columns)
        if held_out:
            calm[f"run_{number + 1:02}"] = run(np.zeros(len(instants)))[0][kept].round(7).tolist()
    for place in (folder / "logs", folder / "held_out"):
        configure(place, craft)
    truth = {"cause": cause, "seed": seed, "vehicle": craft.name, "calm_rates": calm}
    (folder / "truth.json").write_text(json.dumps(truth), encoding="utf-8")


def table(path: Path, columns: Mapping[str, FloatArray]) -> None:
    """Write a CSV file."""
    rows: Sequence[str] = [
        ",".join(f"{value:.4f}" for value in row) for row in zip(*map(np.ndarray.tolist, columns.values()), strict=True)
    ]
    path.write_text("\n".join([",".join(columns), *rows]) + "\n", encoding="utf-8")


def configure(folder: Path, craft: Craft) -> None:
    """Write rovid.toml and the thrust curve."""
    command = np.linspace(-1.0, 1.0, 401)
    table(folder / "thrust_curve.csv", {"command": command, "thrust_N": craft.full_thrust * command * np.abs(command)})
    thrusters = "".join(
        f'\n[[thrusters]]\nname = "{name}"\nyaw_arm = {craft.arm}\ncurve = "thrust_curve.csv"\n'
        f'command = {{ csv = "{name}_cmd" }}\n'
        for name in ("fore", "aft")
    )
    signals = ""
    for name, (unit, *_) in SIGNALS.items():
        angle = ', unit = "deg"' if unit == "deg" else ""
        signals += f'{name} = {{ csv = "{name}_{unit}"{angle} }}\n'
    text = f'[vehicle]\nname = "{craft.name}"\n{thrusters}\n[signals]\ntime = {{ csv = "time_s" }}\n'
    text += f'heading = {{ csv = "heading_deg", unit = "deg" }}\n{signals}'
    (folder / "rovid.toml").write_text(text, encoding="utf-8")


def main() -> None:
    """Write one campaign from the command line."""
    parser = argparse.ArgumentParser(description="Write a campaign with a cause of no catalogue.")
    parser.add_argument("out", type=Path)
    parser.add_argument("--cause", choices=tuple(CAUSES), default="nothing")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    write(arguments.out, arguments.cause, arguments.seed)


if __name__ == "__main__":
    main()
