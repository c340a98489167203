"""Server of the Model Context Protocol: the documents of the commands as tools. It writes nothing."""

import functools
import json
from collections.abc import Callable
from importlib.resources import files
from typing import Any, ParamSpec, TypeVar

from mcp.server.mcpserver import MCPServer
from mcp.server.mcpserver.exceptions import ToolError
from mcp.server.mcpserver.resources import TextResource
from mcp.types import ToolAnnotations

import rovid
from rovid.api.results import Record
from rovid.present.terminal.topics import topic_names, topic_text

# Longest diagnosis in s by default: many clients wait a minute for a tool.
_BUDGET = 50.0
Document = dict[str, Any]
P = ParamSpec("P")
R = TypeVar("R")
_READS = ToolAnnotations(read_only_hint=True, open_world_hint=False)


def server() -> MCPServer:
    """The server with its tools, and the JSON Schemas as resources."""
    mcp = MCPServer("rovid", version=rovid.__version__, instructions=topic_text("skill"))
    for tool in (check, fit, simulate, diagnose, plan, compare, export, help):
        mcp.tool(annotations=_READS)(_with_messages(tool))
    for file in (files("rovid") / "schemas").iterdir():
        text = file.read_text(encoding="utf-8")
        uri, kind = f"rovid://schemas/{file.name}", "application/schema+json"
        mcp.add_resource(TextResource(uri=uri, name=file.name, mime_type=kind, text=text))
    return mcp


def _with_messages(tool: Callable[P, R]) -> Callable[P, R]:
    """The ``tool``, whose messages to the user the client receives."""

    @functools.wraps(tool)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return tool(*args, **kwargs)
        except rovid.RovidError as error:
            raise ToolError(str(error)) from error

    return run


def check(folder: str, axis: str = "yaw", axes: str | None = None) -> Document:
    """What is in the logs of a folder and what is wrong with them (rovid-check/1). Call it first.

    In all tools, axes "planar" in place of an axis takes surge, sway and yaw together.
    """
    return _document(rovid.open(folder, axis=axis, axes=axes).check())


def fit(folder: str, effects: list[str] | None = None, axis: str = "yaw", axes: str | None = None) -> Document:
    """Inertia, drag and parameters of the given effects with standard errors (rovid-fit/1)."""
    return _document(rovid.open(folder, axis=axis, axes=axes).fit(effects or ()))


def simulate(folder: str, effects: list[str] | None = None, axis: str = "yaw", axes: str | None = None) -> Document:
    """Free-running simulation of the fitted model against each log (rovid-simulation/1)."""
    study = rovid.open(folder, axis=axis, axes=axes)
    return _document(study.simulate(study.fit(effects or ())))


def diagnose(folder: str, axis: str = "yaw", budget_seconds: float = _BUDGET, axes: str | None = None) -> Document:
    """Named causes of what the simulation gets wrong, with evidence (rovid-diagnosis/1). Takes up to a minute."""
    return _document(rovid.open(folder, axis=axis, axes=axes).diagnose(budget=budget_seconds))


def plan(
    folder: str, between: list[str] | None = None, effects: list[str] | None = None, minutes: float = 10.0
) -> Document:
    """The next run with its commands: it separates two causes, or narrows a parameter (rovid-plan/1)."""
    return _document(rovid.open(folder).plan(between or (), effects=effects or (), minutes=minutes))


def compare(folder_a: str, folder_b: str, axis: str = "yaw") -> Document:
    """What changed from the campaign in folder A to that in folder B (rovid-comparison/1)."""
    return _document(rovid.open(folder_a, axis=axis).compare(rovid.open(folder_b, axis=axis)))


def export(
    folder: str,
    format: str,  # noqa: A002 - as the command
    effects: list[str] | None = None,
    axes: str | None = None,
) -> Document:
    """The fitted model in a simulator's format, verified by re-simulation: rovid-export/1 with the file's ``content``.

    The content of a binary format is null. Write it with `rovid export`.
    """
    study = rovid.open(folder, axes=axes)
    exported = study.export(format, study.fit(effects or ()))
    return _document(exported) | {"content": exported.content if isinstance(exported.content, str) else None}


def help(topic: str = "") -> str:  # noqa: A001 - as the command
    """A page of the documentation; without a topic the names of all pages."""
    return topic_text(topic) if topic else "\n".join(topic_names())


def _document(record: Record) -> Document:
    """The document as the command prints it: numbers that are not finite are null."""
    printed: Document = json.loads(record.to_json())
    return printed
