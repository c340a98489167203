"""What a set of real logs is made of."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.figure import Figure

from benchmarks.gallery.judge import Answer, Cause, Claim

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"
PLAIN, EXTENDED = "plain.toml", "extended.toml"
Answers = dict[str, Answer]


@dataclass(frozen=True, kw_only=True)
class Step:
    """One command; left out where the file that it ``needs`` was not made."""

    name: str
    words: str
    needs: str = ""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture drawn of what the commands left in the room; None where that is not there."""

    name: str
    caption: str
    draw: Callable[[Path, Answers], Figure | None]


@dataclass(frozen=True, kw_only=True)
class RealSet:
    """One set of real logs.

    Attributes
    ----------
    key
        Its name on the command line, and of the folder that the commands are given.
    logs
        Pattern within the folder of data.
    texts
        Files beside the logs, rovid.toml among them, by name.
    ours
        Our judgement in a few sentences, which no rerun can make untrue; what one can stands in the claims' remarks.
    """

    key: str
    title: str
    about: str
    source: str
    logs: str
    texts: dict[str, str] = field(default_factory=dict)
    steps: tuple[Step, ...]
    claims: tuple[Claim, ...]
    causes: tuple[Cause, ...] = ()
    pictures: tuple[Picture, ...]
    ours: str


def model_steps(key: str, axis: str = "") -> tuple[Step, ...]:
    """The plain model and its free run, the diagnosis, and the free run of what it found."""
    along = f" --axis {axis}" if axis else ""
    return (
        Step(name="check", words=f"check {key}{along}"),
        Step(name="fit", words=f"fit {key}{along} -p {PLAIN}"),
        Step(name="plain", words=f"simulate -p {PLAIN} --mcap plain", needs=PLAIN),
        Step(name="diagnose", words=f"diagnose {key}{along} -p {EXTENDED}"),
        Step(name="extended", words=f"simulate -p {EXTENDED} --mcap extended", needs=EXTENDED),
    )
