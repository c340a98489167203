"""Where compiled code and the plots' fonts are kept from one run to the next, on machines that allow no writing too."""

from __future__ import annotations

import contextlib
import functools
import os
import stat
import sys
import tempfile
from pathlib import Path


@functools.cache
def can_cache() -> bool:
    """Whether compiled code can be kept: where numba does by itself, else in a private folder.

    Said on standard error when that folder is made, and in each run in which there is none. Where NUMBA_DISABLE_JIT
    is set there is nothing to keep.
    """
    import numba

    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]  # numba ships no types
        return False
    if _numba_keeps() or _keeps_privately():
        return True
    sys.stderr.write(
        "Note: compiled code cannot be kept anywhere, so that each run compiles anew, which takes some ten seconds. "
        "Set NUMBA_CACHE_DIR to a folder that can be written.\n"
    )
    return False


def _keeps_privately() -> bool:
    import numba

    private = _private_folder()
    if private is None:
        return False
    os.environ["NUMBA_CACHE_DIR"] = str(private / "numba")
    numba.config.reload_config()  # type: ignore[no-untyped-call]  # numba ships no types
    return _numba_keeps()


def configure_font_cache() -> None:
    """Before matplotlib is imported: a private folder where it would make one anew in each run, and say so."""
    if "MPLCONFIGDIR" in os.environ or not sys.platform.startswith("linux"):
        return
    with contextlib.suppress(RuntimeError):  # there is no home
        config = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        if all(_can_be_written(folder / "matplotlib") for folder in (config, cache)):
            return
    private = _private_folder()
    if private is not None:
        os.environ["MPLCONFIGDIR"] = str(private / "matplotlib")


def _numba_keeps() -> bool:
    import numba

    try:
        # It looks for a place when it is asked to keep something; nothing is compiled yet.
        numba.njit(cache=True)(_probe)
    except RuntimeError:
        return False
    return True


def _probe() -> None:
    pass


@functools.cache
def _private_folder() -> Path | None:
    """A folder in the temporary one that nobody else can write, for what is in it will be run; None without one."""
    with contextlib.suppress(OSError):
        folder = Path(tempfile.gettempdir()) / f"rovid-cache-{os.getuid() if hasattr(os, 'getuid') else 'own'}"
        is_new = not folder.exists()
        folder.mkdir(mode=0o700, exist_ok=True)
        if _is_ours_alone(folder.lstat()) and _can_be_written(folder):
            if is_new:
                sys.stderr.write(f"Note: compiled code and fonts are kept in {folder}; no other place is open.\n")
            return folder
    return None


def _is_ours_alone(found: os.stat_result) -> bool:
    # Windows has a temporary folder for each user.
    ours = os.name == "nt" or (found.st_uid == os.getuid() and not found.st_mode & 0o077)
    return stat.S_ISDIR(found.st_mode) and ours


def _can_be_written(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
