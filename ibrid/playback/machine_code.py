"""Elementary operations as machine code, for four parameter sets at a time.

A diagram has an expression of its own. It is written as LLVM's assembly, of which LLVM makes code
in some hundredths of a second; that runs ten times as fast as a loop that looks up one operation
after another.
"""

import ctypes
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
from llvmlite import binding, ir

from ibrid.errors import IbridError
from ibrid.fit.just_in_time import config

#: Parameter sets that one instruction takes.
LANES = 4
#: (operation, by its number in CasADi; place of the result; places of the operands).
Operation = tuple[int, int, Sequence[int]]
Code = Callable[[int, int], None]

#: Bytes of a number. What LLVM calls numbers in lanes, the address of such, and truths in lanes.
_SIZE, _NUMBERS, _TRUTHS = 8, f"<{LANES} x double>", f"<{LANES} x i1>"
_ADDRESS = str(ir.VectorType(ir.DoubleType(), LANES).as_pointer())
#: Functions of C's library, which take one number after another.
_CALLS = (
    "exp",
    "expm1",
    "log",
    "log1p",
    "pow",
    "tan",
    "asin",
    "acos",
    "atan",
    "atan2",
    "sinh",
    "cosh",
    "tanh",
    "asinh",
    "acosh",
    "atanh",
    "hypot",
    "floor",
    "ceil",
    "fmod",
    "remainder",
    "copysign",
    "erf",
)
#: pi / 2 in three parts, of which multiples are exact; sine and cosine from -pi/4 to pi/4. From
#: Cephes (S. Moshier).
_QUARTER = 1.57079625129699707031, 7.54978941586159635336e-8, 5.39030285815811905290e-15
_SINE = (
    1.58962301576546568060e-10,
    -2.50507477628578072866e-8,
    2.75573136213857245213e-6,
    -1.98412698295885395996e-4,
    8.33333333332211858878e-3,
    -1.66666666666666307295e-1,
)
_COSINE = (
    -1.13585365213876817300e-11,
    2.08757008419747316778e-9,
    -2.75573141792967388112e-7,
    2.48015872888517045348e-5,
    -1.38888888888730564116e-3,
    4.16666666666665929218e-2,
)

binding.initialize_native_target()
binding.initialize_native_asmprinter()


@dataclass(frozen=True)
class Routine:
    """What one code does.

    `operations` : in order. `rows` : place -> row from which it is read, of all that are no results
    of operations before. `written` : (place, row) of what is written, after all is read.
    """

    operations: Sequence[Operation]
    rows: Mapping[int, int]
    written: Sequence[tuple[int, int]]


def machine_code(
    routines: Sequence[Routine], literals: Mapping[int, float], *, optimised: bool = True
) -> list[Code]:
    """code(address, lanes) of each routine : its operations on the columns of float64 (rows, lanes)
    in C order there, lanes a multiple of `LANES`.

    literals : place -> number. optimised : False for code that is made in half of the time and runs
    a fifth longer. Raises IbridError for an operation without a law here.
    """
    assembly = _Assembly()
    for number, routine in enumerate(routines):
        assembly.function(f"routine{number}", routine, literals)
    processor, features = _processor()
    machine = binding.Target.from_default_triple().create_target_machine(
        cpu=processor, features=features, opt=2 if optimised else 0
    )
    engine = binding.create_mcjit_compiler(binding.parse_assembly(assembly.text), machine)
    codes: list[Code] = []
    for number in range(len(routines)):
        code = ctypes.CFUNCTYPE(None, ctypes.c_int64, ctypes.c_int64)(
            engine.get_function_address(f"routine{number}")
        )
        vars(code)["engine"] = engine  # which owns what is called
        codes.append(code)
    return codes


def _processor() -> tuple[str, str]:
    """Name and features of what code is made for: this machine's processor, or the one of numba's
    code (NUMBA_CPU_NAME).
    """
    settings: Any = config
    name = settings.CPU_NAME or binding.get_host_cpu_name()
    features = settings.CPU_FEATURES
    if features is None:
        features = binding.get_host_cpu_features().flatten()
    return name, features


class _Assembly:
    """LLVM's assembly of some functions. A value is known by the name under which it is written."""

    def __init__(self) -> None:
        self._declared: dict[str, str] = {}
        self._lines: list[str] = []
        self._written = 0
        zero, unit = _number(0.0), _number(1.0)
        self._laws: dict[int, Callable[..., str]] = {
            ca.OP_ASSIGN: lambda a: a,
            ca.OP_NEG: lambda a: self._new(f"fneg {_NUMBERS} {a}"),
            ca.OP_SQ: lambda a: self._joined("fmul", a, a, how=""),
            ca.OP_TWICE: lambda a: self._joined("fadd", a, a, how=""),
            ca.OP_INV: lambda a: self._joined("fdiv", unit, a, how=""),
            ca.OP_DIV: partial(self._joined, "fdiv", how=""),
            ca.OP_ADD: partial(self._joined, "fadd"),
            ca.OP_SUB: partial(self._joined, "fsub"),
            ca.OP_MUL: partial(self._joined, "fmul"),
            ca.OP_SQRT: partial(self._intrinsic, "sqrt"),
            ca.OP_FABS: partial(self._intrinsic, "fabs"),
            ca.OP_CONSTPOW: partial(self._called, "pow"),
            ca.OP_SIN: lambda a: self._turn(a)[0],
            ca.OP_COS: lambda a: self._turn(a)[1],
            ca.OP_SIGN: lambda a: self._select(
                self._compared("ueq", a, zero), a, self._called("copysign", unit, a)
            ),
            ca.OP_LT: partial(self._truth, "olt"),
            ca.OP_LE: partial(self._truth, "ole"),
            ca.OP_EQ: partial(self._truth, "oeq"),
            ca.OP_NE: partial(self._truth, "une"),
            ca.OP_NOT: partial(self._truth, "oeq", zero),
            ca.OP_AND: lambda a, c: self._select(
                self._holds(a), self._select(self._holds(c), unit, zero), zero
            ),
            ca.OP_OR: lambda a, c: self._select(
                self._holds(a), unit, self._select(self._holds(c), unit, zero)
            ),
            ca.OP_IF_ELSE_ZERO: lambda a, c: self._select(self._holds(a), c, zero),
            ca.OP_FMIN: partial(self._intrinsic, "minnum"),
            ca.OP_FMAX: partial(self._intrinsic, "maxnum"),
        } | {getattr(ca, f"OP_{name.upper()}"): partial(self._called, name) for name in _CALLS}

    @property
    def text(self) -> str:
        """All of it."""
        return "\n".join([*self._declared.values(), *self._lines])

    def function(self, name: str, routine: Routine, literals: Mapping[int, float]) -> None:
        """The operations on `LANES` columns after `LANES` columns."""
        self._values = {place: _number(value) for place, value in literals.items()}
        self._turns: dict[str, tuple[str, str]] = {}
        self._rows = routine.rows
        self._lines += [
            f"define void @{name}(i64 %first, i64 %lanes) {{",
            "start:",
            f"%length = mul i64 %lanes, {_SIZE}",
            "%behind = add i64 %first, %length",
            "br label %loop",
            "loop:",
            "%column = phi i64 [ %first, %start ], [ %following, %loop ]",
        ]
        for operation, place, operands in routine.operations:
            if operation not in self._laws:
                raise IbridError(
                    f"a law has the operation {operation} of CasADi, which playback does not know; "
                    "write it otherwise"
                )
            self._values[place] = self._laws[operation](*(self._value(one) for one in operands))
        for place, row in routine.written:
            value = self._value(place)
            self._lines.append(
                f"store {_NUMBERS} {value}, {_ADDRESS} {self._at(row)}, align {_SIZE}"
            )
        self._lines += [
            f"%following = add i64 %column, {_SIZE * LANES}",
            "%more = icmp ult i64 %following, %behind",
            "br i1 %more, label %loop, label %end",
            "end:",
            "ret void",
            "}",
        ]

    def _new(self, instruction: str) -> str:
        """The name of what an instruction makes."""
        self._written += 1
        self._lines.append(f"%x{self._written} = {instruction}")
        return f"%x{self._written}"

    def _at(self, row: int) -> str:
        """The address of a row of the columns."""
        address = self._new(f"add i64 %column, {self._new(f'mul i64 %length, {row}')}")
        return self._new(f"inttoptr i64 {address} to {_ADDRESS}")

    def _value(self, place: int) -> str:
        if place not in self._values:
            at = self._at(self._rows[place])
            self._values[place] = self._new(f"load {_NUMBERS}, {_ADDRESS} {at}, align {_SIZE}")
        return self._values[place]

    def _joined(self, operation: str, a: str, c: str, how: str = "contract ") -> str:
        """how : "contract " where a multiplication and an addition may be one."""
        return self._new(f"{operation} {how}{_NUMBERS} {a}, {c}")

    def _compared(self, how: str, a: str, c: str) -> str:
        return self._new(f"fcmp {how} {_NUMBERS} {a}, {c}")

    def _select(self, truth: str, a: str, c: str) -> str:
        return self._new(f"select {_TRUTHS} {truth}, {_NUMBERS} {a}, {_NUMBERS} {c}")

    def _either(self, a: str, c: str) -> str:
        return self._new(f"or {_TRUTHS} {a}, {c}")

    def _truth(self, how: str, a: str, c: str) -> str:
        return self._select(self._compared(how, a, c), _number(1.0), _number(0.0))

    def _holds(self, a: str) -> str:
        return self._compared("une", a, _number(0.0))

    def _intrinsic(self, name: str, *operands: str) -> str:
        name = f"llvm.{name}.v{LANES}f64"
        self._declare(name, _NUMBERS, len(operands))
        return self._new(
            f"call {_NUMBERS} @{name}({', '.join(f'{_NUMBERS} {one}' for one in operands)})"
        )

    def _called(self, name: str, *operands: str) -> str:
        self._declare(name, "double", len(operands))
        result = _number(0.0)
        for lane in range(LANES):
            each = [self._new(f"extractelement {_NUMBERS} {one}, i32 {lane}") for one in operands]
            value = self._new(f"call double @{name}({', '.join(f'double {one}' for one in each)})")
            result = self._new(f"insertelement {_NUMBERS} {result}, double {value}, i32 {lane}")
        return result

    def _declare(self, name: str, kind: str, operands: int) -> None:
        self._declared[name] = f"declare {kind} @{name}({', '.join([kind] * operands)})"

    def _turn(self, a: str) -> tuple[str, str]:
        """Sine and cosine: of what is left of whole quarters, which say which is which and of which
        sign. Right below 1e9.
        """
        if a in self._turns:
            return self._turns[a]
        plus, minus, times = (
            partial(self._joined, one, how="") for one in ("fadd", "fsub", "fmul")
        )
        rest, quarters = a, self._intrinsic("rint", times(a, _number(1 / sum(_QUARTER))))
        for part in _QUARTER:
            rest = minus(rest, times(quarters, _number(part)))
        square = times(rest, rest)
        sine = plus(rest, times(times(rest, square), self._polynomial(square, _SINE)))
        half = minus(_number(1.0), times(square, _number(0.5)))
        cosine = plus(half, times(times(square, square), self._polynomial(square, _COSINE)))
        quarter = minus(
            quarters, times(self._intrinsic("floor", times(quarters, _number(0.25))), _number(4.0))
        )
        is_one, is_two, is_three = (
            self._compared("oeq", quarter, _number(float(one))) for one in (1, 2, 3)
        )
        odd = self._either(is_one, is_three)
        first, second = self._select(odd, cosine, sine), self._select(odd, sine, cosine)
        signed = [
            self._select(self._either(*turned), self._new(f"fneg {_NUMBERS} {one}"), one)
            for one, turned in ((first, (is_two, is_three)), (second, (is_one, is_two)))
        ]
        self._turns[a] = signed[0], signed[1]
        return self._turns[a]

    def _polynomial(self, a: str, coefficients: tuple[float, ...]) -> str:
        """Horner's."""
        value = _number(coefficients[0])
        for one in coefficients[1:]:
            value = self._joined("fadd", self._joined("fmul", value, a), _number(one))
        return value


def _number(value: float) -> str:
    """A number in all lanes, by its bits."""
    bits = struct.unpack("<Q", struct.pack("<d", value))[0]
    return f"<{', '.join([f'double 0x{bits:016X}'] * LANES)}>"
