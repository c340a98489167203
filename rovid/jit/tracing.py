"""Functions that go on the same way whatever the numbers are, which compiled loops need not have compiled.

Where a loop that calls one is compiled, Python runs the function, on stand-ins for its numbers: each operation on these
writes its instruction into the loop. That takes a tenth of the time that numba takes to compile it, or less. Where
nothing is compiled the function is what it was.
"""

from __future__ import annotations

import dis
import functools
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import CellType, FunctionType, ModuleType
from typing import Any, NamedTuple, NoReturn, TypeVar

import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target

from rovid.jit.simd import constant_vector, register_intrinsic

Function = TypeVar("Function", bound=Callable[..., Any])
Kinds = tuple[types.Type, ...]

_STRAIGHT: set[Callable[..., Any]] = set()
_ANY = (types.VarArg(types.Any),)  # type: ignore[no-untyped-call]  # numba ships no types


def traced(function: Function) -> Function:
    """``function``, which compiled code may call too: of numbers, lanes, arrays and tuples of them, by position.

    What it calls is known to numba, or straight itself. It may ask for what is no number of the loop, such as whether a
    constant range is over; numba has to compile what asks for more.
    """

    def generate(context: Any, builder: Any, kinds: Kinds, values: Any) -> Any:
        return _Loop(context, builder).written(function, kinds, values)

    register_intrinsic(function, lambda *kinds: (_result(function, kinds), *kinds), generate, _ANY)
    _STRAIGHT.add(function)
    return function


def switch(functions: Mapping[int, Callable[..., Any]], otherwise: Callable[..., Any]) -> Callable[..., Any]:
    """(number, ...) -> what the straight function of that number makes of the rest; compiled code may call it too.

    All of them give what is of one kind. Which of them it is takes a single jump.
    """

    def chosen(number: int, *arguments: Any) -> Any:
        return functions.get(number, otherwise)(*arguments)

    def typed(number: Any, *kinds: Any) -> Any:
        (result,) = {_result(one, kinds) for one in (*functions.values(), otherwise)}
        return result, number, *kinds

    def generate(context: Any, builder: Any, kinds: Kinds, values: Any) -> Any:
        loop, result = _Loop(context, builder), context.get_value_type(_result(otherwise, kinds[1:]))
        room = cgutils.alloca_once(builder, result)  # type: ignore[no-untyped-call]  # as above
        behind, other = builder.append_basic_block(), builder.append_basic_block()
        jump = builder.switch(values[0], other)
        blocks = {number: builder.append_basic_block() for number in functions}
        for number, block in blocks.items():
            jump.add_case(values[0].type(number), block)
        for block, function in zip((*blocks.values(), other), (*functions.values(), otherwise), strict=True):
            builder.position_at_end(block)
            builder.store(loop.written(function, kinds[1:], values[1:]), room)
            builder.branch(behind)
        builder.position_at_end(behind)
        return builder.load(room)

    register_intrinsic(chosen, typed, generate, _ANY)
    return chosen


def is_branch_free(function: Any) -> bool:
    """Whether a compiled ``function`` and all that it calls go on the same way whatever the numbers are."""
    if not isinstance(function, Dispatcher):
        return function in _STRAIGHT
    plain = function.py_func
    names = plain.__code__.co_names
    if {"min", "max"} & set(names) or any("JUMP" in step.opname for step in dis.get_instructions(plain)):
        return False
    called = [plain.__globals__.get(name) for name in names]
    return all(is_branch_free(one) for one in called if isinstance(one, Dispatcher))


@functools.cache
def _result(function: Callable[..., Any], kinds: Kinds) -> types.Type:
    """The kind of what ``function`` gives of arguments of such ``kinds``."""
    loop = _Loop(None, None)
    return loop.taken(_taking(function)(*(loop.given(kind, None) for kind in kinds)))[0]


@functools.cache
def _resolved(function: Any, kinds: Kinds) -> tuple[Any, Any]:
    """What numba calls for ``function``, and its signature."""
    callee = cpu_target.typing_context.resolve_value_type(function)
    return callee, callee.get_call_type(cpu_target.typing_context, kinds, {})


class _Loop(NamedTuple):
    """Where instructions are written to; nowhere yet while their types are found out."""

    context: Any
    builder: Any

    def written(self, function: Callable[..., Any], kinds: Kinds, values: Sequence[Any]) -> Any:
        """What ``function`` gives of ``values`` of such ``kinds``."""
        return self.taken(_taking(function)(*map(self.given, kinds, values)))[1]

    def call(self, function: Any, arguments: Sequence[Any]) -> Any:
        """What a ``function`` that numba knows gives."""
        pairs = [self.taken(argument) for argument in arguments]
        callee, told = _resolved(function, tuple(kind for kind, _ in pairs))
        if not self.builder:
            return self.given(told.return_type, None)
        cast = functools.partial(self.context.cast, self.builder)
        values = [cast(value, kind, wanted) for (kind, value), wanted in zip(pairs, told.args, strict=True)]
        return self.given(told.return_type, self.context.get_function(callee, told)(self.builder, values))

    def given(self, kind: types.Type, value: Any) -> Any:
        """A stand-in for a ``value`` of that ``kind``, or a tuple of them."""
        if kind is types.none:
            return None
        return self._members(kind, value) if isinstance(kind, types.BaseTuple) else _StandIn(self, kind, value)

    def _members(self, kind: Any, value: Any) -> Any:
        members = [self.builder.extract_value(value, at) if self.builder else None for at in range(len(kind))]
        every = [self.given(own, member) for own, member in zip(kind.types, members, strict=True)]
        named = getattr(kind, "instance_class", None)
        return named(*every) if named else tuple(every)

    def taken(self, thing: Any) -> tuple[types.Type, Any]:
        """Kind and value of a stand-in, a number, or a tuple of them."""
        if isinstance(thing, _StandIn):
            return thing.kind, thing.value
        if isinstance(thing, tuple):
            members = [self.taken(one) for one in thing]
            named = type(thing) if hasattr(thing, "_fields") else None
            kind: Any = types.BaseTuple.from_types(  # type: ignore[no-untyped-call]  # as above
                [one for one, _ in members], named
            )
            values = [value for _, value in members]
            return kind, self.context.make_tuple(self.builder, kind, values) if self.builder else None
        if isinstance(thing, np.ndarray):
            return constant_vector(thing)
        kind = cpu_target.typing_context.resolve_value_type(thing)
        return kind, self.context.get_constant_generic(self.builder, kind, thing) if self.builder else None


class _StandIn:
    """For a number, lanes or an array of the loop."""

    # Lanes that are known beforehand are numpy's.
    __array_ufunc__: Any = None
    __eq__: Any = None
    __hash__: Any = None

    def __init__(self, loop: _Loop, kind: types.Type, value: Any) -> None:
        self.loop = loop
        self.kind = kind
        self.value = value

    def __bool__(self) -> NoReturn:
        raise TypeError("what goes straight on cannot ask how large a number is.")


def _operator(name: str, function: Callable[..., Any], *, turned: bool = False) -> None:
    def operate(*operands: Any) -> Any:
        return _call(function, *(reversed(operands) if turned else operands))

    setattr(_StandIn, name, operate)


for _name in ("add", "sub", "mul", "truediv", "neg", "abs", "getitem"):
    _operator(f"__{_name}__", abs if _name == "abs" else getattr(operator, _name))
    if _name in ("add", "sub", "mul", "truediv"):
        _operator(f"__r{_name}__", getattr(operator, _name), turned=True)


def _call(function: Any, *arguments: Any) -> Any:
    """What ``function`` gives: written into the loop where there is a stand-in among the arguments."""
    loop = _loop_of(arguments)
    if loop is None:
        return function(*arguments)
    return _taking(function)(*arguments) if is_branch_free(function) else loop.call(function, arguments)


def _loop_of(things: Iterable[Any]) -> _Loop | None:
    for thing in things:
        loop = thing.loop if isinstance(thing, _StandIn) else _loop_of(thing) if isinstance(thing, tuple) else None
        if loop is not None:
            return loop
    return None


@functools.cache
def _taking(function: Any) -> Callable[..., Any]:
    """The same ``function``, or that which numba compiles, all that it calls by name taking stand-ins."""
    plain = function.py_func if isinstance(function, Dispatcher) else function
    cells = tuple(CellType(_seen(cell.cell_contents)) for cell in plain.__closure__ or ())
    known = {name: found if name == "__builtins__" else _seen(found) for name, found in plain.__globals__.items()}
    return FunctionType(plain.__code__, known, plain.__name__, plain.__defaults__, cells)


def _seen(found: Any) -> Any:
    if isinstance(found, ModuleType):
        return _Module(found)
    return functools.partial(_call, found) if callable(found) and not isinstance(found, type) else found


class _Module:
    """As a module, whose functions take stand-ins."""

    def __init__(self, module: ModuleType) -> None:
        self.module = module

    def __getattr__(self, name: str) -> Any:
        return _seen(getattr(self.module, name))
