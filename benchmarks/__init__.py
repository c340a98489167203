"""Measurements, each a program of its own."""

import os

# As the command line does: what is measured is what its users wait for.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# No result depends on how busy the machine is.
os.environ.setdefault("ROVID_BUDGET", "3600")
