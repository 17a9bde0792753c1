"""Modelica: a block with named connectors and named states, one file that needs no library."""

import re
from collections.abc import Iterable, Sequence

import numpy as np

from ibrid.analysis.models.linear_model import UNITS, LinearModel
from ibrid.export.names import MODELICA, MODELICA_WORDS, written_in

INPUT, OUTPUT = "RealInput", "RealOutput"
#: The same types as those of the standard library, so that signals of its blocks connect.
CONNECTORS = (f"  connector {INPUT} = input Real;", f"  connector {OUTPUT} = output Real;")


@written_in(MODELICA)
def modelica(model: LinearModel, name: str = "LinearInverter") -> bytes:
    """The file's content: a block with v_D, v_Q in, i_D, i_Q out, deviations from the operating
    point v0, i0.

    State "pll.angle" is called pll_angle, starts at zero and has its own equation. name : of the
    block.
    """
    rest = model.at_rest()
    outer = (*model.inputs, *model.outputs, *rest)
    states = identifiers([*outer, *model.states])[len(outer) :]
    columns = (*states, *model.inputs)
    derivatives = [
        (f"der({state})", row)
        for state, row in zip(states, np.hstack([model.A, model.B]), strict=True)
    ]
    currents = [
        (name, row) for name, row in zip(model.outputs, np.hstack([model.C, model.D]), strict=True)
    ]
    lines = [
        f"block {name} {quoted(f'{model.name} at {model.op}, written by ibrid')}",
        *CONNECTORS,
        *(
            f"  {INPUT} {name} {quoted('terminal voltage, deviation, per unit')};"
            for name in model.inputs
        ),
        *(
            f"  {OUTPUT} {name} {quoted('current out of the inverter, deviation, per unit')};"
            for name in model.outputs
        ),
        *(f"  parameter Real {one} = {value!r};" for one, value in rest.items()),
        *(
            f"  Real {state}(start = 0, fixed = true) {quoted(f'{name}, deviation')};"
            for state, name in zip(states, model.states, strict=True)
        ),
        "equation",
        *(f"  {left} = {weighted(row, columns)};" for left, row in (*derivatives, *currents)),
        f"  annotation(Documentation(info = {documentation(model)}));",
        f"end {name};",
    ]
    return ("\n".join(lines) + "\n").encode()


def identifiers(names: Iterable[str]) -> tuple[str, ...]:
    """A Modelica identifier for each name: dots become underscores; keywords and doubles get one
    more.
    """
    unique: list[str] = []
    for name in names:
        word = re.sub(r"\W|^(?=\d)", "_", name, flags=re.ASCII)
        while word in unique or word in MODELICA_WORDS:
            word += "_"
        unique.append(word)
    return tuple(unique)


def quoted(text: str) -> str:
    """A Modelica string."""
    return f'"{MODELICA.text(text)}"'


def documentation(model: LinearModel, units: str = UNITS) -> str:
    """What the numbers mean: a Modelica string of HTML, from a model with Modelica's names."""
    parameters = ", ".join(f"{name} = {value!r}" for name, value in model.parameters.items())
    delays = ", ".join(f"{name} of order {order}" for name, order in model.pade_orders.items())
    sentences = [
        f"{units}.",
        f"Operating point: p = {model.p!r}, q = {model.q!r} at the {model.power_node}, v = "
        f"{model.v!r}, per unit; "
        f"nominal frequency {model.f0_hz!r} Hz.",
        *([f"Pade forms of delays: {delays}."] if delays else []),
        *([f"Fitted parameters: {parameters}."] if parameters else []),
    ]
    return f'"<html>{"".join(f"<p>{sentence}</p>" for sentence in sentences)}</html>"'


def weighted(gains: Sequence[float] | np.ndarray, names: Sequence[str]) -> str:
    """Sum of number times name, zeros left out; "0" of nothing."""
    terms = [
        f"{float(gain)!r}*{name}" for gain, name in zip(gains, names, strict=True) if gain != 0
    ]
    return " + ".join(terms).replace("+ -", "- ") if terms else "0"
