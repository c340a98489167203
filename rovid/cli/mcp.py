"""``rovid mcp``."""

from importlib.util import find_spec

from rovid.core.errors import ConfigError


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
