"""One and the same short run, written in every format but CSV and MCAP."""

from __future__ import annotations

import io
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from tests.readers.logs import turning

TIME, HEADING = turning(300)
CHANGES = ((0.0, 1.0), (3.017, 2.0), (7.033, 3.0))
Row = tuple[str, tuple[object, ...]]


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A format, and the run in it.

    Attributes
    ----------
    write
        Makes its bytes.
    heading, command
        As rovid.toml names them; without a heading where its format has a standard one.
    """

    write: Callable[[], bytes]
    heading: str
    command: str
    tolerance: float = 1e-6


# --- ArduPilot DataFlash ------------------------------------------------------------------------------------------

_BIN_LETTERS = {"Q": "Q", "f": "f", "B": "B", "H": "H", "C": "H"}
_BIN_MESSAGES = {"ATT": ("Qf", "TimeUS,Yaw"), "RCOU": ("QH", "TimeUS,C1"), "BAT": ("QBC", "TimeUS,Inst,Volt")}


def dataflash(rows: list[Row]) -> bytes:
    """A DataFlash log of ATT, RCOU and BAT messages."""
    kinds, data = {}, b""
    for number, (name, (letters, labels)) in enumerate(_BIN_MESSAGES.items(), start=1):
        form = struct.Struct("<" + "".join(_BIN_LETTERS[letter] for letter in letters))
        kinds[name] = (bytes([number]), form)
        texts = name.encode(), letters.encode(), labels.encode()
        data += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, 3 + form.size, *texts)
    for name, values in rows:
        mark, form = kinds[name]
        data += b"\xa3\x95" + mark + form.pack(*values)
    return data


def _bin() -> bytes:
    rows: list[Row] = [("ATT", (int(1e6 * t), h % 360.0)) for t, h in zip(TIME, HEADING, strict=True)]
    rows += [("RCOU", (int(1e6 * t), int(c))) for t, c in CHANGES]
    return dataflash(sorted(rows, key=lambda row: row[1][0]))  # type: ignore[arg-type, return-value]


# --- Parquet ------------------------------------------------------------------------------------------------------


def parquet(columns: Mapping[str, Any]) -> bytes:
    """A table of ``columns``."""
    out = io.BytesIO()
    pq.write_table(pa.table(dict(columns)), out)
    return out.getvalue()


def _parquet() -> bytes:
    command = np.select([at <= TIME for at, _ in CHANGES[::-1]], [value for _, value in CHANGES[::-1]])
    return parquet({"time_s": TIME, "heading_deg": HEADING % 360.0, "fore_V": command})


RECORDINGS: Mapping[str, Recording] = {
    ".parquet": Recording(write=_parquet, heading='heading = { csv = "heading_deg" }', command='{ csv = "fore_V" }'),
    ".BIN": Recording(write=_bin, heading="", command='{ bin = "RCOU.C1" }', tolerance=1e-5),
}
