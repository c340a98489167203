"""Bench readings of two thrusters."""

from __future__ import annotations

from benchmarks.gallery import pictures
from benchmarks.gallery.base import Picture, RealSet, Step
from benchmarks.gallery.judge import WRONG, Claim, Document, Reader, Reading, number, ratio

_KEY, _THRUSTERS = "kaxan", ("kaxan_520", "kaxan_540")
_NO_READING = (
    "There is no reading between -0.14 V and 0.93 V; rovid ends the zone at the last reading inside, not where "
    "the curve begins to rise."
)


def _end(of: str, which: int) -> Reader:
    """Reads the lower (0) or upper (1) end of a range; it has no standard error."""

    def read(document: Document) -> Reading | None:
        return (float(document[of][which]), None) if document[of] else None

    return read


def _zone(thruster: str, which: int, known: str, remark: str = "") -> Claim:
    low, high = (0.5, 1.5) if which else (-1.5, -0.5)
    return Claim(
        known=known,
        step=thruster,
        judge=number(_end("dead_zone", which), low, high, "V"),
        remarks={WRONG: remark} if remark else {},
    )


BENCH = RealSet(
    key=_KEY,
    title="KAXAN: bench readings of two thrusters",
    about="Command in V and thrust in N of two thrusters of the ROV KAXAN, 47 readings each, without a header. "
    "Near zero the readings scatter by half a newton and are not monotonic. They were probably read from a plot.",
    source="[Kaxan](https://github.com/enricoande/Kaxan) at 8f24f17; MIT licence, Copyright (c) 2018 Enrico "
    "Anderlini. The files come with rovid as `sample_logs/thruster_bench`.",
    logs="thruster_bench/kaxan_5*.csv",
    steps=tuple(
        Step(name=key, words=f"fit-thruster {_KEY}/{key}.csv --unit N -o {key}_curve.csv") for key in _THRUSTERS
    ),
    claims=(
        _zone(
            "kaxan_520",
            1,
            "Both thrusters have a dead zone of about 1 V on each side, 0.5 to 1.5 V: within the zone the readings "
            "scatter about zero. The upper end of 520",
            _NO_READING,
        ),
        _zone("kaxan_520", 0, "The lower end of 520"),
        _zone("kaxan_540", 1, "The upper end of 540"),
        _zone("kaxan_540", 0, "The lower end of 540"),
        Claim(
            known="Thruster 520 has much less thrust in reverse: the outermost readings are -63.11 N and 96.33 N",
            step="kaxan_520",
            judge=number(ratio(_end("thrust_range", 0), _end("thrust_range", 1)), -63.12 / 96.32, -63.10 / 96.34),
        ),
    ),
    pictures=(
        Picture(
            name="real_kaxan.png",
            caption="The readings, and rovid's curves.",
            draw=lambda room, _: pictures.benches(room, _KEY, _THRUSTERS),
        ),
    ),
    ours="Every later command relies on the thrust curve. Its dead zone is the most important part to check.",
)
