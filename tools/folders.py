"""Folders of trial logs of made-up vehicles, as engineers keep them, each with the columns that rovid should find.

``python -m tools.folders OUT --seed 1 --count 40`` writes OUT/00, OUT/01, … and OUT/truth.json. Names are in five
languages and many styles. Units, signs, clocks, separators, decoys and missing columns vary. A plain vehicle is driven
by held levels, steps, a random sequence, a hand at the stick or an autopilot.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from mcap.writer import Writer

from tools.folder_words import LANGUAGES, STYLES, unit_words
from tools.truth import FloatArray

_DAY = 1_767_600_000.0  # s since the epoch: 5 January 2026, 08:00 UTC
_TWICE = ("", "heading", "rate")  # what the thrusters' logger may hold of the motion too
_WIRED_ROUND = 0.25  # share of the thrusters that push back at a positive command
_SUBSTEPS = 4
_MOST = 100  # columns of a table


@dataclass(frozen=True, kw_only=True)
class Mount:
    """A thruster: its place, in keys of `LANGUAGES`, and how its thrust turns and moves the vehicle."""

    role: tuple[str, ...]
    yaw: float = 0.0
    surge: float = 0.0
    sway: float = 0.0
    heave: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Craft:
    """A vehicle: its thrusters, time constant in s at full rate, full rate in rad/s; ``floats``: a surface vessel."""

    name: str
    mounts: tuple[Mount, ...]
    tau: float
    rate: float
    floats: bool = False

    @property
    def teams(self) -> tuple[tuple[bool, ...], ...]:
        """Groups of thrusters that turn the vehicle: all; with tunnel thrusters also the tunnels or the screws."""
        tunnels = tuple(bool(mount.sway and not mount.surge) for mount in self.mounts)
        everyone = (True,) * len(tunnels)
        return (everyone, tunnels, tuple(not tunnel for tunnel in tunnels)) if any(tunnels) else (everyone,)


_VECTORED = (
    Mount(role=("fore", "port"), yaw=1.0, surge=1.0, sway=1.0),
    Mount(role=("fore", "stbd"), yaw=-1.0, surge=1.0, sway=-1.0),
    Mount(role=("aft", "port"), yaw=1.0, surge=1.0, sway=-1.0),
    Mount(role=("aft", "stbd"), yaw=-1.0, surge=1.0, sway=1.0),
)
_SCREWS = (Mount(role=("port",), yaw=1.0, surge=1.0), Mount(role=("stbd",), yaw=-1.0, surge=1.0))
_UP = (Mount(role=("vertical", "port"), heave=1.0), Mount(role=("vertical", "stbd"), heave=1.0))
CRAFTS = (
    Craft(name="small ROV", mounts=(*_VECTORED, *_UP), tau=0.6, rate=1.2),
    Craft(name="observation ROV", mounts=(*_SCREWS, Mount(role=("vertical",), heave=1.0)), tau=1.2, rate=0.9),
    Craft(name="work-class ROV", mounts=(*_VECTORED, *_UP), tau=4.0, rate=0.35),
    Craft(name="twin-screw USV", mounts=_SCREWS, tau=2.0, rate=0.5, floats=True),
    Craft(
        name="tunnel thrusters",
        mounts=(
            Mount(role=("port",), yaw=0.6, surge=1.0),
            Mount(role=("stbd",), yaw=-0.6, surge=1.0),
            Mount(role=("bow",), yaw=1.0, sway=1.0),
            Mount(role=("stern",), yaw=-1.0, sway=1.0),
        ),
        tau=3.0,
        rate=0.3,
        floats=True,
    ),
)
# A vehicle with one logged torque, the torque that the controller demands.
_TORQUE = Craft(name="torque alone", mounts=(Mount(role=(), yaw=1.0),), tau=4.0, rate=0.3)

# Kind of command -> (at full thrust either way, counted from neutral; neutral; decimals).
KINDS: Mapping[str, tuple[tuple[float, ...], float, int]] = {
    "us": ((400.0,), 1500.0, 0),
    "%": ((100.0,), 0.0, 1),
    "1": ((1.0,), 0.0, 3),
    "V": ((5.0, 10.0), 0.0, 2),
    "rpm": ((1200.0, 3000.0), 0.0, 0),
    "N": ((60.0, 800.0), 0.0, 1),
    "permille": ((1000.0,), 0.0, 0),
    "N m": ((40.0, 900.0), 0.0, 1),
}
# Thrusters by number: the name -> the kinds for which it is usual. {n} counts from 1, {n0} from 0.
_NUMBERED: Mapping[str, tuple[str, ...]] = {
    "T{n}": ("us", "%", "1", "V", "N"),
    "M{n}": ("us", "%", "1", "rpm", "permille"),
    "u{n}": ("1", "V", "%", "N"),
    "thr_{n}_cmd": ("us", "%", "1", "permille"),
    "pwm{n}": ("us",),
    "ch{n}_us": ("us",),
    "motor{n0}": ("us", "%", "1", "rpm"),
    "RCOU.C{n}": ("us",),
    "servo{n}_raw": ("us",),
    "esc{n}": ("us", "permille"),
    "Thruster {n}": ("%", "1", "rpm", "V"),
    "thr{n}.cmd": ("%", "1"),
}
DRIVERS = ("held", "steps", "random", "stick", "autopilot")
_TIMES = ("s", "s", "s since start-up", "ms", "epoch s", "epoch ms", "iso8601", "iso8601")


@dataclass(frozen=True, kw_only=True)
class Clocks:
    """Clock of a separate logger of the thrusters.

    Attributes
    ----------
    apart
        s; lead of its clock at the beginning of the day. If the logs start at 0, the difference of the starts, up to
        this value in both directions.
    drift
        Further lead in each second, s/s.
    twice
        Motion that this logger also measures by a separate sensor: a heading or a yaw rate.
    """

    apart: float = 0.5
    drift: float = 0.0
    twice: str = ""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Clocks:
        """Up to 2 s apart, drifting by up to 200 ppm."""
        apart, drift = float(rng.uniform(-2.0, 2.0)), float(rng.uniform(-2e-4, 2e-4))
        return cls(apart=apart, drift=drift, twice=str(rng.choice(_TWICE)))


@dataclass(frozen=True, kw_only=True)
class Folder:
    """Expected result of reading the folder. Names are as in the logs.

    Attributes
    ----------
    format
        csv or mcap: the key of a source in rovid.toml.
    heading, heading_unit
        Its column or topic; deg or rad. What grows is positive, whatever it is against a compass: ``turned_round``.
    thrusters
        Name -> whether a greater command turns that heading up (1), down (-1) or not (0).
    decoys
        Mapping from a name to its meaning.
    time, time_unit
        A column, and s, ms, epoch or iso8601; none in MCAP.
    yaw_rate, yaw_rate_unit
        Where one is logged.
    kind, neutral
        Of the commands; a key of `KINDS`.
    split
        One file a sensor, on clocks that differ.
    ahead, drift
        Log of the thrusters -> s that its clock is ahead of the other one where it begins; s more each s.
    middle
        Log of the thrusters -> s from there to its middle.
    lacking
        What no log of the folder holds though it is needed: the answer is then to say so.
    about
        The draw in words.
    """

    format: str
    heading: str
    heading_unit: str
    turned_round: bool
    thrusters: Mapping[str, int]
    decoys: Mapping[str, str]
    time: str
    time_unit: str
    yaw_rate: str = ""
    yaw_rate_unit: str = ""
    kind: str
    neutral: float
    split: bool = False
    ahead: Mapping[str, float] = field(default_factory=dict)
    drift: float = 0.0
    middle: Mapping[str, float] = field(default_factory=dict)
    lacking: str = ""
    about: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Ride:
    """A run: (n,) s; angles in rad, unwrapped; rates in rad/s; commands by thruster -1 to 1; (n,) demands."""

    time: FloatArray
    heading: FloatArray
    rate: FloatArray
    desired: FloatArray
    commands: FloatArray
    surge: FloatArray
    yaw_demand: FloatArray
    depth: FloatArray
    speed: FloatArray


@dataclass(frozen=True, kw_only=True)
class Column:
    """A column to be written: its values, decimals, and the group (nav, thr, sys) that goes into one file."""

    name: str
    values: FloatArray
    decimals: int
    group: str

    def of(self, rows: slice) -> Column:
        """These rows alone."""
        return replace(self, values=self.values[rows])


@dataclass(kw_only=True)
class Namer:
    """Names of one folder, none twice: ``words`` of a language, joined in a ``style``."""

    rng: np.random.Generator
    language: str
    style: str
    taken: set[str] = field(default_factory=set)
    words: dict[str, str] = field(default_factory=dict)

    def word(self, key: str) -> str:
        """The folder's word for ``key``, the same each time."""
        if key not in self.words:
            self.words[key] = str(self.rng.choice(LANGUAGES[self.language][key]))
        return self.words[key]

    def joined(self, group: str, words: str, unit: str) -> str:
        """A column of ``words``; one that is taken gets a number."""
        count, name = 1, self._styled(group, words, unit)
        while name.lower() in self.taken:
            count += 1
            name = self._styled(group, f"{words}{count}", unit)
        self.taken.add(name.lower())
        return name

    def _styled(self, group: str, words: str, unit: str) -> str:
        return STYLES[self.style](group, words, *unit_words(unit, self.language))

    def name(self, group: str, key: str, unit: str, role: str = "") -> str:
        """A column of what ``key`` says; ``role`` is a thruster's place, or its number, which comes last."""
        words = self.word(key)
        words = f"{words.replace('{role}', '')} {role}" if role.isdigit() else words.replace("{role}", role)
        return self.joined(group, " ".join(words.split()), unit)


def write_folder(folder: Path, *, seed: int, index: int, clocks: Clocks | None = None) -> Folder:
    """Write the logs of the draw's folder ``index`` into ``folder`` and return what they hold.

    Vehicle, language, format and the split into one file for each sensor follow from ``index``: 40 consecutive folders
    have a fixed share of each. With ``clocks`` every folder has one file for each sensor.
    """
    rng = np.random.default_rng([seed, index])
    folder.mkdir(parents=True, exist_ok=True)
    craft = _TORQUE if index % 20 == 11 else CRAFTS[index % len(CRAFTS)]
    mcap = index % 8 == 3 and clocks is None
    split = not mcap and (index % 10 == 7 or clocks is not None)
    clocks = clocks or Clocks()
    style = "topic" if mcap else str(rng.choice([style for style in STYLES if style != "topic"]))
    namer = Namer(rng=rng, language=("en", "de", "en", "fr", "en", "no", "es")[index % 7], style=style)
    clock = Stamps.drawn(rng, namer, mcap=mcap)
    kind = "N m" if craft is _TORQUE else str(rng.choice([kind for kind in KINDS if kind != "N m"]))
    names = _commands(namer, craft, kind)
    lacking = "heading" if index % 40 == 29 and not clocks.twice else ""
    draw = _Draw(
        rng=rng,
        craft=craft,
        kind=kind,
        full=float(rng.choice(KINDS[kind][0])),
        names=names,
        heading="" if lacking else namer.name("nav", "heading", unit := str(rng.choice(["deg", "deg", "deg", "rad"]))),
        sense=np.where(rng.random(len(names)) < _WIRED_ROUND, -1.0, 1.0),
        idle=[k for k, mount in enumerate(craft.mounts) if mount.heave and rng.random() < 0.15],
        noise=math.radians(float(rng.choice([0.02, 0.1, 0.3]))),
        extra=_Extra.drawn(rng, craft, namer, names, kind=kind, unit="deg" if lacking else unit),
    )
    drivers = [str(driver) for driver in rng.choice(DRIVERS, size=int(rng.integers(2, 5)), replace=False)]
    layout = Layout.drawn(rng, namer.language, style)
    sparse = not mcap and not split and rng.random() < 0.1
    ahead: dict[str, float] = {}
    middle: dict[str, float] = {}
    for number, driver in enumerate(drivers):
        ride, columns = draw.run(driver, later=number > 0)
        start = clock.start(rng, number)
        if mcap:
            _write_mcap(folder / f"{driver}_{number + 1:02d}.mcap", start, ride.time, columns)
            continue
        if sparse:
            columns[0].values[1::2] = np.nan
        if not split:
            cells = clock.cells(ride.time, start)
            layout.write(folder / f"{driver}_{number + 1:02d}.csv", clock.name, cells, layout.ordered(columns))
            continue
        columns += draw.twice(clocks.twice, ride, namer)
        loggers = _Loggers.of(clocks, clock, rng, start, number)
        for every, (part, groups) in enumerate((("ins", ("nav", "sys")), ("thrusters", ("thr",)))):
            rows, instants = loggers.rows(ride.time, every)
            kept = [column.of(rows) for column in columns if column.group in groups]
            layout.write(
                folder / f"{part}_{number + 1:02d}.csv", clock.name, clock.cells(instants, 0.0), layout.ordered(kept)
            )
        ahead[f"thrusters_{number + 1:02d}.csv"] = loggers.ahead
        middle[f"thrusters_{number + 1:02d}.csv"] = 0.5 * float(instants[-1] - instants[0])
    extra = draw.extra
    return Folder(
        format="mcap" if mcap else "csv",
        heading=draw.heading,
        heading_unit=extra.unit,
        turned_round=extra.turned_round,
        thrusters=draw.ways(),
        decoys={name: key for key, name in extra.labels.items() if key != "yaw_rate"},
        time=clock.name,
        time_unit=clock.unit,
        yaw_rate=extra.labels.get("yaw_rate", ""),
        yaw_rate_unit=extra.rate_unit,
        kind=kind,
        neutral=KINDS[kind][1],
        split=split,
        ahead=ahead,
        drift=clocks.drift,
        middle=middle,
        lacking=lacking,
        about=f"{craft.name}, {namer.language}, {style}, {kind}, {'+'.join(drivers)}",
    )


@dataclass(frozen=True, kw_only=True)
class Stamps:
    """The time of a folder's logs: ``name`` of its column, ``kind`` of `_TIMES`."""

    name: str
    kind: str

    @classmethod
    def drawn(cls, rng: np.random.Generator, namer: Namer, *, mcap: bool) -> Stamps:
        """Draw one; MCAP tells the time by itself."""
        kind = "epoch s" if mcap else str(rng.choice(_TIMES))
        if mcap:
            return cls(name="", kind=kind)
        if kind == "ms":  # the name says so even where no other does
            style = "snake" if namer.style == "bare" else namer.style
            return cls(name=STYLES[style]("log", namer.word("time"), "ms", "ms"), kind=kind)
        key = "epoch" if kind.startswith("epoch") else "stamp" if kind == "iso8601" else "time"
        return cls(name=namer.name("log", key, "s" if key == "time" else ""), kind=kind)

    @property
    def unit(self) -> str:
        """One of s, ms, epoch and iso8601."""
        return self.kind.split()[0]

    def start(self, rng: np.random.Generator, number: int) -> float:
        """S at which the day's log ``number`` begins: of the epoch, since start-up, or of the log itself."""
        if self.kind in {"s", "ms"}:
            return 0.0
        return float(rng.uniform(20.0, 4000.0)) if "start-up" in self.kind else _DAY + 900.0 * number

    def cells(self, time: FloatArray, start: float) -> list[str]:
        """``time`` in s since ``start`` as it is logged."""
        instants = (time + start).tolist()
        if self.kind in {"ms", "epoch ms"}:
            return [f"{1000.0 * instant:.0f}" for instant in instants]
        if self.kind == "iso8601":
            stamps = (datetime.fromtimestamp(round(instant, 3), UTC) for instant in instants)
            return [stamp.strftime("%Y-%m-%dT%H:%M:%S.%f")[:-3] + "Z" for stamp in stamps]
        return [f"{instant:.3f}" for instant in instants]


@dataclass(frozen=True, kw_only=True)
class _Loggers:
    """Two loggers of one run: when each begins, in s of the run, and how the second one's clock goes."""

    begins: tuple[float, float]
    start: float
    ahead: float
    drift: float

    @classmethod
    def of(cls, clocks: Clocks, clock: Stamps, rng: np.random.Generator, start: float, number: int) -> _Loggers:
        """Of the day's run ``number``, which begins at ``start``."""
        if clock.kind in {"s", "ms"}:  # each begins at 0
            apart = clocks.apart * float(rng.uniform(0.3, 1.0)) if number else clocks.apart
            return cls(begins=(max(apart, 0.0), max(-apart, 0.0)), start=0.0, ahead=apart, drift=clocks.drift)
        ahead = clocks.apart + 900.0 * number * clocks.drift
        return cls(begins=(0.0, 0.0), start=start, ahead=ahead, drift=clocks.drift)

    def rows(self, time: FloatArray, which: int) -> tuple[slice, FloatArray]:
        """Rows of the first, or of the second, which takes every other one; and their times by its clock."""
        first = int(np.searchsorted(time, self.begins[which]))
        rows = slice(first, None, 1 + which)
        since = time[rows]
        if self.start == 0.0:  # both count from their own beginning
            zero = self.begins[which]
            return rows, since - zero if not which else (since - zero) * (1.0 + self.drift)
        return rows, self.start + since + (self.ahead + self.drift * since if which else 0.0)


def _commands(namer: Namer, craft: Craft, kind: str) -> list[str]:
    """Names of the commands: by the thruster's place, or by number."""
    rng = namer.rng
    if craft is _TORQUE:
        return [namer.joined("thr", str(rng.choice(["torque", "yaw torque", "N"])), kind)]
    usual = [name for name, kinds in _NUMBERED.items() if kind in kinds]
    if usual and rng.random() < 0.5:
        pattern = str(rng.choice(usual))
        styled = pattern in {"T{n}", "M{n}", "Thruster {n}"} or namer.style in {"topic", "dots"}
        plain = [pattern.format(n=k + 1, n0=k).replace(".", "_" if styled else ".") for k in range(len(craft.mounts))]
        return [namer.joined("thr", name, kind) if styled else name for name in plain]
    roles = [" ".join(namer.word(part) for part in mount.role) for mount in craft.mounts]
    pattern = namer.word("command")
    if any(word in role for role in roles for word in ("thruster", "tunnel", "strahler", "propulseur", "helice")):
        pattern = "{role}"
    return [namer.joined("thr", pattern.format(role=role), kind) for role in roles]


@dataclass(kw_only=True, eq=False)
class _Draw:
    """A folder being drawn: its vehicle, how that is wired, and what is logged of it."""

    rng: np.random.Generator
    craft: Craft
    kind: str
    full: float
    names: Sequence[str]
    heading: str
    sense: FloatArray
    idle: Sequence[int]
    noise: float
    extra: _Extra
    second: str | None = None

    def ways(self) -> dict[str, int]:
        """Thruster -> whether a greater command turns the logged heading up, down or not."""
        compass = -1.0 if self.extra.turned_round else 1.0
        turns = [compass * mount.yaw * sense for mount, sense in zip(self.craft.mounts, self.sense, strict=True)]
        return {name: int(np.sign(turn)) for name, turn in zip(self.names, turns, strict=True)}

    def run(self, driver: str, *, later: bool) -> tuple[_Ride, list[Column]]:
        """A run of ``driver``'s and what is logged of it; a later log may lack a column that matters little."""
        ride, extra = self._ride(driver), self.extra
        _, neutral, decimals = KINDS[self.kind]
        columns = [
            Column(name=name, values=neutral + self.full * values, decimals=decimals, group="thr")
            for name, values in zip(self.names, ride.commands, strict=True)
        ]
        if self.heading:
            measured = extra.compass * ride.heading + self.rng.normal(0.0, self.noise, len(ride.time))
            columns.insert(0, _angle(self.heading, measured, extra.unit, signed=extra.signed))
        columns += extra.columns(ride)
        if later and len(extra.labels) > 3 and self.rng.random() < 0.3:
            del columns[-1]
        return ride, columns

    def twice(self, what: str, ride: _Ride, namer: Namer) -> list[Column]:
        """What the thrusters' logger holds of the motion, by a sensor of its own."""
        if not what:
            return []
        count, extra = len(ride.time), self.extra
        if self.second is None:
            key, unit = ("heading", extra.unit) if what == "heading" else ("yaw_rate", "deg/s")
            self.second = namer.name("thr", key, unit)
        if what == "rate":
            rate = extra.compass * np.degrees(ride.rate + self.rng.normal(0.0, 0.004, count))
            return [Column(name=self.second, values=rate, decimals=2, group="thr")]
        measured = extra.compass * ride.heading + 0.03 + self.rng.normal(0.0, 0.005, count)
        return [replace(_angle(self.second, measured, extra.unit, signed=extra.signed), group="thr")]

    def _ride(self, driver: str) -> _Ride:
        """For some tens of time constants."""
        rng, craft = self.rng, self.craft
        step = float(rng.choice([0.05, 0.1])) if craft.tau > 0.7 else 0.05
        count = int(np.clip(craft.tau * rng.uniform(60.0, 120.0), 100.0, 240.0) / step)
        yaw = _demand(driver, rng, count, step, craft.tau)
        ahead = levels(rng, count, step, 6.0 * craft.tau, (0.0, 0.0, 0.25, 0.4, -0.2))
        across = levels(rng, count, step, 6.0 * craft.tau, (0.0, 0.0, 0.3, -0.3))
        up = _stick(rng, count, step, 3.0)
        mix = np.array([[np.sign(mount.yaw), mount.surge, mount.sway, mount.heave] for mount in craft.mounts])
        others = mix[:, 1:] @ np.stack([ahead, across, up])
        if driver == "held":
            _alone(rng, others, yaw, craft, step)
        others[list(self.idle)] = 0.0
        team = levels(rng, count, step, 10.0 * craft.tau, range(len(craft.teams))).astype(int)
        shares = mix[:, :1] * np.array(craft.teams, dtype=np.float64).T[:, team]
        return _integrate(rng, craft, driver, step, self.sense, yaw, ahead, others, shares)


def levels(rng: np.random.Generator, count: int, step: float, seconds: float, values: Sequence[float]) -> FloatArray:
    """Levels one after the other, each held for about ``seconds``."""
    parts: list[FloatArray] = []
    while sum(map(len, parts)) < count:
        parts.append(np.full(max(1, int(seconds * rng.uniform(0.6, 1.6) / step)), float(rng.choice(values))))
    return np.concatenate(parts)[:count]


def _stick(rng: np.random.Generator, count: int, step: float, seconds: float) -> FloatArray:
    """A hand at the stick: slow, with rests at neutral."""
    wave = _smooth(rng, count, step, seconds)
    wave[np.abs(wave) < 0.15] = 0.0
    rests = levels(rng, count, step, 4.0 * seconds, (1.0, 1.0, 0.0))
    return np.asarray(np.clip(0.6 * wave * rests, -0.9, 0.9))


def _smooth(rng: np.random.Generator, count: int, step: float, seconds: float) -> FloatArray:
    """Noise of unit size that forgets within ``seconds``."""
    keep = math.exp(-step / seconds)
    draw = rng.normal(0.0, math.sqrt(1.0 - keep**2), count).tolist()
    wave, held = np.empty(count), float(rng.normal())
    for k, kick in enumerate(draw):
        held = keep * held + kick
        wave[k] = held
    return wave


def _demand(driver: str, rng: np.random.Generator, count: int, step: float, tau: float) -> FloatArray:
    """Demand of yaw, -1 to 1; of an autopilot the desired heading in rad."""
    if driver == "held":
        return levels(rng, count, step, 8.0 * tau + 4.0, (0.3, 0.5, 0.7, -0.3, -0.5, -0.7, 0.0))
    if driver == "steps":
        size = float(rng.uniform(0.3, 0.7))
        return levels(rng, count, step, 4.0 * tau + 2.0, (size, -size, 0.0))
    if driver == "random":
        size = float(rng.uniform(0.3, 0.7))
        return levels(rng, count, step, 1.5 * tau + 0.5, (size, -size))
    if driver == "stick":
        return _stick(rng, count, step, 1.5 * tau + 1.0)
    return np.cumsum(np.diff(levels(rng, count, step, 5.0 * tau + 8.0, (-1.9, -1.0, -0.4, 0.5, 1.2, 2.0)), prepend=0.0))


def _alone(rng: np.random.Generator, others: FloatArray, yaw: FloatArray, craft: Craft, step: float) -> None:
    """Towards the end of the run each thruster that turns the vehicle runs by itself, both ways."""
    turning = [k for k, mount in enumerate(craft.mounts) if mount.yaw]
    rows = int(3.0 * craft.tau / step) + 1
    begin = max(len(yaw) // 2, len(yaw) - 3 * rows * len(turning))
    yaw[begin:] = 0.0
    others[:, begin:] = 0.0
    for place, k in enumerate(turning):
        first = begin + 3 * rows * place
        size = float(rng.uniform(0.4, 0.7))
        others[k, first : first + rows] = size
        others[k, first + rows : first + 2 * rows] = -size


def _integrate(
    rng: np.random.Generator,
    craft: Craft,
    driver: str,
    step: float,
    sense: FloatArray,
    yaw: FloatArray,
    ahead: FloatArray,
    others: FloatArray,
    shares: FloatArray,
) -> _Ride:
    """The vehicle's motion: inertia 1, drag for the full rate at full torque, weak reverse, thrusters with a lag."""
    count, fine = len(yaw), step / _SUBSTEPS
    arms = np.array([mount.yaw for mount in craft.mounts])
    forces = np.array([mount.surge for mount in craft.mounts])
    full = craft.rate / craft.tau
    linear = 0.3 / craft.tau
    quadratic = (full - linear * craft.rate) / craft.rate**2
    torque = full / np.abs(arms).sum()
    drift = 0.04 * full * _smooth(rng, count, step, 3.0 * craft.tau)
    reverse, lag = float(rng.uniform(0.75, 1.0)), float(rng.uniform(0.05, 0.25)) * craft.tau
    heading, rate, speed, depth = float(rng.uniform(0.0, 2.0 * np.pi)), 0.0, 0.0, 5.0
    start = heading
    thrust = np.zeros(len(arms))
    commands = np.empty((len(arms), count))
    track, turning, wanted, asked, surged, deep = (np.empty(count) for _ in range(6))
    for k in range(count):
        track[k], turning[k], surged[k], deep[k] = heading, rate, speed, depth
        wanted[k] = start + yaw[k] if driver == "autopilot" else start
        error = wanted[k] - heading
        asked[k] = (
            float(np.clip(1.2 * error - 1.5 * craft.tau * rate, -0.7, 0.7)) if driver == "autopilot" else float(yaw[k])
        )
        commands[:, k] = np.clip(shares[:, k] * asked[k] + others[:, k], -1.0, 1.0)
        goal = commands[:, k] * np.where(commands[:, k] < 0.0, reverse, 1.0)
        for _ in range(_SUBSTEPS):
            thrust += (goal - thrust) * min(1.0, fine / lag)
            moment = torque * float(arms @ thrust) + drift[k]
            rate += fine * (moment - quadratic * abs(rate) * rate - linear * rate)
            heading += fine * rate
        speed += step * (0.5 * float(forces @ thrust) - 0.5 * speed)
        depth = max(0.5, depth + 0.05 * step * float(others[-1, k]))
    return _Ride(
        time=step * np.arange(count, dtype=np.float64),
        heading=track,
        rate=turning,
        desired=wanted,
        commands=commands * sense[:, None],
        surge=ahead,
        yaw_demand=asked,
        depth=deep,
        speed=surged,
    )


def _angle(name: str, radians: FloatArray, unit: str, *, signed: bool) -> Column:
    """A heading as it is logged: 0 to a turn, or half a turn either way."""
    turn = 360.0 if unit == "deg" else 2.0 * math.pi
    decimals = 2 if unit == "deg" else 4
    value = np.degrees(radians) if unit == "deg" else radians
    wrapped = (value + turn / 2.0) % turn - turn / 2.0 if signed else value % turn
    return Column(name=name, values=np.array(wrapped), decimals=decimals, group="nav")


_NAV = {"desired_heading", "heading_error", "course", "yaw_rate", "roll", "pitch", "depth", "speed"}
_OF_THRUSTERS = {"current", "feedback", "temperature"}
_ASKED = ("cmd", "stellwert", "commande", "pådrag", "mando")  # names that part a command from what came of it


@dataclass(frozen=True, kw_only=True, eq=False)
class _Extra:
    """What is logged besides heading and commands.

    ``labels`` are what -> its name; of what there is one for each thruster the key ends in the thruster's place.
    """

    rng: np.random.Generator
    labels: Mapping[str, str]
    unit: str
    signed: bool
    turned_round: bool
    rate_unit: str
    rate_sign: float
    camera_us: bool
    constant: frozenset[str]

    @classmethod
    def drawn(
        cls, rng: np.random.Generator, craft: Craft, namer: Namer, thrusters: Sequence[str], *, kind: str, unit: str
    ) -> _Extra:
        """Draw what is logged; ``unit`` is the heading's."""
        rate_unit = str(rng.choice(["deg/s", "rad/s"]))
        camera_us = bool(kind == "us" or rng.random() < 0.3)
        units = {"desired_heading": unit, "heading_error": unit, "course": "deg", "lights": "%", "current": "A"}
        units |= {"camera": "us" if camera_us else "deg", "feedback": "rpm", "temperature": "C", "battery": "%"}
        units |= {"supply": "V", "roll": "deg", "pitch": "deg", "yaw_rate": rate_unit, "depth": "m", "speed": "m/s"}
        units |= {"water": "C", "stick_yaw": "", "stick_surge": "", "counter": ""}
        units = {key: value for key, value in units.items() if key not in _barred(craft, thrusters, kind)}
        labels: dict[str, str] = {}
        for key in sorted(units):
            if rng.random() > (0.8 if key == "yaw_rate" else 0.55):
                continue
            group = "nav" if key in _NAV else "sys"
            if key not in _OF_THRUSTERS:
                labels[key] = namer.name(group, key, units[key])
                continue
            for k, mount in enumerate(craft.mounts):
                numbered = any(char.isdigit() for char in thrusters[k])
                role = str(k + 1) if numbered else " ".join(namer.word(part) for part in mount.role)
                labels[f"{key}{k}"] = namer.name(group, key, units[key], role)
        return cls(
            rng=rng,
            labels=labels,
            unit=unit,
            signed=bool(rng.random() < 0.35),
            turned_round=bool(rng.random() < 0.15),
            rate_unit=rate_unit if "yaw_rate" in labels else "",
            rate_sign=-1.0 if rng.random() < 0.15 else 1.0,
            camera_us=camera_us,
            constant=frozenset(key for key in ("lights", "camera", "battery") if rng.random() < 0.25),
        )

    @property
    def compass(self) -> float:
        """-1 where the logged heading grows to port."""
        return -1.0 if self.turned_round else 1.0

    def columns(self, ride: _Ride) -> list[Column]:
        """Each of ``labels`` over ``ride``."""
        columns = []
        for key, name in self.labels.items():
            values, decimals, group = self._values(key, ride)
            columns.append(Column(name=name, values=values, decimals=decimals, group=group))
        return columns

    def _values(self, key: str, ride: _Ride) -> tuple[FloatArray, int, str]:
        if key[-1].isdigit():
            return self._of_thruster(key.rstrip("0123456789"), ride.commands[int(key[-1])])
        angular: dict[str, Callable[[], FloatArray]] = {
            "desired_heading": lambda: ride.desired,
            "course": lambda: ride.heading + 0.1 * _smooth(self.rng, len(ride.time), 0.1, 5.0),
        }
        if key in angular:
            turned = self.compass * angular[key]()
            signed = self.signed and key != "course"
            column = _angle("", turned, "deg" if key == "course" else self.unit, signed=signed)
            return column.values, column.decimals, "nav"
        return self._plain(key, ride)

    def _of_thruster(self, key: str, command: FloatArray) -> tuple[FloatArray, int, str]:
        rng, count = self.rng, len(command)
        if key == "current":
            return np.abs(command) ** 1.5 * 12.0 + 0.3 + rng.normal(0.0, 0.1, count), 2, "sys"
        if key == "temperature":
            return 18.0 + 4.0 * np.linspace(0.0, 1.0, count) + 0.2 * np.cumsum(np.abs(command)) / count, 1, "sys"
        late = np.concatenate([np.zeros(3), command[:-3]])
        return np.sign(late) * np.sqrt(np.abs(late)) * 2500.0 + rng.normal(0.0, 8.0, count), 0, "sys"

    def _plain(self, key: str, ride: _Ride) -> tuple[FloatArray, int, str]:
        rng, count = self.rng, len(ride.time)
        step = float(ride.time[1])
        still = key in self.constant
        if key == "heading_error":
            error = self.compass * (ride.desired - ride.heading)
            error = (error + np.pi) % (2.0 * np.pi) - np.pi
            return (np.degrees(error), 2, "nav") if self.unit == "deg" else (error, 4, "nav")
        if key == "yaw_rate":
            rate = self.rate_sign * self.compass * ride.rate + rng.normal(0.0, 0.004, count)
            return (np.degrees(rate), 2, "nav") if self.rate_unit == "deg/s" else (rate, 4, "nav")
        if key == "camera":
            tilt = np.zeros(count) if still else levels(rng, count, step, 15.0, (-0.7, -0.3, 0.0, 0.4, 0.8))
            return (1500.0 + 400.0 * tilt, 0, "sys") if self.camera_us else (45.0 * tilt, 0, "sys")
        if key == "lights":
            return (np.zeros(count) if still else levels(rng, count, step, 20.0, (0.0, 25.0, 50.0, 100.0))), 0, "sys"
        if key == "battery":
            return (np.full(count, 87.0) if still else np.linspace(92.0, 88.0, count).round()), 0, "sys"
        load = np.abs(ride.commands).sum(axis=0)
        plain: dict[str, tuple[FloatArray, int, str]] = {
            "supply": (15.8 - 0.25 * load + rng.normal(0.0, 0.02, count), 2, "sys"),
            "stick_yaw": (ride.yaw_demand, 3, "sys"),
            "stick_surge": (ride.surge, 3, "sys"),
            "roll": (1.5 * _smooth(rng, count, step, 2.0), 2, "nav"),
            "pitch": (1.0 * _smooth(rng, count, step, 2.5), 2, "nav"),
            "counter": (np.arange(count, dtype=np.float64), 0, "sys"),
            "depth": (ride.depth + rng.normal(0.0, 0.01, count), 2, "nav"),
            "speed": (np.abs(ride.speed) + rng.normal(0.0, 0.02, count), 2, "nav"),
            "water": (11.0 + 0.1 * _smooth(rng, count, step, 60.0), 2, "sys"),
        }
        return plain[key]


def _barred(craft: Craft, thrusters: Sequence[str], kind: str) -> set[str]:
    """What such a vehicle has not, or what nobody could tell from its commands by its name."""
    barred = {"depth", "water"} if craft.floats else {"course", "speed"}
    if craft is _TORQUE:
        return barred | _OF_THRUSTERS
    asked = any(word in thrusters[0].lower() for word in _ASKED)
    return barred if kind != "rpm" or asked else barred | {"feedback"}


@dataclass(frozen=True, kw_only=True)
class Layout:
    """How a table is written."""

    delimiter: str
    decimal: str
    encoding: str
    comments: tuple[str, ...]
    end: str
    order: tuple[int, ...]

    @classmethod
    def drawn(cls, rng: np.random.Generator, language: str, style: str) -> Layout:
        """Draw one."""
        comma = language != "en" and rng.random() < 0.5
        delimiter = ";" if comma else str(rng.choice([",", ",", ";", "\t"]))
        encoding = str(rng.choice(["utf-8", "utf-8-sig", "cp1252"]))
        remarks = ("# logger 2.4.1", f"# {style} export") if rng.random() < 0.2 else ()
        return cls(
            delimiter=delimiter,
            decimal="," if comma else ".",
            encoding=encoding,
            comments=remarks,
            end=str(rng.choice(["\n", "\r\n"])),
            order=tuple(rng.permutation(_MOST).tolist() if rng.random() < 0.5 else range(_MOST)),
        )

    def ordered(self, columns: Sequence[Column]) -> list[Column]:
        """As they stand in the table."""
        return [columns[k] for k in self.order if k < len(columns)]

    def write(self, path: Path, time: str, stamps: Sequence[str], columns: Sequence[Column]) -> None:
        """Write a table; a value that is not a number leaves its cell empty."""
        cells = [
            ["" if math.isnan(value) else f"{value + 0.0:.{column.decimals}f}" for value in column.values.tolist()]
            for column in columns
        ]
        # A decimal comma in the time too, unless it is text.
        times = [stamp if ":" in stamp else stamp.replace(".", self.decimal) for stamp in stamps]
        rows = [[row.replace(".", self.decimal) for row in column] for column in cells]
        lines = [*self.comments, self.delimiter.join([time, *(column.name for column in columns)])]
        lines += [self.delimiter.join(row) for row in zip(times, *rows, strict=True)]
        path.write_bytes((self.end.join(lines) + self.end).encode(self.encoding))


def _write_mcap(path: Path, start: float, time: FloatArray, columns: Sequence[Column]) -> None:
    """Write each column as a topic of JSON messages with the field that its name ends in."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels = {}
        for column in columns:
            topic, name = column.name.rsplit(".", 1)
            schema = json.dumps({"type": "object", "properties": {name: {"type": "number"}}}).encode()
            channels[column.name] = (
                writer.register_channel(topic, "json", writer.register_schema(topic.strip("/"), "jsonschema", schema)),
                name,
            )
        for k, second in enumerate(time.tolist()):
            instant = round(1e9 * (start + second))
            for column in columns:
                channel, name = channels[column.name]
                message = json.dumps({name: round(float(column.values[k]), column.decimals)})
                writer.add_message(channel, instant, message.encode(), instant)
        writer.finish()  # type: ignore[no-untyped-call]


def main() -> None:
    """Write a draw of folders, and truth.json beside them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, default=40)
    options = parser.parse_args()
    truths = {
        f"{index:02d}": asdict(write_folder(options.out / f"{index:02d}", seed=options.seed, index=index))
        for index in range(options.count)
    }
    (options.out / "truth.json").write_text(json.dumps(truths, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
