"""Water that co-rotates after long turning and reduces the drag."""

from dataclasses import replace

from rovid.effects.base import (
    REFERENCE_RATE,
    Effect,
    EffectParameter,
    Instant,
    Numbers,
    Term,
    Values,
    compiled,
    drag,
    where_nonnegative,
)


@compiled
def _linear(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    return drag(at.body, at.rate) - drag(at.body, at.relative_rate), (at.rate - x[0]) / p[1]


@compiled
def _share(p: Numbers, x: Numbers) -> float:
    return p[0] * x[0]


@compiled
def _annulus(at: Instant, p: Numbers, x: Numbers) -> tuple[float, float]:
    # Wall friction that balances the drag if the hull turns at the reference rate and the water at its share of that.
    water, relative = p[0] * REFERENCE_RATE, (1.0 - p[0]) * REFERENCE_RATE
    friction = drag(at.body, relative) / (water * water)
    slope = 2.0 * at.body.quadratic_drag * relative + at.body.linear_drag
    inertia = p[1] * (slope + 2.0 * friction * water)
    pull = drag(at.body, at.rate - x[0])
    change = (pull - friction * abs(x[0]) * x[0]) / (inertia + 1e-150)
    # A share of zero means no such water.
    return where_nonnegative(-p[0], 0.0, drag(at.body, at.rate) - pull), where_nonnegative(-p[0], 0.0, change)


@compiled
def _state(p: Numbers, x: Numbers) -> float:
    return x[0]


def _fastest(values: Values) -> float:
    return 1.0 / values["time_constant"]


def _unknown_start(values: Values, rate: float, acceleration: float) -> tuple[float, ...]:
    """The state of the water is a rate of the vehicle."""
    return (rate,)


EFFECT: Effect = Effect(
    id="entrained_swirl",
    axes=("yaw",),
    title="entrained swirl",
    parameters=(
        EffectParameter(name="coupling", unit="1", high=0.9, initial_values=(0.1,)),
        EffectParameter(
            name="time_constant",
            unit="s",
            neutral=1.0,
            low=0.3,
            high=300.0,
            initial_values=(4.0, 20.0, 90.0),
            scale="time",
        ),
    ),
    equation="all drag of r − s·w in place of r, τ·dw/dt = r − w",
    fingerprint="a rate that creeps up in long holds; rotation that continues after a stop; more drag at a reversal",
    experiment="several turns in one direction, rest, and the same turns back",
    rivals=("tether_torsion", "oscillatory_drag", "added_mass_memory"),
    acts=Term(_linear, states=1, fastest=_fastest, entrained_rate=_share, unknown_start=_unknown_start),
)
FORMS: tuple[Effect, ...] = (
    EFFECT,
    replace(
        EFFECT,
        form="annulus",
        equation="all drag of r − w in place of r, If·dw/dt = drag − C·|w|·w; s = w/r and τ as at r = 0.3 rad/s",
        acts=Term(_annulus, states=1, fastest=_fastest, entrained_rate=_state, unknown_start=_unknown_start),
    ),
)
