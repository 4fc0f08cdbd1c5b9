"""Four numbers that compiled functions process with one instruction.

A processor divides and takes square roots several times faster if it does so for four numbers at once. Every operation
is the IEEE 754 operation on each number, so the results are bit-identical to those of single numbers.

Besides the functions of this module, the operators ``+ - * /``, the comparisons and `abs` accept lanes, or lanes and a
single number, and ``& |`` accept the results of comparisons. In plain Python, lanes are a numpy array.
"""

import operator
from collections.abc import Callable, Iterable
from itertools import product
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AbstractTemplate, infer_global, signature
from numba.extending import lower_builtin, models, register_model

# parts of numba without types for type checkers
_types: Any = types
_signature: Any = signature
_register_globally: Any = infer_global
_register_lowering: Any = lower_builtin
_get_or_insert_function: Any = cgutils.get_or_insert_function

_COUNT = 4
_INDEX = ir.IntType(32)


class LanesType(types.Type):
    """Compiled type of four numbers or of four truth values.

    Attributes:
        vector: Type of the vector register.
    """

    def __init__(self, name: str, element: Any) -> None:
        """Create the type for elements of a machine type."""
        self.vector = ir.VectorType(element, _COUNT)
        super().__init__(name=name)


@register_model(LanesType)
class LanesModel(models.PrimitiveModel):
    """Representation of lanes in compiled functions: a vector register."""

    def __init__(self, manager: Any, kind: LanesType) -> None:
        """Create the representation of a type."""
        create: Any = super().__init__
        create(manager, kind, kind.vector)


_NUMBERS, _TRUTHS = LanesType("lanes", ir.DoubleType()), LanesType("truths", ir.IntType(1))
_NUMBER = _types.float64


def lanes(a: float, b: float, c: float, d: float) -> Any:
    """Return four numbers as lanes."""
    return np.array([a, b, c, d])


def pair(a: float, b: float) -> Any:
    """Return two numbers, twice, as lanes."""
    return np.array([a, b, a, b])


def joined(x: Any, y: Any) -> Any:
    """Return the first two numbers of `x`, followed by the first two of `y`."""
    return np.concatenate([x[:2], y[:2]])


def split(x: Any) -> tuple[Any, Any]:
    """Return the first two numbers of lanes, twice, and the last two, twice."""
    return np.concatenate([x[:2], x[:2]]), np.concatenate([x[2:], x[2:]])


def unpacked(x: Any) -> Any:
    """Return the four numbers as a tuple."""
    return tuple(x.tolist())


def truths(x: Any) -> Any:
    """Return the four results of a comparison as a tuple."""
    return tuple(x.tolist())


def select(condition: Any, x: Any, y: Any) -> Any:
    """Return `x` in the lanes in which `condition` is true, and `y` in the others."""
    return np.where(condition, x, y)


def root(x: Any) -> Any:
    """Return the square roots."""
    return np.sqrt(x)


def _compile(function: Any, kinds: Iterable[tuple[Any, ...]], result: Any, generate: Callable[..., Any]) -> None:
    """Make a function or an operator available to compiled functions.

    Args:
        function: The function.
        kinds: Accepted combinations of argument types.
        result: Type of the result.
        generate: Function that generates the machine code, from a builder and the arguments. It returns a list if the
            result is a tuple.
    """
    accepted = list(kinds)

    class LanesFunction(AbstractTemplate):
        """Typing of the function."""

        def generic(self, args: Any, _kws: Any) -> Any:
            """Return the signature for some argument types; None if they are not accepted."""
            return _signature(result, *args) if tuple(args) in accepted else None

    def lower(context: Any, builder: Any, sig: Any, values: Any) -> Any:
        made = generate(builder, *values)
        return context.make_tuple(builder, sig.return_type, made) if isinstance(made, list) else made

    _register_globally(function)(LanesFunction)
    for each in accepted:
        _register_lowering(function, *each)(lower)


def _packed(builder: Any, *values: Any) -> Any:
    vector = ir.Constant(_NUMBERS.vector, ir.Undefined)
    for number, value in enumerate(values):
        vector = builder.insert_element(vector, value, ir.Constant(_INDEX, number))
    return vector


def _shuffled(builder: Any, x: Any, y: Any, *places: int) -> Any:
    return builder.shuffle_vector(x, y, ir.Constant(ir.VectorType(_INDEX, _COUNT), list(places)))


def _elements(builder: Any, x: Any) -> list[Any]:
    return [builder.extract_element(x, ir.Constant(_INDEX, number)) for number in range(_COUNT)]


def _repeated(builder: Any, x: Any) -> Any:
    """Return lanes unchanged, and a single number in all lanes."""
    return x if x.type == _NUMBERS.vector else _packed(builder, *(x,) * _COUNT)


def _vector_function(name: str) -> Callable[..., Any]:
    """Return the generator of a function that processors provide for vectors."""
    kind = ir.FunctionType(_NUMBERS.vector, [_NUMBERS.vector])
    full_name = f"llvm.{name}.v{_COUNT}f64"
    return lambda builder, x: builder.call(_get_or_insert_function(builder.module, kind, full_name), [x])


def _compile_operators() -> None:
    one_or_four = [kinds for kinds in product((_NUMBERS, _NUMBER), repeat=2) if _NUMBERS in kinds]
    for function, instruction in (
        (operator.add, ir.IRBuilder.fadd),
        (operator.sub, ir.IRBuilder.fsub),
        (operator.mul, ir.IRBuilder.fmul),
        (operator.truediv, ir.IRBuilder.fdiv),
    ):
        _compile(function, one_or_four, _NUMBERS, _between_repeated(instruction))
    for function, sign in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
        _compile(function, one_or_four, _TRUTHS, _between_repeated(_comparison(sign)))
    _compile(operator.and_, [(_TRUTHS, _TRUTHS)], _TRUTHS, ir.IRBuilder.and_)
    _compile(operator.or_, [(_TRUTHS, _TRUTHS)], _TRUTHS, ir.IRBuilder.or_)
    _compile(operator.neg, [(_NUMBERS,)], _NUMBERS, ir.IRBuilder.fneg)
    _compile(abs, [(_NUMBERS,)], _NUMBERS, _vector_function("fabs"))


def _between_repeated(instruction: Callable[..., Any]) -> Callable[..., Any]:
    return lambda builder, x, y: instruction(builder, _repeated(builder, x), _repeated(builder, y))


def _comparison(sign: str) -> Callable[..., Any]:
    """Return the generator of a comparison, which is false if an operand is not a number."""
    return lambda builder, x, y: builder.fcmp_ordered(sign, x, y)


def _compile_functions() -> None:
    _compile(lanes, [(_NUMBER,) * _COUNT], _NUMBERS, _packed)
    _compile(pair, [(_NUMBER, _NUMBER)], _NUMBERS, lambda builder, a, b: _packed(builder, a, b, a, b))
    _compile(joined, [(_NUMBERS, _NUMBERS)], _NUMBERS, lambda builder, x, y: _shuffled(builder, x, y, 0, 1, 4, 5))
    _compile(
        split,
        [(_NUMBERS,)],
        _types.UniTuple(_NUMBERS, 2),
        lambda builder, x: [_shuffled(builder, x, x, 0, 1, 0, 1), _shuffled(builder, x, x, 2, 3, 2, 3)],
    )
    _compile(unpacked, [(_NUMBERS,)], _types.UniTuple(_NUMBER, _COUNT), _elements)
    _compile(truths, [(_TRUTHS,)], _types.UniTuple(_types.boolean, _COUNT), _elements)
    _compile(
        select,
        [(_TRUTHS, *kinds) for kinds in product((_NUMBERS, _NUMBER), repeat=2)],
        _NUMBERS,
        lambda builder, choice, x, y: builder.select(choice, _repeated(builder, x), _repeated(builder, y)),
    )
    _compile(root, [(_NUMBERS,)], _NUMBERS, _vector_function("sqrt"))


_compile_operators()
_compile_functions()
