"""A library with the IEEE/CIGRE interface for real code (Technical Brochure 958, 2025): what it
says of itself, and an instance.

Eight functions are exported; inputs, outputs and parameters are C structures whose members lie at
multiples of their own size (natural alignment), all states in arrays of the caller's.
"""

import ctypes
import struct
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ibrid.errors import IbridError, near

#: Type of a signal or a parameter, by the interface's number -> NumPy's type. 10 is a pointer to
#: text.
TYPES: Mapping[int, str] = {
    1: "i1",
    2: "i1",
    3: "u1",
    4: "i2",
    5: "u2",
    6: "i4",
    7: "u4",
    8: "f4",
    9: "f8",
    10: "u8",
}
TEXT = 10
#: Versions of the interface whose structures are these: the released one, and drafts of it that
#: were published in code.
VERSIONS = ((1, 1), (0, 0))
EMT, RMS = 1, 2
#: Answers of the functions: fine, a message, an error.
ERROR = 2
#: Signals, parameters and states of a library at most, and characters of a text of it that are
#: read.
MOST, LONGEST = 100_000, 500
_FUNCTIONS = ("GetInfo", "FirstCall", "CheckParameters", "Initialize", "Outputs")


#: Texts of a library about itself, in their order.
_WORDS = (
    "name",
    "model_version",
    "description",
    "general",
    "created",
    "creator",
    "date",
    "by",
    "comment",
    "history",
)


class _SignalInfo(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_char_p) for name in ("name", "description", "unit")),
        *((name, ctypes.c_int32) for name in ("type", "width")),
    ]


class _ParameterInfo(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_char_p) for name in ("name", "group", "description", "unit")),
        *((name, ctypes.c_int32) for name in ("type", "fixed")),
        *((name, ctypes.c_uint8 * 8) for name in ("default", "minimum", "maximum")),
    ]


class _ModelInfo(ctypes.Structure):
    _fields_ = [
        ("version", ctypes.c_uint8 * 4),
        *((name, ctypes.c_char_p) for name in _WORDS),
        ("sample_s", ctypes.c_double),
        ("mode", ctypes.c_uint8),
        ("inputs", ctypes.c_int32),
        ("input_info", ctypes.POINTER(_SignalInfo)),
        ("outputs", ctypes.c_int32),
        ("output_info", ctypes.POINTER(_SignalInfo)),
        ("parameters", ctypes.c_int32),
        ("parameter_info", ctypes.POINTER(_ParameterInfo)),
        *((name, ctypes.c_int32) for name in ("int_states", "float_states", "double_states")),
    ]


class ModelInstance(ctypes.Structure):
    """What is handed to every call. `time` is its fourth number of eight bytes."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("inputs", "outputs", "parameters")),
        ("time", ctypes.c_double),
        ("mode", ctypes.c_uint8),
        *((name, ctypes.c_char_p) for name in ("error", "message")),
        *((name, ctypes.c_void_p) for name in ("int_states", "float_states", "double_states")),
    ]


#: Place of `time` among numbers of eight bytes.
TIME = vars(ModelInstance)["time"].offset // 8


@dataclass(frozen=True)
class CigrePort:
    """A number of an input, an output or the parameters.

    type : of `TYPES`. offset : bytes from the structure's beginning. range : lowest and highest
    value, None where none is said.
    """

    name: str
    unit: str
    description: str
    type: int
    offset: int
    usual: float | str = 0.0
    range: tuple[float, float] | None = None

    @property
    def place(self) -> int:
        """Among numbers of its own size."""
        return self.offset // np.dtype(TYPES[self.type]).itemsize


@dataclass(frozen=True, eq=False)
class CigreLibrary958:
    """A library that is loaded, and what it says of itself; ports of a signal of several numbers
    are NAME[0], NAME[1], ...
    """

    functions: Mapping[str, Any]
    name: str
    words: Sequence[str]
    sample_s: float
    inputs: Mapping[str, CigrePort]
    outputs: Mapping[str, CigrePort]
    parameters: Mapping[str, CigrePort]
    states: tuple[int, int, int]


def load_library(file: str) -> CigreLibrary958:
    """Load a library and read what it says of itself.

    Raises IbridError for a file that is no library of this platform, or one of another interface or
    version.
    """
    path = Path(file)
    _require_own_platform(path)
    try:
        library = ctypes.CDLL(str(path))
    except OSError as error:
        raise IbridError(
            f"{path}: cannot be loaded as a library ({' '.join(str(error).split())[:300]})"
        ) from None
    functions = {}
    for name in _FUNCTIONS:
        try:
            functions[name] = getattr(library, f"Model_{name}")
        except AttributeError:
            raise IbridError(
                f"{path}: has no function Model_{name}, so it is no library of the IEEE/CIGRE "
                "interface"
            ) from None
        functions[name].argtypes = [] if name == "GetInfo" else [ctypes.c_void_p]
        functions[name].restype = (
            ctypes.POINTER(_ModelInfo) if name == "GetInfo" else ctypes.c_int32
        )
    pointer = functions["GetInfo"]()
    if not pointer:
        raise IbridError(f"{path}: tells nothing of itself (Model_GetInfo answers a null pointer)")
    info = pointer.contents
    version = tuple(info.version)
    if version[:2] not in VERSIONS:
        raise IbridError(
            f"{path}: has version {'.'.join(map(str, version))} of the IEEE/CIGRE interface, 1.1 "
            "is known; ask for one of that"
        )
    if info.mode == RMS:
        raise IbridError(
            f"{path}: is for RMS programs alone, and instantaneous values are measured; ask for "
            "one for EMT"
        )
    counts = [
        info.inputs,
        info.outputs,
        info.parameters,
        info.int_states,
        info.float_states,
        info.double_states,
    ]
    if not all(0 <= count <= MOST for count in counts):
        raise IbridError(
            f"{path}: says that it has {max(counts, key=abs)} signals or states, so it has another "
            "interface"
        )
    words = [
        _text(getattr(info, name)) for name in ("description", "model_version", "creator", "date")
    ]
    return CigreLibrary958(
        functions,
        _text(info.name),
        [word for word in words if word],
        float(info.sample_s),
        _ports(info.input_info[: info.inputs], path),
        _ports(info.output_info[: info.outputs], path),
        _ports(info.parameter_info[: info.parameters], path),
        (info.int_states, info.float_states, info.double_states),
    )


class CigreInstance:
    """An instance of a library, in memory of ours.

    Its numbers are reached through views: type -> array over the structure.
    """

    def __init__(self, library: CigreLibrary958, parameters: Mapping[str, float | str]) -> None:
        self.library = library
        self.inputs = _views(library.inputs.values())
        self.outputs = _views(library.outputs.values())
        self.parameters = _views(library.parameters.values())
        self._states = [
            np.zeros(count + 1, dtype=kind)
            for count, kind in zip(library.states, ("i4", "f4", "f8"), strict=True)
        ]
        self._texts: list[ctypes.Array] = []
        self.memory = np.zeros(ctypes.sizeof(ModelInstance) // 8)
        self.instance = ModelInstance.from_buffer(self.memory)
        for name, view in (
            ("inputs", self.inputs),
            ("outputs", self.outputs),
            ("parameters", self.parameters),
        ):
            setattr(self.instance, name, view["u1"].ctypes.data)
        for name, states in zip(
            ("int_states", "float_states", "double_states"), self._states, strict=True
        ):
            setattr(self.instance, name, states.ctypes.data)
        self.instance.mode = EMT
        self.address = self.memory.ctypes.data
        if strange := [name for name in parameters if name not in library.parameters]:
            raise IbridError(
                f"{library.name} has no parameter {strange[0]!r:.60}; "
                f"{near(strange[0], library.parameters)}"
            )
        for name, port in library.parameters.items():
            self._set_parameter(port, parameters.get(name, port.usual))

    def begin(self) -> None:
        """First call, check of the parameters, initialisation, at the inputs that are written."""
        for name in ("FirstCall", "CheckParameters", "Initialize"):
            self.require(self.library.functions[name](self.address), f"Model_{name}")

    def require(self, answer: int, function: str) -> None:
        """Raise IbridError, with the library's own words, where a function answered an error."""
        if answer >= ERROR:
            words = _text(self.instance.error) or "no further word"
            raise IbridError(
                f"{self.library.name}: {function} refused at t = {self.instance.time:g} s ({words})"
            )

    def put(self, name: str, value: float) -> None:
        """Set an input, or a parameter that is no input."""
        for ports, views in (
            (self.library.inputs, self.inputs),
            (self.library.parameters, self.parameters),
        ):
            if name in ports:
                _write(views, ports[name], value)
                return
        raise IbridError(
            f"{self.library.name} has no input {name!r:.60}; {near(name, self.library.inputs)}"
        )

    def _set_parameter(self, port: CigrePort, value: float | str) -> None:
        if port.type == TEXT:
            self._texts.append(ctypes.create_string_buffer(str(value).encode()))
            value = ctypes.addressof(self._texts[-1])
        elif isinstance(value, str):
            raise IbridError(
                f"{self.library.name}: the parameter {port.name} must be a number; found "
                f"{value!r:.40}"
            )
        elif port.range is not None and not port.range[0] <= value <= port.range[1]:
            low, high = port.range
            raise IbridError(
                f"{self.library.name}: the parameter {port.name} must be {low:g} to {high:g}; "
                f"found {value:g}"
            )
        _write(self.parameters, port, value)


def _ports(entries: Sequence[Any], path: Path) -> dict[str, CigrePort]:
    """Names and offsets of the members of a structure."""
    ports: dict[str, CigrePort] = {}
    offset = 0
    for entry in entries:
        if entry.type not in TYPES:
            raise IbridError(
                f"{path}: {_text(entry.name)!r} has a type {entry.type} that the IEEE/CIGRE "
                "interface lacks"
            )
        size = np.dtype(TYPES[entry.type]).itemsize
        width = max(getattr(entry, "width", 1), 1)
        offset = -(-offset // size) * size
        for number in range(min(width, MOST)):
            name = _text(entry.name) if width == 1 else f"{_text(entry.name)}[{number}]"
            usual, range_ = _values(entry) if isinstance(entry, _ParameterInfo) else (0.0, None)
            words = _text(entry.unit), _text(entry.description)
            ports[name] = CigrePort(name, *words, entry.type, offset, usual, range_)
            offset += size
    return ports


def _values(entry: Any) -> tuple[float | str, tuple[float, float] | None]:
    """Default of a parameter, and its range where it is a number and the highest value lies above
    the lowest.
    """
    if entry.type == TEXT:
        return _text(ctypes.c_char_p.from_buffer_copy(entry.default).value), None
    parts = (entry.default, entry.minimum, entry.maximum)
    usual, low, high = (
        float(np.frombuffer(bytes(one), dtype=TYPES[entry.type], count=1)[0]) for one in parts
    )
    return usual, (low, high) if low < high else None


def _write(views: Mapping[str, np.ndarray], port: CigrePort, value: float) -> None:
    """A number into a structure; whole ones are rounded."""
    kind = TYPES[port.type]
    views[kind][port.place] = value if kind[0] == "f" else round(value)


def _views(ports: Any) -> dict[str, np.ndarray]:
    """Memory of a structure, as an array for each type of number."""
    ends = [port.offset + 8 for port in ports]
    memory = np.zeros(max(ends, default=8) // 8 + 1, dtype="u8")
    return {kind: memory.view(kind) for kind in sorted(set(TYPES.values()))}


def _text(content: bytes | None) -> str:
    return " ".join((content or b"")[:LONGEST].decode("utf-8", errors="replace").split())


def _require_own_platform(path: Path) -> None:
    """Raise IbridError where the first bytes of a file say that it is for another system, or for 32
    bits.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(4096)
    except OSError as error:
        raise IbridError(
            f"{path}: cannot be read ({error.strerror}); correct `file` in the device file"
        ) from None
    windows = sys.platform == "win32"
    if head[:4] == b"\x7fELF":
        system, bits = "Linux", 32 if head[4] == 1 else 64
    elif head[:2] == b"MZ":
        at = struct.unpack_from("<I", head, 0x3C)[0] if len(head) > 0x40 else 0
        machine = struct.unpack_from("<H", head, at + 4)[0] if at + 6 <= len(head) else 0
        system, bits = "Windows", 32 if machine == 0x14C else 64
    elif sys.platform == "darwin":
        return
    else:
        raise IbridError(
            f"{path}: is no library; a .dll, .so or .dylib with the IEEE/CIGRE interface must be "
            "given"
        )
    own = "Windows" if windows else "Linux"
    if system != own and sys.platform != "darwin":
        raise IbridError(
            f"{path}: is a library for {system}, and this is {own}; measure it there, or ask for "
            f"one for {own}"
        )
    if bits != struct.calcsize("P") * 8:
        raise IbridError(
            f"{path}: is a library of {bits} bits, and this Python has {struct.calcsize('P') * 8}; "
            "ask for one of as many"
        )
