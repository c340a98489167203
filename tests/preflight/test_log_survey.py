"""Survey of logs with damaged payloads, topics or files: each is reported, and the rest is used."""

from __future__ import annotations

import io
import json
import shutil
import sqlite3
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from mcap.writer import Writer

from rovid.preflight.log_survey import unit_conflicts
from rovid.preflight.raw_columns import SignalGuess
from rovid.preflight.signal_guess import ColumnMapping
from tests.conftest import Rovid
from tests.readers.logs import HEADING, campaign, csv_text, dive, finished, standard, toml
from tests.readers.recordings import RECORDINGS, bag, said
from tests.whole.test_bad_input import assert_one_message

Payload = tuple[str, str, tuple[str, bytes] | None, Sequence[bytes]]  # topic, encoding, schema's encoding and text

DEEP = b'{"a":' * 100_000
GOOD = b'{"depth": 1.0}'
RECURSIVE = b"a_msgs/Node next\n" + b"=" * 80 + b"\nMSG: a_msgs/Node\na_msgs/Node next\n"
FURTHER: dict[str, Payload] = {
    "bad JSON": ("/further", "json", None, [b"{nonsense"]),
    "bad JSON later": ("/further", "json", None, [GOOD, GOOD, b"{nonsense"]),
    "bad UTF-8": ("/further", "json", None, [b'{"a": "\xff\xfe"}']),
    "deep JSON": ("/further", "json", None, [DEEP]),
    "a number of 5000 digits": ("/further", "json", None, [b'{"depth": ' + b"9" * 5000 + b"}"]),
    "an unknown encoding": ("/further", "flatbuffer", ("flatbuffer", b"x"), [b"x"]),
    "no schema": ("/further", "cdr", None, [b"x"]),
    "a schema that is none": ("/further", "cdr", ("ros2msg", b"float64 \xc3\xa9 = = ["), [b"x"]),
    "a schema that holds itself": ("/further", "cdr", ("ros2msg", RECURSIVE), [b"\0\1\0\0" + bytes(8)]),
    "a cut message": ("/further", "cdr", ("ros2msg", b"float64 data"), [b"\0\1\0\0\0"]),
    "a descriptor that is none": ("/further", "protobuf", ("protobuf", b"\xff\xff\xff"), [b"\xff"]),
}


def recording(further: Payload, *, alone: bool = False) -> bytes:
    """An ordinary dive in JSON with one further topic, or that topic ``alone``."""
    output = io.BytesIO()
    writer = Writer(output)
    writer.start()
    plain = writer.register_schema("plain", "jsonschema", b"{}")
    messages = [] if alone else dive()
    channels = {topic: writer.register_channel(topic, "json", plain) for topic, _, _ in messages}
    for topic, ns, fields in messages:
        writer.add_message(channels[topic], ns, json.dumps(fields).encode(), ns)
    topic, encoding, schema, payloads = further
    number = 0 if schema is None else writer.register_schema("a_msgs/msg/Node", *schema)
    channel = writer.register_channel(topic, encoding, number)
    for at, payload in enumerate(payloads):
        writer.add_message(channel, 10**9 + at, payload, 10**9)
    return finished(writer, output)


@pytest.mark.parametrize("what", FURTHER)
def test_a_damaged_unneeded_topic_does_not_hide_others(what: str, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "dive.mcap").write_bytes(recording(FURTHER[what]))
    document = rovid("init", tmp_path, "--json").document
    assert document["signals"]["mcap"]["heading"]["source"] == "/phins/heading.data"
    assert [one["source"] for one in document["commands"]["mcap"]] == ["/thrusters/fore.data"]
    if "digits" not in what:
        (warning,) = document["warnings"]
        assert warning.startswith(f"{tmp_path / 'dive.mcap'}: ")
        assert "'/further'" in warning
    assert rovid("check", tmp_path).code == 0


@pytest.mark.parametrize("what", FURTHER)
def test_a_file_without_a_valid_topic_is_reported(what: str, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "bad.mcap").write_bytes(recording(FURTHER[what], alone=True))
    (tmp_path / "good.csv").write_text(csv_text(standard()))
    document = rovid("init", tmp_path, "--json").document
    assert document["signals"]["csv"]["heading"]["source"] == "heading_deg"
    assert document["warnings"]


def test_a_single_damaged_file_leads_to_one_message(tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "bad.mcap").write_bytes(recording(FURTHER["bad JSON"], alone=True))
    assert_one_message(rovid("init", tmp_path), "bad.mcap", "message 1 of topic '/further' cannot be decoded")


def test_field_names_that_no_path_can_express_are_skipped(tmp_path: Path, rovid: Rovid) -> None:
    odd = json.dumps({"a.b": 1.0, "c[0]": 1.0, "": 1.0, "d": {"e.f": 2.0}, "g": 3.0}).encode()
    (tmp_path / "dive.mcap").write_bytes(recording(("/odd", "json", None, [odd])))
    assert rovid("init", tmp_path, "--json").document["warnings"] == []


def broken_bag(what: str) -> bytes:
    rows = [row for row in said() if row[0] != "/attitude"]
    data = bag([*rows, ("/further", "std_msgs/msg/Float32", 1.0, {"data": 1.0})], ros=2)
    return changed(
        data,
        "UPDATE topics SET type = 'no_such/msg/Type' WHERE name = '/further'"
        if what == "a type that nobody knows"
        else "UPDATE messages SET data = X'00' WHERE topic_id = (SELECT id FROM topics WHERE name = '/further')",
    )


def changed(data: bytes, *statements: str) -> bytes:
    """A ROS 2 bag after ``statements``."""
    with sqlite3.connect(":memory:") as bag:
        bag.deserialize(data)
        bag.execute("PRAGMA writable_schema = ON")
        for statement in statements:
            bag.execute(statement)
        bag.commit()
        return bag.serialize()


@pytest.mark.parametrize("what", ["a type that nobody knows", "a payload that is too short"])
def test_a_damaged_topic_of_a_bag_does_not_hide_others(what: str, tmp_path: Path, rovid: Rovid) -> None:
    (tmp_path / "dive.db3").write_bytes(broken_bag(what))
    document = rovid("init", tmp_path, "--json").document
    assert document["signals"]["bag"]["heading"]["source"].startswith("/phins/heading.data")
    assert ["/further" in text for text in document["warnings"]] == [True]


ROWS: dict[str, Callable[[Path], object]] = {
    "bad.csv": lambda path: path.write_bytes(bytes(range(256)) * 40),
    "bad.mcap": lambda path: path.write_bytes(b"\x89MCAP0\r\n" + b"\xff" * 100),
    "bad.parquet": lambda path: path.write_bytes(b"PAR1" + bytes(100) + b"PAR1"),
    "bad.bag": lambda path: path.write_bytes(b"#ROSBAG V2.0\n" + bytes(100)),
    "bad.db3": lambda path: path.write_bytes(b"SQLite format 3\0" + bytes(5000)),
    "bad.BIN": lambda path: path.write_bytes(b"\xa3\x95" + bytes(100)),
    "bad.tlog": lambda path: path.write_bytes(bytes(100)),
    "bad.nmea": lambda path: path.write_bytes(b"$HEHDT,1.0,T*00\r\n"),
    "bad.ulg": lambda path: path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8)),
    "gone.csv": lambda path: path.symlink_to("nowhere.csv"),
}


@pytest.mark.parametrize("name", ROWS)
def test_each_damaged_file_is_reported(name: str, tmp_path: Path, rovid: Rovid) -> None:
    campaign(tmp_path, mapped_everywhere())
    ROWS[name](tmp_path / name)
    (tmp_path / "good.csv").write_text(csv_text(standard()))
    (tmp_path / "good.mcap").write_bytes(recording(FURTHER["bad JSON"]))
    done = rovid("check", tmp_path)
    assert done.code == 2
    assert done.err.startswith("rovid: 1 of 3 logs cannot be used. ")
    assert name in done.err
    document = rovid("init", tmp_path, "--force", "--json").document
    assert document["logs"] == 2
    assert [text for text in document["warnings"] if name in text]
    assert set(document["signals"]) == {"csv", "mcap"}


def mapped_everywhere() -> str:
    command = '{ csv = "fore_V", mcap = "/thrusters/fore.data", bin = "RCOU.C1", tlog = "SERVO_OUTPUT_RAW.servo1_raw", '
    return toml(
        command=command + 'ulg = "actuator_motors.control[0]" }',
        heading=HEADING.replace("{ csv", '{ nmea = "heading", csv'),
    )


def test_logs_without_recognised_columns_do_not_hide_others(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    folder = tmp_path / "day"
    shutil.copytree(csv_day, folder, ignore=shutil.ignore_patterns("rovid.toml"))
    (folder / "camera.mcap").write_bytes(recording(("/camera", "json", None, [b'{"gain": 1.0}'] * 30), alone=True))
    document = rovid("init", folder, "--json").document
    assert set(document["signals"]) == {"csv"}
    assert "no heading and no command was recognised among /camera.gain" in str(document["warnings"])


@pytest.mark.parametrize(("unit", "names"), [("rad", "heading, roll: "), ("deg", "")])
def test_formats_with_different_units_of_a_signal_are_reported(unit: str, names: str) -> None:
    def mapping(unit: str) -> ColumnMapping:
        guess = SignalGuess(source="yaw", unit=unit, reason="by name")
        supply = SignalGuess(source="volt", reason="by name")
        return ColumnMapping(signals={"heading": guess, "supply_voltage": supply, "roll": guess}, commands=())

    problems = unit_conflicts({"bin": mapping("deg"), "tlog": mapping(unit)})
    assert [problem.partition("the units differ between bin and tlog logs")[0] for problem in problems] == [
        names
    ] * bool(names)


def test_a_damaged_curve_does_not_hide_the_logs(csv_day: Path, tmp_path: Path, rovid: Rovid) -> None:
    folder = tmp_path / "day"
    shutil.copytree(csv_day, folder, ignore=shutil.ignore_patterns("rovid.toml"))
    (folder / "thrust_curve.csv").write_text("command,thrust_N\n0,zero\n")
    document = rovid("init", folder, "--json").document
    assert document["curve"]["guessed"]
    assert "thrust_N is 'zero'" in str(document["warnings"])


def test_a_column_with_late_text_is_skipped(tmp_path: Path, rovid: Rovid) -> None:
    note = ["1.0"] * 400
    note[390] = "lost"
    (tmp_path / "a.csv").write_text(csv_text(standard(depth_m=note, height_m=note)))
    document = rovid("init", tmp_path, "--json").document
    assert document["signals"]["csv"]["heading"]["source"] == "heading_deg"
    said = [text.partition(": ")[2].partition(" is ")[0] for text in document["warnings"]]
    assert said == ["depth_m", "height_m"]
    assert all("a.csv:392" in text for text in document["warnings"])


def test_columns_with_equal_names_are_skipped(tmp_path: Path, rovid: Rovid) -> None:
    text = csv_text(standard(note=standard()["fore_V"])).replace(",note\n", ",fore_mV\n").splitlines()
    header = f"{text[0]},fore_mV"
    (tmp_path / "a.csv").write_text("\n".join([header, *(f"{line},1" for line in text[1:])]) + "\n")
    document = rovid("init", tmp_path, "--json").document
    assert [one["source"] for one in document["commands"]["csv"]] == ["fore_V"]
    assert "several columns are named 'fore_mV'" in str(document["warnings"])


DB3: dict[str, tuple[str, ...]] = {
    "a topic's name that is no UTF-8": ("UPDATE topics SET name = CAST(X'2FFFFE' AS TEXT) WHERE name = '/attitude'",),
    "numbers that are text": (
        "CREATE TABLE other AS SELECT id || 'x' AS id, name, type, serialization_format FROM topics",
        "DROP TABLE topics",
        "ALTER TABLE other RENAME TO topics",
    ),
    "a topic that is nothing": ("UPDATE topics SET name = '', type = '', serialization_format = '' WHERE id = 2",),
    "a topic without a name": ("UPDATE topics SET name = x'' WHERE name = '/attitude'",),
    "a stamp that is none": ("UPDATE messages SET timestamp = 'noon' WHERE id = 3",),
    "a payload that is text": ("UPDATE messages SET data = 'text' WHERE id = 3",),
}


@pytest.mark.parametrize("what", DB3)
def test_unusual_databases_are_reported(what: str, tmp_path: Path, rovid: Rovid) -> None:
    recorded = RECORDINGS[".db3"]
    campaign(tmp_path, toml(heading=recorded.heading, command=recorded.command))
    (tmp_path / "a.db3").write_bytes(changed(recorded.write(), *DB3[what]))
    for command in (["check", tmp_path], ["init", tmp_path, "--force"]):
        done = rovid(*command)
        assert done.code in {0, 2}
        assert "Traceback" not in done.err


def test_a_damaged_schema_is_reported(tmp_path: Path, rovid: Rovid) -> None:
    recorded = RECORDINGS[".db3"]
    campaign(tmp_path, toml(heading=recorded.heading, command=recorded.command))
    data = recorded.write()
    assert b"CREATE TABLE topics" in data
    (tmp_path / "a.db3").write_bytes(data.replace(b"CREATE TABLE topics", b"CREATE \xff\xff\xff\xff\xff topics"))
    assert_one_message(rovid("fit-drag", tmp_path), "a.db3", "cut or damaged")
    assert_one_message(rovid("init", tmp_path, "--force"), "a.db3", "cut or damaged")


@pytest.mark.parametrize("absurd", ["1e308", "-1e308"])
def test_absurd_numbers_do_not_affect_the_guess(absurd: str, tmp_path: Path, rovid: Rovid) -> None:
    lines = csv_text(standard()).splitlines()
    for at, sign in ((5, ""), (9, "-")):
        lines[at] = ",".join([*lines[at].split(",")[:-1], f"{sign}{absurd}".replace("--", "")])
    (tmp_path / "dive.csv").write_text("\n".join(lines) + "\n")
    (curve,) = rovid("init", tmp_path, "--json").document["written"][1:]
    assert absurd.strip("-") not in (tmp_path / curve).read_text()
    assert rovid("check", tmp_path).code in {0, 2}
