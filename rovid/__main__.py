"""``python -m rovid``."""

from rovid.cli.cli import main

main()
