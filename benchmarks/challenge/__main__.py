"""Run a round of the challenge: draw campaigns, collect the answers of all entrants, score, write the page.

``python -m benchmarks.challenge`` repeats the last open round. ``--entrants stepwise sindy`` runs these entrants only.
``--seal FILE`` draws the secret of a new round, writes it to FILE, and prints the hash for rounds.json. Existing
answers are kept, and an interrupted round continues.
"""

from __future__ import annotations

import argparse
import importlib
import json
import secrets
import time
import warnings
from pathlib import Path
from typing import Any

from benchmarks.challenge.page import write_page
from benchmarks.challenge.rules import Campaign, read_campaign
from benchmarks.challenge.score import problem, score, scored
from benchmarks.challenge.seal import digest, draw_round

HERE = Path(__file__).parent
ROUNDS = HERE / "rounds.json"
ENTRANTS = {
    "prior": "regressions:prior", "stepwise": "regressions:stepwise", "sindy": "regressions:sindy",
    "mujoco": "with_mujoco:answer", "likelihood": "likelihood:answer", "rovid": "with_rovid:answer",
    "rovid_planar": "with_rovid:answer_planar",
}  # fmt: skip


def answered(entrant: str, campaigns: list[Campaign], path: Path, truths: dict[str, Any]) -> dict[str, Any]:
    """The document of an entrant; what it cannot answer is kept with the reason."""
    document: dict[str, Any] = {"entrant": entrant, "campaigns": {}, "failures": {}, "seconds": {}}
    if path.exists():
        document = json.loads(path.read_text(encoding="utf-8"))
    module, function = ENTRANTS[entrant].split(":")
    try:
        answer = getattr(importlib.import_module(f"benchmarks.challenge.{module}"), function)
    except ImportError as error:
        print(f"{entrant} is left out: {error}")
        return document
    for campaign in campaigns:
        if campaign.name in document["campaigns"] or campaign.name in document["failures"]:
            continue
        began = time.monotonic()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                said = answer(campaign)
            if wrong := problem(said, len(truths[campaign.name]["turns"])):
                raise ValueError(wrong)
            document["campaigns"][campaign.name] = said
        except Exception as error:  # noqa: BLE001 - an entrant that fails gets the score of no answer
            document["failures"][campaign.name] = f"{type(error).__name__}: {error}"
        document["seconds"][campaign.name] = round(time.monotonic() - began, 1)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(document) + "\n", encoding="utf-8")
        here = score(document["campaigns"].get(campaign.name), truths[campaign.name])
        print(f"{entrant:<11} {campaign.name} {here['cause']:<26} p {here['p']:.3f} {here['named'] or '-'}", flush=True)
    return document


def main() -> None:
    rounds = json.loads(ROUNDS.read_text(encoding="utf-8"))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--secret", help="of a round that is not open; by default that of the last open round")
    parser.add_argument("--campaigns", type=int, help="of each simulator, by default those of the round")
    parser.add_argument("--entrants", nargs="+", choices=list(ENTRANTS), default=list(ENTRANTS))
    parser.add_argument("--folder", type=Path, default=Path("build/challenge"))
    parser.add_argument("--page", type=Path, help="where to write the page, docs/challenge.md for instance")
    parser.add_argument("--seal", type=Path, metavar="FILE")
    options = parser.parse_args()
    if options.seal:
        secret = f"{secrets.token_hex(16)}:{secrets.randbelow(2**32)}"
        options.seal.write_text(secret + "\n", encoding="utf-8")
        print(digest(secret))
        return
    open_round = [
        one for one in rounds if one["secret"] or (options.secret and digest(options.secret) == one["sha256"])
    ]
    if not open_round:
        parser.error("no round is open; give the secret of one with --secret, or wait until it is revealed.")
    here = open_round[-1]
    secret = options.secret or here["secret"]
    if digest(secret) != here["sha256"]:
        parser.error(f"the secret of round {here['round']} does not have the published hash.")
    folder = options.folder / f"round_{here['round']}"
    draw_round(secret, options.campaigns or here["campaigns"], folder)
    truths = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    # The simulators alternate: an interrupted entrant has answered equally many campaigns of each.
    campaigns = [read_campaign(folder / name) for name in sorted(truths, key=lambda name: name.split("_")[1])]
    documents = {}
    for entrant in ENTRANTS:
        path = folder / "answers" / f"{entrant}.json"
        if entrant in options.entrants:
            given = [one for one in campaigns if entrant != "rovid_planar" or one.is_coupled]
            documents[entrant] = answered(entrant, given, path, truths)
        elif path.exists():
            documents[entrant] = json.loads(path.read_text(encoding="utf-8"))
    asked = {entrant: {name: truths[name] for name in truths if name in one["seconds"]}
             for entrant, one in documents.items()}  # fmt: skip
    results = {entrant: scored(one, asked[entrant]) for entrant, one in documents.items() if asked[entrant]}
    print(write_page(results, documents, here, options.page))


if __name__ == "__main__":
    main()
