"""Text of a first rovid.toml: each guess with its reason, marks on assumptions, and what the user has to fill in."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from textwrap import wrap
from typing import TypeVar

from rovid.core.errors import LINE_LENGTH, RovidError, display_text, join_words
from rovid.core.formatting import TextTemplates, toml_key, toml_text
from rovid.core.output_files import GUESSED_CURVE as GUESSED
from rovid.core.output_files import OutputFile, OutputSet
from rovid.preflight.axis_guess import SIDEWAYS, PlanarGuess
from rovid.preflight.command_effects import CommandEffect
from rovid.preflight.drive_guess import RudderGuess
from rovid.preflight.log_survey import FULL_THRUST, GUESSED_CURVE, LogSurvey, all_commands, config_output
from rovid.preflight.raw_columns import SignalGuess
from rovid.preflight.thruster_guess import ThrusterCommand
from rovid.readers import read_campaign
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import name_words
from rovid.trial.config import load_config
from rovid.trial.tables import curve_csv

Guess = TypeVar("Guess", SignalGuess, ThrusterCommand, RudderGuess)
_TEXTS = TextTemplates(__file__, "config")
# Width of a comment in characters.
_WIDTH = 110
# Estimates of a clock offset at most, each from the stretch that the last one makes common. A decision.
_ESTIMATES = 3
# Maximum number of unused columns that are listed.
_MAX_UNUSED = 40


def config_files(survey: LogSurvey) -> dict[OutputFile, str]:
    """Files to write with their texts: rovid.toml, and the thrust curve if it is new."""
    files = {config_output([survey.folder]): config_text(survey)}
    if survey.new_curve is not None:
        curve = OutputFile(survey.folder / survey.curve, GUESSED)
        files[curve] = curve_csv(survey.new_curve.command, survey.new_curve.thrust)
    return files


def write_config(survey: LogSurvey, paths: Sequence[Path], *, force: bool) -> tuple[LogSurvey, list[Path]]:
    """Write the files, for joined trials a second time with the clock offsets; return the survey and the paths.

    Raises RovidError if an existing file may not be replaced.
    """
    # The user may have replaced an existing guessed curve by a bench curve: only rovid.toml is protected by `force`.
    config = config_output([survey.folder])
    outputs = OutputSet([config], force=force)
    files = config_files(survey)
    outputs.write(files)
    if survey.join is not None and not survey.unrecognised:
        # The import takes long, and only joined trials need it.
        from rovid.preflight.clock_offsets import estimate_clock_offsets

        with suppress(RovidError):  # `rovid check` reports errors in the logs
            # A large offset is estimated again from the stretch that both files then have in common.
            for _ in range(_ESTIMATES):
                read = load_config(config.path, survey.axis)
                found = estimate_clock_offsets(read_campaign(paths, read).trials, read)
                if not found.offsets:
                    break
                whole = tuple(clock.with_given for clock in found.offsets)
                survey = replace(survey, clock_offsets=replace(found, offsets=whole))
                files = config_files(survey)
                OutputSet([config], force=True).write({config: files[config]})
                if not any(clock.certain for clock in found.offsets):
                    break
    return survey, [output.path for output in files]


def config_text(survey: LogSurvey) -> str:
    """Text of rovid.toml."""
    sections = (_head, _vehicle, _thrusters, _signals, _join, _exclusions)
    return "\n".join(line for section in sections for line in section(survey)) + "\n"


def log_count_text(survey: LogSurvey) -> str:
    """Number of logs in words, as "3 logs"."""
    more = f" ({survey.unread} more not read)" if survey.unread else ""
    return ("one log" if survey.logs == 1 else f"{survey.logs} logs") + more


def assumptions_in(survey: LogSurvey) -> Assumptions:
    """Arms, and a new curve, in the written file that were not measured."""
    turning = {command.name for command in all_commands(survey.mappings) if command.direction}
    thrusters = _commands(survey)
    if turning and not survey.with_planar:
        thrusters = {name: commands for name, commands in thrusters.items() if name in turning}
    items: list[str] = []
    for name, commands in thrusters.items():
        if all(command.is_motor for command in commands.values()):
            items.append(f"torque_constant of {name}")
            continue
        first, planar = next(iter(commands.values())), survey.with_planar
        keys = ["surge", "sway"] * (planar and first.source not in survey.overrides.directions)
        turns = not (planar and all(one.turns_nothing for one in commands.values()))
        if keys := keys + [survey.axis.arm_key] * (turns and _is_arm_guessed(survey, commands)):
            items.append(f"{join_words(keys)} of {name}")
        if survey.curve_guessed:
            items.append(f"curve of {name}")
    rudders = _rudders(survey)
    if survey.with_planar and rudders and not survey.curve and any(one.propeller[0] for one in survey.planar.values()):
        items.append("thrust_constant of propeller")
    unknown = "position" if survey.with_planar else "coefficient"
    for name, each in rudders.items():
        rudder = next(iter(each.values()))
        if rudder.given is None or survey.with_planar:
            items.append(f"{unknown if rudder.wheelbase is None else 'wheelbase'} of {name}")
    return Assumptions(items=tuple(items), thrusters=len(thrusters) + len(rudders))


def _head(survey: LogSurvey) -> Iterator[str]:
    yield from config_lines("head", logs=log_count_text(survey))
    for kind in survey.unrecognised:
        option = f"--{'command' if kind == 'command' else 'heading'} NAME"
        yield f"# OPEN: no column was recognised as {kind}. Put it in below, or run `rovid init LOGS {option} --force`."
    if survey.unknown_directions:
        names = ", ".join(display_text(source, LINE_LENGTH) for source in survey.unknown_directions)
        verb = survey.axis.motion_verb.removesuffix("s")
        yield f"# OPEN: the logs do not show whether, and which way, these {verb} the vehicle: {names}."
    yield ""


def _vehicle(survey: LogSurvey) -> Iterator[str]:
    profile, overrides = survey.profile, survey.overrides
    yield "[vehicle]"
    yield f"name = {toml_text(overrides.name or (profile.name if profile else survey.folder.resolve().name))}"
    if profile is not None:
        if survey.profile_guessed:
            yield "# A guess: the same outputs turn this type. `rovid init LOGS --vehicle TYPE --force` sets the type."
        else:
            yield "# Published for this type of vehicle. If yours differs, correct it:"
        yield from (f"# {display_text(source, LINE_LENGTH)}" for source in profile.sources)
    elif not overrides.size:
        yield "# Mass and size are not in the logs. With both, rovid computes the added inertia."
    units = {"mass": "kg", "length": "m", "width": "m"}
    if survey.axis.self_righting:
        units["height"] = "m"
    for name, unit in units.items():
        published = getattr(profile, name, None)
        value = overrides.size.get(name, published)
        if value is None:
            yield f"# {name} =       # {unit}"
        elif value == published:
            yield f"{name} = {value:g}    # {unit}; published, not measured here"
        else:
            yield f"{name} = {value:g}    # {unit}"


def _thrusters(survey: LogSurvey) -> Iterator[str]:
    if survey.curve_guessed and survey.curve == GUESSED_CURVE:
        yield from config_lines("guessed_curve", curve=survey.curve, thrust=f"{FULL_THRUST:g}")
    elif survey.curve_guessed:
        yield ""
        yield f"# {survey.curve} is that of the type of vehicle, which is a guess."
    turning = {command.name for command in all_commands(survey.mappings) if command.direction}
    for name, commands in _commands(survey).items():
        # If some are known to turn the vehicle, the others are left to the user.
        mark = "# " if turning and name not in turning and not survey.with_planar else ""
        yield ""
        yield from _reasons(commands)
        yield f"{mark}[[thrusters]]"
        yield f"{mark}name = {toml_text(name)}"
        source_table = inline_table({kind: command.source for kind, command in commands.items()})
        if all(command.is_motor for command in commands.values()):
            sign = next((one.direction for one in commands.values() if one.direction), 1)
            largest = max(max(abs(one.lowest), abs(one.highest)) for one in commands.values())
            if 0.3 < largest <= 1.0:
                largest = 1.0
            yield from config_lines("motor", sign=f"{sign:.1f}", most=f"{largest:.10g}", command=source_table)
            continue
        if survey.with_planar:
            yield from _planar_shares(survey, next(iter(commands.values())).source)
        if survey.with_planar and all(one.turns_nothing for one in commands.values()):
            yield "yaw_arm = 0.0    # m: an assumption, for a thruster that does not turn the vehicle"
        else:
            yield from (f"{mark}{line}" for line in _arm(survey, commands))
        yield f"{mark}curve = {toml_text(survey.curve_of(name))}"
        if survey.curve_guessed:
            yield f"{mark}curve_guessed = {toml_text(survey.curve)}   # as above; put a bench curve into curve"
        yield f"{mark}command = {source_table}"
    if survey.with_planar and _rudders(survey):
        yield from propeller_lines(survey.planar, survey.curve)
    yield from _rudder_blocks(survey)
    if "command" in survey.unrecognised:
        unit = "m" if survey.axis.angular else "share of the thrust along the axis"
        yield from config_lines("open_thruster", key=survey.axis.arm_key, unit=unit)
    elif survey.axis.self_righting and not any(mapping.commands for mapping in survey.mappings.values()):
        yield ""
        yield f"# No command acts in {survey.axis.name}: each log is assumed to be a release of the tilted vehicle."


def propeller_lines(guesses: Mapping[str, PlanarGuess], curve: str = "") -> Iterator[str]:
    """A block of rovid.toml for a propeller: with a measured thrust ``curve``, or a thrust known up to a constant."""
    sources = {kind: guess.propeller for kind, guess in guesses.items() if guess.propeller[0]}
    if sources:
        most = f"{1.1 * max(most for _, most in sources.values()):.4g}"
        command = inline_table({kind: source for kind, (source, _) in sources.items()})
        text = "propeller_with_curve" if curve else "propeller"
        yield from config_lines(text, curve=toml_text(curve), most=most, command=command)


def _planar_shares(survey: LogSurvey, source: str) -> Iterator[str]:
    """Lines of the shares of a thruster's force along surge and sway."""
    direction = survey.overrides.directions.get(source)
    if direction is None:
        yield from share_lines(source, list(survey.planar.values()))
    else:
        ahead, starboard = f"{math.cos(direction):.4f}", f"{math.sin(direction):.4f}"
        yield from config_lines("share_given", ahead=ahead, starboard=starboard)


def _rudders(survey: LogSurvey) -> dict[str, dict[str, RudderGuess]]:
    """Name of a rudder -> format -> its guess."""
    return _by_name((kind, one.name, one) for kind, mapping in survey.mappings.items() for one in mapping.rudders)


def _rudder_blocks(survey: LogSurvey) -> Iterator[str]:
    for name, rudders in _rudders(survey).items():
        yield ""
        rudder = next(iter(rudders.values()))
        angles = {kind: one.angle for kind, one in rudders.items()}
        yield from _reasons(angles)
        behind = survey.with_planar and any(guess.propeller[0] for guess in survey.planar.values())
        yield from config_lines(
            "rudder",
            name=toml_text(name),
            angle=_source_table(angles),
            speed=toml_text(rudder.speed),
            mark="" if survey.with_planar else "# ",
            behind='behind = "propeller"' if behind else '# behind = "NAME"',
        )
        if rudder.given is not None and rudder.wheelbase is None:
            yield f"coefficient = {rudder.given:.10g}    # N m s^2/(m^2 rad)"
        elif rudder.given is not None:
            yield f"wheelbase = {rudder.given:.10g}    # m"
        elif rudder.wheelbase is None:
            yield "# coefficient =       # N m s^2/(m^2 rad): not in the logs; times and ratios hold without it"
        else:
            yield from config_lines("wheelbase", size=f"{rudder.wheelbase:g}")


def _commands(survey: LogSurvey) -> dict[str, dict[str, ThrusterCommand]]:
    """Name of a thruster -> format -> its command."""
    return _by_name((kind, one.name, one) for kind, mapping in survey.mappings.items() for one in mapping.commands)


def _by_name(guesses: Iterable[tuple[str, str, Guess]]) -> dict[str, dict[str, Guess]]:
    """Name -> format -> guess, of formats, names and guesses."""
    named: dict[str, dict[str, Guess]] = {}
    for kind, name, guess in guesses:
        named.setdefault(name, {})[kind] = guess
    return named


def _arm(survey: LogSurvey, commands: Mapping[str, ThrusterCommand]) -> Iterator[str]:
    """Lines of the arm of one thruster, given by format."""
    direction = next((command.direction for command in commands.values() if command.direction), 1)
    size = next((command.arm for command in commands.values() if command.arm), 0.0)
    if any(command.arm_measured for command in commands.values()):
        yield f"yaw_arm = {direction * size:.4g}    # m"
    elif _is_arm_guessed(survey, commands):
        key = survey.axis.arm_key
        arm = f"{direction * size:.4g}" if size else f"{direction:.1f}"
        origin = "m: the sign is that of the logs, the distance is not in them"
        if not survey.axis.angular:
            origin = "the sign is that of the logs; share of the thrust along the axis, 1 if straight along it"
        elif survey.profile_guessed and size:
            origin = "m: published for that type"
        yield from config_lines("guessed_arm", key=key, arm=arm, origin=origin)
    else:
        origin = "published for this type" if survey.profile else "by the autopilot's parameters"
        yield f"yaw_arm = {direction * size:.4g}    # m: {origin}"


def _is_arm_guessed(survey: LogSurvey, commands: Mapping[str, ThrusterCommand]) -> bool:
    if any(command.arm_measured for command in commands.values()):
        return False
    return survey.profile_guessed or not any(command.arm for command in commands.values())


def _signals(survey: LogSurvey) -> Iterator[str]:
    yield ""
    yield "[signals]"
    clocks = {kind: clock for kind, clock in survey.clock_sources.items() if clock and kind in survey.mappings}
    if clocks:
        if survey.unit_reason:
            yield f"# {survey.unit_reason}"
        if survey.time_unit != "auto":
            clocks["unit"] = survey.time_unit
        yield f"time = {inline_table(clocks)}"
    planar_mark = "# " * (not survey.with_planar)
    for mark, found in (("", survey.mappings), (planar_mark, survey.planar)):
        named = _by_name((kind, name, one) for kind, guess in found.items() for name, one in guess.signals.items())
        if named and mark:
            yield from config_lines("planar_signals")
        for name, guesses in named.items():
            yield from _reasons(guesses)
            yield f"{mark}{toml_key(name)} = {_source_table(guesses)}"
    if survey.axis.position_signal in survey.unrecognised:
        unit, _ = survey.axis.display_unit
        yield f'# {survey.axis.position_signal} = {{ {next(iter(survey.mappings))} = "COLUMN", unit = "{unit}" }}'
    for kind, mapping in survey.mappings.items():
        guess = survey.planar.get(kind, PlanarGuess())
        known = {one.source for one in guess.signals.values()} | {guess.propeller[0]}
        names = [display_text(source, LINE_LENGTH) for source in mapping.unused if source not in known]
        if len(names) > _MAX_UNUSED:
            names[_MAX_UNUSED:] = ["…"]
        if names:
            yield f"# {kind}: not used: {', '.join(names)}"


def _join(survey: LogSurvey) -> Iterator[str]:
    join = survey.join
    if join is None:
        return
    parts = ", ".join(map(toml_text, join.parts))
    yield from config_lines("join", position=survey.axis.position_words, parts=parts)
    if join.time:
        columns = [f"{toml_key(part)} = {toml_text(column)}" for part, (column, _) in join.time.items()]
        yield f"time = {{ {', '.join(columns)} }}"
    for group in survey.clock_offsets.groups:
        yield from (f"# {line}" for line in wrap(survey.clock_offsets.text(group), _WIDTH))
    certain = [clock for clock in survey.clock_offsets.offsets if clock.certain]
    if not certain:
        yield from config_lines("no_offset")
        return
    yield ""
    yield "[join.offset]    # s to be added to that clock, as estimated above"
    yield from (clock.join_settings["offset"] for clock in certain)
    drifting = [clock for clock in certain if clock.drift]
    if drifting:
        yield ""
        yield "[join.drift]    # ppm to be added to that clock"
    yield from (clock.join_settings["drift"] for clock in drifting)


def _exclusions(survey: LogSurvey) -> Iterator[str]:
    if survey.left_out.text:
        yield ""
        yield from (f"# {line}" for line in wrap(survey.left_out.text, _WIDTH))
    for exclusion in (*survey.left_out.exclusions, *survey.overrides.exclusions):
        yield from config_lines("exclusion", log=toml_text(exclusion.log), begin=f"{exclusion.begin:.10g}")
        if math.isfinite(exclusion.end):
            yield f"to = {exclusion.end:.10g}"
        yield f"reason = {toml_text(exclusion.reason)}"


def _source_table(guesses: Mapping[str, SignalGuess]) -> str:
    """Inline table of one signal, given by format."""
    first = next(iter(guesses.values()))
    entries: dict[str, str | int] = {kind: guess.source for kind, guess in guesses.items()}
    if first.unit:
        entries["unit"] = first.unit
    if first.sign < 0:
        entries["sign"] = -1
    return inline_table(entries)


def _reasons(guesses: Mapping[str, SignalGuess] | Mapping[str, ThrusterCommand]) -> Iterator[str]:
    for kind, guess in guesses.items():
        yield f"# {kind}: {display_text(guess.reason, LINE_LENGTH)}"


def inline_table(values: Mapping[str, str | int] | Mapping[str, str]) -> str:
    """An inline table of rovid.toml."""
    entries = [f"{key} = {toml_text(value) if isinstance(value, str) else value}" for key, value in values.items()]
    return "{ " + ", ".join(entries) + " }"


def config_lines(name: str, /, **values: str) -> list[str]:
    """Lines of a text in templates/config.toml with these ``values``."""
    return _TEXTS[name].removesuffix("\n").format(**values).split("\n")


def share_lines(source: str, guesses: Sequence[PlanarGuess]) -> Iterator[str]:
    """Lines of rovid.toml for the shares of a thruster along surge and sway, each marked as a guess.

    A thruster that the logs show along neither is taken to push ahead; by its name to starboard. One that they show
    along both is taken to stand at 45 deg. No share is excluded: an oblique thruster may show along one axis alone.
    """
    shown: dict[str, CommandEffect] = {}
    for axis in ("surge", "sway"):
        for guess in guesses:
            effect = guess.effects.get(axis, {}).get(source)
            if effect is not None and effect.direction:
                shown[axis] = effect
    likeliest = "sway" if name_words(source) & SIDEWAYS else "surge"
    for axis in ("surge", "sway"):
        if (effect := shown.get(axis)) is None:
            share = "1.0" if axis == likeliest and not shown else "0.0"
            yield from config_lines("share_assumed", axis=axis, share=share)
        else:
            share = f"{effect.direction / math.sqrt(len(shown)):.2g}"
            yield from config_lines("share_shown", axis=axis, share=share, evidence=effect.text)
