"""Roll decays of a tanker's model."""

from __future__ import annotations

from benchmarks.gallery import pictures
from benchmarks.gallery.base import SAMPLES, Picture, RealSet, Step, model_steps
from benchmarks.gallery.judge import (
    RIGHT,
    UNDECIDED,
    WRONG,
    Cause,
    Claim,
    Document,
    Reader,
    Reading,
    names,
    number,
    parameter,
)

_KEY = "kvlcc2"
_STEPS = model_steps(_KEY, "roll")
_BOTH = "--effect speed_dependent_damping --effect restoring_curve"


def _swing(name: str) -> Reader:
    """Reads the damping ratio of the largest swing of one log."""

    def read(document: Document) -> Reading | None:
        swings = {swing["name"]: swing for swing in document["decay"]["swings"]}
        return parameter(name, "damping_ratio")(swings)

    return read


DECAY = RealSet(
    key=_KEY,
    title="KVLCC2: roll decays of a model tanker",
    about="A 1:68 model of the tanker KVLCC2 in a towing tank of SSPA, 2018: heeled and released, without "
    "thrusters. Two decays are at rest, one is under way at 15.5 kn (full scale). Every fifth reading is used, "
    "at 20 Hz.",
    source="M. Alexandersson, Mendeley Data, doi 10.17632/2stvkyngj9.1, CC BY 4.0, through "
    "github.com/martinlarsalbert/Prediction-of-roll-motion-using-fully-nonlinear-potential-flow-and-Ikedas-method at "
    "cce8abd. The logs come with rovid as `sample_logs/kvlcc2_roll_decay`.",
    logs="kvlcc2_roll_decay/decay_*.csv",
    texts={"rovid.toml": (SAMPLES / "kvlcc2_roll_decay" / "rovid.toml").read_text(encoding="utf-8")},
    steps=(
        *_STEPS[:3],
        Step(name="told", words=f"fit {_KEY} --axis roll {_BOTH} -p told.toml"),
        Step(name="told run", words="simulate -p told.toml --mcap told", needs="told.toml"),
        *_STEPS[3:],
    ),
    claims=(
        Claim(
            known="The natural period is 2.54 s, from the times of the peaks; the required accuracy is 0.5 %",
            step="fit",
            judge=number(parameter("decay", "natural_period"), 0.995 * 2.54, 1.005 * 2.54, "s", sharp=0.01),
        ),
        Claim(
            known="Stiffness over inertia is less than 7.10 1/s²: weight and metacentric height give 822 N "
            "m/rad, the mass and radius of gyration of the model give 115.7 kg m², and the water adds inertia",
            step="fit",
            judge=number(parameter("decay", "over_inertia", "restoring_stiffness"), 0.0, 822.0 / 115.7, "1/s²"),
            remarks={RIGHT: "The difference is added inertia."},
        ),
        Claim(
            known="The damping ratio of the first swings at rest (`decay_21337.csv`) is 0.0086 to 0.0095, from "
            "the heights of the first five to seven peaks. Compared with the fit that includes both causes",
            step="told",
            judge=number(_swing("decay_21337.csv"), 0.0086, 0.0095),
            remarks={
                WRONG: "The first swings have more damping than the linear and quadratic drag that fit the whole "
                "decay. The standard error does not include this difference."
            },
        ),
        Claim(
            known="Under way (`decay_21340.csv`) the damping ratio is 0.0145 to 0.0152, from the same analysis",
            step="told",
            judge=number(_swing("decay_21340.csv"), 0.0145, 0.0152),
        ),
        Claim(
            known="Damping grows with the ship's speed: the peak heights of swings of 5 to 7 deg give a damping "
            "ratio of 0.006 at rest and of 0.013 under way",
            step="diagnose",
            judge=names("speed_dependent_damping", by_name=True),
            remarks={
                WRONG: "The effect fits well if requested by name, but the diagnosis does not name it.",
                UNDECIDED: "The effect fits well if requested by name; the diagnosis names it as a member of a "
                "class at most.",
            },
        ),
        Claim(
            known="The restoring torque is nonlinear: in another program a cubic term reduces the error at rest "
            "to a ninth",
            step="diagnose",
            judge=names("restoring_curve", by_name=True),
        ),
    ),
    causes=(
        Cause(
            effects=("speed_dependent_damping",),
            acts=True,
            why="The heights of the peaks show the effect without a model.",
        ),
        Cause(
            effects=("restoring_curve",),
            acts=True,
            why="The righting arm of a hull is nonlinear; a cubic term removes most of the error at rest.",
        ),
        Cause(
            effects=("coulomb_resistance",),
            acts=None,
            why="Damping at rest that is neither linear nor quadratic looks similar; no friction is known.",
        ),
    ),
    pictures=(
        Picture(
            name="real_kvlcc2.png",
            caption="The decays from their release on, with the envelope of each model's free-running "
            "simulation. Data: M. Alexandersson, CC BY 4.0; cut and plotted by rovid.",
            draw=lambda room, _: pictures.decays(room, ("decay_21337", "decay_21338", "decay_21340")),
        ),
    ),
    ours="A decay test is made for period and damping, and the peaks alone verify both. The damping of the first "
    "swings shows that the form of the model is approximate.",
)
