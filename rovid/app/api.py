"""The requests of the page: list the logs, draft and save rovid.toml, and run `rovid check`."""

import math
import shlex
import shutil
import tempfile
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rovid.app import form_state
from rovid.app.access import RootFolder
from rovid.core.errors import ConfigError, OutputError, RovidError
from rovid.core.input_files import read_toml, require_exists
from rovid.core.output_files import OutputFile, OutputSet
from rovid.preflight.check import check_logs
from rovid.preflight.config_writer import config_files
from rovid.preflight.log_reading import LogsRead, is_thrust_curve, log_files, read_columns, read_logs, resolve_source
from rovid.preflight.log_survey import LogSurvey, SurveyOptions, config_output, survey_read_logs
from rovid.preflight.planar_check import PlanarCheck, check_planar
from rovid.preflight.raw_columns import RawColumn
from rovid.present.documents.results import check_document, survey_document
from rovid.present.terminal.check import VERDICTS, check_notes, check_tasks
from rovid.readers.formats import READERS
from rovid.trial.axis import PLANAR, SIGNAL_UNITS, YAW, parameter_file_name
from rovid.trial.config import FILE_NAME, load_config
from rovid.trial.log_files import nothing_to_read
from rovid.trial.vehicle_presets import load_preset, preset_names

Document = dict[str, Any]
_FileKey = tuple[Any, ...]
# Bytes of columns that stay in memory.
_CACHE_SIZE = 400 << 20
# Most plots of faults.
_SPOTS = 8


@dataclass(kw_only=True)
class Api:
    """The requests of one user. Logs that were read are cached until the files change."""

    root: RootFolder
    scratch: Path | None = None  # Folder of temporary files; None: that of the system
    _survey_lock: threading.Lock = field(default_factory=threading.Lock)
    _columns_lock: threading.Lock = field(default_factory=threading.Lock)
    _check_lock: threading.Lock = field(default_factory=threading.Lock)
    _checks: int = 0
    _logs_read: dict[_FileKey, LogsRead] = field(default_factory=dict)
    _surveys: dict[tuple[_FileKey, SurveyOptions], LogSurvey] = field(default_factory=dict)
    _columns: dict[_FileKey, Mapping[str, RawColumn]] = field(default_factory=dict)

    def look(self, names: Sequence[str]) -> Document:
        """The logs, the vehicle types, and the rovid.toml with its choices if there is one."""
        paths = self.paths(names)
        folder = config_folder(paths)
        files = [file for file in log_files(paths, []) if not is_thrust_curve(file)]
        if not files:
            raise nothing_to_read([folder])
        config = self.config_file(paths)
        text = None if config is None else _read_text(config)
        own = text is not None and self.foreign_config(paths) is None
        data = form_state.read_form_data(text) if own and text is not None else None
        existing: Document | None = None
        if config is not None and text is not None:
            kinds = sorted({READERS[file.suffix.lower()].kind for file in files})
            choice = None if own else form_state.choices_of(text, kinds)
            existing = {"file": self.root.name(config), "text": text, "choice": choice}
        vehicles = []
        for name in preset_names():
            preset = load_preset(name)
            sizes = {key: getattr(preset, key) for key in ("mass", "length", "width")}
            vehicles.append({"id": name, "name": preset.name, "arms": dict(preset.arms), **sizes})
        return {
            "folder": self.root.name(folder),
            "logs": [self._log_document(file, paths) for file in files],
            "vehicles": vehicles,
            "units": {name: list(units) for name, units in SIGNAL_UNITS.items()},
            "existing": existing,
            "chosen": None if data is None else data[0],
        }

    def columns(
        self,
        name: str,
        needed: Sequence[str],
        begin: float,
        end: float,
        bins: int,
        turns: Mapping[str, float] | None = None,
        time_unit: str = "auto",
    ) -> Document:
        """The columns of one log for plots, with the time in ``time_unit``; see `columns_document`."""
        path = self.root.path(name)
        require_exists(path)
        with self._columns_lock:
            key = (time_unit, *_file_key(path))
            if key not in self._columns:
                self._columns[key] = read_columns(path, time_unit)[1]
                while len(self._columns) > 1 and sum(map(_size_in_memory, self._columns.values())) > _CACHE_SIZE:
                    self._columns.pop(next(iter(self._columns)))
            return form_state.columns_document(self._columns[key], needed, begin, end, min(max(bins, 10), 5000), turns)

    def draft(self, document: object) -> Document:
        """The rovid.toml for the choices, the open questions, and equivalent commands."""
        form = form_state.parse_form(document)
        paths = self.paths(form.logs)
        guessed, survey = self._survey(paths, form)
        files = config_files(survey)
        config, *curves = files
        return {
            "text": files[config],
            "file": self.root.name(config.path),
            "beside": [self.root.name(output.path) for output in curves],
            "survey": survey_document(survey, []),
            "commands": self._commands(form, config_folder(paths), guessed, survey),
            # Speeds and positions, with which surge, sway and yaw can be taken together.
            "planar": sorted({name for guess in guessed.planar.values() for name in guess.signals}),
        }

    def check(self, document: object) -> Document:
        """The result of `rovid check` for the choices, or for the user's own rovid.toml if there is one."""
        form = form_state.parse_form(document)
        paths = self.paths(form.logs)
        self._checks += 1
        number = self._checks
        with self._check_lock:
            if number != self._checks:
                return {"stale": True}  # A newer request is waiting, and a check may take long.
            if (config := self.foreign_config(paths)) is not None:
                return _check(paths, config, config, planar=form.planar)
            _, survey = self._survey(paths, form)
            with tempfile.TemporaryDirectory(dir=self.scratch) as name:
                folder = Path(name)
                for output, text in config_files(survey).items():
                    (folder / output.path.name).write_text(text, encoding="utf-8")
                for curve in survey.curves:
                    if not (folder / curve).exists():
                        shutil.copyfile(survey.folder / curve, folder / curve)
                return _check(paths, folder / FILE_NAME, survey.folder / FILE_NAME, planar=form.planar)

    def save(self, document: object) -> Document:
        """Write rovid.toml and the guessed thrust curve; only files that the page wrote are replaced."""
        form = form_state.parse_form(document)
        _, survey = self._survey(self.paths(form.logs), form)
        files = config_files(survey)
        config, *curves = files
        contents = {output: files[output].encode() for output in curves}
        beside = {output.path.name: data for output, data in contents.items()}
        text = form_state.with_form_data(files[config], form, beside)
        OutputSet([*files], force=_may_replace(files)).write({config: text, **contents})
        return {"written": [self.root.name(output.path) for output in files]}

    def foreign_config(self, paths: Sequence[Path]) -> Path | None:
        """The rovid.toml of these logs if the page did not write it for them; else None."""
        config = self.config_file(paths)
        if config is None:
            return None
        own = config.parent == config_folder(paths) and form_state.read_form_data(_read_text(config)) is not None
        return None if own else config

    def config_file(self, paths: Sequence[Path]) -> Path | None:
        """The rovid.toml of these logs: the nearest one, not above the root folder."""
        folder = config_folder(paths)
        for here in (folder, *folder.parents):
            config = here / FILE_NAME
            if not here.is_relative_to(self.root.folder):
                return None
            if config.is_file():
                if not self.root.contains(config):
                    raise ConfigError("is a link that leads out of the folder.", where=config)
                self._require_curves_inside(config)
                return config
        return None

    def paths(self, names: Sequence[str]) -> list[Path]:
        """Paths of the logs that the page names. Raises RovidError if one is missing or outside of the root folder."""
        if not names:
            raise ConfigError("no logs were chosen.")
        paths = list(map(self.root.path, names))
        for path in paths:
            require_exists(path)
        # The folder is included because rovid also reads thrust curves and joined logs next to a log.
        self.root.require([config_folder(paths), *paths])
        return paths

    def _require_curves_inside(self, config: Path) -> None:
        """Refuse thrust curves outside of the root folder."""
        try:
            blocks = read_toml(config).get("thrusters", [])
        except RovidError:
            return  # The error is reported when the file is loaded.
        for block in blocks if isinstance(blocks, list) else []:
            curve = block.get("curve") if isinstance(block, dict) else None
            if isinstance(curve, str) and ("\0" in curve or not self.root.contains(config.parent / curve)):
                mend = "Put the curve next to the logs, or use the command line."
                raise ConfigError(f"curve is {curve!r}, outside of {self.root.folder}.", where=config, mend=mend)

    def _log_document(self, file: Path, paths: Sequence[Path]) -> Document:
        folder = paths[0] if paths[0].is_dir() else file.parent
        name = file.relative_to(folder).as_posix() if file.is_relative_to(folder) else file.name
        kind = READERS[file.suffix.lower()].kind
        return {"path": self.root.name(file), "name": name, "kind": kind, "bytes": file.stat().st_size}

    def _survey(self, paths: Sequence[Path], form: form_state.FormState) -> tuple[LogSurvey, LogSurvey]:
        """The survey by rovid's guesses alone, and the survey with the user's choices."""
        with self._survey_lock:
            key = (form.time_unit, *map(_file_key, log_files(paths, [])))
            if key not in self._logs_read:
                # Only one folder is kept, because its logs may be large.
                self._logs_read.clear()
                self._surveys.clear()
                self._logs_read[key] = read_logs(paths, time_unit=form.time_unit)
            own = SurveyOptions(vehicle=form.vehicle, interactive=True, planar=form.planar)
            guessed = self._cached_survey(key, own)
            # The check names the columns of a rovid.toml that no log has.
            logs = self._logs_read[key].logs.values()
            present = sorted(set().union(*(log for group in logs for log in group)))
            known = (
                [one for one in group if resolve_source(one, present) in present] for group in form.changes(guessed)
            )
            headings, commands = map(tuple, known)
            options = replace(own, headings=headings, commands=commands)
            # This survey also determines the sign of the chosen columns, which takes time.
            self._cached_survey(key, options)
            return guessed, survey_read_logs(self._logs_read[key], options, form.overrides)

    def _cached_survey(self, key: _FileKey, options: SurveyOptions) -> LogSurvey:
        if (key, options) not in self._surveys:
            self._surveys[key, options] = survey_read_logs(self._logs_read[key], options)
        return self._surveys[key, options]

    def _commands(
        self, form: form_state.FormState, folder: Path, guessed: LogSurvey, survey: LogSurvey
    ) -> list[Document]:
        """Command lines that do the same, for the folder in which `rovid open` was started."""
        logs = list(map(shell_word, form.logs))
        headings, commands = form.changes(guessed)
        init = ["rovid", "init", *logs]
        if form.vehicle:
            init += ["--vehicle", form.vehicle]
        if len(headings) == 1:
            init += ["--heading", headings[0]]
        if commands and not any("," in source for source in commands):
            init += ["--command", ",".join(commands)]
        parameters, page = output_paths(self.root.name(folder), planar=form.planar)
        axes = axes_options(planar=form.planar)
        lines = {
            "A first rovid.toml, without the values entered by hand": [*init, *axes],
            "Content and problems of the logs": ["rovid", "check", *axes, *logs],
            "Diagnosis only": ["rovid", "diagnose", *axes, *logs, "-p", parameters],
            "Report with all results": ["rovid", "report", *axes, *logs, "-p", parameters, "-o", page],
        }
        if form.planar or not any(mapping.rudders for mapping in survey.mappings.values()):
            lines["The next run, after the report"] = ["rovid", "plan", *axes, "-p", parameters]
            to_simulator = ["rovid", "export", "gz-sim", *axes, "-p", parameters]
            lines["Parameters for a simulator, after the report"] = to_simulator
        return [{"what": purpose, "line": shlex.join(words)} for purpose, words in lines.items()]


def _check(paths: Sequence[Path], config: Path, place: Path, *, planar: bool) -> Document:
    """Result of `rovid check` with the file ``config``, which will be saved as ``place``."""
    try:
        loaded = replace(load_config(config, PLANAR if planar else YAW), path=place)
        checked = (check_planar if planar else check_logs)(paths, loaded)
    except RovidError as error:
        text = str(error).replace(str(config.parent), str(place.parent))
        return {"verdict": "no_go", "words": "No go: rovid.toml is not complete yet.", "tasks": [text], "notes": []}
    spots = []
    for fault in checked.faults:
        if spot := fault.excerpt:
            values = [value if math.isfinite(value) else None for value in spot.displayed.tolist()]
            document = {"title": fault.title, "label": spot.label, "time": spot.time.tolist()}
            spots.append(document | {"values": values, "at": fault.at})
    lead, words, _ = VERDICTS[checked.verdict]
    answer: Document = {
        "verdict": checked.verdict,
        "words": f"{lead} {words}",
        "caution": loaded.vehicle.assumptions.caution,
        "spots": spots[:_SPOTS],
    }
    answer |= {"tasks": list(check_tasks(checked)), "notes": check_notes(checked)}
    if isinstance(checked, PlanarCheck):
        return answer
    return answer | {"document": check_document(checked, loaded.vehicle)}


def _may_replace(files: Mapping[OutputFile, str]) -> bool:
    """Whether the page wrote this rovid.toml unchanged since. Raises OutputError if a thrust curve was changed."""
    config, *curves = files
    data = form_state.read_form_data(_read_text(config.path)) if config.path.is_file() else None
    if data is None:
        return False
    for output in filter(lambda output: output.path.is_file(), curves):
        content, digest = output.path.read_bytes(), data[1].get(output.path.name)
        if content not in (b"", files[output].encode()) and form_state.sha256_digest(content) != digest:
            mend = "If it is a measured curve now, rename it: rovid then uses it as one."
            raise OutputError("exists already and was changed since rovid wrote it.", where=output.path, mend=mend)
    return True


def config_folder(paths: Sequence[Path]) -> Path:
    """Folder of the rovid.toml for these logs."""
    config = config_output(paths)
    return config.path.parent


def output_paths(folder: str, *, planar: bool = False) -> tuple[str, str]:
    """Names of the parameter file and of the report for the logs in ``folder``."""
    prefix = f"{shell_word(folder)}/" if folder else ""
    file = parameter_file_name(PLANAR.name if planar else YAW.name)
    return f"{prefix}{file}", f"{prefix}{'report_planar' if planar else 'report'}"


def axes_options(*, planar: bool) -> list[str]:
    """Options of a command for yaw alone, or for surge, sway and yaw together."""
    return ["--axes", "planar"] if planar else []


def shell_word(name: str) -> str:
    """A path that a command line does not read as an option."""
    return f"./{name}" if name.startswith("-") else name or "."


def _file_key(file: Path) -> _FileKey:
    status = file.stat()
    return file, status.st_mtime_ns, status.st_size


def _size_in_memory(columns: Mapping[str, RawColumn]) -> int:
    return sum(column.values.nbytes + column.time.nbytes for column in columns.values())


def _read_text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")
