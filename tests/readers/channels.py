"""Trials from channels in memory, each on a clock of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from rovid.readers.build_trial import build
from rovid.readers.raw_log import Channel, RawLog
from rovid.trial.trial import Trial
from tests.readers.logs import campaign, toml, turning

TIME, HEADING = turning()
HEADINGS = (TIME, HEADING % 360.0)
Pairs = tuple[ArrayLike, ArrayLike]
_OPTIONAL = ("yaw_rate", "roll", "pitch", "supply")


def trial_of(folder: Path, *, sortable: bool = True, **signals: Pairs) -> Trial:
    """A trial from (time, values) of each signal; underscores in names stand for dots; rovid.toml is in ``folder``."""
    channels = {}
    for key, (time, values) in signals.items():
        name = "command.fore" if key == "fore" else key
        channels[name] = Channel(
            source=f"/{key}.data",
            clock=f"log time of /{key}",
            time=np.asarray(time, dtype=np.float64),
            values=np.asarray(values, dtype=np.float64),
        )
    raw = RawLog(channels=channels, place=lambda _, index: f"message {index + 1}", sortable=sortable)
    config = campaign(folder, toml(*(f'{name} = {{ csv = "{name}", mcap = "/{name}.data" }}' for name in _OPTIONAL)))
    return build(raw, config, Path("dive.mcap"), "dive.mcap")
