"""C99: one source file with the matrices and an exact step, for real-time targets and programs of one's own."""

import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from textwrap import wrap

import numpy as np
from scipy.linalg import matrix_balance

from ibrid.analysis.models.linear_model import UNITS, LinearModel
from ibrid.export.names import C, written_in


@written_in(C)
def c_source(model: LinearModel, name: str = "inverter") -> bytes:
    """The file's content: constant matrices with all their digits, and the functions of `sources/linear_model.c`.

    The step x(t + h) = exp(A h) x(t) + ... is exact for a voltage that is held or goes in a straight line; h is chosen
    at run time. name : of the type and in front of every symbol, so that several models go into one program; with NAME_HEADER
    defined the file declares what it otherwise defines.
    """
    _, (scale, _) = matrix_balance(model.A, permute=False, separate=True)
    big = name.upper()
    first, functions = renamed(template("linear_model.c"), name).split("/* --- functions --- */\n")
    parts = [
        c_comment(
            model,
            f"{model.name}: a linear inverter model written by ibrid.",
            f"{UNITS}.",
            f"    static {name} model;                      all zero: at rest",
            f"    {name}_set_step(&model, 1e-4);            once; -1 if the step is not possible",
            f"    {name}_output(&model, v, i);              i[2] from v[2]: deviations from the operating point",
            f"    {name}_step(&model, v, v_next);           give v twice where it is held during the step",
            name=name,
        ),
        f"enum {{ {big}_STATES = {len(model.states)} }};\n",
        first,
        f"#ifndef {big}_HEADER\n#include <math.h>\n#include <string.h>\n",
        *(
            names_of(f"{name}_{part}", getattr(model, part))
            for part in ("states", "inputs", "outputs")
        ),
        *(f"const double {name}_{one} = {value!r};" for one, value in model.at_rest().items()),
        *(_matrix(f"{big}_{part}", getattr(model, part)) for part in "ABCD"),
        f"/* powers of two that balance A */\nstatic const double {big}_SCALE[{big}_STATES] = {{{_row(scale)}}};\n",
        functions,
        "#endif\n",
    ]
    return "\n".join(parts).encode()


def template(file: str) -> str:
    """One of `sources`."""
    return (files("ibrid.export") / "sources" / file).read_text(encoding="utf-8")


def renamed(source: str, name: str) -> str:
    """The source with `name` and NAME in place of inverter and INVERTER wherever a symbol begins so."""
    return re.sub(r"\binverter(?=\b|_)", name, re.sub(r"\bINVERTER(?=\b|_)", name.upper(), source))


def c_comment(model: LinearModel, *first: str, name: str) -> str:
    """The file's first lines: what it holds, how it is used, at which operating point and with which numbers."""
    lines = [
        *first,
        "",
        f"Operating point {model.op}: p = {model.p!r}, q = {model.q!r} at the {model.power_node}, v = {model.v!r}, per "
        f"unit; nominal frequency {model.f0_hz!r} Hz.",
        *_listed(
            "Delays are Pade forms",
            {name: f"order {order}" for name, order in model.pade_orders.items()},
        ),
        *_listed(
            "Fitted parameters", {name: repr(value) for name, value in model.parameters.items()}
        ),
        "",
        f"Elsewhere in the program this file declares all that after #define {name.upper()}_HEADER. At rest the terminals have "
        f"{', '.join(f'{name}_{one}' for one in model.at_rest())}: per unit, rad/s, VA, V.",
    ]
    wrapped = [part for line in lines for part in wrap(line, 116, replace_whitespace=False) or [""]]
    return "/* " + "\n".join(f" * {line}".rstrip() for line in wrapped)[3:] + "\n */"


def _listed(title: str, values: Mapping[str, str]) -> Sequence[str]:
    return (
        [f"{title}: {', '.join(f'{name} = {value}' for name, value in values.items())}."]
        if values
        else []
    )


def names_of(name: str, words: Sequence[str]) -> str:
    """A constant array of texts that the language admits."""
    listed = ", ".join(f'"{word}"' for word in words)
    return f"const char *const {name}[{len(words)}] = {{{listed}}};"


def numbers_of(name: str, values: Sequence[float] | np.ndarray) -> str:
    """A constant array."""
    return f"static const double {name}[{len(values)}] = {{{_row(np.asarray(values, dtype=float))}}};\n"


def _matrix(name: str, values: np.ndarray) -> str:
    rows, columns = values.shape
    listed = ",\n".join(f"    {{{_row(row)}}}" for row in values)
    return f"static const double {name}[{rows}][{columns}] = {{\n{listed}\n}};"


def _row(values: np.ndarray) -> str:
    return ", ".join(f"{value:.17g}" for value in values.tolist())
