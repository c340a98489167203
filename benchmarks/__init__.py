"""Benchmarks. Each module is a program."""

import os

# One thread, as in the command line: the benchmarks measure the time that users wait.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# s; the load of the machine must not change a result.
os.environ.setdefault("ROVID_BUDGET", "3600")
