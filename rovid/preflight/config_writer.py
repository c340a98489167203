"""A first rovid.toml as text: each guess with its reason, what no log tells marked, what is open said."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from textwrap import wrap

from rovid.core.atomic_write import OutputFile, OutputSet
from rovid.core.errors import LINE_LENGTH, RovidError, display_text
from rovid.core.escaping import toml_key, toml_text
from rovid.core.signatures import GUESSED_CURVE as GUESSED
from rovid.preflight.clock_report import ClockOffsets
from rovid.preflight.log_survey import FULL_THRUST, GUESSED_CURVE, LogSurvey, all_commands, output_files
from rovid.preflight.raw_columns import SignalGuess
from rovid.preflight.thruster_guess import ThrusterCommand
from rovid.readers import read_campaign
from rovid.trial.assumptions import Assumptions
from rovid.trial.axis import Axis
from rovid.trial.config import load_config
from rovid.trial.tables import curve_csv

# Columns of a comment.
_WIDE = 110
# So many columns are listed that are not used.
_LISTED = 40
_OPEN_THRUSTER = (
    "# [[thrusters]]",
    '# name = "NAME"',
    "# yaw_arm = 1.0    # m",
    '# curve = "CURVE.csv"',
    '# command = { csv = "COLUMN" }',
)


def config_files(survey: LogSurvey) -> dict[OutputFile, str]:
    """What to write where: rovid.toml, and the curve where there is none yet."""
    config, _ = output_files([survey.folder])
    files = {config: config_text(survey)}
    if survey.new_curve is not None:
        curve = OutputFile(survey.folder / survey.curve, GUESSED)
        files[curve] = curve_csv(survey.new_curve.command, survey.new_curve.thrust)
    return files


def write_config(survey: LogSurvey, paths: Sequence[Path], *, force: bool) -> tuple[LogSurvey, list[Path]]:
    """Write it; where trials are joined of several files, once more with what their clocks are off. What was written.

    Raises
    ------
    RovidError
        A file of that name may not be replaced.
    """
    # A guessed curve that is there may be a bench curve by now, but it may not be needed either.
    config, _ = output_files([survey.folder])
    claim = OutputSet([config], force=force)
    files = config_files(survey)
    claim.write(files)
    if survey.join is not None and not survey.unrecognised:
        # A fit stands behind it, which other logs need not wait for.
        from rovid.preflight.clock_offsets import estimate_clock_offsets

        with suppress(RovidError):  # `rovid check` says what is wrong with the logs
            read = load_config(config.path, survey.axis)
            survey = replace(survey, clock_offsets=estimate_clock_offsets(read_campaign(paths, read).trials, read))
            files = config_files(survey)
            OutputSet([config], force=True).write({config: files[config]})
    return survey, [output.path for output in files]


def config_text(survey: LogSurvey) -> str:
    """The text of rovid.toml; each guess with its reason."""
    parts = (_head, _thrusters, _signals, _joined, _left_out)
    return "\n".join(line for part in parts for line in part(survey)) + "\n"


def log_count_text(survey: LogSurvey) -> str:
    """How many logs were looked at."""
    if survey.logs == 1:
        return "one log"
    return f"{survey.logs} logs"


def _head(survey: LogSurvey) -> Iterator[str]:
    yield f"# Written by `rovid init` from {log_count_text(survey)}. Each guess says why: correct what is wrong. A line"
    yield "# *_guessed marks what no log can tell, and every number that hangs on it."
    for what in survey.unrecognised:
        option = f"--{'command' if what == 'command' else 'heading'} NAME"
        yield f"# OPEN: no column was recognised as {what}. Put it in below, or run `rovid init LOGS {option} --force`."
    if survey.unknown_directions:
        names = ", ".join(display_text(source, LINE_LENGTH) for source in survey.unknown_directions)
        yield f"# OPEN: which way these {_move(survey.axis)} the vehicle, if at all, no log tells: {names}."
    yield ""
    yield "[vehicle]"
    known = survey.profile
    hand = survey.overrides
    yield f"name = {toml_text(hand.name or (known.name if known else survey.folder.resolve().name))}"
    if known is None and not hand.size:
        yield "# Mass and size are not in the logs; with them rovid tells the added inertia."
    elif known is not None:
        yield f"# {_how_known(survey)}"
        yield from (f"# {display_text(source, LINE_LENGTH)}" for source in known.sources)
    sizes = [(name, "m") for name in ("length", "width", *["height"] * survey.axis.self_righting)]
    for name, unit in (("mass", "kg"), *sizes):
        published = getattr(known, name, None)
        value = hand.size.get(name, published)
        if value is None:
            yield f"# {name} =       # {unit}"
        else:
            yield f"{name} = {value:g}    # {unit}{'; published, not measured here' if value == published else ''}"


def _move(axis: Axis) -> str:
    """What thrusters do along it."""
    return axis.motion_verb.removesuffix("s")


def _example(axis: Axis) -> str:
    """A line with a thruster's arm."""
    return f"{axis.arm_key} = 1.0    # {'m' if axis.angular else 'share of the thrust along the axis'}"


def _how_known(survey: LogSurvey) -> str:
    """Why it is taken for a vehicle of this type."""
    if survey.profile_guessed:
        return "A guess: of this type the same outputs turn it. `rovid init LOGS --vehicle TYPE --force` makes it sure."
    return "Published of this type of vehicle; where yours differs, correct it:"


def _thrusters(survey: LogSurvey) -> Iterator[str]:
    if survey.curve_guessed:
        yield from _guessed_curve(survey)
    turning = {command.name for command in all_commands(survey.mappings) if command.direction}
    for name, ones in _by_name(survey).items():
        # Where some are known to turn the vehicle, the others wait for the user to say so.
        mark = "# " if turning and name not in turning else ""
        yield ""
        yield from _why(ones)
        yield f"{mark}[[thrusters]]"
        yield f"{mark}name = {toml_text(name)}"
        for line in _arm(survey, ones):
            yield f"{mark}{line}"
        yield f"{mark}curve = {toml_text(survey.curve)}"
        if survey.curve_guessed:
            yield f"{mark}curve_guessed = {toml_text(survey.curve)}   # as above; put a bench curve into curve"
        sources = {kind: one.source for kind, one in ones.items()}
        yield f"{mark}command = {_sources(sources)}"
    if "command" in survey.unrecognised:
        yield ""
        yield from (line.replace("yaw_arm = 1.0    # m", _example(survey.axis)) for line in _OPEN_THRUSTER)
    elif not any(one.commands for one in survey.mappings.values()) and survey.axis.self_righting:
        yield ""
        yield f"# Nothing was seen to drive it in {survey.axis.name}: each log is taken for one of a vehicle let go of."


def _arm(survey: LogSurvey, ones: Mapping[str, ThrusterCommand]) -> Iterator[str]:
    """The lines of a thruster's arm."""
    way = next((one.direction for one in ones.values() if one.direction), 1)
    size = next((one.arm for one in ones.values() if one.arm), 0.0)
    if _given(ones):
        yield f"yaw_arm = {way * size:.4g}    # m"
    elif _arm_guessed(survey, ones):
        told = (
            "published for that type"
            if survey.profile_guessed and size
            else "the sense is that of the logs, the distance is not in them"
        )
        arm = f"{way * size:.4g}" if size else f"{way:.1f}"
        key = survey.axis.arm_key
        if not survey.axis.angular:
            told = "the sense is that of the logs; share of the thrust along the axis, 1 if straight along it"
        yield f"{key} = {arm}            # {'m: ' * survey.axis.angular}{told}"
        yield f"{key}_guessed = {arm}    # as long as both are the same; put what was measured into {key}"
    else:
        told = "published for this type" if survey.profile else "by the autopilot's parameters"
        yield f"yaw_arm = {way * size:.4g}    # m: {told}"


def _arm_guessed(survey: LogSurvey, ones: Mapping[str, ThrusterCommand]) -> bool:
    """Whether nobody said how long the arm of a thruster is."""
    size = next((one.arm for one in ones.values() if one.arm), 0.0)
    return not _given(ones) and (survey.profile_guessed or not size)


def _given(ones: Mapping[str, ThrusterCommand]) -> bool:
    return any(one.arm_measured for one in ones.values())


def assumptions_in(survey: LogSurvey) -> Assumptions:
    """What of the file that is written is no measurement: arms, and a curve that was not there."""
    turning = {command.name for command in all_commands(survey.mappings) if command.direction}
    thrusters = {name: ones for name, ones in _by_name(survey).items() if not turning or name in turning}
    items: list[str] = []
    for name, ones in thrusters.items():
        items += [f"{survey.axis.arm_key} of {name}"] * _arm_guessed(survey, ones) + [
            f"curve of {name}"
        ] * survey.curve_guessed
    return Assumptions(items=tuple(items), thrusters=len(thrusters))


def _guessed_curve(survey: LogSurvey) -> Iterator[str]:
    yield ""
    if survey.curve != GUESSED_CURVE:
        yield f"# {survey.curve} is that of the type of vehicle, which is a guess."
        return
    proportion = f"thrust in proportion to the command, {FULL_THRUST:g} N at its end"
    yield f"# {survey.curve} is a guess: {proportion}. Until a"
    yield "# bench curve takes its place no number holds that was fitted through it, and the diagnosis finds what"
    yield "# the guess lacks, as the drive's own dead band."


def _by_name(survey: LogSurvey) -> dict[str, dict[str, ThrusterCommand]]:
    """Each thruster by the formats in which its command was found."""
    named: dict[str, dict[str, ThrusterCommand]] = {}
    for kind, guesses in survey.mappings.items():
        for command in guesses.commands:
            named.setdefault(command.name, {})[kind] = command
    return named


def _signals(survey: LogSurvey) -> Iterator[str]:
    yield ""
    yield "[signals]"
    clocks = {kind: clock for kind, clock in survey.clock_sources.items() if clock and kind in survey.mappings}
    if clocks:
        yield f"time = {_sources(clocks)}"
    named: dict[str, dict[str, SignalGuess]] = {}
    for kind, guesses in survey.mappings.items():
        for name, signal in guesses.signals.items():
            named.setdefault(name, {})[kind] = signal
    for name, ones in named.items():
        yield from _why(ones)
        yield f"{toml_key(name)} = {_signal(ones)}"
    if survey.axis.position_signal in survey.unrecognised:
        unit = "deg" if survey.axis.angular else "m"
        yield f'# {survey.axis.position_signal} = {{ {next(iter(survey.mappings))} = "COLUMN", unit = "{unit}" }}'
    for kind, guesses in survey.mappings.items():
        if guesses.unused:
            names = [display_text(source, LINE_LENGTH) for source in guesses.unused]
            yield f"# {kind}: not used: {', '.join(names[:_LISTED])}{', …' if len(names) > _LISTED else ''}"


def _joined(survey: LogSurvey) -> Iterator[str]:
    join = survey.join
    if join is None:
        return
    yield ""
    yield "[join]"
    yield f"# No file holds both {survey.axis.position_words} and commands: files whose names differ in one of these"
    yield "# words are one trial."
    yield f"parts = [{', '.join(map(toml_text, join.parts))}]"
    if join.time:
        columns = [f"{toml_key(part)} = {toml_text(column)}" for part, (column, _) in join.time.items()]
        yield f"time = {{ {', '.join(columns)} }}"
    yield from _clocks(survey.clock_offsets)


def _clocks(clocks: ClockOffsets) -> Iterator[str]:
    """What is to be added to each clock, where that is sure."""
    for alike in clocks.groups:
        yield from (f"# {line}" for line in wrap(clocks.text(alike), _WIDE))
    sure = [clock for clock in clocks.offsets if clock.certain]
    if not sure:
        yield "# The clocks are taken for one. What is known of them goes here, for a part or for a file:"
        yield "# [join.offset]    # s to be added to that clock"
        return
    yield ""
    yield "[join.offset]    # s to be added to that clock, as estimated above"
    yield from (clock.join_settings["offset"] for clock in sure)
    drifting = [clock for clock in sure if clock.drift]
    if drifting:
        yield ""
        yield "[join.drift]    # ppm: what comes to it as the log goes on"
    yield from (clock.join_settings["drift"] for clock in drifting)


def _left_out(survey: LogSurvey) -> Iterator[str]:
    for stretch in survey.overrides.exclusions:
        yield ""
        yield "[[leave_out]]"
        yield f"log = {toml_text(stretch.log)}"
        yield f"from = {stretch.begin:.10g}    # s from the beginning of the log"
        if math.isfinite(stretch.end):
            yield f"to = {stretch.end:.10g}"
        yield f"reason = {toml_text(stretch.reason)}"


def _signal(ones: Mapping[str, SignalGuess]) -> str:
    first = next(iter(ones.values()))
    parts = [f"{kind} = {toml_text(one.source)}" for kind, one in ones.items()]
    if first.unit:
        parts.append(f"unit = {toml_text(first.unit)}")
    if first.sign < 0:
        parts.append("sign = -1")
    return "{ " + ", ".join(parts) + " }"


def _sources(sources: Mapping[str, str]) -> str:
    parts = [f"{kind} = {toml_text(source)}" for kind, source in sources.items()]
    return "{ " + ", ".join(parts) + " }"


def _why(ones: Mapping[str, SignalGuess] | Mapping[str, ThrusterCommand]) -> Iterator[str]:
    for kind, one in ones.items():
        yield f"# {kind}: {display_text(one.reason, LINE_LENGTH)}"
