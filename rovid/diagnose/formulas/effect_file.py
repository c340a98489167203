"""The effect of a formula, as the text of a Python file in the form of a plug-in, and as the effect that it holds."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

from rovid.core.formatting import TextTemplates
from rovid.diagnose.formulas.products import HOURS, OPERATORS, STATES, THRUST, Factor, Product
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
    law = _Law.of(products)
    column, imports = _series(products)
    signals = tuple(dict.fromkeys(signal for product in products for signal in product.signals))
    functions, options = "", ""
    if law.states:
        functions += _TEXTS["fastest"].format(rates=law.fastest)
        options += f", states={law.states}, fastest=_fastest"
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
        states=", x" if law.states else "",
        body=law.body,
        functions=functions,
        parameters="\n".join(_parameters(products, sizes, units)),
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


class _Law(NamedTuple):
    """The compiled term of a formula."""

    body: str  #: Code.
    states: int  #: Number of states.
    fastest: str  #: Code of the fastest rates of change of the states, comma-separated.

    @classmethod
    def of(cls, products: Sequence[Product]) -> Self:
        if _is_series(products):
            # The series itself is zero without coefficients; an instant that does not come from it may have any value.
            used = " or ".join(f"p[{k}] != 0.0" for k in range(len(products)))
            return cls(f"    return at.surge if {used} else 0.0\n", 0, "")
        places = {name: f"p[{k}]" for k, name in enumerate(names_of(products))}
        terms, derivatives, fastest = [], list[str](), ["1e-9"]
        for k, product in enumerate(products, start=1):
            now, past, first = _code(product.factors), "at.surge", len(derivatives)
            if product.states:
                operator, constants = OPERATORS[product.operator], [*product.units_of_constants(k)]
                past = f"x[{first}]"
                inside = {f"c{n}": places[name] for n, name in enumerate(constants)}
                inside |= {"u": now, "x0": past, "x1": f"x[{first + 1}]"}
                derivatives += [code.format(**inside) for code in operator.derivatives]
                values = {f"c{n}": f'values["{name}"]' for n, name in enumerate(constants)}
                fastest.append(operator.fastest.format(**values))
            if product.operator:
                beside = [_code(product.outside)] * bool(product.outside)
                now = " * ".join([*beside, f"({past} - {now})" if product.is_change else past])
            terms.append(f"p[{k - 1}] * {now}")
        body = f"    torque = {' + '.join(terms)}\n    return {', '.join(['torque', *derivatives])}\n"
        return cls(body, len(derivatives), ", ".join(fastest))


def _parameters(products: Sequence[Product], sizes: Sequence[float], units: Mapping[str, str]) -> list[str]:
    """Code of the parameters, in the order of `names_of`."""
    found = [
        _TEXTS["coefficient"].format(
            name=f"c{k}",
            unit=product.unit_of_coefficient(units),
            low=-_BOUND / size,
            high=_BOUND / size,
            first=_FIRST / size,
            second=-_FIRST / size,
        )
        for k, (product, size) in enumerate(zip(products, sizes, strict=True), start=1)
    ]
    for k, product in enumerate(products, start=1):
        for (name, unit), start in zip(product.units_of_constants(k).items(), product.constants, strict=True):
            low, high = start / _RANGE, start * _RANGE
            found.append(_TEXTS["constant"].format(name=name, unit=unit, start=start, low=low, high=high))
    return found


def _series(products: Sequence[Product]) -> tuple[str, str]:
    """Code of the one series that takes the place of the speed ahead, and the import that it needs; "" for none."""
    if _is_series(products):
        terms = [f'values["c{k}"] * {_series_code(product.factors)}' for k, product in enumerate(products, start=1)]
        return " + ".join(terms), ""
    for k, product in enumerate(products, start=1):
        if product.of_series:
            function, (constant,) = OPERATORS[product.operator].function.__name__, product.units_of_constants(k)
            torque = "inputs.weighted_sum(thrust, inputs.arms)"
            column = f'inputs.apply_per_trial({function}, {torque}, values["{constant}"])'
            return column, f"from rovid.effects.actuator_dynamics import {function}\n"
    return _series_code(next((product.logged for product in products if product.logged), ())), ""


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
