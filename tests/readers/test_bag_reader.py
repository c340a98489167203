"""ROS bags of both kinds: fields, quaternions, clocks, and what is wrong with them."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pytest

from rovid.core.errors import LogError
from rovid.readers import find_logs, read_campaign, read_log
from rovid.store.parameter_file import sha256
from rovid.trial.trial import Trial
from tests.readers.logs import campaign, kinds, toml
from tests.readers.recordings import HEADING, TIME, bag, said

COMMAND = '{ bag = "/thrusters/fore.data" }'
BOTH = pytest.mark.parametrize("suffix", [".bag", ".db3"])
BAGS = {".bag": bag(said(), ros=1), ".db3": bag(said(), ros=2)}


def read(folder: Path, suffix: str, heading: str, *, command: str = COMMAND, time: str = "") -> Trial:
    config = campaign(folder, toml(heading=f"heading = {heading}", command=command, time=time))
    path = folder / f"a{suffix}"
    if not path.exists():
        path.write_bytes(BAGS[suffix])
    return read_log(path, config)


@BOTH
@pytest.mark.parametrize(
    "heading",
    [
        '{ bag = "/phins/heading.data" }',
        '{ bag = "/phins/heading.list[2]" }',
        '{ mcap = "/phins/heading.list.2" }',
        '{ bag = "/attitude" }',
    ],
)
@pytest.mark.parametrize("clock", ["", 'time = { mcap = "header" }', 'time = { bag = "log" }'])
def test_fields_and_clocks(suffix: str, heading: str, clock: str, tmp_path: Path) -> None:
    if "header" in clock:
        with pytest.raises(LogError, match=r"message 1 of topic '/(thrusters/fore|attitude)' has no time header.stamp"):
            read(tmp_path, suffix, heading, time=clock)
        return
    trial = read(tmp_path, suffix, heading, time=clock)
    np.testing.assert_allclose(np.rad2deg(trial.position[trial.measured]), HEADING, atol=1e-6)
    np.testing.assert_allclose(trial.time[trial.measured], TIME, atol=1e-6)


@BOTH
@pytest.mark.parametrize(
    ("heading", "words"),
    [
        ('{ bag = "/phin/heading.data" }', "no topic for '/phin/heading.data'.* Nearest: '/phins/heading'"),
        ('{ bag = "/phins/heading.date" }', "never holds the field 'date'.* Its fields: .*data"),
        ('{ bag = "/phins/heading.header" }', "is a std_msgs__msg__Header; a number or a quaternion"),
        ('{ bag = "/phins/heading.header.frame_id" }', "is 'phins'; a number"),
    ],
)
def test_wrong_names(suffix: str, heading: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(LogError, match=words):
        read(tmp_path, suffix, heading)


def test_types_that_the_bag_does_not_define(tmp_path: Path) -> None:
    """Bags up to Humble: ROS 2's own types are known, others are not."""
    path = tmp_path / "a.db3"
    path.write_bytes(BAGS[".db3"])
    with sqlite3.connect(path) as database:
        database.execute("DROP TABLE message_definitions")
    database.close()
    trial = read(tmp_path, ".db3", '{ bag = "/attitude" }')
    np.testing.assert_allclose(np.rad2deg(trial.position[trial.measured]), HEADING, atol=1e-6)
    with pytest.raises(LogError, match=r"type test_msgs/msg/Stamped of topic '/phins/heading'.* is not defined"):
        read(tmp_path, ".db3", '{ bag = "/phins/heading.data" }')


def test_a_bag_of_ros_2_is_a_folder(tmp_path: Path) -> None:
    config = campaign(tmp_path, toml(heading='heading = { bag = "/phins/heading.data" }', command=COMMAND, time=""))
    (tmp_path / "dive").mkdir()
    (tmp_path / "dive" / "dive_0.db3").write_bytes(BAGS[".db3"])
    (tmp_path / "dive" / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    assert [trial.name for trial in read_campaign([tmp_path], config).trials] == ["dive/dive_0.db3"]


def test_a_cut_database_is_read_up_to_the_cut(tmp_path: Path) -> None:
    data = BAGS[".db3"]
    (tmp_path / "a.db3").write_bytes(data[: int(0.7 * len(data))])
    try:
        trial = read(tmp_path, ".db3", '{ bag = "/phins/heading.data" }')
    except LogError as error:
        assert "cut or damaged" in str(error)  # noqa: PT017 - which of both depends on the version of SQLite
    else:
        assert kinds(trial)["truncated"] == 1


@pytest.mark.parametrize("closed", [True, False])
def test_nothing_is_left_beside_a_bag_that_writes_ahead(closed: bool, tmp_path: Path) -> None:
    """As recorders leave it that have their bags survive a crash; what the crash left in the journal is read."""
    path, made = tmp_path / "a.db3", tmp_path / "made.db3"
    made.write_bytes(BAGS[".db3"])
    with sqlite3.connect(made) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA wal_autocheckpoint = 0")
        (attitude,) = database.execute("SELECT id FROM topics WHERE name = '/attitude'").fetchone()
        database.execute("DELETE FROM messages WHERE topic_id = ?", [attitude])
        database.commit()
        if not closed:
            shutil.copy(made, path)
            shutil.copy(f"{made}-wal", f"{path}-wal")
    database.close()
    if closed:
        shutil.copy(made, path)
    there = {item.name for item in tmp_path.iterdir()} | {"rovid.toml", "curve.csv"}
    trial = read(tmp_path, ".db3", '{ bag = "/phins/heading.data" }')
    np.testing.assert_allclose(np.rad2deg(trial.position[trial.measured]), HEADING, atol=1e-6)
    with pytest.raises(LogError, match="no message on topic '/attitude'"):
        read(tmp_path, ".db3", '{ bag = "/attitude" }')
    assert {item.name for item in tmp_path.iterdir()} <= there


def test_bags_that_differ_only_in_their_journals_are_different_trials(tmp_path: Path) -> None:
    """Recorders that were killed leave the messages in the journal, next to databases of equal bytes."""
    empty = tmp_path / "empty.db3"
    empty.write_bytes(BAGS[".db3"])
    with sqlite3.connect(empty) as database:
        database.execute("CREATE TEMP TABLE kept AS SELECT * FROM messages")
        database.execute("DELETE FROM messages")
        database.commit()
        database.execute("VACUUM")
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA wal_autocheckpoint = 0")
        whole = len(said())
        for name, limit in {"a": whole, "b": whole - 2, "c": whole - 4}.items():
            database.execute("DELETE FROM messages")
            database.execute("INSERT INTO messages SELECT * FROM kept ORDER BY id LIMIT ?", [limit])
            database.commit()
            shutil.copy(empty, tmp_path / f"{name}.db3")
            shutil.copy(f"{empty}-wal", tmp_path / f"{name}.db3-wal")
    database.close()
    for item in tmp_path.glob("empty*"):
        item.unlink()
    before = {item.name: item.read_bytes() for item in tmp_path.iterdir()}
    assert before["a.db3"] == before["b.db3"] == before["c.db3"]
    config = campaign(tmp_path, toml(heading='heading = { bag = "/phins/heading.data" }', command=COMMAND))
    logs, remarks = find_logs([tmp_path], config)
    assert [name for name, _ in logs] == ["a.db3", "b.db3", "c.db3"]
    assert not remarks
    trials = [read_log(path, config) for _, path in logs]
    assert [int(trial.measured.sum()) for trial in trials] == [len(TIME), len(TIME) - 1, len(TIME) - 2]
    assert not any(trial.remarks for trial in trials)
    assert len({sha256(path) for _, path in logs}) == 3
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    assert {item.name for item in tmp_path.iterdir()} == {*before, "rovid.toml", "curve.csv"}


def test_what_a_damaged_table_lacks_though_it_says_it_cannot_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.db3"
    path.write_bytes(BAGS[".db3"])
    with sqlite3.connect(path) as database:
        (declared,) = database.execute("SELECT sql FROM sqlite_master WHERE name = 'topics'").fetchone()
        assert "name TEXT NOT NULL" in declared
        database.execute("PRAGMA writable_schema = ON")
        say = "UPDATE sqlite_master SET sql = ? WHERE name = 'topics'"
        database.execute(say, [declared.replace("NOT NULL", "")])
    database.close()
    with sqlite3.connect(path) as database:
        database.execute("UPDATE topics SET name = NULL WHERE name = '/attitude'")
        database.execute("PRAGMA writable_schema = ON")
        database.execute(say, [declared])
    database.close()
    trial = read(tmp_path, ".db3", '{ bag = "/phins/heading.data" }')
    np.testing.assert_allclose(np.rad2deg(trial.position[trial.measured]), HEADING, atol=1e-6)
    with pytest.raises(LogError, match="no topic for '/attitude'"):
        read(tmp_path, ".db3", '{ bag = "/attitude" }')
