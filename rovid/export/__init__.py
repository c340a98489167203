"""The parameters in a simulator's own format, checked by re-simulation: one file a target.

Another target is one such file and one line in `rovid.export.formats`.
"""

from rovid.export.exported import Exported, Loss, export
from rovid.export.formats import EXPORTERS, exporter
from rovid.export.subject import Subject, subject_of
from rovid.export.target import Target

__all__ = ["EXPORTERS", "Exported", "Loss", "Subject", "Target", "export", "exporter", "subject_of"]
