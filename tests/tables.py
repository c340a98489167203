"""A table, written and read."""

from __future__ import annotations

from pathlib import Path

from rovid.trial.tables import CsvTable, read_table


def table(text: str, folder: Path, **options: tuple[str, ...]) -> CsvTable:
    path = folder / "table.csv"
    path.write_text(text)
    return read_table(path, **options)
