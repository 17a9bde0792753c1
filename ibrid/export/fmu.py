"""FMU 2.0 for co-simulation and model exchange: compiled code, its sources and a description, in
one zip.
"""

import hashlib
import io
import uuid
import zipfile
from collections.abc import Iterable, Sequence
from xml.etree import ElementTree

import numpy as np

from ibrid.analysis.models.linear_model import UNITS, LinearModel
from ibrid.assembly.averaged import NonlinearModel
from ibrid.export.c_source import c_source, renamed, template
from ibrid.export.compiling import WINDOWS, shared_library
from ibrid.export.names import XML, written_in
from ibrid.export.nonlinear_c import nonlinear_c
from ibrid.export.nonlinear_model import ABSOLUTE

#: The earliest date a zip can hold; with today's, equal models would differ.
_DATE = (1980, 1, 1, 0, 0, 0)
_MAIN = "fmi2.c"
IDENTIFIER = "inverter"


def fmu(
    model: LinearModel,
    name: str = IDENTIFIER,
    *,
    moving: NonlinearModel | None = None,
    windows: bool = False,
) -> bytes:
    """The file's content. Inputs v_D, v_Q and outputs i_D, i_Q are deviations; each state is a
    local variable. Constants say the operating point from which they deviate. name :
    modelIdentifier, and modelName where another one was chosen.
    moving : the nonlinear model at the same point: everything is absolute and begins at rest.
    windows : with a binary for Windows beside that of this platform.

    Co-simulation steps of the linear model are exact for inputs that are held, or interpolated
    linearly; those of the nonlinear one are Runge-Kutta steps; any communication step is allowed.
    Directional derivatives give A, B, C, D.

    Raises IbridError without a C compiler, or on a platform that FMI 2.0 has no name for.
    """
    inverter = c_source(model, name) if moving is None else nonlinear_c(model, moving, name)
    wrapper = renamed(template(_MAIN), name).encode()
    guid = str(uuid.UUID(bytes=hashlib.sha256(inverter + wrapper).digest()[:16]))
    big = name.upper()
    known = {
        "GUID": f'"{guid}"',
        "AT_REST": _braced(model.at_rest().values()),
        "V_START": _braced(_starts(model, moving)[0]),
    }
    defined = "".join(f"#define {big}_{word} {value}\n" for word, value in known.items())
    sources = {f"{name}.c": inverter, _MAIN: defined.encode() + wrapper}
    libraries = [
        shared_library(sources, _MAIN, target) for target in (None, *([WINDOWS] if windows else []))
    ]
    members = {
        "modelDescription.xml": model_description(model, guid, name, moving),
        **{f"binaries/{one.folder}/{name}{one.suffix}": one.content for one in libraries},
        **{f"sources/{file}": content for file, content in sources.items()},
    }
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for file, content in members.items():
            entry = zipfile.ZipInfo(file, _DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system, entry.external_attr = 3, 0o644 << 16
            archive.writestr(entry, content)
    return stream.getvalue()


def _braced(numbers: Iterable[float]) -> str:
    return f"{{{', '.join(repr(float(one)) for one in numbers)}}}"


def _starts(
    model: LinearModel, moving: NonlinearModel | None
) -> tuple[Sequence[float], Sequence[float]]:
    """Of the inputs and of the states."""
    return (
        ((0.0, 0.0), [0.0] * len(model.states))
        if moving is None
        else (moving.v0.tolist(), moving.x0.tolist())
    )


@written_in(XML)
def model_description(
    model: LinearModel,
    guid: str,
    name: str = IDENTIFIER,
    moving: NonlinearModel | None = None,
) -> bytes:
    """The file's content; variables in the order of their value references (`sources/fmi2.c`)."""
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=model.name if name == IDENTIFIER else name,
        guid=guid,
        description=f"{UNITS if moving is None else ABSOLUTE}. "
        f"Operating point {model.op}: p = {model.p!r}, q = {model.q!r} at the {model.power_node}, "
        f"v = {model.v!r}; nominal frequency {model.f0_hz!r} Hz",
        generationTool="ibrid",
        variableNamingConvention="structured",
        numberOfEventIndicators="0",
    )
    for way, more in (
        ("ModelExchange", ()),
        ("CoSimulation", ("canHandleVariableCommunicationStepSize", "canInterpolateInputs")),
    ):
        able = (
            *more,
            "canGetAndSetFMUstate",
            "canSerializeFMUstate",
            "providesDirectionalDerivative",
        )
        element = ElementTree.SubElement(
            root, way, {"modelIdentifier": name, **dict.fromkeys(able, "true")}
        )
        listed = ElementTree.SubElement(element, "SourceFiles")
        ElementTree.SubElement(listed, "File", name=_MAIN)
    ElementTree.SubElement(root, "DefaultExperiment", startTime="0", stopTime="1", stepSize="1e-4")
    _variables(ElementTree.SubElement(root, "ModelVariables"), model, moving)
    _structure(ElementTree.SubElement(root, "ModelStructure"), model, everything=moving is not None)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="utf-8", xml_declaration=True) + b"\n"


def _variables(
    parent: ElementTree.Element, model: LinearModel, moving: NonlinearModel | None
) -> None:
    (v_start, x_start), what = _starts(model, moving), "deviation, " if moving is None else ""
    first_state = 1 + len(model.inputs) + len(model.outputs)  # numbered from one
    for name, start in zip(model.inputs, v_start, strict=True):
        _real(parent, name, f"terminal voltage, {what}per unit", causality="input").set(
            "start", repr(float(start))
        )
    for name in model.outputs:
        note = f"terminal current out of the inverter, {what}per unit"
        _real(parent, name, note, causality="output", initial="calculated")
    for name, start in zip(model.states, x_start, strict=True):
        state = _real(parent, name, f"state, {what}per unit", causality="local", initial="exact")
        state.set("start", repr(float(start)))
    for index, name in enumerate(model.states, first_state):
        rate = _real(parent, f"der({name})", "per second", causality="local", initial="calculated")
        rate.set("derivative", str(index))
    for name, value in model.at_rest().items():
        told = {"causality": "local", "variability": "constant", "initial": "exact"}
        _real(parent, name, "at rest: per unit, rad/s, VA, V", **told).set("start", repr(value))


def _real(
    parent: ElementTree.Element, name: str, description: str, **attributes: str
) -> ElementTree.Element:
    told = {
        "name": name,
        "valueReference": str(len(parent)),
        "description": description,
        "variability": "continuous",
    }
    variable = ElementTree.SubElement(parent, "ScalarVariable", told | attributes)
    return ElementTree.SubElement(variable, "Real")


def _structure(parent: ElementTree.Element, model: LinearModel, *, everything: bool) -> None:
    """Outputs, derivatives and what is calculated at the start, with the variables on which each
    depends; or on everything.
    """
    inputs, outputs, states = len(model.inputs), len(model.outputs), len(model.states)
    known = [*range(1, inputs + 1), *range(inputs + outputs + 1, inputs + outputs + states + 1)]
    output_needs = (np.hstack([model.D, model.C]) != 0) | everything
    rate_needs = (np.hstack([model.B, model.A]) != 0) | everything
    for part in ("Outputs", "Derivatives", "InitialUnknowns"):
        unknowns = ElementTree.SubElement(parent, part)
        if part != "Derivatives":
            _unknowns(unknowns, inputs + 1, output_needs, known)
        if part != "Outputs":
            _unknowns(unknowns, inputs + outputs + states + 1, rate_needs, known)


def _unknowns(
    parent: ElementTree.Element, first: int, needs: np.ndarray, known: Sequence[int]
) -> None:
    for index, row in enumerate(needs, first):
        dependencies = " ".join(str(one) for one, needed in zip(known, row, strict=True) if needed)
        ElementTree.SubElement(parent, "Unknown", index=str(index), dependencies=dependencies)
