"""Values for shell completion. Each Tab key press imports this module, so its imports have to be fast."""

import ast
from pathlib import Path

import typer

from rovid.core.errors import RovidError
from rovid.core.input_files import read_toml
from rovid.export import FORMATS
from rovid.trial.axis import AXES, PLANAR, YAW, parameter_file_name

# The same as `rovid.estimate.thrust_curve.THRUST_UNITS`, which a test checks.
THRUST_UNITS = ("N", "kN", "kgf", "gf", "lbf")
# Values that are known without reading anything, by their name in options.toml; the functions below find the others.
FIXED = {
    "axes": tuple(AXES),
    "axis_sets": (PLANAR.name,),
    "formats": tuple(FORMATS),
    "thrust_units": THRUST_UNITS,
    "effect_actions": ("new", "try"),
}
# Parameters of every model.
BASE = ("inertia", "quadratic_drag", "linear_drag")
_CATALOGUE = Path(__file__).parents[1] / "effects" / "catalogue.py"


def vehicles() -> list[str]:
    """Types for --vehicle."""
    from rovid.trial.vehicle_presets import preset_names

    return preset_names()


def topics() -> list[str]:
    """Pages of `rovid help`."""
    from rovid.present.terminal.topics import topic_names

    return topic_names()


def effects() -> list[str]:
    """Ids of the effects, parsed from the source of the catalogue, because its import takes a second."""
    lines = ast.parse(_CATALOGUE.read_text(encoding="utf-8")).body
    listed = next(line for line in lines if isinstance(line, ast.Assign) and ast.unparse(line.targets[0]) == "EFFECTS")
    return sorted(ast.literal_eval(listed.value))


def parameters(context: typer.Context) -> list[str]:
    """Names for --narrow: the parameters in the parameter file, or else those of the plain model."""
    axis = context.params.get("axis") or YAW.name
    path = Path(context.params.get("parameters") or parameter_file_name(axis))
    try:
        return list(read_toml(path)["parameters"])
    except (RovidError, LookupError, TypeError):
        return list(BASE)
