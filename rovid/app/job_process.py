"""A rovid command that ends with the page that started it: ``python -m rovid.app.job_process report LOGS``.

The page holds the other end of standard input. The pipe closes when the page ends, also if the page is killed.
"""

import os
import runpy
import signal
import sys
import threading
import time

# Time in s between SIGTERM and SIGKILL.
PATIENCE = 5.0


def _end_with_the_page() -> None:
    """Wait for the end of standard input, then end this process and its copies."""
    while os.read(0, 1):
        pass
    if sys.platform == "win32":
        os.kill(os.getpid(), signal.SIGTERM)
    else:
        os.killpg(0, signal.SIGTERM)
        time.sleep(PATIENCE)
        os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    threading.Thread(target=_end_with_the_page, daemon=True).start()
    runpy.run_module("rovid", run_name="__main__", alter_sys=True)
