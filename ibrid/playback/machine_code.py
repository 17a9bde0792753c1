"""Elementary operations as machine code, for four parameter sets at a time.

A diagram has an expression of its own. LLVM makes code of it in some hundredths of a second, and that runs ten times as fast as
a loop that looks up one operation after another.
"""

import ctypes
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import casadi as ca
from llvmlite import binding, ir
from numba.core import config

from ibrid.errors import IbridError

#: Parameter sets that one instruction takes.
LANES = 4
#: (operation, by its number in CasADi; place of the result; places of the operands).
Operation = tuple[int, int, Sequence[int]]
Code = Callable[[int, int], None]

_WORD, _NUMBERS, _SIZE, _FAST = ir.IntType(64), ir.VectorType(ir.DoubleType(), LANES), 8, ("contract",)
_Value = Any
#: Functions of C's library, which take one number after another.
_CALLS = (
    "exp", "expm1", "log", "log1p", "pow", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "asinh", "acosh",
    "atanh", "hypot", "floor", "ceil", "fmod", "remainder", "copysign", "erf",
)  # fmt: skip
#: pi / 2 in three parts, of which multiples are exact; sine and cosine from -pi/4 to pi/4. From Cephes (S. Moshier).
_QUARTER = 1.57079625129699707031, 7.54978941586159635336e-8, 5.39030285815811905290e-15
_SINE = (1.58962301576546568060e-10, -2.50507477628578072866e-8, 2.75573136213857245213e-6, -1.98412698295885395996e-4,
         8.33333333332211858878e-3, -1.66666666666666307295e-1)  # fmt: skip
_COSINE = (-1.13585365213876817300e-11, 2.08757008419747316778e-9, -2.75573141792967388112e-7, 2.48015872888517045348e-5,
           -1.38888888888730564116e-3, 4.16666666666665929218e-2)  # fmt: skip

binding.initialize_native_target()
binding.initialize_native_asmprinter()


def machine_code(
    operations: Iterable[Operation],
    literals: Mapping[int, float],
    rows: Mapping[int, int],
    written: Iterable[tuple[int, int]],
    *,
    optimised: bool = True,
) -> Code:
    """code(address, lanes) : operations on the columns of float64 (rows, lanes) in C order there, lanes a multiple of `LANES`.

    literals : place -> number. rows : place -> row from which it is read, of all others that are no results of operations before.
    written : (place, row) of what is written, after all is read. optimised : False for code that is made in half of the time and
    runs a fifth longer. Raises IbridError for an operation without a law here.
    """
    module = ir.Module()
    function = ir.Function(module, ir.FunctionType(ir.VoidType(), [_WORD, _WORD]), "run")
    start, loop, end = (function.append_basic_block(name) for name in ("start", "loop", "end"))
    builder: Any = ir.IRBuilder(start)
    first, length = function.args[0], builder.mul(function.args[1], _WORD(_SIZE))
    behind = builder.add(first, length)
    builder.branch(loop)
    builder.position_at_end(loop)
    column = builder.phi(_WORD)
    _Column(builder, column, length, literals, rows).run(operations, written)
    following = builder.add(column, _WORD(_SIZE * LANES))
    column.add_incoming(first, start)
    column.add_incoming(following, loop)
    builder.cbranch(builder.icmp_unsigned("<", following, behind), loop, end)
    builder.position_at_end(end)
    builder.ret_void()
    processor, features = _processor()
    machine = binding.Target.from_default_triple().create_target_machine(
        cpu=processor, features=features, opt=2 if optimised else 0
    )
    engine = binding.create_mcjit_compiler(binding.parse_assembly(str(module)), machine)
    code = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)(engine.get_function_address("run"))
    vars(code)["engine"] = engine  # which owns what is called
    return code


def _processor() -> tuple[str, str]:
    """Name and features of what code is made for: this machine's processor, or the one of numba's code (NUMBA_CPU_NAME)."""
    settings: Any = config
    name = settings.CPU_NAME or binding.get_host_cpu_name()
    features = settings.CPU_FEATURES
    if features is None:
        features = binding.get_host_cpu_features().flatten()
    return name, features


class _Column:
    """The operations on `LANES` columns from an address on, rows of some length in bytes."""

    def __init__(
        self, builder: Any, column: _Value, length: _Value, literals: Mapping[int, float], rows: Mapping[int, int]
    ) -> None:
        self.builder, self.column, self.length, self.rows, b = builder, column, length, rows, builder
        self.values = {place: _number(value) for place, value in literals.items()}
        self.turns: dict[_Value, tuple[_Value, _Value]] = {}
        zero, unit = _number(0.0), _number(1.0)
        self.laws: dict[int, Callable[..., _Value]] = {
            ca.OP_ASSIGN: lambda a: a, ca.OP_NEG: b.fneg, ca.OP_SQ: lambda a: b.fmul(a, a), ca.OP_TWICE: lambda a: b.fadd(a, a),
            ca.OP_INV: lambda a: b.fdiv(unit, a), ca.OP_DIV: b.fdiv, ca.OP_ADD: partial(b.fadd, flags=_FAST),
            ca.OP_SUB: partial(b.fsub, flags=_FAST), ca.OP_MUL: partial(b.fmul, flags=_FAST),
            ca.OP_SQRT: partial(self._intrinsic, "sqrt"), ca.OP_FABS: partial(self._intrinsic, "fabs"),
            ca.OP_CONSTPOW: partial(self._called, "pow"),
            ca.OP_SIN: lambda a: self._turn(a)[0], ca.OP_COS: lambda a: self._turn(a)[1],
            ca.OP_SIGN: lambda a: b.select(b.fcmp_unordered("==", a, zero), a, self._called("copysign", unit, a)),
            ca.OP_LT: partial(self._truth, "<"), ca.OP_LE: partial(self._truth, "<="), ca.OP_EQ: partial(self._truth, "=="),
            ca.OP_NE: lambda a, c: b.select(b.fcmp_unordered("!=", a, c), unit, zero),
            ca.OP_AND: lambda a, c: b.select(self._holds(a), b.select(self._holds(c), unit, zero), zero),
            ca.OP_OR: lambda a, c: b.select(self._holds(a), unit, b.select(self._holds(c), unit, zero)),
            ca.OP_IF_ELSE_ZERO: lambda a, c: b.select(self._holds(a), c, zero), ca.OP_NOT: partial(self._truth, "==", zero),
            ca.OP_FMIN: partial(self._intrinsic, "minnum"), ca.OP_FMAX: partial(self._intrinsic, "maxnum"),
        } | {getattr(ca, f"OP_{name.upper()}"): partial(self._called, name) for name in _CALLS}  # fmt: skip

    def run(self, operations: Iterable[Operation], written: Iterable[tuple[int, int]]) -> None:
        for operation, place, operands in operations:
            if operation not in self.laws:
                raise IbridError(
                    f"a law has the operation {operation} of CasADi, which playback does not know; write it otherwise"
                )
            self.values[place] = self.laws[operation](*(self._value(one) for one in operands))
        for place, row in written:
            self.builder.store(self._value(place), self._at(row), align=_SIZE)

    def _at(self, row: int) -> _Value:
        address = self.builder.add(self.column, self.builder.mul(self.length, _WORD(row)))
        return self.builder.inttoptr(address, _NUMBERS.as_pointer())

    def _value(self, place: int) -> _Value:
        if place not in self.values:
            self.values[place] = self.builder.load(self._at(self.rows[place]), align=_SIZE)
        return self.values[place]

    def _truth(self, how: str, a: _Value, c: _Value) -> _Value:
        return self.builder.select(self.builder.fcmp_ordered(how, a, c), _number(1.0), _number(0.0))

    def _holds(self, a: _Value) -> _Value:
        return self.builder.fcmp_unordered("!=", a, _number(0.0))

    def _intrinsic(self, name: str, *operands: _Value) -> _Value:
        return self.builder.call(self._declared(f"llvm.{name}.v{LANES}f64", _NUMBERS, len(operands)), operands)

    def _called(self, name: str, *operands: _Value) -> _Value:
        function, result = self._declared(name, ir.DoubleType(), len(operands)), _number(0.0)
        for lane in range(LANES):
            index = ir.IntType(32)(lane)
            each = self.builder.call(function, [self.builder.extract_element(one, index) for one in operands])
            result = self.builder.insert_element(result, each, index)
        return result

    def _declared(self, name: str, kind: ir.Type, operands: int) -> _Value:
        module = self.builder.module
        return module.globals.get(name) or ir.Function(module, ir.FunctionType(kind, [kind] * operands), name)

    def _turn(self, a: _Value) -> tuple[_Value, _Value]:
        """Sine and cosine: of what is left of whole quarters, which say which is which and of which sign. Right below 1e9."""
        if a in self.turns:
            return self.turns[a]
        b, rest = self.builder, a
        quarters = self._intrinsic("rint", b.fmul(a, _number(1 / sum(_QUARTER))))
        for part in _QUARTER:
            rest = b.fsub(rest, b.fmul(quarters, _number(part)))
        square = b.fmul(rest, rest)
        sine = b.fadd(rest, b.fmul(b.fmul(rest, square), self._polynomial(square, _SINE)))
        half = b.fsub(_number(1.0), b.fmul(square, _number(0.5)))
        cosine = b.fadd(half, b.fmul(b.fmul(square, square), self._polynomial(square, _COSINE)))
        quarter = b.fsub(quarters, b.fmul(self._intrinsic("floor", b.fmul(quarters, _number(0.25))), _number(4.0)))
        is_one, is_two, is_three = (b.fcmp_ordered("==", quarter, _number(float(one))) for one in (1, 2, 3))
        odd = b.or_(is_one, is_three)
        first, second = b.select(odd, cosine, sine), b.select(odd, sine, cosine)
        turned = b.or_(is_two, is_three), b.or_(is_one, is_two)
        self.turns[a] = b.select(turned[0], b.fneg(first), first), b.select(turned[1], b.fneg(second), second)
        return self.turns[a]

    def _polynomial(self, a: _Value, coefficients: tuple[float, ...]) -> _Value:
        """Horner's."""
        value = _number(coefficients[0])
        for one in coefficients[1:]:
            value = self.builder.fadd(self.builder.fmul(value, a, flags=_FAST), _number(one), flags=_FAST)
        return value


def _number(value: float) -> _Value:
    return ir.Constant(_NUMBERS, [value] * LANES)
