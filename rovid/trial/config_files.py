"""The files that rovid.toml consists of."""

import contextlib
from collections.abc import Sequence
from pathlib import Path

from rovid.core.errors import ConfigError
from rovid.core.input_files import read_toml
from rovid.trial.config import find_config


def config_files(paths: Sequence[Path]) -> list[Path]:
    """The rovid.toml of ``paths``, its thrust curves and the file of its prior, as far as they exist."""
    files: list[Path] = []  # Errors in rovid.toml are reported when the file is loaded.
    with contextlib.suppress(ConfigError):
        config = find_config(paths)
        files.append(config)
        document = read_toml(config)
        blocks, coupled = document.get("thrusters"), document.get("planar")
        tables = [*blocks] if isinstance(blocks, list) else []
        tables += [coupled.get("prior")] if isinstance(coupled, dict) else []
        known = [table for table in tables if isinstance(table, dict)]
        named = [config.parent / str(table[key]) for table in known for key in ("curve", "file") if key in table]
        files += [path for path in named if path.exists()]
    return files
