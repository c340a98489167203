"""The gallery of real logs: one file a set, written by hand; how it is judged; pictures and page."""

from __future__ import annotations

from benchmarks.gallery.ardusub import FLASH, TLOG
from benchmarks.gallery.base import RealSet
from benchmarks.gallery.bluerov2 import DIVE, STRAIGHT
from benchmarks.gallery.esso_osaka import ESSO
from benchmarks.gallery.kaxan import BENCH
from benchmarks.gallery.kvlcc2 import DECAY
from benchmarks.gallery.motors import CAR, LOOP, MOTOR

SETS: tuple[RealSet, ...] = (DIVE, STRAIGHT, DECAY, ESSO, TLOG, FLASH, BENCH, CAR, LOOP, MOTOR)

__all__ = ["SETS", "RealSet"]
