"""What topics hold, whatever they are called."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from mcap.writer import Writer

from rovid.core.errors import LogError
from tests.readers.logs import (
    Message,
    campaign,
    dive,
    finished,
    kinds,
    mcap_bytes,
    read_mcap,
    to_ns,
    toml,
)
from tests.readers.test_mcap_reader import TIME, assert_dive


def test_a_topic_with_dots_wins_by_length(tmp_path: Path) -> None:
    other: list[Message] = [("/phins", int(ns), {"x": 1.0}) for ns in to_ns(TIME[::7])]
    renamed = [(topic.replace("/phins/heading", "/phins.heading"), ns, fields) for topic, ns, fields in dive()]
    config = campaign(tmp_path, toml(heading='heading = { mcap = "/phins.heading.data" }'))
    messages = sorted([*renamed, *other], key=lambda message: message[1])
    assert_dive(read_mcap(tmp_path, mcap_bytes(messages), config))


def test_messages_out_of_order_are_sorted(tmp_path: Path) -> None:
    messages = dive()
    messages[40], messages[44] = messages[44], messages[40]
    messages[200:210] = messages[200:210][::-1]
    trial = read_mcap(tmp_path, mcap_bytes(messages))
    assert_dive(trial)
    assert set(kinds(trial)) == {"backward"}


def test_two_channels_of_one_topic(tmp_path: Path) -> None:
    output = io.BytesIO()
    writer = Writer(output)
    writer.start()
    heads = [writer.register_channel("/phins/heading", "json", 0) for _ in range(2)]
    fore = writer.register_channel("/thrusters/fore", "json", 0)
    count = 0
    for topic, ns, fields in dive():
        if topic != "/depth":
            channel = fore if topic == "/thrusters/fore" else heads[count % 2]
            count += 1
            writer.add_message(channel, ns, json.dumps(fields).encode(), ns)
    assert_dive(read_mcap(tmp_path, finished(writer, output)))


def test_a_topic_without_messages(tmp_path: Path) -> None:
    output = io.BytesIO()
    writer = Writer(output)
    writer.start()
    channels = {topic: writer.register_channel(topic, "json", 0) for topic in ("/phins/heading", "/thrusters/fore")}
    for topic, ns, fields in dive():
        if topic == "/phins/heading":
            writer.add_message(channels[topic], ns, json.dumps(fields).encode(), ns)
    with pytest.raises(LogError, match="holds no message on topic '/thrusters/fore'"):
        read_mcap(tmp_path, finished(writer, output))
