"""Files outside of the folder are not read or written, and no file is replaced."""

from __future__ import annotations

import socket
import time
from pathlib import Path

import pytest

from rovid.app import access
from rovid.app.access import RootFolder, Upload, clean_name
from rovid.core.errors import RovidError
from tests.app.served import Served

OUTSIDE = (
    "..",
    "../secret",
    "day/../../secret",
    "/etc",
    "//etc",
    "~",
    "~root",
    "day/..",
    "..\\secret",
    "day\\..\\..\\secret",
    "C:\\Windows",
    "day\0",
    "\0",
    ".ssh",
    "day/.hidden",
    "loop/a",
    "way_out",
    "way_out/secret.csv",
    "%2e%2e/secret",
)


@pytest.fixture(scope="module")
def _links(top: Path) -> None:
    (top.parent / "secret").mkdir()
    (top.parent / "secret" / "secret.csv").write_text("time_s,kept_secret\n0,1\n")
    (top / "way_out").symlink_to(top.parent / "secret")
    (top / "loop").symlink_to(top / "loop")


@pytest.mark.usefixtures("_links")
@pytest.mark.parametrize("name", OUTSIDE)
def test_files_outside_are_neither_read_nor_listed(server: Served, name: str) -> None:
    asked = (
        server.get("api/look", ("log", name)),
        server.get("api/folders", ("in", name)),
        server.get("api/columns", ("log", name)),
        server.post("draft", {"logs": [name]}),
        server.post("check", {"logs": ["day", name]}),
        server.post("save", {"logs": [name]}),
        server.post("run", {"logs": [name]}),
        server.upload("a.csv", b"time_s\n", folder=name),
    )
    for answer in asked[:1] + asked[2:]:
        assert answer.error
        assert "kept_secret" not in answer.error
    # A missing folder is empty.
    assert asked[1].status == 400 or asked[1].document == []


@pytest.mark.usefixtures("_links")
@pytest.mark.parametrize("way", ["..%2fsecret", "%2e%2e/secret", "..%5csecret", "%00", "....//secret", "%252e%252e/x"])
def test_an_encoded_path_is_refused(server: Served, way: str) -> None:
    assert server.ask(f"/report/{way}").status == 403
    for target in (f"static/{way}/secret.csv", "static/..%2f..%2fguard.py", "static/app.py", way):
        answer = server.ask(f"/{server.token}/{target}")
        assert answer.status == 404
        assert not answer.body.strip() or answer.body == b"Not Found"
    assert server.ask(f"/{server.token}/api/look?log={way}").status == 400


@pytest.mark.usefixtures("_links")
def test_folders_that_are_links_out_are_not_offered(server: Served) -> None:
    assert [one["path"] for one in server.get("api/folders").document] == ["day"]


def test_a_log_that_is_a_link_out_is_named(tmp_path: Path) -> None:
    (tmp_path / "elsewhere.csv").write_text("time_s,heading_deg\n")
    inside = tmp_path / "top" / "day"
    inside.mkdir(parents=True)
    (inside / "a.csv").symlink_to(tmp_path / "elsewhere.csv")
    with pytest.raises(RovidError, match="a link that leads out of"):
        RootFolder(folder=tmp_path / "top").require([inside])


def test_the_root_is_the_working_folder_or_the_parent_of_the_logs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = tmp_path / "here", tmp_path / "there"
    for folder in (here / "day", here / ".hidden", there):
        folder.mkdir(parents=True)
    (there / "a.csv").touch()
    monkeypatch.chdir(here)
    assert RootFolder.for_logs([]).folder == here
    assert RootFolder.for_logs([here / "day"]).folder == here
    assert RootFolder.for_logs([there]).folder == there
    assert RootFolder.for_logs([there / "a.csv"]).folder == there
    assert RootFolder.for_logs([here / ".hidden"]).folder == here / ".hidden"


NAMES = {
    "run 1.csv": "run 1.csv",
    "../../etc/passwd.csv": "etc/passwd.csv",
    "/abs/a.BIN": "abs/a.BIN",
    "C:\\logs\\a.csv": "C_/logs/a.csv",
    "day/ins/a.csv": "day/ins/a.csv",
    ".hidden.csv": "hidden.csv",
    "a\0b\x1b[31m.csv": "ab[31m.csv",
    "nul.csv": "_nul.csv",
    "re\u202evsc.csv": "revsc.csv",
    'what?*"<>|.csv': "what______.csv",
    "Tiefe ü.csv": "Tiefe ü.csv",
    "x" * 300 + ".csv": "x" * 116 + ".csv",
}


@pytest.mark.parametrize("name", NAMES)
def test_an_uploaded_name_is_valid_on_every_system(name: str) -> None:
    assert clean_name(name).as_posix() == NAMES[name]


@pytest.mark.parametrize("name", ["rovid.toml", "a.py", "a", "", "..", "a.csv.exe", ".csv"])
def test_other_files_are_not_uploaded(name: str) -> None:
    with pytest.raises(RovidError, match="is no log"):
        clean_name(name)


def test_an_upload_replaces_nothing(server: Served, top: Path) -> None:
    first = server.upload("a.csv", b"one").document
    again = server.upload("a.csv", b"two", first["folder"]).document
    other = server.upload("../a.csv", b"three").document
    assert [one["name"] for one in (first, again)] == [f"{first['folder']}/a.csv", f"{first['folder']}/a_2.csv"]
    assert other["folder"] != first["folder"]
    texts = {path.relative_to(top).as_posix(): path.read_text() for path in top.glob("logs_*/**/*.csv")}
    assert texts == {first["name"]: "one", again["name"]: "two", other["name"]: "three"}
    # Uploads into existing folders are refused.
    assert "is not a folder of dropped logs" in server.upload("b.csv", b"x", "day").error
    assert not list(top.rglob(".rovid-upload-*"))


def test_an_interrupted_upload_leaves_nothing(server: Served, top: Path) -> None:
    before = sorted(top.rglob("*"))
    head = f"POST /{server.token}/api/upload?name=cut.csv HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n"
    with socket.create_connection(("127.0.0.1", server.port)) as connection:
        connection.sendall(f"{head}Content-Length: 1000\r\n\r\ntime_s,heading".encode())
        stop = time.monotonic() + 20.0
        while sorted(top.rglob("*")) == before:
            assert time.monotonic() < stop
            time.sleep(0.01)
    while sorted(top.rglob("*")) != before:
        assert time.monotonic() < stop, sorted(top.rglob("*"))
        time.sleep(0.01)
    assert server.said.read_text() == ""


def test_a_too_large_upload_is_refused_and_leaves_nothing(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(access, "LARGEST", 10)
    arrival = Upload.start(tmp_path, Path("a.csv"), tmp_path_factory.mktemp("session"))
    with pytest.raises(RovidError, match="larger than"):
        arrival.check_size("11")
    arrival.write(b"12345")
    with pytest.raises(RovidError, match="larger than"):
        arrival.write(b"678901")
    arrival.close()
    assert not tmp_path.exists()
