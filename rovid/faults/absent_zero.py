"""A field that is left out of the message where it is zero, as JSON writers of protobuf do.

Such a field comes and goes, and is never zero where it is present. If the value before were held, the thrusters would
never stop.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from rovid.core.array_types import FloatArray
from rovid.faults.base import CommandData, Detection, Detectors
from rovid.trial.fault import Fault

# Smallest median length of the runs of messages with the field; fields at a lower rate than the topic are alone.
_MIN_RUN = 2.0
# Runs without the field that are this short, between equal values, are losses: in at most this share of the runs.
_SHORT, _MAX_LOSSES = 2, 0.5


def _detect(data: CommandData) -> Iterator[Detection[CommandData]]:
    absent = np.isnan(data.values)
    if not data.sparse or not absent.any() or not is_zero(data.values):
        return
    at = max(0.0, float(data.time[int(np.argmax(absent))] - data.measured[0]))
    count = int(np.count_nonzero(absent))
    text = (
        f"{data.log}: the commands of {data.name} are absent from {count} of {len(absent)} messages, first at {at:.2f} "
        "s, and never zero in the others: zeros were left out."
    )
    fault = Fault(
        fault="absent_zero", logs=(data.log,), at=(at,), size=float(count), unit="messages", text=text, remedy="zero"
    )
    values = np.where(absent, 0.0, data.values)
    yield Detection(fault=fault, done="It was taken as zero there.", repair=lambda data: replace(data, values=values))


def is_zero(values: FloatArray) -> bool:
    """Whether the field is absent where it is zero, rather than lost, or published at a lower rate or on change.

    ``values``: (n,) of all messages, NaN where absent.
    """
    absent = np.isnan(values)
    if absent.all():
        return True
    if np.any(values == 0.0):
        return False
    edges = np.flatnonzero(np.diff(absent, prepend=~absent[0], append=~absent[-1]))
    lengths, is_absent = np.diff(edges), absent[edges[:-1]]
    if np.median(lengths[~is_absent]) < _MIN_RUN:
        return False
    inner = np.flatnonzero(is_absent[1:-1]) + 1  # Runs without the field between two with it.
    if not inner.size:
        return True
    before, after = values[edges[inner] - 1], values[edges[inner + 1]]
    losses = (lengths[inner] <= _SHORT) & (before == after)
    return bool(np.mean(losses) <= _MAX_LOSSES)


DETECTORS: Detectors = {"command": (_detect,)}
