"""Converts a thruster maker's bench table (PWM in us, force in kgf) to a thrust curve command,thrust_N.

Run ``python -m tools.t200_curve t200_16V_bench.csv t200_16V_curve.csv``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd

from tools.truth import NEWTON_PER_KGF

_COMMAND = "PWM (µs)"
_FORCE = "Force (Kg f)"


def thrust_curve(bench: Path) -> pd.DataFrame:
    """Columns command (us) and thrust_N; rows without a number are left out, repeated commands averaged."""
    table = pd.read_csv(bench).rename(columns=str.strip)
    numbers = table[[_COMMAND, _FORCE]].apply(pd.to_numeric, errors="coerce").dropna()
    thrust = numbers.groupby(_COMMAND)[_FORCE].mean() * NEWTON_PER_KGF
    return pd.DataFrame({"command": thrust.index, "thrust_N": thrust.to_numpy()})


def main() -> None:
    """Convert from the command line."""
    parser = argparse.ArgumentParser(description="Convert a bench table to a thrust curve.")
    parser.add_argument("bench", type=Path, help="the table as the maker publishes it")
    parser.add_argument("out", type=Path, help="the curve to write")
    arguments = parser.parse_args()
    curve = thrust_curve(arguments.bench)
    curve.to_csv(arguments.out, index=False, float_format="%.6g", lineterminator="\n")


if __name__ == "__main__":
    main()
