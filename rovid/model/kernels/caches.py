"""What is kept on disk of compiled loops, and until when it is good."""

from __future__ import annotations

import hashlib
from pathlib import Path

from rovid import effects
from rovid.effects.series import lagged
from rovid.ground import compiled, lanes, straight
from rovid.ground.caches import keeps_compiled
from rovid.model.kernels.step import step

_MARK = "kernels.sources"


def _kept_beside(function: object) -> Path:
    """The folder in which numba keeps a compiled ``function``."""
    return Path(str(function.stats.cache_path))  # type: ignore[attr-defined]  # numba ships no types


def is_compiled() -> bool:
    """Whether this machine has compiled the simulation before."""
    return keeps_compiled() and any(_kept_beside(step).glob("free_run._simulate*.nbi"))


def forget_stale() -> None:
    """Delete compiled functions that were made from other sources.

    Numba looks at the age of a function's own file alone, and would run the old terms under the new numbers.
    """
    if not keeps_compiled():
        return
    folder, digest = _kept_beside(step), _digest_of_sources()
    mark = folder / _MARK
    try:
        if mark.exists() and mark.read_text() == digest:
            return
        for kept in (folder, _kept_beside(lagged)):
            for stale in kept.glob("*.nb[ci]"):
                stale.unlink(missing_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        mark.write_text(digest)
    except OSError:  # nothing can be kept there, so that nothing is stale either
        return


def _digest_of_sources() -> str:
    digest = hashlib.sha256()
    rooms = Path(effects.__file__).parent, Path(__file__).parent
    sources = [source for room in rooms for source in sorted(room.glob("*.py"))]
    for source in (*sources, *(Path(str(one.__file__)) for one in (compiled, lanes, straight))):
        digest.update(source.read_bytes())
    return digest.hexdigest()
