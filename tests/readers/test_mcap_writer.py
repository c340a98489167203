"""Recordings that rovid writes."""

from __future__ import annotations

import numpy as np

from rovid.core.escaping import field_names
from rovid.readers.mcap_writer import OutputTopic, mcap_bytes
from tests.hostile import NAMES


def test_a_recording_keeps_the_commands_of_thrusters_with_names_alike() -> None:
    fields = dict(zip(field_names(NAMES), np.ones((len(NAMES), 3)), strict=True))
    assert len(fields) == len(NAMES)
    assert mcap_bytes(
        [OutputTopic(name="/commands", time=np.arange(3.0), fields=fields, units=dict.fromkeys(fields, ""))]
    )
