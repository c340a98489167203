"""Write a draw of folders of dirty logs, and truth.json next to them."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from tools.dirty.folder import FAULTS, FORMATS, write_folder
from tools.dirty.vehicle import HIDDEN


def main() -> None:
    """Write OUT/000, OUT/001, and so on, and OUT/truth.json."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--fault", choices=["none", "any", *FAULTS], default="any")
    parser.add_argument("--format", choices=FORMATS)
    parser.add_argument("--hide", choices=HIDDEN, help="an effect that acts as well")
    options = parser.parse_args()
    fault = None if options.fault == "none" else options.fault
    truths = {
        f"{number:03d}": write_folder(
            options.out / f"{number:03d}", options.seed, number, fault, options.hide, options.format
        )
        for number in range(options.count)
    }
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "truth.json").write_text(json.dumps(truths, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
