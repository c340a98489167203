"""Read log files as trials, with one reader for each format.

A reader is a module with a function ``read(path, config) -> RawLog`` that returns channels as logged. A new format is
one such module, one line in `rovid.trial.log_files` and one in docs/logs.md. Time order, units, unwrapping, outliers,
gaps and the time base are common to all formats (`rovid.readers.build_trial`).
"""

from rovid.readers.campaign import find_logs, read_campaign, read_trials
from rovid.readers.formats import READERS, read_log
