"""FMU 2.0 for co-simulation and model exchange: compiled code, its sources and a description, in one zip."""

import hashlib
import io
import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ibrid.analysis.linear_model import UNITS, LinearModel
from ibrid.errors import IbridError
from ibrid.export.c_source import c_source, renamed, template
from ibrid.export.names import XML, written_in

#: The earliest date a zip can hold; with today's, equal models would differ.
_DATE = (1980, 1, 1, 0, 0, 0)
_MAIN = "fmi2.c"
IDENTIFIER = "inverter"


def fmu(model: LinearModel, name: str = IDENTIFIER) -> bytes:
    """The file's content. Inputs v_D, v_Q and outputs i_D, i_Q are deviations; each state is a local variable. Constants say
    the operating point from which they deviate. name : modelIdentifier, and modelName where another one was chosen.

    Co-simulation steps are exact for inputs that are held, or interpolated linearly; any communication step is allowed.
    Directional derivatives give A, B, C, D.

    Raises IbridError without a C compiler, or on a platform that FMI 2.0 has no name for.
    """
    inverter = c_source(model, name)
    wrapper = renamed(template(_MAIN), name).encode()
    guid = str(uuid.UUID(bytes=hashlib.sha256(inverter + wrapper).digest()[:16]))
    at_rest = ", ".join(map(repr, model.at_rest().values()))
    big = name.upper()
    known = f'#define {big}_GUID "{guid}"\n#define {big}_AT_REST {{{at_rest}}}\n'
    sources = {f"{name}.c": inverter, _MAIN: known.encode() + wrapper}
    library = shared_library(sources, _MAIN)
    members = {
        "modelDescription.xml": model_description(model, guid, (_MAIN,), name),
        f"binaries/{library.folder}/{name}{library.suffix}": library.content,
        **{f"sources/{name}": content for name, content in sources.items()},
    }
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in members.items():
            entry = zipfile.ZipInfo(name, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system, entry.external_attr = 3, 0o644 << 16
            archive.writestr(entry, content)
    return stream.getvalue()


@written_in(XML)
def model_description(model: LinearModel, guid: str, sources: Sequence[str], name: str = IDENTIFIER) -> bytes:
    """The file's content; variables in the order of their value references (`sources/fmi2.c`)."""
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=model.name if name == IDENTIFIER else name,
        guid=guid,
        description=f"{UNITS}. Operating point {model.op}: p = {model.p!r}, q = {model.q!r} at the {model.power_node}, "
        f"v = {model.v!r}; nominal frequency {model.f0_hz!r} Hz",
        generationTool="ibrid",
        variableNamingConvention="structured",
        numberOfEventIndicators="0",
    )
    for way, more in (
        ("ModelExchange", ()),
        ("CoSimulation", ("canHandleVariableCommunicationStepSize", "canInterpolateInputs")),
    ):
        able = (*more, "canGetAndSetFMUstate", "canSerializeFMUstate", "providesDirectionalDerivative")
        abilities = {"modelIdentifier": name, **dict.fromkeys(able, "true")}
        element = ElementTree.SubElement(root, way, abilities)
        listed = ElementTree.SubElement(element, "SourceFiles")
        for source in sources:
            ElementTree.SubElement(listed, "File", name=source)
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize="1e-4")
    _variables(ElementTree.SubElement(root, "ModelVariables"), model)
    _structure(ElementTree.SubElement(root, "ModelStructure"), model)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _variables(parent: ElementTree.Element, model: LinearModel) -> None:
    first_state = 1 + len(model.inputs) + len(model.outputs)  # numbered from one
    for name in model.inputs:
        _real(parent, name, "terminal voltage, deviation, per unit", causality="input").set("start", "0")
    for name in model.outputs:
        note = "terminal current out of the inverter, deviation, per unit"
        _real(parent, name, note, causality="output", initial="calculated")
    for name in model.states:
        _real(parent, name, "state, deviation", causality="local", initial="exact").set("start", "0")
    for index, name in enumerate(model.states, first_state):
        rate = _real(parent, f"der({name})", "per second", causality="local", initial="calculated")
        rate.set("derivative", str(index))
    for name, value in model.at_rest().items():
        told = {"causality": "local", "variability": "constant", "initial": "exact"}
        _real(parent, name, "at rest: per unit, rad/s, VA, V", **told).set("start", repr(value))


def _real(parent: ElementTree.Element, name: str, description: str, **attributes: str) -> ElementTree.Element:
    told = {"name": name, "valueReference": str(len(parent)), "description": description, "variability": "continuous"}
    variable = ElementTree.SubElement(parent, "ScalarVariable", told | attributes)
    return ElementTree.SubElement(variable, "Real")


def _structure(parent: ElementTree.Element, model: LinearModel) -> None:
    """Outputs, derivatives and what is calculated at the start, with the variables on which each depends."""
    inputs, outputs, states = len(model.inputs), len(model.outputs), len(model.states)
    known = [*range(1, inputs + 1), *range(inputs + outputs + 1, inputs + outputs + states + 1)]
    output_needs = np.hstack([model.D, model.C]) != 0
    rate_needs = np.hstack([model.B, model.A]) != 0
    for part in ("Outputs", "Derivatives", "InitialUnknowns"):
        unknowns = ElementTree.SubElement(parent, part)
        if part != "Derivatives":
            _unknowns(unknowns, inputs + 1, output_needs, known)
        if part != "Outputs":
            _unknowns(unknowns, inputs + outputs + states + 1, rate_needs, known)


def _unknowns(parent: ElementTree.Element, first: int, needs: np.ndarray, known: Sequence[int]) -> None:
    for index, row in enumerate(needs, first):
        dependencies = " ".join(str(one) for one, needed in zip(known, row, strict=True) if needed)
        ElementTree.SubElement(parent, "Unknown", index=str(index), dependencies=dependencies)


COMPILERS = ("cc", "gcc", "clang")

#: (system, bits) -> the folder that FMI 2.0 gives it, and the ending of its shared libraries.
_PLATFORMS = {
    ("linux", 64): ("linux64", ".so"),
    ("linux", 32): ("linux32", ".so"),
    ("darwin", 64): ("darwin64", ".dylib"),
    ("win32", 64): ("win64", ".dll"),
    ("win32", 32): ("win32", ".dll"),
}
# contraction to fused operations would make the numbers depend on the processor; no build id, no path, no date
_OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-shared")


@dataclass(frozen=True)
class SharedLibrary:
    """`folder` : FMI's name of the platform. `suffix` : of its shared libraries. `content` : the file."""

    folder: str
    suffix: str
    content: bytes


def shared_library(sources: Mapping[str, bytes], main: str) -> SharedLibrary:
    """Compile `main`, one of the named sources, which may include the others.

    Raises IbridError without a C compiler, on a platform that FMI 2.0 has no name for, or where compiling fails.
    """
    compiler = next(filter(None, map(shutil.which, COMPILERS)), None)
    if compiler is None:
        raise IbridError(
            f"an FMU needs a C compiler, found none of {', '.join(COMPILERS)}; install one (Debian: apt-get install gcc "
            "libc6-dev), or export c or modelica, which need none"
        )
    folder, suffix = fmi_platform()
    portable = () if sys.platform == "win32" else ("-fPIC",)
    with tempfile.TemporaryDirectory(prefix="ibrid-") as place:
        for name, content in sources.items():
            (Path(place) / name).write_bytes(content)
        command = [compiler, *_OPTIONS, *portable, "-o", f"model{suffix}", main, "-lm"]
        done = subprocess.run(command, cwd=place, capture_output=True, text=True, errors="replace", check=False)
        library = Path(place) / f"model{suffix}"
        if done.returncode != 0 or not library.is_file():
            said = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr.strip()[:200])
            raise IbridError(f"{compiler} must compile the exported model; it says: {said or done.returncode}")
        return SharedLibrary(folder, suffix, library.read_bytes())


def fmi_platform() -> tuple[str, str]:
    """The folder of this platform in an FMU 2.0 and the ending of its shared libraries; IbridError without one."""
    bits = 64 if sys.maxsize > 2**32 else 32
    machine = platform.machine().lower()
    known = _PLATFORMS.get((sys.platform, bits))
    if known is None or (sys.platform == "linux" and machine not in ("x86_64", "amd64", "i386", "i686", "x86")):
        raise IbridError(
            f"FMI 2.0 has binaries for Linux and Windows on x86 and for macOS, found {sys.platform} on {machine}; "
            "export on one of those, or export c or modelica"
        )
    return known
