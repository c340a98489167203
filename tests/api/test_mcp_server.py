"""The server of the Model Context Protocol, asked by the protocol's own client over standard input and output."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client
from mcp.types import TextContent, TextResourceContents

from rovid.present.terminal.topics import topic_text
from tests.conftest import SAMPLES, require_schema, run_rovid


async def session(folder: Path) -> dict[str, Any]:
    parameters = StdioServerParameters(command=sys.executable, args=["-m", "rovid", "mcp"], cwd=folder)
    async with Client(stdio_client(parameters)) as client:
        tools = (await client.list_tools()).tools
        resources = (await client.list_resources()).resources
        schema = await client.read_resource("rovid://schemas/rovid-check-1.json")
        log = str(SAMPLES / "rosub_hidden" / "steps.csv")
        return {
            "instructions": client.instructions,
            "read_only": {tool.name: tool.annotations and tool.annotations.read_only_hint for tool in tools},
            "schemas": {resource.name for resource in resources},
            "schema": schema.contents[0],
            "check": await client.call_tool("check", {"folder": log}),
            "coupled": await client.call_tool("check", {"folder": str(SAMPLES / "planar_rov"), "axes": "planar"}),
            "refused": await client.call_tool("fit", {"folder": "no_such_folder"}),
        }


def test_a_client_gets_the_documents_of_the_commands_and_nothing_is_written(tmp_path: Path) -> None:
    found = anyio.run(session, tmp_path)
    assert found["instructions"] == topic_text("skill")
    tools = ("check", "fit", "simulate", "diagnose", "plan", "compare", "export", "help")
    assert found["read_only"] == dict.fromkeys(tools, True)
    folder = Path(__file__).parents[2] / "rovid" / "schemas"
    assert found["schemas"] == {file.name for file in folder.iterdir()}
    assert isinstance(found["schema"], TextResourceContents)
    assert json.loads(found["schema"].text)["properties"]["schema"] == {"const": "rovid-check/1"}
    document = found["check"].structured_content
    require_schema(document)
    assert document == run_rovid("check", SAMPLES / "rosub_hidden" / "steps.csv", "--json").document
    coupled = found["coupled"].structured_content
    require_schema(coupled)
    assert (coupled["axes"], len(coupled["logs"])) == ("planar", 6)
    assert found["refused"].is_error
    (text,) = found["refused"].content
    assert isinstance(text, TextContent)
    assert "no_such_folder" in text.text
    assert "Traceback" not in text.text
    assert [*tmp_path.iterdir()] == []


def test_without_the_package_one_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rovid.cli.report.find_spec", lambda _: None)
    done = run_rovid("mcp")
    assert (done.code, done.out) == (2, "")
    assert "pip install 'rovid[mcp]'" in done.err
