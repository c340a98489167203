"""Section on simulated campaigns of docs/discover.md, and one campaign in a line of the terminal."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.wide_page import aligned_table, wrapped
from tools.beyond import CAUSES

Record = dict[str, Any]
BEGIN, END = "<!-- formulas: begin -->", "<!-- formulas: end -->"
GOAL = 0.8  # share of what the true cause would remove
VISIBLE = 20.0  # nats of held-out log-likelihood, from which an effect counts as visible
NOTHING = "nothing"
TORQUE = "thruster_torque"
# Effect -> the sets of signals that drive it; the thrust of a single thruster counts as the torque of all.
DRIVERS: dict[str, tuple[set[str], ...]] = {
    **dict.fromkeys(
        ("thruster_deadband", "thrust_asymmetry", "thrust_curve_shape", "supply_sag", "thruster_lag", "command_delay",
         "slew_limit", "command_hysteresis"),
        ({TORQUE},),
    ),
    **dict.fromkeys(("drag_curvature", "drag_asymmetry", "coulomb_resistance", "oscillatory_drag"), ({"rate"},)),
    # By the equation of motion the rate and the torque give the acceleration.
    **dict.fromkeys(("added_mass_memory", "entrained_swirl", "tank_seiche"), ({"rate"}, {TORQUE}, {"rate", TORQUE})),
    "thruster_imbalance": ({"thrust"},),
    "advance_speed_loss": ({"rate", TORQUE},),
    "bias_torque": (set(),),
    "tether_torsion": ({"angle"},),
    "heading_dependent_torque": ({"heading"},),
    "heading_deviation": ({"heading"}, {"heading", "rate"}),
    "speed_dependent_damping": ({"rate", "surge_velocity"},),
    "sideslip_moment": ({"sway_velocity"},),
}  # fmt: skip


_STRUCK = """\
One effect is hidden in a calm campaign of the ROSUB 6000 (seven runs, 5 Hz, disturbance of 2.5 N m), and struck from \
the catalogue. The reference is the held-out log-likelihood gain of the struck effect next to the plain model. *Share* \
is the part of the reference that the best formula reaches with the causes next to it. Without a formula it is the \
part that the causes reach. The names are those of the remaining catalogue, so each is a stand-in. Seeds are separated \
by /. The products of drag relative to moving water and to a wake came after seeds 1 and 2, of which only \
oscillatory_drag and entrained_swirl were repeated, and after most campaigns with nothing hidden."""
_OUTSIDE = """\
`tools/beyond.py` simulates two vehicles with the cause, and was written without knowledge of the search. The products \
of roots of two thrusts, the term of a cause's own signal and the test of waves against the thrust came later, after \
seed 1 of interference, coanda and mast; the products of drag relative to moving water came after keulegan_carpenter, \
with seed 1 repeated. *Removed* is \
the share of the mean square error of the free-running rate on three further runs that the best formula removes, or \
the causes if each of them is apt. The error is that against the rate without disturbance. *Error without* is its RMS \
with the plain model, as a share of the RMS rate."""


def held_out_share(record: Record) -> float:
    """Largest share of the struck effect's held-out gain that a formula reaches, with the causes next to it."""
    gains = [one["held_out_nats"] + record["causes_nats"] * bool(one["beside"]) for one in record["formulas"][:1]]
    return float(max([record["causes_nats"], *gains]) / record["reference_nats"])


def removed(record: Record) -> float:
    """Share of the mean square error of the rate on further runs that the best formula removes, or an apt cause."""
    apt = record["removed_by_causes"] if record["causes"] and not wrong_names(record) else 0.0
    return float(max([apt, *record["removed_by_formulas"][:1]]))


def wrong_names(record: Record) -> list[str]:
    """Established causes that are not akin to the hidden one; for each a tie or an alternative may be apt."""
    akin = CAUSES[record["hidden"]].akin if record["kind"] == "beyond" else ()
    return [
        f"{one['effect']} ({one['evidence']})"
        for one in record["established"]
        if not {one["effect"], one["effect"].partition(":")[0], *one["or"]} & {*akin}
    ]


def right_signals(record: Record) -> bool:
    """Whether the best formula has the signals that drive the struck effect, and no others."""
    if not record["formulas"]:
        return False
    single = record["hidden"] == "thruster_imbalance"
    names = {
        "thrust" if single and one.startswith("thrust:") else TORQUE if one.startswith("thrust:") else one
        for one in record["formulas"][0]["signals"]
    }
    return names in DRIVERS.get(record["hidden"], ())


def _plain_error(record: Record) -> float:
    return float(record["plain_error"])


def line_of(record: Record) -> str:
    """One campaign in a line of the terminal."""
    head = f"{record['kind']:<6} {record['hidden']:<24} seed {record['seed']:2d}"
    if "failure" in record:
        return f"{head} {record['failure']}"
    if record["kind"] == "struck":
        known = record["reference_nats"] >= VISIBLE
        gain = f"{record['reference_nats']:7.0f} nats, share {held_out_share(record):5.2f}" if known else "not visible"
    else:
        gain = f"removed {removed(record):5.2f}"
    named = ", ".join(f"{one['effect']} ({one['evidence']})" for one in record["established"]) or "-"
    seconds = " + ".join(f"{one:.0f}" for one in record["seconds"])
    return f"{head} {gain}  {_best(record)}  [{named}]  {seconds} s"


def _best(record: Record) -> str:
    if not record["formulas"]:
        return "none"
    best = record["formulas"][0]
    return f"`{best['formula']}`" + (f" next to {' and '.join(best['beside'])}" if best["beside"] else "")


def _shares(records: Iterable[Record], share: Callable[[Record], float]) -> str:
    return " / ".join(f"{share(record):.2f}" for record in records)


def _names(records: Iterable[Record]) -> str:
    every = dict.fromkeys(f"{one['effect']}, {one['evidence']}" for r in records for one in r["established"])
    return "; ".join(every) or "none"


def _count(records: Sequence[Record], good: Callable[[Record], bool]) -> str:
    return f"{sum(map(good, records))} of {len(records)}"


def _grouped(records: Sequence[Record]) -> dict[str, list[Record]]:
    names = dict.fromkeys(record["hidden"] for record in records)
    return {name: [record for record in records if record["hidden"] == name] for name in names}


def section(records: Sequence[Record]) -> str:
    """The section for all campaigns."""
    records = sorted((one for one in records if "failure" not in one), key=lambda one: one["seed"])
    bare = [one for one in records if one["hidden"] == NOTHING]
    struck = [one for one in records if one["kind"] == "struck" and one["hidden"] != NOTHING]
    visible = [one for one in struck if one["reference_nats"] >= VISIBLE]
    outside = [one for one in records if one["kind"] == "beyond" and one["hidden"] != NOTHING]
    parts = [
        "## Results in simulated campaigns",
        "### Effects that were struck from the catalogue",
        _STRUCK,
        _struck_counts(struck, visible, bare),
        aligned_table(
            ["struck effect", "reference, nats", "share", "best formula, first seed", "names established"],
            [
                [
                    name,
                    f"{statistics.median(one['reference_nats'] for one in some):.0f}",
                    _shares(some, held_out_share),
                    _best(some[0]),
                    _names(some),
                ]
                for name, some in _grouped(visible).items()
            ],
        ),
        "### Ten causes of no catalogue",
        _OUTSIDE,
        _outside_counts(outside),
        aligned_table(
            ["hidden cause", "error without", "removed", "best formula, first seed", "names established"],
            [
                [name, _shares(some, _plain_error), _shares(some, removed), _best(some[0]), _names(some)]
                for name, some in _grouped(outside).items()
            ],
        ),
        "### Failures",
        "\n".join(_failures(visible, outside, bare)) or "None.",
    ]
    return "\n\n".join(wrapped(part) for part in parts)


def _struck_counts(struck: Sequence[Record], visible: Sequence[Record], bare: Sequence[Record]) -> str:
    unseen = sorted({one["hidden"] for one in struck} - {one["hidden"] for one in visible})
    reached = _count(visible, lambda one: held_out_share(one) >= GOAL)
    offered = _count(bare, lambda one: bool(one["formulas"]))
    text = (
        f"A share of {GOAL} or more: {reached} campaigns. The best formula has the signals of the struck effect in "
        f"{_count(visible, right_signals)}. With nothing hidden a formula is offered in {offered}."
    )
    left = sorted({*DRIVERS} - {one["hidden"] for one in struck})
    text += f" Without a reference of {VISIBLE:.0f} nats: {', '.join(unseen)}." if unseen else ""
    return text + (f" Not run yet: {', '.join(left)}." if left else "")


def _outside_counts(outside: Sequence[Record]) -> str:
    wrong = _count(outside, lambda one: bool(wrong_names(one)))
    confirmed = _count(outside, lambda one: any("confirmed" in name for name in wrong_names(one)))
    return (
        f"{GOAL:.0%} or more: {_count(outside, lambda one: removed(one) >= GOAL)} campaigns. A name that is not apt is "
        f"established in {wrong}, and confirmed in {confirmed}."
    )


def _failures(struck: Sequence[Record], outside: Sequence[Record], bare: Sequence[Record]) -> list[str]:
    found = [f"- {one['hidden']}, seed {one['seed']}: the share is {held_out_share(one):.2f}."
             for one in struck if held_out_share(one) < GOAL]  # fmt: skip
    for one in outside:
        if removed(one) < GOAL:
            found.append(f"- {one['hidden']}, seed {one['seed']}: {removed(one):.2f} of the error is removed.")
        if names := wrong_names(one):
            found.append(f"- {one['hidden']}, seed {one['seed']}: {', '.join(names)} is established.")
    return found + [f"- nothing hidden, seed {one['seed']}: {_best(one)}." for one in bare if one["formulas"]]


def write_section(path: Path, records: Sequence[Record]) -> None:
    """Replace the section between its markers."""
    before, _, rest = path.read_text(encoding="utf-8").partition(BEGIN)
    whole = f"{before}{BEGIN}\n\n{section(records)}\n\n{END}{rest.partition(END)[2]}"
    path.write_text(whole, encoding="utf-8")
