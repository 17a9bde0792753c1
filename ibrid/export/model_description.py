"""modelDescription.xml of FMI 2.0: the variables of a linear model, their start values and what depends on what."""

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

from ibrid.analysis.linear_model import UNITS, LinearModel
from ibrid.export.names import XML, written_in

IDENTIFIER = "inverter"


@written_in(XML)
def model_description(model: LinearModel, guid: str, sources: Sequence[str]) -> bytes:
    """The file's content; variables in the order of their value references (`sources/fmi2.c`)."""
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=model.name,
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
        abilities = {"modelIdentifier": IDENTIFIER, **dict.fromkeys(able, "true")}
        element = ElementTree.SubElement(root, way, abilities)
        listed = ElementTree.SubElement(element, "SourceFiles")
        for name in sources:
            ElementTree.SubElement(listed, "File", name=name)
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
