"""Arithmetic of complex numbers in lanes, each the same quantity at `LANES` frequencies, for
compiled loops.

They lie in one array of float64: a number takes `WIDTH` places, the real parts first, and is named
by its first place. An operation reads all that it needs before it writes, which lets a processor
take the lanes at once; loops over arrays would have to prove that arrays do not overlap.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

#: Frequencies at once, and places that a complex number takes.
LANES = 8
WIDTH = 2 * LANES
#: A matrix (2, 2) takes so many parts, which lie side by side.
PARTS = 8

_NUMBER = ir.DoubleType()
_LANES = ir.VectorType(_NUMBER, LANES)
#: What rounding may do: fused operations and other orders of sums, as in the loops that use these.
_FAST = ("contract", "reassoc", "nsz")


class _Writer:
    """Writes the instructions of an operation on an array."""

    def __init__(self, context: Any, builder: Any, kind: Any, array: Any) -> None:
        self.builder = builder
        self.data = cgutils.create_struct_proxy(kind)(context, builder, value=array).data

    def read(self, place: Any, part: int = 0) -> Any:
        """The lanes that begin `part` times `LANES` places behind a place."""
        read = self.builder.load(self._address(place, part))
        read.align = 8
        return read

    def write(self, value: Any, place: Any, part: int = 0) -> None:
        written = self.builder.store(value, self._address(place, part))
        written.align = 8

    def add(self, one: Any, other: Any) -> Any:
        return self.builder.fadd(one, other, flags=_FAST)

    def subtract(self, one: Any, other: Any) -> Any:
        return self.builder.fsub(one, other, flags=_FAST)

    def multiply(self, one: Any, other: Any) -> Any:
        return self.builder.fmul(one, other, flags=_FAST)

    def in_all(self, value: Any) -> Any:
        """One value in all lanes."""
        index = ir.IntType(32)
        first = self.builder.insert_element(
            ir.Constant(_LANES, ir.Undefined), value, ir.Constant(index, 0)
        )
        same = ir.Constant(ir.VectorType(index, LANES), [0] * LANES)
        return self.builder.shuffle_vector(first, ir.Constant(_LANES, ir.Undefined), same)

    def size(self, value: Any) -> Any:
        return self.builder.call(self._function("llvm.fabs", _LANES, [_LANES]), [value])

    def total(self, value: Any) -> Any:
        """The sum over lanes."""
        add = self._function("llvm.vector.reduce.fadd", _NUMBER, [_NUMBER, _LANES])
        return self.builder.call(add, [ir.Constant(_NUMBER, 0.0), value], fastmath=_FAST)

    def _function(self, name: str, returns: Any, takes: list[Any]) -> Any:
        kind = ir.FunctionType(returns, takes)
        return cgutils.get_or_insert_function(self.builder.module, kind, f"{name}.v{LANES}f64")

    def _address(self, place: Any, part: int) -> Any:
        at = self.builder.add(place, ir.Constant(place.type, part * LANES))
        return self.builder.bitcast(self.builder.gep(self.data, [at]), _LANES.as_pointer())


def _operation(*takes: Any, returns: Any = types.void) -> Callable[[Callable[..., Any]], Any]:
    """Make an operation on an array of what writes its instructions; `takes` : the kinds of the
    arguments behind the array.
    """

    def made(write: Callable[..., Any]) -> Any:
        kinds = (types.Array(types.float64, 1, "C"), *takes)

        def instructions(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            array, *others = given
            result = write(_Writer(context, builder, signature.args[0], array), *others)
            return context.get_dummy_value() if result is None else result

        typed = (returns(*kinds), instructions)
        named = {
            1: lambda context, array, at: typed,
            2: lambda context, array, at, second: typed,
            3: lambda context, array, at, second, third: typed,
        }[len(takes)]
        named.__name__, named.__doc__ = write.__name__, write.__doc__
        return intrinsic(named)

    return made


_PLACE, _REAL = types.int64, types.float64


@_operation(_PLACE, _REAL)
def put(lanes: _Writer, at: Any, value: Any) -> None:
    """The number at `at` <- a real value."""
    lanes.write(lanes.in_all(value), at)
    lanes.write(ir.Constant(_LANES, [0.0] * LANES), at, 1)


@_operation(_PLACE, _PLACE)
def copy(lanes: _Writer, at: Any, other: Any) -> None:
    """The number at `at` <- the other."""
    lanes.write(lanes.read(other), at)
    lanes.write(lanes.read(other, 1), at, 1)


@_operation(_PLACE)
def negate(lanes: _Writer, at: Any) -> None:
    """The number at `at` <- its negative."""
    for part in range(2):
        lanes.write(lanes.builder.fneg(lanes.read(at, part)), at, part)


@_operation(_PLACE)
def invert(lanes: _Writer, at: Any) -> None:
    """The number at `at` <- its inverse."""
    real, imaginary = lanes.read(at), lanes.read(at, 1)
    square = lanes.add(lanes.multiply(real, real), lanes.multiply(imaginary, imaginary))
    inverse = lanes.builder.fdiv(ir.Constant(_LANES, [1.0] * LANES), square)
    lanes.write(lanes.multiply(real, inverse), at)
    lanes.write(lanes.builder.fneg(lanes.multiply(imaginary, inverse)), at, 1)


@_operation(_PLACE, _PLACE, _PLACE)
def multiply(lanes: _Writer, at: Any, one: Any, other: Any) -> None:
    """The number at `at` <- one times the other."""
    a, b = lanes.read(one), lanes.read(one, 1)
    c, d = lanes.read(other), lanes.read(other, 1)
    real = lanes.subtract(lanes.multiply(a, c), lanes.multiply(b, d))
    imaginary = lanes.add(lanes.multiply(a, d), lanes.multiply(b, c))
    lanes.write(real, at)
    lanes.write(imaginary, at, 1)


@_operation(_PLACE, _PLACE, _PLACE)
def subtract_product(lanes: _Writer, at: Any, one: Any, other: Any) -> None:
    """The number at `at` <- itself less one times the other."""
    a, b = lanes.read(one), lanes.read(one, 1)
    c, d = lanes.read(other), lanes.read(other, 1)
    real, imaginary = lanes.read(at), lanes.read(at, 1)
    real = lanes.add(lanes.subtract(real, lanes.multiply(a, c)), lanes.multiply(b, d))
    imaginary = lanes.subtract(imaginary, lanes.multiply(a, d))
    imaginary = lanes.subtract(imaginary, lanes.multiply(b, c))
    lanes.write(real, at)
    lanes.write(imaginary, at, 1)


@_operation(_PLACE, _PLACE, _REAL)
def add_scaled_matrix(lanes: _Writer, at: Any, other: Any, scale: Any) -> None:
    """The matrix (2, 2) at `at` <- itself and a real multiple of the other."""
    scales = lanes.in_all(scale)
    for part in range(PARTS):
        scaled = lanes.multiply(lanes.read(other, part), scales)
        lanes.write(lanes.add(lanes.read(at, part), scaled), at, part)


@_operation(_PLACE, _PLACE, returns=_REAL)
def dot_matrices(lanes: _Writer, first: Any, second: Any) -> Any:
    """The sum of the products of the real and of the imaginary parts of two matrices (2, 2), over
    their entries and lanes.
    """
    products = [lanes.multiply(lanes.read(first, k), lanes.read(second, k)) for k in range(PARTS)]
    total = products[0]
    for product in products[1:]:
        total = lanes.add(total, product)
    return lanes.total(total)


@_operation(_PLACE, returns=_REAL)
def magnitude(lanes: _Writer, at: Any) -> Any:
    """|Re| + |Im| of a number, summed over its lanes."""
    return lanes.total(lanes.add(lanes.size(lanes.read(at)), lanes.size(lanes.read(at, 1))))
