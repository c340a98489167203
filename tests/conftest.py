"""What the tests share: the command line run in process, and a trial day written once."""

from __future__ import annotations

import contextlib
import functools
import gc
import io
import itertools
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import pytest
from jsonschema import Draft202012Validator
from jsonschema.exceptions import best_match

from rovid.cli import cli
from rovid.core.errors import RovidError
from rovid.diagnose.result import Diagnosis
from rovid.effects import plugins
from rovid.store import study as study_room
from rovid.store.study import Study, input_files
from rovid.trial.assumptions import Assumptions
from tools.programme import CAMPAIGN
from tools.trial_day import write_trial_day

# As the command line does; the workers that share the tests begin with it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Workers that share the tests have shared the cores.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("ROVID_CORES", "1")

# No result depends on how busy the machine is.
os.environ.setdefault("ROVID_BUDGET", "3600")

# How long a command takes here is up to the machine.
os.environ.setdefault("ROVID_PROGRESS", "none")

# As wide as a pipe is taken to be; the workers that share the tests are told that of a terminal.
os.environ["COLUMNS"] = "160"

# The thousands of collected tests stay until the end: a garbage collection need not look through them again.
gc.set_threshold(100_000)


# Rooms whose fixtures take seconds: with two workers, each begins with every second one.
COSTLY = ("whole", "present", "app", "docs", "fleet", "faults", "compare", "preflight")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the tests so that no worker takes tests of a costly room from another one, whose fixtures it would repeat.

    Each worker gets an equal number of tests in a row, and one that has done its own takes the last ones of another.
    """
    shares: list[list[pytest.Item]] = [[] for _ in range(int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))]
    rooms: dict[str, list[pytest.Item]] = {}
    for item in items:
        rooms.setdefault(item.path.relative_to(ROOT / "tests").parts[0], []).append(item)
    for place, room in enumerate(COSTLY):
        shares[place % len(shares)] += rooms.pop(room, [])
    cheap = itertools.chain.from_iterable(rooms.values())
    for share in shares:
        share.extend(itertools.islice(cheap, max(len(items) // len(shares) - len(share), 0)))
    items[:] = itertools.chain(*shares, cheap)


def pytest_collection_finish() -> None:
    gc.collect()
    gc.freeze()


ROOT = Path(__file__).parent.parent
SAMPLES = ROOT / "sample_logs"


@dataclass(frozen=True)
class Done:
    """What a command printed and how it ended."""

    code: int
    out: str
    err: str

    @property
    def document(self) -> dict[str, Any]:
        assert self.code == 0, self.err
        parsed = json.loads(self.out)
        assert isinstance(parsed, dict)
        require_schema(parsed)
        return parsed


def require_schema(document: dict[str, Any]) -> None:
    """Assert that a document has the schema that it names, as published in the package."""
    problem = best_match(schema_of(document["schema"]).iter_errors(document))
    assert problem is None, f"{document['schema']}{problem.json_path[1:]}: {problem.message[:300]}"


@functools.cache
def schema_of(name: str) -> Draft202012Validator:
    text = (ROOT / "rovid" / "schemas" / f"{name.replace('/', '-')}.json").read_text(encoding="utf-8")
    return Draft202012Validator(json.loads(text))


Rovid = Callable[..., Done]


def slow(*values: Any) -> Any:
    """A case of a test for `make test-slow` alone."""
    return pytest.param(*values, marks=pytest.mark.slow)


@pytest.fixture
def rovid(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Rovid:
    """Run a command in an empty folder, as its user would."""
    monkeypatch.chdir(tmp_path)
    return run_rovid


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder, empty, beside what a test writes."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def run_rovid(*arguments: object) -> Done:
    out, err = io.StringIO(), io.StringIO()
    # Plug-ins of the commands before would be further candidates: in a process of its own a command has none of them.
    fresh = mock.patch.object(plugins, "_LOADED", plugins._Loaded())  # noqa: SLF001 - what this process has loaded
    argv, sys.argv = sys.argv, ["rovid", *map(str, arguments)]
    code = 0
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), _opened_once(), fresh:
            cli.main()
    except SystemExit as end:
        code = int(end.code or 0)
    finally:
        sys.argv = argv
    return Done(code=code, out=out.getvalue(), err=err.getvalue())


# The studies that commands opened last, by all that they depend on.
_OPENED: dict[object, Study] = {}


@contextlib.contextmanager
def _opened_once() -> Iterator[None]:
    """Logs that one of the last commands has read are not read again, unless a file has changed since."""
    whole = study_room.open_study

    def once(paths: Sequence[Path], **options: Any) -> Study:
        try:
            files = [*input_files(paths), *(file for path in paths if path.is_dir() for file in path.rglob("*"))]
            stamps = {(file, (stat := file.stat()).st_mtime_ns, stat.st_size) for file in files}
        except (OSError, RovidError):
            stamps = set()
        if not stamps or os.environ.get("ROVID_PROGRESS") != "none":
            return whole(paths, **options)
        # Neither progress, which nobody sees, nor reading in another process changes what is read.
        others = repr({name: value for name, value in options.items() if name not in {"report", "reading"}})
        folder = None if all(path.is_absolute() for path in paths) else Path.cwd()
        key = folder, tuple(paths), others, frozenset(stamps)
        if key not in _OPENED:
            study = whole(paths, **options)
            if len(_OPENED) > 3:
                _OPENED.pop(next(iter(_OPENED)))
            _OPENED[key] = study
        return _OPENED[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study_room, "open_study", once)
        yield


# Plots that the page of a yaw day shows; those of single trials are files only.
SHOWN_PLOTS = ("thrust_curves", "steady_torque", "inertia", "sine_runs", "overview", "residuals")


@contextlib.contextmanager
def blank_plots(*drawn: str) -> Iterator[None]:
    """Reports whose plots are all set up, but drawn as one blank: for tests of what else a page says and writes.

    Those of the names ``drawn`` are drawn all the same.
    """
    from matplotlib.figure import Figure

    from rovid.present.page import figures, page_files
    from rovid.present.plots import canvas

    figure, whole = Figure(figsize=(0.5, 0.5)), page_files.render_draft
    as_png, as_svg = canvas.render_png(figure), canvas.render_svg(figure)

    def picture(sketch: page_files.FigureDraft, guess: Assumptions) -> page_files.ReportFigure:
        if sketch.name in drawn:
            return whole(sketch, guess)
        return page_files.ReportFigure(name=sketch.name, caption=sketch.caption, alt=sketch.alt, png=as_png, svg=as_svg)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "render_draft", picture)
        yield


@pytest.fixture
def blank() -> Iterator[None]:
    """Plots of reports are blank; see `blank_plots`."""
    with blank_plots():
        yield


@contextlib.contextmanager
def diagnosed_once(known: dict[str, Diagnosis]) -> Iterator[None]:
    """The same logs, asked of in the same way, say the same again; ``known`` is what has been diagnosed already."""
    whole = Study.diagnosis

    def once(study: Study, report: Callable[[str], None] = lambda _: None, **options: Any) -> Diagnosis:
        origin = study.provenance
        logs = [(source.name, source.sha256) for source in origin.sources]
        # Beside logs nothing that is stored is asked for.
        key = repr((logs, study.vehicle, origin.settings, origin.options, options if study.runs is None else {}))
        if key not in known:
            known[key] = whole(study, report, **options)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Study, "diagnosis", once)
        yield


# Runs of the sample day that are enough to fit all of the plain model, in a quarter of the time.
SHORT_DAY = ("aft_only", "coast_02", "fore_only", "hold_03", "hold_05", "sine_40s_a", "staircase")


def write_short_day(folder: Path, *, runs: Sequence[str] = SHORT_DAY, configured: bool = True) -> None:
    """Write logs of the sample day and its thrust curve into a new ``folder``, and its rovid.toml."""
    folder.mkdir(parents=True)
    names = [*(f"{name}.csv" for name in (*runs, "thrust_curve")), *(["rovid.toml"] if configured else [])]
    for name in names:
        shutil.copy(SAMPLES / "rosub_tank" / name, folder)


@pytest.fixture(scope="session")
def csv_day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short synthetic day, all CSV, with a fixed seed: half of the runs of a whole one."""
    folder = tmp_path_factory.mktemp("day")
    campaign = [run for run in CAMPAIGN if run.name in {*SHORT_DAY, "hold_01", "sine_20s"}]
    write_trial_day(folder, seed=11, formats="csv", campaign=campaign)
    return folder
