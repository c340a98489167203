"""``rovid mcp``."""

from importlib.util import find_spec

from rovid.cli.options import Page
from rovid.core.errors import ConfigError

PAGE = Page(
    text="""
    Serves check, fit, diagnose, plan, compare, export and help to an assistant, by the Model Context Protocol over
    standard input and output. The tools take folders of this machine and return the documents that the commands print
    with --json. The JSON Schemas of all documents are resources. Nothing is written.

    Enter it as a server with the command "rovid" and the argument "mcp" in the settings of the assistant. It needs the
    package mcp: `pip install 'rovid[mcp]'`.
    """,
    examples=(("Serve an assistant, which starts it by itself", "rovid mcp"),),
    see=("rovid help skill", "rovid help api"),
)


def mcp() -> None:
    """Serve an assistant by the Model Context Protocol."""
    if find_spec("mcp") is None or find_spec("mcp.server.mcpserver") is None:
        raise ConfigError(
            "needs the package mcp, version 2 or later.",
            where="rovid mcp",
            mend="Install it with `pip install 'rovid[mcp]'`.",
        )
    from rovid.api.mcp_server import server

    server().run("stdio")
