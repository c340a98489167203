"""Which reader reads which file."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import cast

from rovid.core.errors import LogError
from rovid.core.paths import require_regular
from rovid.readers.raw_log import LogContents, RawLog
from rovid.trial.config import Config
from rovid.trial.log_files import FORMATS
from rovid.trial.trial import Trial


@dataclass(frozen=True, kw_only=True)
class LogFormat:
    """A log format; whatever keeps one of its files from being read is that file's `RovidError`.

    Attributes
    ----------
    kind
        Its key in the sources of a signal in rovid.toml, and the name of its reader: a file that holds
        ``read(path, config) -> RawLog`` and ``sources(path)``.
    """

    kind: str

    @property
    def _reader(self) -> ModuleType:
        """Imported when the first such file is read, for start-up time."""
        return import_module(f"rovid.readers.{self.kind}_reader")

    def read(self, path: Path, config: Config) -> RawLog:
        """Raw channels of ``path``."""
        with _opened(path):
            return cast("Callable[[Path, Config], RawLog]", self._reader.read)(path, config)

    def sources(self, path: Path) -> LogContents:
        """What of ``path`` can be read."""
        with _opened(path):
            return cast("Callable[[Path], LogContents]", self._reader.sources)(path)


@contextmanager
def _opened(path: Path) -> Iterator[None]:
    """Say of ``path`` what the system has against reading it."""
    require_regular(path, LogError)
    try:
        yield
    except OSError as error:
        raise LogError(f"cannot be read ({error.strerror or error}).", where=path) from error
    except MemoryError as error:
        raise LogError("needs more memory than there is.", where=path, mend="Split the log.") from error


READERS: Mapping[str, LogFormat] = {suffix: LogFormat(kind=kind) for suffix, kind in FORMATS.items()}


def read_log(path: Path, config: Config, name: str | None = None) -> Trial:
    """One trial from one file.

    Parameters
    ----------
    path
        A file with one of the suffixes in `READERS`.
    name
        What to call the trial; the file's name by default.

    Raises
    ------
    LogError
        The file cannot be read as what it claims to be, or holds no usable heading.
    ConfigError
        rovid.toml does not map this format.
    """
    form = READERS.get(path.suffix.lower())
    if form is None:
        raise LogError(
            f"has the suffix {path.suffix!r}; {', '.join(READERS)} were expected.",
            where=path,
            mend="Convert the log or name it by its format.",
        )
    from rovid.readers.build_trial import build

    config = config.for_format(form.kind)
    if trial_files(path, config):
        from rovid.readers.join_files import read_joined

        return build(_whole(read_joined(path, config), config, path), config, path, name or path.name)
    return build(form.read(path, config), config, path, name or path.name)


def trial_files(path: Path, config: Config) -> list[Path]:
    """The files of the trial that ``path`` is one of, itself among them; none where it is a trial by itself."""
    if config.join is None:
        return []
    from rovid.readers.join_files import companions

    return companions(path, config)


def _whole(raw: RawLog, config: Config, path: Path) -> RawLog:
    """``raw``, which holds all that is needed."""
    for name in config.required_signals:
        if name not in raw.channels:
            raise LogError(
                f"neither this nor the files joined with it hold what {name} is mapped to.",
                where=path,
                mend="Correct [signals], or parts in [join], in rovid.toml.",
            )
    return raw
