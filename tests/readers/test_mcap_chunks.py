"""Chunks of MCAP, unpacked in bounded memory."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard

from rovid.trial.config import Config
from tests.readers.apart import STATUS
from tests.readers.logs import EPOCH, dive, mcap_bytes
from tests.readers.test_mcap_limits import (
    MAGIC,
    WHOLE,
    channel,
    chunk_head,
    in_front,
    read_apart,
    record,
)

LOOSE = mcap_bytes(dive(), chunked=False, summary=False, indexed=False)


def pictures(count: int, size: int = 1_000_000) -> Iterator[bytes]:
    """Messages of a camera, which take a hundredth when packed."""
    yield channel(100, "/camera")
    noise = np.random.default_rng(1)
    for _ in range(count):
        picture = noise.bytes(size // 90)
        yield record(5, struct.pack("<HIQQ", 100, 0, EPOCH, EPOCH) + picture + bytes(size - len(picture)))


@pytest.mark.skipif(not STATUS.exists(), reason="tells its memory in no such file")
@pytest.mark.parametrize("compression", ["zstd", "lz4"])
def test_a_large_chunk_is_not_held(compression: str, config: Config, tmp_path: Path) -> None:
    output = io.BytesIO()
    size = sum(map(len, pictures(400)))
    if compression == "zstd":
        with zstandard.ZstdCompressor().stream_writer(output, closefd=False) as out:
            for part in pictures(400):
                out.write(part)
    else:
        with lz4.frame.LZ4FrameFile(output, "wb") as file:
            for part in pictures(400):
                file.write(part)
    packed = output.getvalue()
    assert 2e6 < len(packed) < 10e6
    path = in_front(tmp_path / "dive.mcap", chunk_head(compression, len(packed), size) + packed)
    assert read_apart(path) == "400"


@pytest.mark.skipif(not STATUS.exists(), reason="tells its memory in no such file")
def test_large_records_are_not_held(config: Config, tmp_path: Path) -> None:
    """A picture, an attachment, a metadata record, a chunk that is not packed: each a hole of 400 MB in the file."""
    size = 400_000_000
    path = tmp_path / "dive.mcap"
    with path.open("wb") as file:

        def hole(head: bytes) -> None:
            file.write(head)
            file.truncate(file.tell() + size)
            file.seek(0, io.SEEK_END)

        picture = struct.pack("<BQHIQQ", 5, 22 + size, 100, 0, EPOCH, EPOCH)
        file.write(MAGIC + channel(100, "/camera"))
        hole(picture)
        hole(struct.pack("<BQ", 9, size))
        hole(struct.pack("<BQ", 12, size))
        hole(chunk_head("", len(picture) + size, len(picture) + size) + picture)
        body = WHOLE[len(MAGIC) : -len(MAGIC) - 29]
        start = len(MAGIC)  # which is no summary, but all of the file
        file.write(body + struct.pack("<BQQQI", 2, 20, start, 0, 0) + MAGIC)
    assert read_apart(path) == "400"
