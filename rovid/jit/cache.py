"""Compiled functions on disk, each good until what it is made of changes."""
# ruff: noqa: SLF001 - numba has no other way to say until when
# mypy: allow-untyped-calls

from __future__ import annotations

import contextlib
import functools
import hashlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

import numba
import numpy as np
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.runtime.nrt import rtsys

# What compiles, beside numba.
_COMPILERS = ("decorators.py", "simd.py", "tracing.py")


class _ByName(CompileResultCacheImpl):
    """In files by the function's name, whatever line it begins in."""

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        base: str = super().get_filename_base(fullname, abiflags)
        return base.replace(f"-{self.locator.get_disambiguator()}.", ".")


class ContentHashCache(FunctionCache):
    """Where a function is kept.

    Numba itself holds it against its own file alone: it would compile it again for a word there, and run the old
    equation of an effect under new numbers.
    """

    _impl_class = _ByName

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        # A later numba might look elsewhere, and find what is no longer good.
        if not hasattr(getattr(self, "_cache_file", None), "_source_stamp"):
            self.disable()

    def is_there(self) -> bool:
        """Whether it need not be compiled."""
        index = Path(self.cache_path) / f"{self._impl.filename_base}.nbi"
        # Not unpickled: that imports the kinds of all arguments.
        text = index.read_bytes() if index.exists() else b""
        return all(part.encode() in text for part in (numba.__version__, content_hash(self._py_func)))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """It as compiled for such arguments; None if it is not, is made of other things by now, or is damaged."""
        self._cache_file._source_stamp = content_hash(self._py_func)
        try:
            # What was compiled needs the memory that arrays are made in. Tables of all that might be compiled take a
            # quarter of a second to set up, and wait until something is.
            rtsys.initialize(target_context)
            return self._load_overload(sig, target_context)
        except Exception:  # noqa: BLE001 - pickle says in many ways that a file is damaged
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep it, where there is room."""
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


@functools.cache
def content_hash(function: FunctionType) -> str:
    """Digest of all that is compiled into a plain ``function``: its code, that of what it calls, constants."""
    return hashlib.sha256(repr((_compilers(), *_parts(function, set()))).encode()).hexdigest()


@functools.cache
def _compilers() -> bytes:
    return b"".join(Path(__file__).with_name(name).read_bytes() for name in _COMPILERS)


def _parts(thing: Any, seen: set[FunctionType]) -> Iterator[object]:
    thing = getattr(thing, "py_func", thing)
    if isinstance(thing, FunctionType) and thing not in seen:
        seen.add(thing)
        for code in _codes(thing.__code__):
            yield code.co_code, code.co_names
            yield from _parts([one for one in code.co_consts if not isinstance(one, CodeType)], seen)
            yield from _parts([thing.__globals__.get(name) for name in code.co_names], seen)
        yield from _parts([cell.cell_contents for cell in thing.__closure__ or ()], seen)
    elif isinstance(thing, Mapping):
        yield from _parts(tuple(thing.items()), seen)
    elif isinstance(thing, tuple | list):
        for one in thing:
            yield from _parts(one, seen)
    elif isinstance(thing, np.ndarray):
        yield thing.tolist()
    elif isinstance(thing, type):
        yield getattr(thing, "_fields", thing.__qualname__)
    elif isinstance(thing, str | bytes | int | float | None):
        yield thing


def _codes(code: CodeType) -> Iterator[CodeType]:
    """Of a function, and of those inside it."""
    yield code
    for inside in code.co_consts:
        if isinstance(inside, CodeType):
            yield from _codes(inside)
