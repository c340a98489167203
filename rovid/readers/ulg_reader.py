"""PX4's ULog, read by pyulog: the wanted fields of the wanted topics; ``topic#1.field`` is of its second instance."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

from rovid.config import Config
from rovid.errors import LogError
from rovid.readers.columns import Columns, channels_of, missing_topic, numeric_sources, raw_log
from rovid.readers.raw import RawLog, foreign, library, mapped
from rovid.trial import Remark

KIND = "ulg"
# Topics that `rovid init` looks into.
_TELLING = ("vehicle_attitude", "vehicle_angular_velocity", "actuator_motors", "actuator_outputs", "battery_status")
_MARK = b"ULog\x01\x12\x35"


def read(path: Path, config: Config) -> RawLog:
    """Wanted fields of ``path``.

    Raises
    ------
    LogError
        It is no ULog, pyulog is not installed, or a topic or field is missing or no number.
    ConfigError
        rovid.toml does not map a command for it.
    """
    signals = mapped(config, KIND, path)
    names = {signal.sources[KIND].partition(".")[0].partition("#")[0] for signal in signals.values()}
    _check(path)
    log = _parsed(path, names)
    present = {_called(data.name, data.multi_id): data.data for data in log.data_list}

    def topic(name: str) -> Columns:
        base, _, instance = name.partition("#")
        columns: Columns | None = present.get(base if instance == "0" else name)
        if columns is None:
            raise missing_topic(path, KIND, name, {_called(d.name, d.multi_id): d for d in _parsed(path).data_list})
        return columns

    channels = channels_of(path, KIND, signals, topic, config.time.sources.get(KIND, "timestamp"))
    return raw_log(channels, _remarks(log))


def sources(path: Path) -> tuple[str, list[str]]:
    """Nothing, for every message has its time, and what tells of motion, thrusters and supply.

    Raises
    ------
    LogError
        It is no ULog, or pyulog is not installed.
    """
    _check(path)
    log = _parsed(path, set(_TELLING))
    return "", numeric_sources({_called(data.name, data.multi_id): data.data for data in log.data_list})


def _check(path: Path) -> None:
    with path.open("rb") as file:
        if file.read(len(_MARK)) != _MARK:
            raise foreign(path, "a ULog of PX4")


def _called(name: str, instance: int) -> str:
    return f"{name}#{instance}" if instance else name


def _parsed(path: Path, names: set[str] | None = None) -> Any:
    """The log, with all topics or those of ``names``."""
    core = library("pyulog.core", "px4", path)
    # What pyulog prints of damage would stand among our own output.
    with path.open("rb") as file, contextlib.redirect_stdout(io.StringIO()):
        try:
            return core.ULog(file, None if names is None else sorted(names))
        except Exception as error:  # damaged files make the library raise anything
            raise LogError(
                f"is a ULog that is damaged ({type(error).__name__}: {str(error)[:100]}).".replace("\n", " "),
                where=path,
                mend="Download the log again, or leave it out.",
            ) from error


def _remarks(log: Any) -> tuple[Remark, ...]:
    remarks = []
    if log.file_corruption:
        text = "The file is damaged; what could not be read of it was left out."
        remarks.append(Remark(kind="truncated", count=1, text=text))
    if log.dropouts:
        lost = sum(dropout.duration for dropout in log.dropouts)
        text = f"The logger fell behind {len(log.dropouts)} times and lost {lost / 1000.0:.1f} s in all."
        remarks.append(Remark(kind="gap", count=len(log.dropouts), text=text))
    return tuple(remarks)
