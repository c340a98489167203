"""Folders of damaged logs, in `tests/cases`, and what is right to say of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

S = {"inertia": 300.0, "quadratic_drag": 120.0, "linear_drag": 15.0}
F = {"inertia": 3000.0, "quadratic_drag": 2200.0, "linear_drag": 120.0}
P = {"inertia": 24.0, "quadratic_drag": 42.0, "linear_drag": 7.5}
# The logs of P hold a pause of 7 s, repeated stamps and cells without heading besides.
ALSO_P = frozenset({"heading_gaps", "lost_rows", "repeated_stamps"})

NOTHING = frozenset({"nothing_found"})
# No hidden cause, and the damage may leave too little.
NO_CAUSE = frozenset({"nothing_found", "too_little_data"})
STOPPED = frozenset({"bad_logs"})


@dataclass(frozen=True, kw_only=True)
class Expected:
    """A fault: where, when (s) and how large (s, rad or 1)."""

    fault: str
    logs: Sequence[str]  #: What their names begin with: these, and no others; empty: not asked for.
    or_logs: Sequence[str] = ()  #: Or these in their place.
    #: Instants of each log in ``logs``, or one for all; empty: not asked for.
    at: Sequence[float] = ()
    at_within: float = 0.15
    size: float | None = None
    size_within: float = 0.0
    either_sign: bool = False
    #: Remedies of which one is applied; empty: not asked for.
    remedies: frozenset[str] = frozenset()


@dataclass(frozen=True, kw_only=True)
class Case:
    """A folder of logs and what is right to say of it."""

    name: str
    faults: Sequence[Expected] = ()
    also: frozenset[str] = frozenset()  #: Faults that may be told besides.
    faults_by: Sequence[str] = ("check", "diagnose")
    truth: Mapping[str, float] = field(default_factory=dict)
    widest: float = 1.0  #: Factor of ``WIDEST``.
    #: Pattern of a message that may stand in the place of an answer; None: there is to be an answer.
    refused: str | None = None
    verdicts: frozenset[str] = NOTHING
    causes: frozenset[str] = frozenset()  #: Causes that may be found or suspected.
    no_go: bool | None = False  #: Whether check says no go; None: as the fit ends.
    says: str = ""  #: Pattern in the texts of the faults.
    never: str = ""  #: Pattern that no output holds.
    trials: int | None = None
    samples: tuple[int, int] | None = None  #: Fewest and most that a fit uses.
    silent: bool = False  #: No remark and no fault at all.
    commands: Sequence[str] = ("check", "fit", "diagnose")


ALL_S = ("aft_only", "fore_only", "hold_a", "hold_b", "prbs", "sine_10", "sine_20", "steps")
ALL_F = ("hold_a", "hold_b", "hold_c", "prbs", "sine_20", "sine_40", "steps")
ALL_P = tuple(f"fahrt{k:02}" for k in (1, 2, 3, 5, 6, 8, 9))
JOINED_P = tuple(f"fahrt{k:02}" for k in range(1, 11))
ASKED = ("check", "fit")
OUTRIGHT = frozenset({"cut"})


def wild(part: str, at: float) -> Case:
    """One stamp of hold_a is wild, in a file of another kind each."""
    expected = Expected(
        fault="wild_stamp", logs=("hold_a",), at=(at,), at_within=0.25, remedies=frozenset({"left_out"})
    )
    return Case(name=f"wild_stamp/{part}", faults=(expected,), truth=S, commands=ASKED, samples=(1190, 1202))


LAG = "thruster_lag.time_constant"


def lagging(name: str, *truth: float, joined: bool = True, also: frozenset[str] = frozenset()) -> Case:
    """Small vehicles with a lag of the thrust and nothing else; ``truth``: inertia, drags and lag."""
    return Case(
        name=name,
        truth=dict(zip(("inertia", "quadratic_drag", "linear_drag", LAG), truth, strict=True)),
        # Commands of a clock of their own may be late instead.
        also=also | {"clocks_apart"} if joined else also,
        verdicts=frozenset({"found"}),
        causes=frozenset({"thruster_lag"}),
        # The plain model is wrong, and without it a lag looks like a clock that is behind.
        commands=("diagnose",),
    )


TABLE = (
    # Each log begins at the instant of a step: the vehicle is at rest, the command is on, and the thrust still zero.
    lagging("begins_with_a_step_1", 0.4035, 0.2543, 0.02356, 2.061, joined=False),
    lagging("begins_with_a_step_2", 10463.0, 20943.0, 13967.0, 0.379),
    lagging("slow_lag_joined", P["inertia"], P["quadratic_drag"], P["linear_drag"], 0.5, also=ALSO_P),
    lagging("slow_commands_1", 107.6, 235.4, 21.2, 0.494),
    # The plain model simulates poorly (R2 0.90), and the one with the lag well.
    lagging("slow_commands_2", 3.807, 9.186, 0.737, 0.649),
    Case(
        name="lost_rows",
        faults=(Expected(fault="lost_rows", logs=ALL_S, size=0.145, size_within=0.02),),
        truth=S,
        says=r"1[345](\.\d+)? ?%",
    ),
    Case(
        name="clock_back",
        faults=(
            # The step of one interval belongs to the log: from 29.9 to 29.2 s instead of 30.0 s.
            Expected(fault="clock_step", logs=ALL_S, at=(29.95,) * 8, size=-0.8, size_within=0.05),
        ),
        truth=S,
        says=r"0\.8\d* s",
    ),
    Case(
        name="heading_reset",
        faults=(
            Expected(
                fault="heading_step",
                logs=("hold_a", "prbs", "sine_20", "steps"),
                at=(66.05, 55.05, 66.05, 57.75),
                size=np.radians(25.0),
                size_within=np.radians(0.5),
                remedies=OUTRIGHT,
            ),
        ),
        truth=S,
    ),
    Case(
        name="heading_reset_ulg",
        faults=(
            Expected(
                fault="heading_step",
                logs=("hold_a", "prbs", "sine_20"),
                at=(65.95, 54.95, 65.95),
                size=np.radians(25.0),
                size_within=np.radians(0.5),
                remedies=OUTRIGHT,
            ),
        ),
        truth=S,
    ),
    Case(
        name="proto3_json_zero",
        faults=(
            Expected(
                fault="absent_zero",
                logs=("prbs", "sine_10", "sine_20", "steps"),  # those with rows of no thrust
                remedies=frozenset({"zero"}),
            ),
        ),
        truth=S,
        trials=6,
    ),
    Case(
        name="commands_end_early",
        faults=(
            Expected(
                fault="stale_commands",
                logs=tuple(f"r{k}" for k in range(5)),
                at=(22.1,) * 5,
                at_within=0.3,
                remedies=frozenset({"unknown", "left_out"}),
            ),
        ),
        truth={"inertia": 0.7},
        commands=ASKED,
    ),
    Case(name="db3_wal", truth=S, silent=True, trials=3, commands=ASKED),
    wild("csv", 20.0),
    wild("csv_first", 0.0),
    wild("mcap", 20.0),
    wild("mcap_first0", 0.0),
    wild("bin", 20.0),
    Case(name="nmea_ths", truth=S, refused=r"no HDT but \d+ THS", trials=2, commands=ASKED),
    Case(
        name="bursts",
        faults=(Expected(fault="arrival_bursts", logs=("hold_a", "prbs", "sine_20")),),
        truth=S,
        refused="arriv|packs",
        no_go=None,
        never=r"500 Hz|the signs of yaw_arm",
        commands=ASKED,
    ),
    Case(
        name="pwm_zero",
        # The vehicle turns by 18 deg and more in the 4 s in which no pulse is logged.
        faults=(
            Expected(fault="sentinel_command", logs=("hold_a", "prbs", "sine_20"), remedies=frozenset({"unknown"})),
        ),
        truth=S,
        never="clamp",
        commands=ASKED,
    ),
    Case(
        name="pwm_zero/clamp_as_advised",
        faults=(Expected(fault="sentinel_command", logs=ALL_S, remedies=frozenset({"zero"})),),
        truth=S,
        commands=ASKED,
    ),
    # Read, or the line, the cell and what it is.
    Case(name="csv_messages/thousands", truth=S, refused=r"(?s)hold_a\.csv:\d+.*'1\.000'.*thousand", commands=ASKED),
    Case(name="csv_messages/unitrow", truth=S, refused=r"(?s)hold_a\.csv:2.*\bunit", commands=ASKED),
    # Read, its motors taken for no vehicle; or the row that is no number.
    Case(
        name="three_header_rows",
        refused=r"(?i)(row|line) 2\b.*(text|unit)|\.csv:2\b|no heading and no command",
        commands=("init",),
    ),
    Case(
        name="nan_bursts_false_delay",
        faults=(Expected(fault="heading_gaps", logs=("hold_a", "prbs", "sine_20", "steps")),),
        truth=F,
    ),
    Case(
        name="gaps_crash",
        faults=(Expected(fault="heading_gaps", logs=("coast_04", "hold_01", "prbs_03", "prbs_05", "sine_02")),),
        truth={"inertia": 0.403, "quadratic_drag": 0.254, "linear_drag": 0.0236},
        verdicts=NOTHING,
    ),
    Case(name="few_holds_1", truth=F, refused="few|cannot", widest=4.0, commands=("fit-drag",)),
    Case(name="few_holds_8", truth=F, refused="few|cannot", widest=4.0, commands=("fit-drag",)),
    Case(
        name="same_run_other_heading",
        faults=(
            Expected(
                fault="same_run_twice",
                # Which of the two is named is open; all seven runs are.
                logs=ALL_F,
                remedies=frozenset({"counted_once"}),
            ),
        ),
        truth=F,
        samples=(12000, 13000),  # of 12681 samples, each in two logs
        commands=ASKED,
    ),
    Case(
        name="mixed_drag_silent",
        # The drag of these three is 1.2 times that of the others.
        faults=(
            Expected(
                fault="foreign_log",
                logs=("hold_b", "prbs", "sine_20"),
                or_logs=("hold_a", "hold_c", "sine_40", "steps"),
            ),
        ),
        truth={"inertia": 3000.0, "linear_drag": 120.0},
        refused="kinds|groups|belong",
        no_go=None,
        verdicts=NO_CAUSE | STOPPED,
    ),
    Case(
        name="foreign_logs",
        faults=(Expected(fault="foreign_log", logs=("fahrt21", "fahrt22"), remedies=frozenset({"set_aside"})),),
        also=ALSO_P,
        truth=P,
    ),
    Case(
        name="on_deck",
        faults=(Expected(fault="no_response", logs=("fahrt06",), remedies=frozenset({"set_aside"})),),
        also=ALSO_P,
        truth=P,
        commands=ASKED,
    ),
    Case(
        name="kgf_curve",
        faults=(Expected(fault="thrust_unit", logs=(), size=9.80665, size_within=0.5),),
        also=ALSO_P,
        refused="kgf",
        verdicts=STOPPED,
        no_go=True,
        says="kgf",
    ),
    Case(
        name="percent_and_volts",
        faults=(Expected(fault="unit_mismatch", logs=()),),
        also=ALSO_P,
        refused="unit",
        verdicts=STOPPED,
        no_go=True,
        says="unit",
        never="clamp",
    ),
    Case(
        name="clocks_13ms",
        faults=(Expected(fault="clocks_apart", logs=JOINED_P, size=0.013, size_within=0.004, either_sign=True),),
        also=ALSO_P,
        # The weaker reverse thrust hides it from what knows no causes.
        faults_by=("diagnose",),
        truth=P,
        verdicts=frozenset({"found"}),
        causes=frozenset({"thrust_asymmetry"}),
        commands=("check", "diagnose"),
    ),
    Case(
        name="clock_offset_named_memory",
        faults=(Expected(fault="clocks_apart", logs=ALL_F, size=0.5, size_within=0.05, either_sign=True),),
        truth=F,
        refused=r"0\.(49|50?)\d* ",
        no_go=None,
        verdicts=NOTHING | STOPPED,
        says=r"0\.(49|50?)\d* ",
    ),
    Case(
        name="half_scale_heading_endless",
        faults=(Expected(fault="scaled_heading", logs=(), size=0.5, size_within=0.05),),
        refused=r"half|0\.5",
        no_go=True,
        verdicts=STOPPED,
        says=r"half|0\.5",
    ),
    Case(
        name="saturated_heading_care",
        faults=(Expected(fault="saturated_sensor", logs=ALL_F),),
        also=frozenset({"heading_gaps"}),
        truth=F,
        refused="clipped|saturat|180 deg",
        no_go=None,
        commands=ASKED,
    ),
    Case(name="short_log", refused=".", no_go=True, verdicts=frozenset({"too_little_data", "bad_logs"})),
)
