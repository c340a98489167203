"""Write wide campaigns into a folder, the truth of each beside it.

``python -m tools.wide OUT --seed 1 --start 0 --count 10``
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from tools.wide import FORMS, draw, truth_of, write_campaign


def main() -> None:
    """Write the campaigns that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--effect", choices=["none", *FORMS], help="what is hidden; random by default")
    options = parser.parse_args()
    for index in range(options.start, options.start + options.count):
        campaign = draw(options.seed, index, options.effect)
        folder = options.out / f"wide_{options.seed}_{index:04d}"
        write_campaign(folder, campaign)
        truth = json.dumps(truth_of(campaign, refit=True), indent=1)
        folder.with_suffix(".truth.json").write_text(truth + "\n", encoding="utf-8")
        print(folder)


if __name__ == "__main__":
    main()
