"""What the page asks for: a look at the logs, a rovid.toml of what was chosen, what `rovid check` says of it."""

from __future__ import annotations

import shlex
import shutil
import tempfile
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rovid.app.decimation import columns_document
from rovid.app.form_state import FormState, matches_digest, parse_form, read_form_data, with_form_data
from rovid.app.sandbox import RootFolder
from rovid.core.atomic_write import OutputFile, OutputSet
from rovid.core.errors import ConfigError, DataError, OutputError, RovidError
from rovid.core.paths import require_exists
from rovid.core.toml import read_toml
from rovid.preflight.check import check_logs
from rovid.preflight.config_writer import config_files
from rovid.preflight.log_survey import (
    LogsRead,
    LogSurvey,
    SurveyOptions,
    is_thrust_curve,
    log_files,
    output_files,
    read_columns,
    read_logs,
    survey_read_logs,
)
from rovid.preflight.raw_columns import RawColumn
from rovid.present.documents.results import check_document, survey_document
from rovid.present.terminal.check_text import VERDICTS, check_notes, check_tasks
from rovid.readers.formats import READERS
from rovid.trial.config import FILE_NAME, load_config
from rovid.trial.signal_names import SIGNAL_UNITS
from rovid.trial.vehicle_presets import load_preset, preset_names

Document = dict[str, Any]
# Bytes of columns that are kept for the next look at them.
_ROOM = 400 << 20


@dataclass(kw_only=True)
class Api:
    """One user's work; what is read is kept until the files change."""

    top: RootFolder
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _reading: threading.Lock = field(default_factory=threading.Lock)
    _checking: threading.Lock = field(default_factory=threading.Lock)
    _checks: int = 0
    _looks: dict[tuple[Any, ...], LogsRead] = field(default_factory=dict)
    _surveys: dict[tuple[Any, ...], LogSurvey] = field(default_factory=dict)
    _columns: dict[tuple[Any, ...], Mapping[str, RawColumn]] = field(default_factory=dict)

    def look(self, names: Sequence[str]) -> Document:
        """What there is: logs, types of vehicles, a rovid.toml, and what was chosen for it."""
        paths = self.paths(names)
        folder = _folder(paths)
        files = [file for file in log_files(paths, []) if not is_thrust_curve(file)]
        if not files:
            raise DataError("holds no logs.", where=folder, mend=f"Choose a folder with {', '.join(READERS)}.")
        there, theirs = self._existing(folder), self.foreign_config(paths)
        known = None if there is None or theirs else read_form_data(_text_of(there))
        return {
            "folder": self.top.name(folder),
            "logs": [self._log(file, paths) for file in files],
            "vehicles": [_type_document(name) for name in preset_names()],
            "units": {name: list(units) for name, units in SIGNAL_UNITS.items()},
            "existing": None if there is None else {"file": self.top.name(there), "text": _text_of(there)},
            "chosen": None if known is None else known[0],
        }

    def columns(self, name: str, needed: Sequence[str], begin: float, end: float, bins: int) -> Document:
        """Every column of one log, as it is drawn."""
        path = self.top.path(name)
        require_exists(path)
        with self._reading:
            return columns_document(self._columns_of(path), needed, begin, end, min(max(bins, 10), 5000))

    def draft(self, document: object) -> Document:
        """rovid.toml of what was chosen, what is open, and the commands that do the same."""
        choice = parse_form(document)
        paths = self.paths(choice.logs)
        with self._lock:
            guessed, found = self._survey(paths, choice)
        files = config_files(found)
        config, *beside = files
        headings, commands = choice.differs(guessed)
        return {
            "text": files[config],
            "file": self.top.name(config.path),
            "beside": [self.top.name(output.path) for output in beside],
            "survey": survey_document(found, []),
            "commands": self._commands(choice, _folder(paths), headings, commands),
        }

    def check(self, document: object) -> Document:
        """What `rovid check` says of what was chosen; of a rovid.toml of the user's own where that is what counts."""
        choice = parse_form(document)
        paths = self.paths(choice.logs)
        self._checks += 1
        own = self._checks
        with self._checking:
            if own != self._checks:
                return {"stale": True}  # another change has come since, and a check may take long
            if (theirs := self.foreign_config(paths)) is not None:
                return self._checked(paths, theirs)
            with self._lock:
                _, found = self._survey(paths, choice)
            with tempfile.TemporaryDirectory(prefix="rovid-") as name:
                place = Path(name)
                for output, text in config_files(found).items():
                    (place / output.path.name).write_text(text, encoding="utf-8")
                if found.curve and not (place / found.curve).exists():
                    shutil.copyfile(found.folder / found.curve, place / found.curve)
                return self._checked(paths, place / FILE_NAME, found.folder / FILE_NAME)

    def save(self, document: object) -> Document:
        """Write rovid.toml, and the curve where there is none; over nothing but what the page wrote itself."""
        choice = parse_form(document)
        paths = self.paths(choice.logs)
        with self._lock:
            _, found = self._survey(paths, choice)
        files = config_files(found)
        config, *beside = files
        contents = {output: files[output].encode() for output in beside}
        text = with_form_data(files[config], choice, {output.path.name: data for output, data in contents.items()})
        OutputSet([*files], force=self._may_replace(files)).write({config: text, **contents})
        return {"written": [self.top.name(output.path) for output in files]}

    def foreign_config(self, paths: Sequence[Path]) -> Path | None:
        """A rovid.toml that counts for these logs and that the page did not write for them; None if none does."""
        folder = _folder(paths)
        there = self._existing(folder)
        own = there is not None and there.parent == folder and read_form_data(_text_of(there)) is not None
        return None if own else there

    def config_file(self, paths: Sequence[Path]) -> Path | None:
        """The rovid.toml that counts for these logs."""
        return self._existing(_folder(paths))

    def config_folder(self, paths: Sequence[Path]) -> Path:
        """Where their rovid.toml stands, or will."""
        return _folder(paths)

    def paths(self, names: Sequence[str]) -> list[Path]:
        """The logs that the page names.

        Raises
        ------
        RovidError
            One is not there, or not below the top.
        """
        if not names:
            raise ConfigError("no logs were chosen.")
        paths = [self.top.path(name) for name in names]
        for path in paths:
            require_exists(path)
        # Beside a log its curve is looked for, and what is joined with it.
        self.top.require([_folder(paths), *paths])
        return paths

    def _existing(self, folder: Path) -> Path | None:
        """The nearest rovid.toml, not above the top."""
        for here in (folder, *folder.parents):
            if not here.is_relative_to(self.top.folder):
                return None
            if (here / FILE_NAME).is_file():
                if not self.top.contains(here / FILE_NAME):
                    raise ConfigError("is a link that leads out of the folder.", where=here / FILE_NAME)
                self._require_inside(here / FILE_NAME)
                return here / FILE_NAME
        return None

    def _require_inside(self, config: Path) -> None:
        """Refuse thrust curves that lie elsewhere."""
        try:
            blocks = read_toml(config).get("thrusters", [])
        except RovidError:
            return  # to read it says what is wrong
        for block in blocks if isinstance(blocks, list) else []:
            curve = block.get("curve") if isinstance(block, dict) else None
            if isinstance(curve, str) and ("\0" in curve or not self.top.contains(config.parent / curve)):
                raise ConfigError(
                    f"curve is {curve!r}, outside of {self.top.folder}.",
                    where=config,
                    mend="Put the curve beside the logs, or use the command line.",
                )

    def _log(self, file: Path, paths: Sequence[Path]) -> Document:
        root = paths[0] if paths[0].is_dir() else file.parent
        name = file.relative_to(root).as_posix() if file.is_relative_to(root) else file.name
        kind = READERS[file.suffix.lower()].kind
        return {"path": self.top.name(file), "name": name, "kind": kind, "bytes": file.stat().st_size}

    def _looked(self, paths: Sequence[Path]) -> tuple[tuple[Any, ...], LogsRead]:
        key = tuple((file, *_stamp(file)) for file in log_files(paths, []))
        if key not in self._looks:
            # One folder at a time: its logs may be large.
            self._looks.clear()
            self._surveys.clear()
            self._looks[key] = read_logs(paths)
        return key, self._looks[key]

    def _survey(self, paths: Sequence[Path], choice: FormState) -> tuple[LogSurvey, LogSurvey]:
        """What rovid guesses by itself, and with what was chosen."""
        key, looked = self._looked(paths)
        guessed = self._asked(key, looked, SurveyOptions(vehicle=choice.vehicle, interactive=True))
        headings, commands = choice.differs(guessed)
        # What was chosen is looked at for its sense too, which takes its time.
        asked = SurveyOptions(vehicle=choice.vehicle, headings=headings, commands=commands, interactive=True)
        self._asked(key, looked, asked)
        return guessed, survey_read_logs(looked, asked, choice.hand)

    def _asked(self, key: tuple[Any, ...], looked: LogsRead, asked: SurveyOptions) -> LogSurvey:
        whole = (key, asked)
        if whole not in self._surveys:
            self._surveys[whole] = survey_read_logs(looked, asked)
        return self._surveys[whole]

    def _columns_of(self, path: Path) -> Mapping[str, RawColumn]:
        key = (path, *_stamp(path))
        if key not in self._columns:
            _, columns, _ = read_columns(path)
            self._columns[key] = columns
            while len(self._columns) > 1 and sum(map(_bytes, self._columns.values())) > _ROOM:
                self._columns.pop(next(iter(self._columns)))
        return self._columns[key]

    def _may_replace(self, files: Mapping[OutputFile, str]) -> bool:
        """Whether rovid.toml is what the page wrote, and nobody changed it since.

        Raises
        ------
        OutputError
            It is, and somebody changed a curve beside it.
        """
        config, *beside = files
        known = read_form_data(_text_of(config.path)) if config.path.is_file() else None
        if known is None:
            return False
        for output in beside:
            there = output.path.read_bytes() if output.path.is_file() else b""
            if there and there != files[output].encode() and not matches_digest(there, known[1].get(output.path.name)):
                raise OutputError(
                    "is there already, and not as rovid wrote it.",
                    where=output.path,
                    mend="If it is a bench curve by now, give it another name: then it is taken for one.",
                )
        return True

    def _checked(self, paths: Sequence[Path], config: Path, place: Path | None = None) -> Document:
        """What `rovid check` says of ``config``, which will be at ``place`` once it is saved."""
        try:
            loaded = load_config(config)
            loaded = replace(loaded, path=place or config)
            checked = check_logs(paths, loaded)
        except RovidError as error:
            text = str(error).replace(str(config.parent), str((place or config).parent))
            return {"verdict": "no_go", "words": "No go: rovid.toml is not whole yet.", "tasks": [text], "notes": []}
        document = check_document(checked, loaded.vehicle)
        lead, words, _ = VERDICTS[checked.verdict]
        return {
            "verdict": checked.verdict,
            "words": f"{lead} {words}",
            "tasks": list(check_tasks(checked)),
            "notes": check_notes(checked),
            "caution": loaded.vehicle.assumptions.caution,
            "document": document,
        }

    def _commands(
        self, choice: FormState, folder: Path, headings: Sequence[str], commands: Sequence[str]
    ) -> list[Document]:
        """The command lines that do the same from the folder in which `rovid open` was started."""
        logs = [shell_word(name) for name in choice.logs]
        init = ["rovid", "init", *logs]
        if choice.vehicle:
            init += ["--vehicle", choice.vehicle]
        if len(headings) == 1:
            init += ["--heading", headings[0]]
        if commands and not any("," in source for source in commands):
            init += ["--command", ",".join(commands)]
        kept, page = output_paths(self.top.name(folder))
        return [
            {"what": "A first rovid.toml, before what is put in by hand", "line": shlex.join(init)},
            {"what": "What is in the logs and wrong with them", "line": shlex.join(["rovid", "check", *logs])},
            {"what": "The diagnosis alone", "line": shlex.join(["rovid", "diagnose", *logs, "-p", kept])},
            {"what": "Everything on one page", "line": shlex.join(["rovid", "report", *logs, "-p", kept, "-o", page])},
        ]


def output_paths(folder: str) -> tuple[str, str]:
    """Where parameter file and page of the logs in ``folder`` go."""
    ahead = f"{shell_word(folder)}/" if folder else ""
    return f"{ahead}parameters.toml", f"{ahead}report"


def shell_word(name: str) -> str:
    """The name of a log or folder as a command line takes it for nothing else."""
    return f"./{name}" if name.startswith("-") else name or "."


def _folder(paths: Sequence[Path]) -> Path:
    config, _ = output_files(paths)
    return config.path.parent


def _stamp(file: Path) -> tuple[int, int]:
    there = file.stat()
    return there.st_mtime_ns, there.st_size


def _bytes(columns: Mapping[str, RawColumn]) -> int:
    return sum(one.values.nbytes + one.time.nbytes for one in columns.values())


def _text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")


def _type_document(name: str) -> Document:
    known = load_preset(name)
    size = {key: getattr(known, key) for key in ("mass", "length", "width")}
    return {"id": name, "name": known.name, "arms": dict(known.arms), **size}
