"""A cache of compiled functions on disk, valid while the hash of all that is compiled into a function is the same."""
# ruff: noqa: SLF001 - numba has no public way to define validity
# mypy: allow-untyped-calls

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

from rovid.jit.decorators import USE_LLVM

# Modules that generate machine code, besides numba.
_GENERATORS = ("decorators.py", "simd.py", "llvm_vector.py", "llvm_tracing.py", "plain_numba.py")


class _NamedImpl(CompileResultCacheImpl):
    """Cache files named after the function, without the line in which it begins."""

    def get_filename_base(self, fullname: str, abiflags: str) -> str:
        base: str = super().get_filename_base(fullname, abiflags)
        return base.replace(f"-{self.locator.get_disambiguator()}.", ".")


class ContentHashCache(FunctionCache):
    """Cache of one function.

    Numba's own cache compares only the time stamp of the function's file. It would compile again after a change of a
    comment, and would run the old equation of an effect after a change in the effect's file.
    """

    _impl_class = _NamedImpl

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        # Another version of numba may keep the stamp elsewhere: without it, nothing would ever become invalid.
        if not hasattr(getattr(self, "_cache_file", None), "_source_stamp"):
            self.disable()

    def is_valid(self) -> bool:
        """Whether the function need not be compiled."""
        index = Path(self.cache_path) / f"{self._impl.filename_base}.nbi"
        # The bytes are searched, not unpickled: that would import the types of all arguments.
        content = index.read_bytes() if index.exists() else b""
        return all(part.encode() in content for part in (numba.__version__, content_hash(self._py_func)))

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Machine code for arguments of these types; None if it is missing, outdated or damaged."""
        self._cache_file._source_stamp = content_hash(self._py_func)
        try:
            # Machine code needs the runtime that allocates arrays. Numba's own method would set up its tables of
            # everything it can compile too, which takes a quarter of a second.
            rtsys.initialize(target_context)
            return self._load_overload(sig, target_context)
        except Exception:  # noqa: BLE001 - unpickling a damaged file raises many kinds of errors
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store machine code if the disk has room."""
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


@functools.cache
def content_hash(function: FunctionType) -> str:
    """Hash of everything compiled into a Python ``function``: its code, the code that it calls, and constants."""
    parts = (USE_LLVM, _generator_source(), *_compiled_parts(function, set()))
    return hashlib.sha256(repr(parts).encode()).hexdigest()


@functools.cache
def _generator_source() -> bytes:
    return b"".join(Path(__file__).with_name(name).read_bytes() for name in _GENERATORS)


def _compiled_parts(thing: Any, seen: set[FunctionType]) -> Iterator[object]:
    thing = getattr(thing, "py_func", thing)
    if isinstance(thing, FunctionType) and thing not in seen:
        seen.add(thing)
        for code in _nested_codes(thing.__code__):
            yield code.co_code, code.co_names
            yield from _compiled_parts([one for one in code.co_consts if not isinstance(one, CodeType)], seen)
            yield from _compiled_parts([thing.__globals__.get(name) for name in code.co_names], seen)
        yield from _compiled_parts([cell.cell_contents for cell in thing.__closure__ or ()], seen)
    elif isinstance(thing, Mapping):
        yield from _compiled_parts(tuple(thing.items()), seen)
    elif isinstance(thing, tuple | list):
        for one in thing:
            yield from _compiled_parts(one, seen)
    elif isinstance(thing, np.ndarray):
        yield thing.tolist()
    elif isinstance(thing, type):
        yield getattr(thing, "_fields", thing.__qualname__)
    elif isinstance(thing, str | bytes | int | float | None):
        yield thing


def _nested_codes(code: CodeType) -> Iterator[CodeType]:
    """The code of a function and of the functions inside it."""
    yield code
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from _nested_codes(inner)
