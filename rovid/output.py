"""Writing results: atomically, and rounded to what is known."""

from __future__ import annotations

import contextlib
import json
import math
import os
import tempfile
from pathlib import Path
from typing import Any

from rovid.errors import OutputError
from rovid.quoting import encodable, json_lines


def require_writable(path: Path) -> None:
    """Find out before a long computation whether ``path`` can be written after it.

    Raises
    ------
    OutputError
        It cannot.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise _not_written(path, error) from error


def write_atomic(path: Path, content: str | bytes) -> None:
    """Write to a temporary file beside ``path`` and rename it, so that a failure leaves the old file whole.

    Raises
    ------
    OutputError
        The folder or file cannot be written.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:
        raise _not_written(path, error) from error
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(data)
        # mkstemp makes the file private; a result is for everyone the folder is for.
        umask = os.umask(0)
        os.umask(umask)
        Path(name).chmod(0o666 & ~umask)
        Path(name).replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            Path(name).unlink()
        raise _not_written(path, error) from error


def _not_written(path: Path, error: OSError) -> OutputError:
    return OutputError(
        f"cannot be written ({error.strerror or error}).", where=path, mend="Choose another place with -o or -p."
    )


def to_json(document: Any) -> str:
    """JSON text; numbers that are not finite become null."""
    return json_lines(json.dumps(_finite(document), indent=2, ensure_ascii=False))


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {encodable(str(key)): _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    if isinstance(value, str):
        return encodable(value)
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, int):
        return value
    number = float(value)
    return number if math.isfinite(number) else None


def plus_minus(value: float, error: float) -> str:
    """Value and standard error, rounded to two digits of the error, three where it begins with 1 to 3."""
    if not math.isfinite(error) or error <= 0.0:
        return f"{value:.4g}"
    decimals = _decimals(error)
    return f"{rounded(value, decimals)} ± {rounded(error, decimals)}"


def _decimals(error: float) -> int:
    """Decimals to print; negative to round before the point."""
    exponent = math.floor(math.log10(error))
    digits = 3 if error / 10.0**exponent < 4.0 else 2
    return digits - 1 - exponent


def rounded(value: float, decimals: int) -> str:
    """``value`` with that many decimals, without exponent."""
    return f"{round(value, decimals):.{max(decimals, 0)}f}"
