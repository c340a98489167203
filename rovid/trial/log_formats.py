"""The formats of logs: one line a suffix, whose file in `rovid.readers` is called as the format."""

from __future__ import annotations

from collections.abc import Mapping

# Suffix of a file -> its format, which is the key of its sources in rovid.toml: "bag" is read by ``bag_reader``.
FORMATS: Mapping[str, str] = {
    ".csv": "csv",
    ".mcap": "mcap",
    ".parquet": "parquet",
    ".bag": "bag",
    ".db3": "bag",
    ".bin": "bin",
    ".tlog": "tlog",
    ".nmea": "nmea",
    ".ulg": "ulg",
}
KINDS = tuple(dict.fromkeys(FORMATS.values()))
