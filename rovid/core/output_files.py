"""Output files: recognised by their signatures, checked before the work, and written all or none after it."""

import contextlib
import os
import re
import shutil
import stat
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from rovid.core.errors import OutputError, RovidError
from rovid.core.transaction import locked, recover, replace_files, write_synced

_HEAD_BYTES = 4096


@dataclass(frozen=True, kw_only=True)
class FileSignature:
    """How files of one kind are recognised."""

    description: str  #: The kind in a sentence, such as "a parameter file".
    pattern: re.Pattern[bytes]  #: Occurs near the beginning of each such file.
    #: Whether a file that matches may be replaced. A log or a rovid.toml belongs to the user once it is written: a
    #: match then only means that the same content might be there already.
    replaceable: bool = True
    head_bytes: int = _HEAD_BYTES  #: How many bytes of a file are searched; -1 for all.

    def matches(self, path: Path) -> bool:
        """Whether the file has this signature."""
        with path.open("rb") as stream:
            return self.pattern.search(stream.read(self.head_bytes)) is not None


def _signature(
    description: str, pattern: bytes, *, replaceable: bool = True, head_bytes: int = _HEAD_BYTES
) -> FileSignature:
    compiled = re.compile(pattern, re.MULTILINE | re.DOTALL)
    return FileSignature(description=description, pattern=compiled, replaceable=replaceable, head_bytes=head_bytes)


def export_mark(name: str) -> str:
    """Text that marks an export in the format ``name``."""
    return f"Written by rovid export {name}"


def export_signature(name: str) -> FileSignature:
    """Signature of an export in the format ``name``."""
    pattern = re.escape(export_mark(name).encode()) + rb"[^\w-]"
    if name == "json":
        pattern = rb'"schema": "rovid-(planar-)?model/[0-9]'
    return _signature(f"an export for {name}", pattern)


def plot_mark(document: str) -> str:
    """Text that marks a picture or a printed page of a ``document``, such as "report"."""
    return f"rovid {document}"


def png_signature(document: str) -> FileSignature:
    """Signature of a PNG picture."""
    mark = re.escape(plot_mark(document).encode())
    return _signature(f"a picture of a {document}", rb"\A\x89PNG\r\n\x1a\n.*tEXtSoftware\x00" + mark)


def svg_signature(document: str) -> FileSignature:
    """Signature of an SVG picture."""
    mark = re.escape(plot_mark(document).encode())
    return _signature(f"a picture of a {document}", rb"\A<\?xml.*<dc:creator>.*<dc:title>" + mark + b"</dc:title>")


def pdf_signature(document: str) -> FileSignature:
    """Signature of a PDF page."""
    mark = re.escape(plot_mark(document).encode())
    return _signature(f"a {document} as PDF", rb"\A%PDF-.*/(Creator|Producer) \(" + mark + rb" *\)")


PARAMETERS = _signature("a parameter file", rb'^schema = "rovid-parameters/[0-9]+"\s*$')
HISTORY = _signature("a history of parameters", rb'\A\{"schema": "rovid-history/[0-9]+"')
PAGE = _signature("a page of rovid report", rb'^<meta name="generator" content="rovid [^"]*">$')
COMPARISON = _signature("a page of rovid compare", rb'^<meta name="generator" content="rovid compare [^"]*">$')
FLEET_PAGE = _signature("a page of rovid fleet", rb'^<meta name="generator" content="rovid-fleet [^"]*">$')
# Parquet stores its metadata at the end.
FLEET_TABLE = _signature("a table of rovid fleet", rb'\APAR1.*"schema": "rovid-fleet/[0-9]', head_bytes=-1)
CAMPAIGN = _signature("a campaign's diagnosis by rovid fleet", rb'\A\{\s*"schema": "rovid-campaign/[0-9]')
C_SOURCE = _signature("a controller in C", rb"\A/\* Heading controller, .{0,80} Written by rovid ")
PYTHON_SOURCE = _signature("a controller in Python", rb'\A"""Heading controller, .{0,80} Written by rovid ')
# rovid quotes the first name of the header, which CSV does not need, and leaves another without quotes. No other
# program writes CSV like this, and all can read it.
PLAN = _signature("a command file of rovid plan", rb'\A"time_s",([^\n]*,)?[^",\n]+(,[^\n]*)?\n')
EFFECT_FILE = _signature("an effect of rovid discover", rb'\A"""[^\n]*, found by rovid discover\. ')
# A new effect is the user's once it is written: no other file is like that.
NEW_EFFECT = _signature("a new effect", rb"\A\0rovid effect", replaceable=False)
CURVE = _signature("a thrust curve of rovid fit-thruster", rb'\A"command",thrust_N\n')
# An MCAP header without profile, with this library name.
RECORDING_LIBRARY = "rovid simulate"
RECORDING = _signature(
    "a recording of rovid simulate",
    rb"\A\x89MCAP0\r\n\x01.{8}\0{4}" + re.escape(len(RECORDING_LIBRARY).to_bytes(4, "little")) + b"rovid simulate",
)
LOG = _signature(
    "the log that this command writes", rb"\A(time_s,|\x89MCAP0\r\n\x01.{8}\0{4}\x05\0{3}rovid|PAR1)", replaceable=False
)
CONFIG = _signature("the rovid.toml that this command writes", rb"\A# Written by `rovid init`", replaceable=False)
GUESSED_CURVE = _signature("the guessed curve that this command writes", CURVE.pattern.pattern, replaceable=False)


# Suffix of a log -> outputs of rovid that have it too.
_NO_LOGS = {".csv": (PLAN,), ".mat": (export_signature("matlab"), export_signature("mss")), ".mcap": (RECORDING,)}


def own_output(path: Path) -> str:
    """The kind of an output of rovid that has the suffix of a log; empty for other files."""
    signatures = _NO_LOGS.get(path.suffix.lower(), ())
    with contextlib.suppress(OSError):  # Reading reports the error.
        return next((one.description for one in signatures if one.matches(path)), "")
    return ""


# A function is called under the locks of the folders: its content may depend on files that are there.
Content = str | bytes | Callable[[], str | bytes]
_OTHER_NAME = "Choose another name."


@dataclass(frozen=True)
class OutputFile:
    """A file to be written, with the signature that files of its kind have."""

    path: Path
    signature: FileSignature

    @property
    def target(self) -> Path:
        """The file itself, if ``path`` is a link."""
        return Path(os.path.realpath(self.path))


class OutputSet:
    """Files that are written together. The constructor checks before the work that they can be written.

    Raises OutputError if a file must not be replaced, or its folder cannot be written.

    ``outputs``: The files.
    ``force``: Whether files that rovid did not write may be replaced.
    ``protected``: Files that are never replaced, whatever they contain.
    """

    def __init__(self, outputs: Sequence[OutputFile], *, force: bool = False, protected: Iterable[Path] = ()) -> None:
        self._force = force
        self._protected = tuple(protected)
        targets = Counter(output.target for output in outputs)
        for output in outputs:
            if targets[output.target] > 1:
                raise OutputError("is given as the place of two outputs.", where=output.path, mend=_OTHER_NAME)
            folder = output.target.parent
            while not folder.exists():
                folder = folder.parent
            try:
                recover(folder)
                self._require_replaceable(output)
                with tempfile.TemporaryFile(dir=folder):
                    pass
            except OSError as error:
                raise _not_written(output.path, error) from error

    def write(self, contents: Mapping[OutputFile, Content], *, stale: Iterable[Path] = ()) -> list[Path]:
        """Write all files and delete the ``stale`` ones, or change nothing; return the paths that had other content.

        Raises OutputError if the files cannot be written after all. The message says where they were saved instead.
        """
        data: dict[OutputFile, bytes] = {}
        try:
            removed = [Path(os.path.realpath(path)) for path in stale]
            targets = [output.target for output in contents]
            folders = sorted({path.parent for path in (*targets, *removed)})
            for folder in folders:
                folder.mkdir(parents=True, exist_ok=True)
            with locked(folders):
                data = _encoded(contents)
                changed = []
                for output, content in data.items():
                    target = output.target
                    is_same_size = target.is_file() and target.stat().st_size == len(content)
                    if not (is_same_size and target.read_bytes() == content):
                        changed.append(output)
                for output in changed:
                    self._require_replaceable(output, differs=True)
                replaced = [output.path for output in changed if output.target.exists()]
                replace_files({output.target: data[output] for output in changed}, removed, folders)
        except OSError as error:
            first = next(iter(contents))
            self.save_elsewhere(data or _encoded(contents), _not_written(first.path, error))
        except OutputError as error:
            if not all(output.signature.replaceable for output in contents):
                raise  # the user's own file was there before
            self.save_elsewhere(data or _encoded(contents), error)
        return replaced

    def save_elsewhere(self, contents: Mapping[OutputFile, bytes], reason: RovidError) -> NoReturn:
        """Save the contents in a new folder, because of a ``reason`` why they cannot go to their places.

        Raises OutputError always, with the reason and the new folder.
        """
        top = Path(os.path.commonpath([output.target.parent for output in contents]))
        files = {os.path.relpath(output.target, top): content for output, content in contents.items()}
        for parent in _fallback_folders():
            folder = None
            try:
                folder = Path(tempfile.mkdtemp(prefix="rovid-result-", dir=parent))
                for name, content in files.items():
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
                    write_synced(folder / name, content)
            except OSError:
                if folder is not None:
                    shutil.rmtree(folder, ignore_errors=True)
                continue
            saved = folder / next(iter(files)) if len(files) == 1 else folder
            raise OutputError(f"{reason} Nothing is lost: the result was saved in {saved}.") from reason
        raise OutputError(f"{reason} The result could not be saved anywhere else either.") from reason

    def _require_replaceable(self, output: OutputFile, *, differs: bool = False) -> None:
        """Refuse a file that must not be replaced; ``differs``: the new content is known to differ from the old."""
        target, signature = output.target, output.signature
        try:
            status = target.stat()
        except FileNotFoundError:
            return
        if not stat.S_ISREG(status.st_mode):
            kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe, socket or device"
            raise OutputError(f"is {kind}; a file was expected.", where=output.path, mend=_OTHER_NAME)
        matches = signature.matches(target)
        if matches and not signature.replaceable and not differs:
            return
        protected = [path for path in self._protected if path.exists()]
        if any(path.samefile(target) for path in protected):
            raise OutputError("is an input of this command and is never replaced.", where=output.path, mend=_OTHER_NAME)
        if not os.access(target, os.W_OK):
            mend = "Make it writable, or name another file on the command line, by -o or -p."
            raise OutputError("is write-protected.", where=output.path, mend=mend)
        if status.st_size and not (matches and signature.replaceable) and not self._force:
            text, mend = f"already exists, and is not {signature.description}.", "Choose another name, or give --force"
            if matches:
                text, mend = "already exists, and may hold your changes.", "Give --force"
            raise OutputError(text, where=output.path, mend=f"{mend} to replace it.")


def _encoded(contents: Mapping[OutputFile, Content]) -> dict[OutputFile, bytes]:
    data = {}
    for output, content in contents.items():
        made = content() if callable(content) else content
        data[output] = made.encode("utf-8", "backslashreplace") if isinstance(made, str) else made
    return data


def _fallback_folders() -> Iterator[Path]:
    """Folders for a result that cannot go to its place, as far as they exist."""
    for find in (Path.cwd, Path.home, lambda: Path(tempfile.gettempdir())):
        with contextlib.suppress(OSError, RuntimeError):
            yield find()


def _not_written(path: Path, error: OSError) -> OutputError:
    mend = "Make the folder writable, or write elsewhere: on the command line by -o or -p, or from another folder."
    return OutputError(f"cannot be written ({error.strerror or error}).", where=path, mend=mend)
