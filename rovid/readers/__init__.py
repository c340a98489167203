"""From files to frozen trials: one file a format, one time base for all.

A reader is a function ``read(path, config) -> RawLog`` that hands over channels as logged. A new format is one such
file, one line in `rovid.trial.log_files` and one in docs/logs.md; ordering, units, unwrapping, outliers, gaps and the
common time base are the same for all (`rovid.readers.build_trial`).
"""

from __future__ import annotations

from rovid.readers.discover import find_logs, read_campaign, read_trials
from rovid.readers.formats import READERS, read_log

__all__ = ["READERS", "find_logs", "read_campaign", "read_log", "read_trials"]
