"""The chunks of MCAP: what is packed in them, block by block, so that no chunk takes more memory than a block."""

from __future__ import annotations

import io
import zlib
from collections.abc import Callable, Iterable, Iterator
from typing import Any, BinaryIO, cast

COMPRESSIONS = ("", "lz4", "zstd")
_BLOCK = 1 << 20
# A zstd frame may ask for this much memory to be unpacked in.
_WINDOW = 64 << 20


class Damage(Exception):  # noqa: N818  no error of the program: what is wrong with the recording from here on
    """The rest of the recording cannot be trusted; the message says why."""


class _Part(io.RawIOBase):
    """``size`` bytes of a file from ``start`` on, as a file; others may move the file's position meanwhile."""

    def __init__(self, file: BinaryIO, start: int, size: int) -> None:
        super().__init__()
        self._file, self._at, self._end = file, start, start + size

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:  # a memory view, which typing calls by two names
        self._file.seek(self._at)
        data = self._file.read(min(len(buffer), self._end - self._at))
        self._at += len(data)
        buffer[: len(data)] = data
        return len(data)


def unpacked(file: BinaryIO, start: int, packed: int, compression: str, size: int) -> Iterator[bytes]:
    """What is packed from ``start`` on: ``size`` bytes, one more where there is more, fewer where it is cut.

    Raises
    ------
    Damage
        It is not what ``compression`` (one of `COMPRESSIONS`) makes.
    """
    left = size + 1
    try:
        read = _reader(_Part(file, start, packed), compression)
        while left and (block := read(min(_BLOCK, left))):
            left -= len(block)
            yield block
    except EOFError:  # how lz4 says that it is cut
        return
    except (RuntimeError, ValueError, MemoryError) as error:
        raise Damage("a chunk does not unpack") from error


def _reader(part: _Part, compression: str) -> Callable[[int], bytes]:
    if compression == "zstd":
        return _zstd(part)
    if compression == "lz4":
        import lz4.frame

        return cast("Callable[[int], bytes]", lz4.frame.LZ4FrameFile(part).read1)
    return io.BufferedReader(part, _BLOCK).read1


def _zstd(part: _Part) -> Callable[[int], bytes]:
    import zstandard

    stream = zstandard.ZstdDecompressor(max_window_size=_WINDOW).stream_reader(
        cast("BinaryIO", part), read_across_frames=True
    )

    def read(size: int) -> bytes:
        try:
            return stream.read(size)
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from error

    return read


def verify(blocks: Iterable[bytes], size: int, crc: int) -> None:
    """That ``blocks`` are ``size`` bytes with the checksum ``crc``, which 0 stands for none.

    Raises
    ------
    Damage
        They are not.
    """
    found = checksum = 0
    for block in blocks:
        found += len(block)
        checksum = zlib.crc32(block, checksum)
    if found != size:
        raise Damage("a chunk does not unpack to the size it claims")
    if crc and checksum != crc:
        raise Damage("a chunk's checksum does not fit its contents")
