"""The page of `rovid open`: from a folder of logs to rovid.toml and the report, on this machine alone.

What it shows comes of the same functions as the command line's; what it does is a rovid.toml or a command.
"""
