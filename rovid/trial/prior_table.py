"""[planar.prior] of rovid.toml: knowledge of the coupled model's parameters from elsewhere, as the user wrote it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rovid.trial.config_fingerprint import text_digest
from rovid.trial.drives import ValueParser
from rovid.trial.vehicle import Vehicle


def prior_table(document: Mapping[str, Any], parser: ValueParser) -> Mapping[str, Any]:
    """The table of a rovid.toml; empty without one. `rovid.store.planar_prior` checks its keys.

    Raises
    ------
    ConfigError
        [planar] has another key, or one of both is no table.
    """
    coupled = document.get("planar", {})
    table = coupled.get("prior", {}) if isinstance(coupled, dict) else None
    if not isinstance(table, dict) or not set(coupled) <= {"prior"}:
        raise parser.error("[planar]", f"is {coupled!r}; a table [planar.prior] and nothing else was expected.")
    return table


def prior_digest(table: Mapping[str, Any], vehicle: Vehicle, folder: Path) -> str:
    """Digest of the prior, of its file, and of the vehicle's mass and size, which added masses depend on."""
    sizes = [vehicle.mass, vehicle.length, vehicle.width, vehicle.height, vehicle.rigid_body_inertia]
    file = folder / str(table.get("file", ""))
    return text_digest(repr((table, sizes)) + (file.read_text(errors="replace") if file.is_file() else ""))
