"""Write planar campaigns into a folder, the truth of each beside it.

``python -m tools.planar OUT --seed 1 --count 10 --family rov --hidden current``
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from tools.planar import FAMILIES, draw, truth_of, write_campaign
from tools.planar.sensors import SIGNALS


def main() -> None:
    """Write the campaigns that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--family", choices=list(FAMILIES), help="random by default")
    parser.add_argument("--hidden", metavar="none|ID|ID:FORM", help="what is hidden; random by default")
    parser.add_argument("--sensors", nargs="+", choices=list(SIGNALS), help="compass first; random by default")
    parser.add_argument("--format", choices=["csv", "csv_parts", "mcap"], help="random by default")
    parser.add_argument("--samples", type=int, default=20_000, help="largest number of readings of a sensor")
    options = parser.parse_args()
    sensors = tuple(options.sensors) if options.sensors else None
    for index in range(options.start, options.start + options.count):
        campaign = draw(options.seed, index, options.hidden, options.family, sensors=sensors,
                        log_format=options.format, samples=options.samples)  # fmt: skip
        folder = options.out / f"planar_{options.seed}_{index:04d}"
        write_campaign(folder, campaign)
        folder.with_suffix(".truth.json").write_text(json.dumps(truth_of(campaign), indent=1) + "\n", encoding="utf-8")
        print(folder)


if __name__ == "__main__":
    main()
