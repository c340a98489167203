"""Options of the commands: descriptions, values for shell completion, and manual pages as plain text."""

import ast
import functools
import inspect
import re
import textwrap
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import typer
from typer.core import TyperCommand, TyperGroup

from rovid.core.errors import ConfigError, RovidError
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


_OPTIONS = tomllib.loads(Path(__file__).with_name("options.toml").read_text(encoding="utf-8"))
_EXIT = """\
Exit status:
  0  Success.
  2  The input cannot be used. One message says where, what was found, what was expected and what to do."""
FIRST_SESSION = """\
A first session, with your own folder of logs:
  rovid init my_logs
  # now read my_logs/rovid.toml and enter your values
  rovid check my_logs
  rovid fit-drag my_logs
  rovid fit-inertia
  rovid diagnose
  rovid report

`rovid COMMAND --help` explains a command and shows examples. `rovid help` lists pages on tasks, files and effects. \
`rovid --install-completion` makes the Tab key complete commands, options, effects, axes and formats."""


@dataclass(frozen=True, kw_only=True)
class Page:
    """The manual page of a command in manual.toml. Its first line is the docstring of the command's function."""

    text: str  # Paragraphs on input, output and use
    # Pairs of a purpose and a command line; ``tests/cli/test_help_format.py`` runs them
    examples: list[tuple[str, str]]
    see: list[str]  # Related commands and pages

    @property
    def epilog(self) -> str:
        """Examples, exit status and related commands as printed."""
        examples = "\n\n".join(f"  # {purpose}\n  {line}" for purpose, line in self.examples)
        return f"Examples:\n{examples}\n\n{_EXIT}\n\nSee also:\n  {', '.join(self.see)}"


class ManualCommand(TyperCommand):
    """A command with the help layout of a manual page; without an option --axes it refuses it with the alternative."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:  # noqa: D102 - typer's
        known = any("--axes" in getattr(one, "opts", ()) for one in self.get_params(ctx))
        if not known and any(one.partition("=")[0] == "--axes" for one in args):
            mend = "Leave --axes out. Surge, sway and yaw together: init, check, fit, diagnose, simulate, report, "
            mend += "plan, compare and export."
            text = f"does not exist for {ctx.command_path}, which works along one axis."
            raise ConfigError(text, where="--axes", mend=mend)
        return super().parse_args(ctx, args)

    def collect_usage_pieces(self, ctx: Any) -> list[str]:  # noqa: D102 - typer's
        # Some versions of typer put required names into braces.
        return [piece.replace("{", "").replace("}", "") for piece in super().collect_usage_pieces(ctx)]

    def format_options(self, ctx: Any, formatter: Any) -> None:  # noqa: D102 - typer's
        arguments, options = [], []
        for parameter in self.get_params(ctx):
            described: Any = parameter
            # Some versions of typer contain their own click, so its classes cannot be compared.
            if described.param_type_name == "argument":
                arguments.append((described.metavar or described.name, described.help or ""))
            else:
                options.append(described.get_help_record(ctx))
        for heading, rows in (("Arguments", arguments), ("Options", options)):
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(list(filter(None, rows)))

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002, D102 - typer's
        formatter.write(f"\n{_wrap(self.epilog or '', formatter.width)}\n")


class ManualGroup(TyperGroup):
    """The list of all commands, each with its full first line."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002, D102 - typer's
        with formatter.section("Commands"):
            formatter.write_dl([(name, (one.help or "").partition("\n")[0]) for name, one in self.commands.items()])

    def format_epilog(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002, D102 - typer's
        formatter.write(f"\n{_wrap(self.epilog or '', formatter.width)}\n")


def _wrap(text: str, width: int) -> str:
    """Wrap each long line below its first word; a wrapped command continues after a backslash."""
    wrapped = []
    for line in text.splitlines():
        marker, end = re.match(r"\s*(?:[#\d]\s+)?", line), ""
        indent = " " * (marker.end() if marker else 0)
        if len(line) > width and line.startswith("  rovid ") and "," not in line:
            indent, end = indent + "  ", " \\"
        wrap = textwrap.TextWrapper(width - len(end), "", indent, break_long_words=False, break_on_hyphens=False)
        wrapped.append(f"{end}\n".join(wrap.wrap(line)) if len(line) > width else line)
    return "\n".join(wrapped)


@dataclass(frozen=True, kw_only=True)
class SharedOptions:
    """Options that several commands share; a command without one of them has its default.

    A command takes them as its parameter ``shared``. The key ``options`` of its table in options.toml lists all its
    options in the order of the help.
    """

    axis: str | None = None
    axes: str | None = None
    parameters: Path | None = None
    cutoff: float | None = None
    budget: float | None = None
    force: bool = False
    effects_from: list[Path] | None = None
    json: bool = False


def described(command: str, function: Callable[..., None]) -> Callable[..., None]:
    """The ``function`` of a command with the descriptions of its arguments and options in options.toml."""
    table, hints = _OPTIONS.get(command, {}), get_type_hints(function)
    parameters, common = dict(inspect.signature(function).parameters), set[str]()
    if "shared" in parameters:
        del parameters["shared"]
        common = set(table["options"]) - set(parameters)
        known = {one.name: one.default for one in fields(SharedOptions)}
        keyword = inspect.Parameter.KEYWORD_ONLY
        parameters |= {name: inspect.Parameter(name, keyword, default=known[name]) for name in common}
        hints |= get_type_hints(SharedOptions)
        parameters |= {name: parameters.pop(name) for name in table["options"]}
    for name, one in parameters.items():
        if hints[name] is not typer.Context:
            description = _description(one, dict({**_OPTIONS["shared"], **table}[name]))
            parameters[name] = one.replace(annotation=Annotated[hints[name], description])

    @functools.wraps(function)
    def run(**values: Any) -> None:
        if common:
            shared = SharedOptions(**{name: values.pop(name) for name in common})
            if shared.effects_from:
                from rovid.effects import load_plugins

                load_plugins(shared.effects_from)
            values["shared"] = shared
        function(**values)

    run.__signature__ = inspect.Signature([*parameters.values()])  # type: ignore[attr-defined] # read by inspect
    return run


def _description(parameter: inspect.Parameter, settings: dict[str, Any]) -> Any:
    """An argument if it may be given by position, else an option; a flag that is off has no opposite."""
    flag = [f"--{parameter.name.replace('_', '-')}"] if parameter.default is False else []
    names = settings.pop("names", flag)
    settings["metavar"] = settings.pop("value", None)
    if complete := settings.pop("complete", ""):
        fixed = FIXED.get(complete, ())
        settings["autocompletion"] = (lambda: list(fixed)) if fixed else globals()[complete]
        settings["help"] = settings["help"].replace("{values}", ", ".join(fixed))
    if parameter.kind is inspect.Parameter.KEYWORD_ONLY:
        return typer.Option(*names, **settings)
    return typer.Argument(show_default=False, **settings)
