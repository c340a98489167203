"""Dirty logs: random vehicles, a plausible programme of runs, and at most one fault of the log in each folder.

Run ``python -m tools.dirty OUT --seed 1 --count 40``. The simulator and the writers share no code with rovid.
"""

from tools.dirty.campaign import Campaign, Damage, Log, Stream
from tools.dirty.folder import FAULTS, FORMATS, draw_folder, write_folder
from tools.dirty.vehicle import HIDDEN, Vehicle

__all__ = [
    "FAULTS",
    "FORMATS",
    "HIDDEN",
    "Campaign",
    "Damage",
    "Log",
    "Stream",
    "Vehicle",
    "draw_folder",
    "write_folder",
]
