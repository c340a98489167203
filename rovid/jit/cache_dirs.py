"""Folders for compiled code and for matplotlib's font cache, also on machines with few writable places."""

import contextlib
import functools
import os
import stat
import sys
import tempfile
from pathlib import Path


@functools.cache
def can_cache() -> bool:
    """Whether compiled code can be cached: in numba's own place, or otherwise in a private folder.

    A note on standard error says when that folder is created, and in each run when there is none. With
    NUMBA_DISABLE_JIT nothing is compiled, and nothing is cached.
    """
    import numba

    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]  # numba ships no types
        return False
    if _numba_can_cache() or _use_private_folder():
        return True
    text = "Note: there is no writable folder for compiled code. Each run compiles anew, which takes some ten seconds. "
    sys.stderr.write(f"{text}Set NUMBA_CACHE_DIR to a writable folder.\n")
    return False


def _use_private_folder() -> bool:
    import numba

    private = _private_folder()
    if private is None:
        return False
    os.environ["NUMBA_CACHE_DIR"] = str(private / "numba")
    numba.config.reload_config()  # type: ignore[no-untyped-call]  # numba ships no types
    return _numba_can_cache()


def configure_font_cache() -> None:
    """Use a private folder if matplotlib would rebuild its font cache in each run; call before matplotlib's import."""
    if "MPLCONFIGDIR" in os.environ or not sys.platform.startswith("linux"):
        return
    with contextlib.suppress(RuntimeError):  # there is no home folder
        config = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        if all(_is_writable(folder / "matplotlib") for folder in (config, cache)):
            return
    private = _private_folder()
    if private is not None:
        os.environ["MPLCONFIGDIR"] = str(private / "matplotlib")


def _numba_can_cache() -> bool:
    import numba

    try:
        # Numba looks for a place when the decorator runs. Nothing is compiled yet.
        numba.njit(cache=True)(_probe)
    except RuntimeError:
        return False
    return True


def _probe() -> None:
    pass


@functools.cache
def _private_folder() -> Path | None:
    """A folder in the temporary folder that only this user can write, as its content will be run; None without one."""
    with contextlib.suppress(OSError):
        folder = Path(tempfile.gettempdir()) / f"rovid-cache-{os.getuid() if hasattr(os, 'getuid') else 'own'}"
        is_new = not folder.exists()
        folder.mkdir(mode=0o700, exist_ok=True)
        if _is_private(folder.lstat()) and _is_writable(folder):
            if is_new:
                sys.stderr.write(f"Note: compiled code and fonts are kept in {folder}; no other place is writable.\n")
            return folder
    return None


def _is_private(status: os.stat_result) -> bool:
    # Windows has a temporary folder for each user.
    private = os.name == "nt" or (status.st_uid == os.getuid() and not status.st_mode & 0o077)
    return stat.S_ISDIR(status.st_mode) and private


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
