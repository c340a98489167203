"""Complete logs in a changing folder, with a simulated clock."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from rovid.export.rovid_equation import mat_file
from rovid.preflight.log_reading import log_files
from rovid.store import folder_monitor
from rovid.store.folder_monitor import FolderChange, FolderMonitor, WatchedLog, read_watched_log
from rovid.store.study import open_study
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import YAW
from tests.store.days import write_day


class Scene:
    """A watched folder and a store of logs that a test moves into it."""

    def __init__(self, store: Path, path: Path, *, at_once: bool = False) -> None:
        self.store, self.path, self.now = store, path, 0.0
        self.watched = FolderMonitor(
            path=path, axis=YAW, settled=5.0, abandoned=60.0, once=at_once, clock=lambda: self.now
        )

    def put(self, *names: str) -> None:
        self.path.mkdir(exist_ok=True)
        for name in names:
            shutil.copy2(self.store / name, self.path)

    def settings(self) -> None:
        self.put("rovid.toml", "thrust_curve.csv")

    def look(self, after: float = 0.0) -> FolderChange | None:
        """The change within ``after`` s, polled once a second."""
        end = self.now + after
        while (found := self.watched.poll()) is None and self.now < end:
            self.now += 1.0
        return found

    def take(self, after: float = 10.0) -> FolderChange:
        change = self.look(after)
        assert change is not None
        self.watched.accept(change)
        return change

    def told(self) -> list[str]:
        return [trouble.text for trouble in self.watched.problems.take_new()]


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("store")
    write_day(folder)
    return folder


@pytest.fixture
def scene(store: Path, tmp_path: Path) -> Scene:
    made = Scene(store, tmp_path / "day")
    made.settings()
    return made


def names(change: FolderChange) -> list[str]:
    return sorted(log.name for log in change.logs.values())


def test_a_log_is_read_when_it_no_longer_changes(scene: Scene) -> None:
    scene.put("sine.csv")
    assert scene.look(4.0) is None
    whole = (scene.path / "sine.csv").read_text()
    (scene.path / "sine.csv").write_text(whole[:5000].rpartition("\n")[0] + "\n")
    assert scene.look(4.0) is None
    (scene.path / "sine.csv").write_text(whole)
    assert scene.look(4.0) is None
    change = scene.take(2.0)
    assert [(log.name, log.cut) for log in change.added] == [("sine.csv", "")]
    assert scene.look(100.0) is None


def test_a_truncated_log_is_read_later_with_a_remark(scene: Scene) -> None:
    scene.put("sine.csv")
    cut = (scene.path / "sine.csv").read_text()[:5003]
    assert not cut.endswith("\n")
    (scene.path / "sine.csv").write_text(cut)
    assert scene.look(59.0) is None
    (log,) = scene.take(2.0).added
    assert "without an end" in log.cut
    assert log.samples > 50


def test_a_growing_log_keeps_its_old_content_until_it_is_read_again(scene: Scene) -> None:
    scene.put("sine.csv", "coast.csv")
    path = scene.path / "sine.csv"
    whole = path.read_text()
    path.write_text(whole[:5000].rpartition("\n")[0] + "\n")
    first = scene.take()
    path.write_text(whole)
    scene.put("steps.csv")
    os.utime(path, (1, 1))
    # The first log keeps growing, and the other log is read meanwhile.
    assert scene.look(3.0) is None
    path.write_text(whole + "\n")
    second = scene.take(3.0)
    assert [log.name for log in second.added] == ["steps.csv"]
    assert second.logs[path] is first.logs[path]
    path.write_text(whole)
    (log,) = scene.take(6.0).replaced
    assert log.samples > first.logs[path].samples


def test_later_logs_are_read_one_by_one_in_order_of_writing(scene: Scene) -> None:
    scene.put("hold_up.csv", "hold_down.csv")
    assert len(scene.take().added) == 2
    scene.put("sine.csv", "coast.csv")
    os.utime(scene.path / "sine.csv", (1, 1))
    assert [[log.name for log in scene.take().added] for _ in range(2)] == [["sine.csv"], ["coast.csv"]]
    assert scene.look(10.0) is None


def test_a_renamed_log_is_not_new(scene: Scene) -> None:
    scene.put("sine.csv", "coast.csv")
    scene.take()
    (scene.path / "sine.csv").rename(scene.path / "sine_20s.csv")
    change = scene.take()
    assert [(before.name, after.name) for before, after in change.renamed] == [("sine.csv", "sine_20s.csv")]
    assert (change.added, change.removed) == ((), ())
    assert names(change) == ["coast.csv", "sine_20s.csv"]


def test_a_deleted_log_is_dropped_unless_it_returns_at_once(scene: Scene) -> None:
    scene.put("sine.csv", "coast.csv")
    scene.take()
    (scene.path / "sine.csv").unlink()
    assert scene.look(3.0) is None
    scene.put("sine.csv")
    assert scene.look(20.0) is None
    (scene.path / "sine.csv").unlink()
    change = scene.take()
    assert [log.name for log in change.removed] == ["sine.csv"]
    assert names(change) == ["coast.csv"]


def test_an_unreadable_log_is_reported_once_per_change(scene: Scene) -> None:
    scene.put("sine.csv", "coast.csv")
    bad = scene.path / "sine.csv"
    whole = bad.read_text()
    bad.write_text("time_s,heading_deg\n")
    assert names(scene.take()) == ["coast.csv"]
    assert scene.told() == []
    scene.look(200.0)
    (told,) = scene.told()
    assert "sine.csv" in told
    bad.write_text("time_s,heading\n")
    scene.look(200.0)
    assert len(scene.told()) == 1
    bad.write_text(whole)
    assert names(scene.take()) == ["coast.csv", "sine.csv"]
    assert scene.told() == ["can be used now."]


def test_commands_beyond_the_thrust_curve_exclude_only_that_log(scene: Scene) -> None:
    scene.put("sine.csv", "coast.csv")
    lines = (scene.path / "sine.csv").read_text().splitlines()
    at = lines[0].split(",").index("fore_V")
    row = lines[9].split(",")
    row[at] = "99"
    lines[9] = ",".join(row)
    (scene.path / "sine.csv").write_text("\n".join(lines) + "\n")
    assert names(scene.take()) == ["coast.csv"]
    scene.look(100.0)
    (told,) = scene.told()
    assert "99" in told


def test_the_folder_may_appear_late_and_disappear(store: Path, tmp_path: Path) -> None:
    scene = Scene(store, tmp_path / "day")
    assert scene.look(10.0) is None
    assert scene.told() == ["is not there; waiting for it."]
    scene.put()
    assert scene.look(10.0) is None
    assert scene.told() == ["holds no log yet; waiting."]
    scene.put("sine.csv")
    assert scene.look(10.0) is None
    (told,) = scene.told()
    assert "rovid init" in told
    scene.settings()
    assert names(scene.take()) == ["sine.csv"]
    assert scene.told() == ["can be used now."]
    scene.path.rename(tmp_path / "elsewhere")
    assert scene.look(100.0) is None
    assert scene.told() == ["is not there; waiting for it."]
    # An unmounted network share is an empty folder.
    scene.path.mkdir()
    assert scene.look(100.0) is None
    assert "holds none of its logs" in scene.told()[0]
    scene.path.rmdir()
    (tmp_path / "elsewhere").rename(scene.path)
    assert scene.look(20.0) is None
    assert scene.told()[-1] == "is there again."
    assert list(scene.watched.logs) == [scene.path / "sine.csv"]


def test_an_edited_rovid_toml_is_awaited(scene: Scene) -> None:
    scene.put("sine.csv")
    scene.take()
    config = scene.path / "rovid.toml"
    text = config.read_text()
    config.write_text(text[:100] + "[")
    scene.put("coast.csv")
    assert scene.look(20.0) is None
    (told,) = scene.told()
    assert "rovid.toml" in told
    config.write_text(text.replace("0.43", "0.44"))
    change = scene.take()
    assert change.settings
    assert names(change) == ["coast.csv", "sine.csv"]
    assert scene.told() == ["can be used now."]
    config.unlink()
    scene.put("steps.csv")
    assert scene.look(20.0) is None
    assert scene.told() == ["is gone; waiting for it."]
    scene.settings()
    assert names(scene.take()) == ["coast.csv", "sine.csv", "steps.csv"]


def test_each_log_is_read_once(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[str] = []
    reads: Callable[..., WatchedLog] = read_watched_log

    def counted(*arguments: object) -> WatchedLog:
        read.append(str(arguments[0]))
        return reads(*arguments)

    monkeypatch.setattr(folder_monitor, "read_watched_log", counted)
    scene.put("sine.csv")
    scene.take()
    scene.put("coast.csv")
    change = scene.take()
    open_study([scene.path], reading=change.reading, without=change.excluded)
    scene.look(100.0)
    assert sorted(read) == ["coast.csv", "sine.csv"]


def test_a_failing_network_share_is_tried_again(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    scene.put("sine.csv")
    broken = True
    opened = Path.open

    def flaky(path: Path, *arguments: object, **options: object) -> object:
        if broken and path.name == "sine.csv":
            raise OSError(116, "Stale file handle")
        return opened(path, *arguments, **options)  # type: ignore[call-overload]  # as it was called

    monkeypatch.setattr(Path, "open", flaky)
    assert scene.look(100.0) is None
    broken = False
    assert names(scene.take()) == ["sine.csv"]


def test_once_reads_all_logs_as_they_are(store: Path, tmp_path: Path) -> None:
    scene = Scene(store, tmp_path / "day", at_once=True)
    scene.settings()
    scene.put("sine.csv", "coast.csv")
    path = scene.path / "coast.csv"
    path.write_text(path.read_text()[:-3])
    change = scene.take(0.0)
    assert {log.name: bool(log.cut) for log in change.added} == {"coast.csv": True, "sine.csv": False}
    assert scene.look() is None


def test_a_command_file_in_the_folder_is_no_log(scene: Scene) -> None:
    scene.put("sine.csv")
    (scene.path / "plan.csv").write_text('"time_s",fore,aft\n0,0,0\n4,1,1\n')
    assert names(scene.take()) == ["sine.csv"]
    assert scene.look(100.0) is None
    assert scene.told() == []
    study = open_study([scene.path])
    assert "plan.csv was left out: it is a command file of rovid plan, no log." in study.remarks()


def test_an_exported_model_in_the_folder_is_no_log(scene: Scene) -> None:
    scene.put("sine.csv")
    content, _ = mat_file({"inertia": 5000.0}, Assumptions())
    (scene.path / "rovid.mat").write_bytes(content)
    assert names(scene.take()) == ["sine.csv"]
    study = open_study([scene.path])
    assert "rovid.mat was left out: it is an export for matlab, no log." in study.remarks()
    assert "rovid.mat" not in {path.name for path in log_files([scene.path], [])}
