"""The effect of a formula, as the text of a Python file in the form of a plug-in, and as the effect that it holds."""

from collections.abc import Mapping, Sequence
from typing import Any

from rovid.core.formatting import TextTemplates
from rovid.diagnose.formulas.grammar import HOURS, STATES, THRUST, Factor, Product
from rovid.effects import Effect
from rovid.effects.actuator_inputs import SPEEDS

_TEXTS = TextTemplates(__file__, "effect_file")
# Bounds and initial size of a coefficient, as torque over the RMS torque in use, where the product has its RMS.
_BOUND, _FIRST = 5.0, 0.03
# Range of a memory's time constant about its start.
_RANGE = 20.0


def names_of(products: Sequence[Product]) -> list[str]:
    """Names of the parameters: coefficients c1, c2, then time constants tau1, tau2 of products with a memory."""
    return [f"c{k}" for k in range(1, len(products) + 1)] + [f"tau{k + 1}" for k in _slow(products)]


def is_possible(products: Sequence[Product]) -> bool:
    """Whether one effect can hold all of the ``products``.

    It has room for four parameters, and for one series of the log. A sum of products of the log alone is one series.
    """
    if _is_series(products):
        return True
    logged = {product.logged for product in products if product.logged}
    uses_speed = any(SPEEDS[0] in product.signals for product in products)
    return len(logged) + uses_speed <= 1 and len(names_of(products)) <= 4


def _is_series(products: Sequence[Product]) -> bool:
    return len(products) > 1 and all(one.factors and one.logged == one.factors and not one.memory for one in products)


def equation(products: Sequence[Product]) -> str:
    """The formula in words of the signals."""
    return " + ".join(f"c{k}*{product.text}" for k, product in enumerate(products, start=1))


def effect_source(
    products: Sequence[Product], sizes: Sequence[float], units: Mapping[str, str], *, name: str, axis: str
) -> str:
    """Text of the file of an effect; ``sizes`` are the RMS values of the products."""
    slow = _slow(products)
    place = {k: len(products) + number for number, k in enumerate(slow)}
    terms, derivatives = [], []
    for k, product in enumerate(products):
        if k in place:
            state = f"x[{slow.index(k)}]"
            terms.append(f"p[{k}] * ({state} - {_code(product)})" if product.lags else f"p[{k}] * {state}")
            derivatives.append(f"({_code(product)} - x[{slow.index(k)}]) / p[{place[k]}]")
        else:
            terms.append(f"p[{k}] * {_code(product)}")
    body = f"    torque = {' + '.join(terms)}\n    return {', '.join(['torque', *derivatives])}\n"
    parameters = [
        _TEXTS["coefficient"].format(
            name=f"c{k + 1}",
            unit=product.unit_of_coefficient(units),
            low=-_BOUND / size,
            high=_BOUND / size,
            first=_FIRST / size,
            second=-_FIRST / size,
        )
        for k, (product, size) in enumerate(zip(products, sizes, strict=True))
    ]
    for k in slow:
        start = products[k].memory
        parameters.append(
            _TEXTS["memory"].format(name=f"tau{k + 1}", start=start, low=start / _RANGE, high=start * _RANGE)
        )
    column = _series_code(next((product.logged for product in products if product.logged), ()))
    if _is_series(products):
        terms = [f'values["c{k}"] * {_series_code(product.factors)}' for k, product in enumerate(products, start=1)]
        column = " + ".join(terms)
        # The series itself is zero without coefficients; an instant that does not come from it may have any value.
        body = "    return at.surge if p[0] != 0.0 or p[1] != 0.0 else 0.0\n"
    signals = tuple(dict.fromkeys(signal for product in products for signal in product.signals))
    functions, options = "", ""
    if slow:
        functions += _TEXTS["fastest"].format(constants=", ".join(f'values["tau{k + 1}"]' for k in slow) + ", 1e9")
        options += f", states={len(slow)}, fastest=_fastest"
    if column:
        functions += _TEXTS["signal"].format(code=column)
        options += ", surge_from_thrust=_signal"
    derived = {*STATES, HOURS} - {*SPEEDS}
    needed = tuple(s for s in signals if s not in derived and not s.startswith(THRUST))
    return _TEXTS["file"].format(
        id=name,
        title=f"formula of {' and '.join(signals) or 'a constant'}",
        axis=axis,
        states=", x" if slow else "",
        body=body,
        functions=functions,
        parameters="\n".join(parameters),
        equation=equation(products),
        signals=" or ".join(signals) or "the constant",
        needs=needed,
        count=max(len(products), 1),
        options=options,
    )


def effect_of(source: str) -> Effect:
    """The effect in the text of a file that `effect_source` wrote."""
    names: dict[str, Any] = {"__name__": "rovid_formula"}
    exec(compile(source, "<formula>", "exec"), names)  # noqa: S102 - the source is made here
    effect = names["EFFECT"]
    assert isinstance(effect, Effect)  # noqa: S101 - for mypy
    return effect


def _series_code(factors: Sequence[Factor]) -> str:
    return " * ".join(factor.code(_column(factor.signal), "np.") for factor in factors)


def _column(signal: str) -> str:
    """Code of a column of the log, of the campaign's clock, or of one thruster's thrust."""
    if signal.startswith(THRUST):
        return f'thrust[:, inputs.names.index("{signal.removeprefix(THRUST)}")]'
    return "inputs.campaign_time / 3600.0" if signal == HOURS else f'inputs.extras["{signal}"]'


def _slow(products: Sequence[Product]) -> list[int]:
    return [k for k, product in enumerate(products) if product.memory]


def _code(product: Product) -> str:
    """Code of a product in a compiled term, without its memory."""
    parts = [factor.code(STATES[factor.signal], "math.") for factor in product.factors if factor.signal in STATES]
    parts += ["at.surge"] * bool(product.logged)
    return " * ".join(parts) or "1.0"
