"""Drag that differs between the two directions of turning."""

from dataclasses import replace

from rovid.effects.base import Effect, EffectParameter, Instant, Numbers, Term, compiled, drag, where_nonnegative


@compiled
def _all_drag(at: Instant, p: Numbers) -> float:
    return where_nonnegative(at.relative_rate, 0.0, -(p[0] - 1.0) * drag(at.body, at.relative_rate))


@compiled
def _quadratic(at: Instant, p: Numbers) -> float:
    return where_nonnegative(
        at.relative_rate, 0.0, -(p[0] - 1.0) * at.body.quadratic_drag * abs(at.relative_rate) * at.relative_rate
    )


EFFECT: Effect = Effect(
    id="drag_asymmetry",
    title="asymmetric drag",
    parameters=(EffectParameter(name="ratio", unit="1", neutral=1.0, low=0.3, high=3.0, initial_values=(1.1, 0.9)),),
    equation="drag times a where r < 0",
    fingerprint="residual torque in proportion to |r|·r in one direction only, both under thrust and in coast-downs",
    experiment="coast-downs from both directions",
    rivals=("thrust_asymmetry", "bias_torque"),
    acts=Term(_all_drag),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(EFFECT, form="quadratic", equation="quadratic drag alone times a where r < 0", acts=Term(_quadratic)),
)
