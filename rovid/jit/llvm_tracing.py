"""LLVM backend of branch-free functions: Python runs them once, and each operation writes its instruction.

Where a compiled loop calls a traced function, Python runs the function on stand-ins for its numbers. Each operation on
a stand-in writes an instruction into the loop. That takes a tenth of the time in which numba compiles the function.
Without compilation a traced function is an ordinary function.
"""

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

from rovid.jit.llvm_vector import constant_vector, register_intrinsic

Function = TypeVar("Function", bound=Callable[..., Any])
Types = tuple[types.Type, ...]

_TRACED: set[Callable[..., Any]] = set()
_ANY = (types.VarArg(types.Any),)  # type: ignore[no-untyped-call]  # numba ships no types


def traced(function: Function) -> Function:
    """Let compiled code call ``function`` with positional numbers, vectors, arrays and tuples of them.

    The function may call functions that numba knows, and other traced ones. It may branch on constants, such as the end
    of a range, but not on numbers of the loop: that raises `TypeError` during compilation.
    """

    def lower(context: Any, builder: Any, argument_types: Types, values: Any) -> Any:
        return _Trace(context, builder).run(function, argument_types, values)

    register_intrinsic(function, lambda *kinds: (_result_type(function, kinds), *kinds), lower, _ANY)
    _TRACED.add(function)
    return function


def switch(functions: Mapping[int, Callable[..., Any]], otherwise: Callable[..., Any]) -> Callable[..., Any]:
    """(number, ...) -> result of the branch-free function with that number; compiled to a single jump.

    All functions return the same type.
    """

    def chosen(number: int, *arguments: Any) -> Any:
        return functions.get(number, otherwise)(*arguments)

    def infer(number: Any, *kinds: Any) -> Any:
        (result,) = {_result_type(one, kinds) for one in (*functions.values(), otherwise)}
        return result, number, *kinds

    def lower(context: Any, builder: Any, kinds: Types, values: Any) -> Any:
        trace, result = _Trace(context, builder), context.get_value_type(_result_type(otherwise, kinds[1:]))
        slot = cgutils.alloca_once(builder, result)  # type: ignore[no-untyped-call]  # as above
        end, default = builder.append_basic_block(), builder.append_basic_block()
        jump = builder.switch(values[0], default)
        blocks = {number: builder.append_basic_block() for number in functions}
        for number, block in blocks.items():
            jump.add_case(values[0].type(number), block)
        for block, function in zip((*blocks.values(), default), (*functions.values(), otherwise), strict=True):
            builder.position_at_end(block)
            builder.store(trace.run(function, kinds[1:], values[1:]), slot)
            builder.branch(end)
        builder.position_at_end(end)
        return builder.load(slot)

    register_intrinsic(chosen, infer, lower, _ANY)
    return chosen


def is_branch_free(function: Any) -> bool:
    """Whether a compiled ``function`` and all that it calls run the same instructions for any numbers."""
    if not isinstance(function, Dispatcher):
        return function in _TRACED
    plain = function.py_func
    names = plain.__code__.co_names
    if {"min", "max"} & set(names) or any("JUMP" in step.opname for step in dis.get_instructions(plain)):
        return False
    called = [plain.__globals__.get(name) for name in names]
    return all(is_branch_free(one) for one in called if isinstance(one, Dispatcher))


@functools.cache
def _result_type(function: Callable[..., Any], argument_types: Types) -> types.Type:
    trace = _Trace(None, None)
    return trace.unwrap(_traceable(function)(*(trace.wrap(kind, None) for kind in argument_types)))[0]


@functools.cache
def _resolved(function: Any, argument_types: Types) -> tuple[Any, Any]:
    """Numba's type of ``function``, and its signature for these arguments."""
    callee = cpu_target.typing_context.resolve_value_type(function)
    return callee, callee.get_call_type(cpu_target.typing_context, argument_types, {})


class _Trace(NamedTuple):
    """Where instructions are written; both None during type inference, which writes none."""

    context: Any
    builder: Any

    def run(self, function: Callable[..., Any], argument_types: Types, values: Sequence[Any]) -> Any:
        """LLVM value of ``function`` for arguments of these types."""
        return self.unwrap(_traceable(function)(*map(self.wrap, argument_types, values)))[1]

    def call(self, function: Any, arguments: Sequence[Any]) -> Any:
        """Stand-in for the result of a ``function`` that numba knows."""
        pairs = [self.unwrap(argument) for argument in arguments]
        callee, sig = _resolved(function, tuple(kind for kind, _ in pairs))
        if not self.builder:
            return self.wrap(sig.return_type, None)
        cast = functools.partial(self.context.cast, self.builder)
        values = [cast(value, kind, wanted) for (kind, value), wanted in zip(pairs, sig.args, strict=True)]
        return self.wrap(sig.return_type, self.context.get_function(callee, sig)(self.builder, values))

    def wrap(self, kind: types.Type, value: Any) -> Any:
        """Stand-in for an LLVM value of this numba type, or a tuple of stand-ins."""
        if kind is types.none:
            return None
        return self._wrap_tuple(kind, value) if isinstance(kind, types.BaseTuple) else _StandIn(self, kind, value)

    def _wrap_tuple(self, kind: Any, value: Any) -> Any:
        members = [self.builder.extract_value(value, at) if self.builder else None for at in range(len(kind))]
        wrapped = [self.wrap(own, member) for own, member in zip(kind.types, members, strict=True)]
        named = getattr(kind, "instance_class", None)
        return named(*wrapped) if named else tuple(wrapped)

    def unwrap(self, thing: Any) -> tuple[types.Type, Any]:
        """Numba type and LLVM value of a stand-in, of a constant, or of a tuple of them."""
        if isinstance(thing, _StandIn):
            return thing.kind, thing.value
        if isinstance(thing, tuple):
            members = [self.unwrap(one) for one in thing]
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
    """Stands for a number, vector or array of the compiled loop."""

    # numpy leaves operations with an array of constants to the stand-in.
    __array_ufunc__: Any = None
    __eq__: Any = None
    __hash__: Any = None

    def __init__(self, trace: _Trace, kind: types.Type, value: Any) -> None:
        self.trace = trace
        self.kind = kind
        self.value = value

    def __bool__(self) -> NoReturn:
        raise TypeError("a traced function cannot branch on a number of the loop.")


def _define_operator(name: str, function: Callable[..., Any], *, reflected: bool = False) -> None:
    def operate(*operands: Any) -> Any:
        return _call(function, *(reversed(operands) if reflected else operands))

    setattr(_StandIn, name, operate)


for _name in ("add", "sub", "mul", "truediv", "neg", "abs", "getitem"):
    _define_operator(f"__{_name}__", abs if _name == "abs" else getattr(operator, _name))
    if _name in ("add", "sub", "mul", "truediv"):
        _define_operator(f"__r{_name}__", getattr(operator, _name), reflected=True)


def _call(function: Any, *arguments: Any) -> Any:
    """Call ``function``; with a stand-in among the arguments, write the call into the loop."""
    trace = _trace_of(arguments)
    if trace is None:
        return function(*arguments)
    return _traceable(function)(*arguments) if is_branch_free(function) else trace.call(function, arguments)


def _trace_of(things: Iterable[Any]) -> _Trace | None:
    """The trace of the first stand-in among ``things``, also inside tuples."""
    for thing in things:
        if isinstance(thing, _StandIn):
            return thing.trace
        if isinstance(thing, tuple) and (trace := _trace_of(thing)) is not None:
            return trace
    return None


@functools.cache
def _traceable(function: Any) -> Callable[..., Any]:
    """A copy of a Python or compiled ``function`` in which all called names accept stand-ins."""
    plain = function.py_func if isinstance(function, Dispatcher) else function
    cells = tuple(CellType(_accepting(cell.cell_contents)) for cell in plain.__closure__ or ())
    names = {name: found if name == "__builtins__" else _accepting(found) for name, found in plain.__globals__.items()}
    return FunctionType(plain.__code__, names, plain.__name__, plain.__defaults__, cells)


def _accepting(found: Any) -> Any:
    if isinstance(found, ModuleType):
        return _Module(found)
    return functools.partial(_call, found) if callable(found) and not isinstance(found, type) else found


class _Module:
    """A module whose functions accept stand-ins."""

    def __init__(self, module: ModuleType) -> None:
        self.module = module

    def __getattr__(self, name: str) -> Any:
        return _accepting(getattr(self.module, name))
