"""What a command takes: time, the processor's, and memory, as the system counts them for a child process."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

# Run by a small process in between: a child's peak memory begins with that of whoever started it.
_MEASURE = """
import json, resource, subprocess, sys, time
begun = time.perf_counter()
done = subprocess.run(sys.argv[1:], capture_output=True, text=True)
seconds = time.perf_counter() - begun
used = resource.getrusage(resource.RUSAGE_CHILDREN)
peak = used.ru_maxrss / (1024 * (1024 if sys.platform == "darwin" else 1))
print(json.dumps([done.returncode, done.stdout, done.stderr, seconds, used.ru_utime + used.ru_stime, peak]))
"""


@dataclass(frozen=True, kw_only=True)
class Usage:
    """What a command printed, s by the clock and of the processor, and MB of memory at its peak."""

    out: str
    seconds: float
    processor: float
    megabytes: float


def measured(command: Sequence[str], folder: Path) -> Usage:
    """Run ``command`` in ``folder``.

    Raises
    ------
    RuntimeError
        It failed; what it said is in the message.
    """
    between = [sys.executable, "-I", "-S", "-c", _MEASURE, *command]
    done = subprocess.run(between, cwd=folder, capture_output=True, text=True, check=True)
    code, out, err, seconds, processor, megabytes = json.loads(done.stdout)
    if code:
        raise RuntimeError(err)
    return Usage(out=out, seconds=seconds, processor=processor, megabytes=megabytes)
