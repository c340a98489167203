"""The web page of `rovid open`: from a folder of logs to rovid.toml and the report, on this machine only.

The page uses the functions of the command line. It writes a rovid.toml or runs a command.
"""
