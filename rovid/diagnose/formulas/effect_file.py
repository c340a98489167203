"""The effect of a formula, as the text of a Python file in the form of a plug-in, and as the effect that it holds."""

from collections.abc import Mapping, Sequence
from typing import Any

from rovid.core.formatting import TextTemplates
from rovid.diagnose.formulas.grammar import HOURS, OPERATORS, STATES, THRUST, Factor, Product
from rovid.effects import Effect
from rovid.effects.actuator_inputs import SPEEDS
from rovid.effects.base import TERM_PARAMETERS, TERM_STATES

_TEXTS = TextTemplates(__file__, "effect_file")
# Bounds and initial size of a coefficient, as torque over the RMS torque in use, where the product has its RMS.
_BOUND, _FIRST = 5.0, 0.03
# Range of an operator's constant about its start.
_RANGE = 20.0


def names_of(products: Sequence[Product]) -> list[str]:
    """Names of the parameters: coefficients c1, c2, then the constants of operators, as tau1 of a memory."""
    constants = [name for k, product in enumerate(products, start=1) for name in product.units_of_constants(k)]
    return [f"c{k}" for k in range(1, len(products) + 1)] + constants


def is_possible(products: Sequence[Product]) -> bool:
    """Whether one effect can hold all of the ``products``.

    It has room for four parameters, for two states, and for one series of the log. A sum of products of the log alone
    is one series.
    """
    if len(names_of(products)) > TERM_PARAMETERS or sum(one.states for one in products) > TERM_STATES:
        return False
    if _is_series(products):
        return True
    series = {product.logged for product in products if product.logged}
    of_series = sum(product.of_series for product in products)
    uses_speed = any(SPEEDS[0] in product.signals for product in products)
    return len(series) + of_series + uses_speed <= 1


def _is_series(products: Sequence[Product]) -> bool:
    logged = (one.factors and one.logged == one.factors and not one.operator for one in products)
    return len(products) > 1 and all(logged)


def equation(products: Sequence[Product]) -> str:
    """The formula in words of the signals."""
    return " + ".join(f"c{k}*{product.text}" for k, product in enumerate(products, start=1))


def effect_source(
    products: Sequence[Product], sizes: Sequence[float], units: Mapping[str, str], *, name: str, axis: str
) -> str:
    """Text of the file of an effect; ``sizes`` are the RMS values of the products."""
    names = names_of(products)
    terms, derivatives, fastest = [], list[str](), ["1e-9"]
    for k, product in enumerate(products):
        past = "at.surge" if product.of_series else ""
        if product.states:
            at = len(derivatives)
            past, operator = f"x[{at}]", OPERATORS[product.operator]
            own = [*product.units_of_constants(k + 1)]
            places = {f"c{n}": f"p[{names.index(name)}]" for n, name in enumerate(own)}
            places |= {"u": _code(product.factors), "x0": past, "x1": f"x[{at + 1}]"}
            derivatives += [code.format(**places) for code in operator.derivatives]
            values = {f"c{n}": f'values["{name}"]' for n, name in enumerate(own)}
            fastest.append(operator.fastest.format(**values))
        change = f" - {_code(product.factors)}" if product.is_change else ""
        beside = product.outside if past else product.factors
        now = [_code(beside)] * bool(beside or not past)
        terms.append(" * ".join([f"p[{k}]", *now, *[f"({past}{change})"] * bool(past)]))
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
    column, imports = _series_code(next((product.logged for product in products if product.logged), ())), ""
    for k, product in enumerate(products, start=1):
        constants = product.units_of_constants(k)
        for (constant, unit), start in zip(constants.items(), product.constants, strict=True):
            low, high = start / _RANGE, start * _RANGE
            parameters.append(_TEXTS["constant"].format(name=constant, unit=unit, start=start, low=low, high=high))
        if product.of_series:
            function = OPERATORS[product.operator].function.__name__
            imports = f"from rovid.effects.actuator_dynamics import {function}\n"
            (constant,) = constants
            torque = "inputs.weighted_sum(thrust, inputs.arms)"
            column = f'inputs.apply_per_trial({function}, {torque}, values["{constant}"])'
    if _is_series(products):
        terms = [f'values["c{k}"] * {_series_code(product.factors)}' for k, product in enumerate(products, start=1)]
        column = " + ".join(terms)
        # The series itself is zero without coefficients; an instant that does not come from it may have any value.
        used = " or ".join(f"p[{k}] != 0.0" for k in range(len(products)))
        body = f"    return at.surge if {used} else 0.0\n"
    signals = tuple(dict.fromkeys(signal for product in products for signal in product.signals))
    functions, options = "", ""
    if derivatives:
        functions += _TEXTS["fastest"].format(rates=", ".join(fastest))
        options += f", states={len(derivatives)}, fastest=_fastest"
    if column:
        functions += _TEXTS["signal"].format(code=column)
        options += ", surge_from_thrust=_signal"
    derived = {*STATES, HOURS} - {*SPEEDS}
    needed = tuple(s for s in signals if s not in derived and not s.startswith(THRUST))
    return _TEXTS["file"].format(
        id=name,
        title=f"formula of {' and '.join(signals) or 'a constant'}",
        axis=axis,
        imports=imports,
        states=", x" if derivatives else "",
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


def _code(factors: Sequence[Factor]) -> str:
    """Code of a product of factors in a compiled term; one series holds all that are logged."""
    parts = [factor.code(STATES[factor.signal], "math.") for factor in factors if factor.signal in STATES]
    parts += ["at.surge"] * any(factor.signal not in STATES for factor in factors)
    return " * ".join(parts) or "1.0"
