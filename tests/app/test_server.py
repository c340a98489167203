"""The server over HTTP: start, requests, report and end."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.app.conftest import logs_into
from tests.app.served import Served, served
from tests.app.test_api import chosen
from tests.conftest import run_rovid


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Served, Path]]:
    """A page with a finished job."""
    top = tmp_path_factory.mktemp("whole") / "top"
    logs_into(top / "day")
    with served(top, "day") as server:
        assert server.get("api/start").document["logs"] == ["day"]
        assert server.post("run", {"logs": ["day"]}).error.startswith("there is no rovid.toml yet")
        assert server.post("save", chosen()).document["written"] == ["day/rovid.toml"]
        server.post("run", {"logs": ["day"], "diagnosis": False})
        done = server.until("done", "failed")
        assert done["error"] == ""
        yield server, top


def test_the_report_is_served_in_a_sandbox(diagnosed: tuple[Served, Path]) -> None:
    server, top = diagnosed
    key = server.get("api/progress").document["report"]
    report = server.ask(f"/report/{key}")
    assert report.body == (top / "day" / "report" / "index.html").read_bytes()
    policy = {name.lower(): value for name, value in report.headers.items()}["content-security-policy"]
    assert policy.startswith("sandbox allow-scripts;")
    assert "script-src 'sha256-" in policy
    assert "default-src 'none'" in policy
    # Later requests find the report at once. It is shown at no address with the token.
    assert server.get("api/look", ("log", "day")).document["report"] == key
    assert server.get(f"report/{key}").status == 403
    assert server.ask(f"/report/{key}", headers={"Sec-Fetch-Site": "cross-site"}).status == 403


def test_other_pages_are_not_served(diagnosed: tuple[Served, Path]) -> None:
    server, top = diagnosed
    known = server.get("api/look", ("log", "day")).document["report"]
    page = top / "day" / "report" / "index.html"
    kept = page.read_bytes()
    page.write_text("<script>alert(1)</script>")
    assert server.ask(f"/report/{known}").status == 404
    assert server.get("api/look", ("log", "day")).document["report"] is None
    page.write_bytes(kept)


def test_files_are_written_only_next_to_the_logs(diagnosed: tuple[Served, Path]) -> None:
    _, top = diagnosed
    assert [path.name for path in top.iterdir()] == ["day"]
    new = {path.name for path in (top / "day").iterdir() if path.suffix != ".csv"}
    assert new == {"rovid.toml", "parameters.toml", "report"}


def test_invalid_requests_are_refused_without_harm(server: Served) -> None:
    token = server.token
    for body in (b"", b"{", b"[" * 100_000, b"\xff", b"3"):
        answer = server.ask(f"/{token}/api/draft", "POST", {}, body)
        assert "the page sent" in answer.error
    assert "more than" in server.ask(f"/{token}/api/draft", "POST", {}, b" " * (5 << 20)).error
    assert server.get("api/columns", ("log", "day/hold_03.csv"), ("bins", "many")).error
    assert server.get("api/columns", ("log", "day/no.csv")).error
    for target, method in (("api/draft", "GET"), ("api/look", "POST"), ("api/start", "DELETE")):
        assert server.ask(f"/{token}/{target}", method).status == 405
    assert server.get("api/start").status == 200


def test_logs_from_elsewhere_take_no_uploads(tmp_path: Path) -> None:
    logs_into(tmp_path / "elsewhere" / "day")
    (tmp_path / "here").mkdir()
    with served(tmp_path / "here", str(tmp_path / "elsewhere" / "day")) as server:
        begun = server.get("api/start").document
        assert (begun["uploads"], begun["logs"]) == (False, [""])
        assert len(server.get("api/look", ("log", "")).document["logs"]) == 2
        assert "in which `rovid open` was started" in server.upload("a.csv", b"x").error


def test_a_taken_port_is_an_error(server: Served, tmp_path: Path) -> None:
    done = run_rovid("open", "--no-browser", "--port", server.port)
    assert done.code == 2
    assert f"port {server.port} of this machine cannot be used" in done.err


def test_missing_packages_name_the_extra(tmp_path: Path) -> None:
    code = (
        "import sys, importlib.util as u; real = u.find_spec\n"
        "u.find_spec = lambda name, *more: None if name in ('starlette', 'uvicorn') else real(name, *more)\n"
        "sys.argv = ['rovid', 'open', '--no-browser']\n"
        "from rovid.cli.cli import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 2
    assert "pip install 'rovid[app]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_missing_logs_are_an_error_at_the_start(tmp_path: Path) -> None:
    done = run_rovid("open", tmp_path / "no_such", "--no-browser")
    assert done.code == 2
    assert "no such file or folder" in done.err
