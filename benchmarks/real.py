"""The gallery of real logs: what is known of each, what rovid says, and whether that is right.

Run ``python -m benchmarks.real --data FOLDER --page docs/real.md``. FOLDER holds a folder for each set, as the files of
`benchmarks.gallery` name them; not all of these logs may be handed on. Every set is done in a room of its own under
``--state`` and kept there: started again it does what is missing, or was done by another state of rovid.
``--only NAME`` does that set anew and no other.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import rovid
from benchmarks.gallery import SETS
from benchmarks.gallery.base import RealSet, Step
from benchmarks.gallery.judge import Answer
from benchmarks.gallery.page import Record, line_of, page_of
from rovid.present.plots.canvas import render_png

PROJECT = Path(__file__).resolve().parents[1]
TOOL = [sys.executable, "-c", "from rovid.cli.cli import main; main()"]


def ask(step: Step, room: Path, timeout: float) -> Answer:
    """Run one command in ``room``, and time it."""
    words = (*shlex.split(step.words), "--json")
    environment = os.environ | {"PYTHONPATH": str(PROJECT)}
    before, began = _processor_seconds(), time.monotonic()
    try:
        done = subprocess.run(
            [*TOOL, *words], cwd=room, env=environment, capture_output=True, text=True, timeout=timeout, check=False
        )
        code, out, message = done.returncode, done.stdout, done.stderr.strip()
    except subprocess.TimeoutExpired:
        code, out, message = None, "", ""
    return Answer(
        words=words[:-1],
        seconds=time.monotonic() - began,
        processor_seconds=_processor_seconds() - before,
        code=code,
        document=json.loads(out) if code == 0 else None,
        message=message,
    )


def _processor_seconds() -> float:
    used = os.times()
    return used.children_user + used.children_system


def prepare(real: RealSet, data: Path, room: Path) -> bool:
    """An empty room with the set's logs and texts in a folder; False where the logs are not in ``data``."""
    logs = sorted(data.glob(real.logs))
    if not logs:
        return False
    shutil.rmtree(room, ignore_errors=True)
    folder = room / real.key
    folder.mkdir(parents=True)
    for log in logs:
        # Not its mode: what is read-only there would stand in the way of the next run here.
        shutil.copyfile(log, folder / log.name)
    for name, text in real.texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return True


def run_set(real: RealSet, room: Path, timeout: float) -> Record:
    """Every step in its order; those for which something is missing are left out."""
    answers: dict[str, Answer] = {}
    for step in real.steps:
        if not step.needs or (room / step.needs).is_file():
            answers[step.name] = ask(step, room, timeout)
            print(line_of(real.key, answers[step.name]), flush=True)
    config = room / real.key / "rovid.toml"
    return Record(
        key=real.key,
        answers=answers,
        config=config.read_text(encoding="utf-8") if config.is_file() else "",
        made_by=fingerprint(real),
        cores=os.cpu_count() or 1,
    )


def fingerprint(real: RealSet) -> str:
    """Of rovid's sources and of what it is asked: answers of another state are asked for anew."""
    sources = b"".join(path.read_bytes() for path in sorted(Path(rovid.__file__).parent.rglob("*.py")))
    return hashlib.sha256(sources + repr((real.logs, real.texts, real.steps)).encode()).hexdigest()


def draw(real: RealSet, record: Record, room: Path, folder: Path) -> list[str]:
    """Draw the set's pictures into ``folder``; names of those for which everything was there."""
    drawn = []
    for picture in real.pictures:
        figure = picture.draw(room, record.answers)
        if figure is not None:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / picture.name).write_bytes(render_png(figure))
            drawn.append(picture.name)
    return drawn


def read_record(path: Path) -> Record | None:
    """What was kept of a set, or None."""
    if not path.is_file():
        return None
    kept: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    answers = {
        name: Answer(**{**answer, "words": tuple(answer["words"])}) for name, answer in kept.pop("answers").items()
    }
    return Record(answers=answers, **kept)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of the real logs")
    parser.add_argument("--state", type=Path, default=PROJECT / "build" / "real", help="where answers are kept")
    parser.add_argument("--only", nargs="*", choices=[real.key for real in SETS], help="sets to do, anew")
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds that a command may take")
    parser.add_argument("--page", type=Path, help="where to write the page, docs/real.md for instance")
    options = parser.parse_args()
    done: list[tuple[RealSet, Record]] = []
    for real in SETS:
        room, kept = options.state / real.key, options.state / f"{real.key}.json"
        record = read_record(kept)
        stale = record is None or record.made_by != fingerprint(real)
        if (real.key in options.only) if options.only is not None else stale:
            if not prepare(real, options.data, room):
                print(f"{real.key}: no {real.logs} in the folder of data", file=sys.stderr)
                continue
            record = run_set(real, room, options.timeout)
            kept.write_text(json.dumps(asdict(record)), encoding="utf-8")
        elif stale and record is not None:
            print(f"{real.key}: kept from another state of the program", file=sys.stderr)
        if record is not None:
            done.append((real, record))
    pictures = options.page.parent / "pictures" if options.page else options.state / "pictures"
    drawn = {real.key: draw(real, record, options.state / real.key, pictures) for real, record in done}
    page = page_of(done, drawn)
    if any(str(folder.resolve()) in page for folder in (options.data, options.state)):
        raise SystemExit("The page tells where the logs are: it is not written.")
    if options.page:
        options.page.write_text(page, encoding="utf-8")
    else:
        print(page)


if __name__ == "__main__":
    main()
