"""``python -m rovid``."""

from rovid.commands.cli import main

main()
