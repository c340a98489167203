"""Messages by topic: fields by path, clocks and errors."""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer

from rovid.core.errors import LogError
from rovid.readers.message_topics import ros_decoder
from tests.readers.logs import (
    ENCODERS,
    EPOCH,
    Message,
    campaign,
    dive,
    finished,
    kinds,
    mcap_bytes,
    read_mcap,
    stamped,
    to_ns,
    toml,
)
from tests.readers.test_mcap_reader import HEADING, TIME, assert_dive, quaternion


@pytest.mark.parametrize("encoding", ENCODERS)
@pytest.mark.parametrize("field", ["list[2]", "list.2"])
def test_elements_of_arrays(encoding: str, field: str, tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(heading=f'heading = {{ mcap = "/phins/heading.{field}" }}'))
    assert_dive(read_mcap(tmp_path, mcap_bytes(dive(), encoding=encoding), config))


def attitude(shape: str, number: int, ns: int) -> dict[str, Any]:
    turn = quaternion(np.deg2rad(HEADING[number]), roll=0.1, pitch=-0.2)
    header = stamped(0.0, ns)["header"]
    return {
        "imu": {"header": header, "orientation": turn, "angular_velocity": {"x": 0.0, "y": 0.0, "z": np.deg2rad(8.0)}},
        "odometry": {"header": header, "pose": {"pose": {"position": {"x": 1}, "orientation": turn}}},
        "pose": {"header": header, "pose": {"position": {"x": 1}, "orientation": turn}},
        "bare": turn,
        "scaled": {key: 3.0 * value for key, value in turn.items()},
    }[shape]


QUATERNIONS = [
    ("imu", "json", "/att"),
    ("imu", "json", "/att.orientation"),
    ("imu", "ros2", "/att"),
    ("imu", "ros2", "/att.orientation"),
    ("odometry", "json", "/att"),
    ("odometry", "json", "/att.pose"),
    ("odometry", "json", "/att.pose.pose.orientation"),
    ("pose", "json", "/att"),
    ("bare", "json", "/att"),
    ("scaled", "json", "/att"),
]


@pytest.mark.parametrize(("shape", "encoding", "source"), QUATERNIONS)
def test_quaternions(shape: str, encoding: str, source: str, tmp_path: Path) -> None:
    """Whatever unit is declared: a quaternion's yaw is in radians."""
    messages: list[Message] = [
        ("/att", int(ns), attitude(shape, number, int(ns))) for number, ns in enumerate(to_ns(TIME))
    ]
    messages.insert(0, ("/thrusters/fore", EPOCH, stamped(1.0, EPOCH)))
    others = [f'{name} = {{ mcap = "{source}", unit = "deg" }}' for name in ("roll", "pitch")]
    if shape == "imu":
        others.append('yaw_rate = { mcap = "/att.angular_velocity.z", unit = "rad/s" }')
    config = campaign(tmp_path, toml(*others, heading=f'heading = {{ mcap = "{source}", unit = "deg" }}'))
    trial = read_mcap(tmp_path, mcap_bytes(messages, encoding=encoding), config)
    np.testing.assert_allclose(trial.position, np.deg2rad(HEADING), atol=1e-9)
    assert trial.roll is not None
    assert trial.pitch is not None
    np.testing.assert_allclose(trial.roll, 0.1, atol=1e-9)
    np.testing.assert_allclose(trial.pitch, -0.2, atol=1e-9)


def test_a_quaternion_obeys_the_sign_and_misses_where_it_is_zero(tmp_path: Path) -> None:
    messages: list[Message] = [("/att", int(ns), attitude("bare", k, int(ns))) for k, ns in enumerate(to_ns(TIME))]
    messages[5] = ("/att", messages[5][1], {"x": 0.0, "y": 0.0, "z": 0.0, "w": 0.0})
    messages[6] = ("/att", messages[6][1], {"x": 0.0, "y": 0.0, "z": 0.0})
    messages[0] = ("/att", messages[0][1], {})
    messages.insert(0, ("/thrusters/fore", EPOCH, stamped(1.0, EPOCH)))
    config = campaign(tmp_path, toml(heading='heading = { mcap = "/att", sign = -1 }'))
    with pytest.raises(LogError, match="a number or a quaternion"):
        read_mcap(tmp_path, mcap_bytes(messages), config)  # an empty message holds none
    messages[1] = ("/att", messages[1][1], attitude("bare", 0, 0))
    trial = read_mcap(tmp_path, mcap_bytes(messages), config)
    assert kinds(trial) == {"missing": 2}
    np.testing.assert_allclose(trial.position[-1], -np.deg2rad(HEADING[-1]) + 2 * np.pi * 0, atol=1e-9)


def test_null_and_absent_fields_are_missing(tmp_path: Path) -> None:
    messages = dive()
    at = [k for k, (topic, _, _) in enumerate(messages) if topic == "/phins/heading"]
    messages[at[50]] = (*messages[at[50]][:2], {"data": None})
    messages[at[60]] = (*messages[at[60]][:2], {"other": 1.0})
    messages[at[70]] = (*messages[at[70]][:2], {"data": float("nan")})
    messages[at[80]] = (*messages[at[80]][:2], {"data": float("inf")})
    messages[at[90]] = (*messages[at[90]][:2], [1, 2])
    messages[at[95]] = (*messages[at[95]][:2], {"data": 10**400})
    trial = read_mcap(tmp_path, mcap_bytes(messages))
    assert kinds(trial) == {"missing": 6}
    assert trial.measured.sum() == 394


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


def test_ros_messages_of_any_byte_order() -> None:
    """Short separators and names, comments, constants and times without a definition are understood."""
    inner = "===\nMSG: test_msgs/B\nuint8 MODE_A=1  # text\nfloat64[] c\nstring<=5 d\n==="
    decode = ros_decoder("test_msgs/A", f"uint8 a\nuint32 b  # [deg]\nB inner\ntime at\n{inner}\n", "cdr")
    for kind, order in ((0, ">"), (1, "<")):
        payload = struct.pack(f"{order}BxxxIIxxxxdI3sxII", 1, 2, 1, 3.0, 3, b"xy\0", 4, 5)
        message = decode(bytes([0, kind, 0, 0]) + payload)
        assert (message.a, message.b, message.inner.c.tolist(), message.inner.d) == (1, 2, [3.0], "xy")
        assert (message.at.sec, message.at.nanosec) == (4, 5)


@pytest.mark.parametrize(
    ("text", "problem"), [("Other a", KeyError), ("float64[ a", Exception), ("wstring a", KeyError)]
)
def test_ros_definitions_that_make_no_sense(text: str, problem: type[Exception]) -> None:
    with pytest.raises(problem):
        ros_decoder("a/A", text, "cdr")
