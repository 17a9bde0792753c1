"""C99: one source file with the matrices and an exact step, for real-time targets and programs of one's own."""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from textwrap import wrap

import numpy as np
from scipy.linalg import matrix_balance

from ibrid.analysis.linear_model import UNITS, LinearModel
from ibrid.export.names import C, written_in


@written_in(C)
def c_source(model: LinearModel) -> bytes:
    """The file's content: constant matrices with all their digits, and the functions of `sources/linear_model.c`.

    The step x(t + h) = exp(A h) x(t) + ... is exact for a voltage that is held or goes in a straight line; h is chosen
    at run time.
    """
    _, (scale, _) = matrix_balance(model.A, permute=False, separate=True)
    parts = [
        _heading(model),
        "#include <math.h>\n#include <string.h>\n",
        f"enum {{ INVERTER_STATES = {len(model.states)} }};\n",
        _names("inverter_states", model.states),
        _names("inverter_inputs", model.inputs),
        _names("inverter_outputs", model.outputs),
        *(_matrix(f"INVERTER_{part}", getattr(model, part)) for part in "ABCD"),
        "/* powers of two that balance A */\n"
        f"static const double INVERTER_SCALE[INVERTER_STATES] = {{{_row(scale)}}};\n",
        (files("ibrid.export") / "sources" / "linear_model.c").read_text(encoding="utf-8"),
    ]
    return "\n".join(parts).encode()


def _heading(model: LinearModel) -> str:
    lines = [
        f"{model.name}: a linear inverter model written by ibrid.",
        "",
        UNITS + ".",
        f"Operating point {model.op}: p = {model.p!r}, q = {model.q!r} at the {model.power_node}, v = {model.v!r}, per "
        f"unit; nominal frequency {model.f0_hz!r} Hz.",
        *_listed("Delays are Pade forms", {name: f"order {order}" for name, order in model.pade_orders.items()}),
        *_listed("Fitted parameters", {name: repr(value) for name, value in model.parameters.items()}),
        "",
        "    static inverter model;                      all zero: at rest",
        "    inverter_set_step(&model, 1e-4);            once; -1 if the step is not possible",
        "    inverter_output(&model, v, i);              i[2] from v[2]: deviations from the operating point",
        "    inverter_step(&model, v, v_next);           give v twice where it is held during the step",
    ]
    wrapped = [part for line in lines for part in wrap(line, 116, replace_whitespace=False) or [""]]
    return "/* " + "\n".join(f" * {line}".rstrip() for line in wrapped)[3:] + "\n */"


def _listed(title: str, values: Mapping[str, str]) -> Sequence[str]:
    return [f"{title}: {', '.join(f'{name} = {value}' for name, value in values.items())}."] if values else []


def _names(name: str, words: Sequence[str]) -> str:
    listed = ", ".join(f'"{word}"' for word in words)
    return f"const char *const {name}[{len(words)}] = {{{listed}}};"


def _matrix(name: str, values: np.ndarray) -> str:
    rows, columns = values.shape
    listed = ",\n".join(f"    {{{_row(row)}}}" for row in values)
    return f"static const double {name}[{rows}][{columns}] = {{\n{listed}\n}};"


def _row(values: np.ndarray) -> str:
    return ", ".join(f"{value:.17g}" for value in values.tolist())
