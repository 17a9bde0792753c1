"""C99 of the nonlinear averaged model: the laws of all modules in one function, integrated at any
step.
"""

import re
from collections.abc import Sequence

import casadi as ca
import numpy as np

from ibrid.analysis.models.linear_model import LinearModel
from ibrid.assembly.averaged import NonlinearModel
from ibrid.errors import IbridError
from ibrid.export.c_source import c_comment, names_of, numbers_of, renamed, template
from ibrid.export.names import C, written_in
from ibrid.export.nonlinear_model import ABSOLUTE

#: Step times the fastest mode. Runge-Kutta of order 4 is stable to 2.7; here its phase errs by 2e-6
#: of the way.
_SHARE = 0.125


@written_in(C)
def nonlinear_c(model: LinearModel, moving: NonlinearModel, name: str = "inverter") -> bytes:
    """The file's content: f and h of the nonlinear model as one function, its derivatives as
    another, and what `sources/nonlinear_model.c` does with them. name : as in `c_source`; model :
    the linear one at the same operating point.

    Raises IbridError for a model with algebraic loops.
    """
    if moving.algebraic:
        raise IbridError(
            f"the model has a loop of direct terms through {moving.algebraic[0]}, which C has to "
            "solve at every step; export "
            "modelica --nonlinear, or the linear model"
        )
    big = name.upper()
    first, functions = renamed(template("nonlinear_model.c"), name).split(
        "/* --- functions --- */\n"
    )
    fastest = float(np.abs(np.linalg.eigvals(model.A)).max()) if len(model.A) else 1.0
    references = [C.text(one) for one in moving.references]
    parts = [
        c_comment(
            model,
            f"{model.name}: a nonlinear averaged inverter model written by ibrid.",
            f"{ABSOLUTE}.",
            f"    static {name} model;",
            f"    {name}_reset(&model);                     at rest at the operating point",
            f"    {name}_set_step(&model, 1e-4);            -1 if the step is not possible",
            f"    {name}_output(&model, v, i);              i[2] from v[2]",
            f"    {name}_step(&model, v, v_next);           give v twice where it is held during "
            "the step",
            f"    model.r[k]                                constants {name}_references[k] that "
            "hold the operating point",
            name=name,
        ),
        f"enum {{ {big}_STATES = {len(model.states)}, {big}_REFERENCES = {len(references)} }};\n",
        first,
        f"#ifndef {big}_HEADER\n#include <math.h>\n#include <string.h>\n",
        *(
            names_of(f"{name}_{part}", getattr(model, part))
            for part in ("states", "inputs", "outputs")
        ),
        names_of(f"{name}_references", references or ["none"]),
        *(f"const double {name}_{one} = {value!r};" for one, value in model.at_rest().items()),
        numbers_of(f"{big}_X0", moving.x0),
        numbers_of(f"{big}_R0", [*moving.r0, 0.0]),
        f"static const double {big}_LONGEST = {_SHARE / fastest!r};\n",
        *_laws(moving, name),
        functions,
        "#endif\n",
    ]
    return "\n".join(parts).encode()


def _laws(moving: NonlinearModel, name: str) -> Sequence[str]:
    x, v, r = (
        ca.SX.sym(one, size)
        for one, size in (("x", len(moving.x0)), ("v", 2), ("r", len(moving.r0)))
    )
    dx, i = moving.f(x, np.zeros(0), v, r), moving.h(x, np.zeros(0), v, r)
    x_seed, v_seed = ca.SX.sym("x_seed", len(moving.x0)), ca.SX.sym("v_seed", 2)
    moved = [ca.jtimes(one, ca.vertcat(x, v), ca.vertcat(x_seed, v_seed)) for one in (dx, i)]
    law = ca.Function("law", [x, v, r], [ca.densify(dx), ca.densify(i)])
    linear = ca.Function("linear", [x, v, r, x_seed, v_seed], [ca.densify(one) for one in moved])
    generator = ca.CodeGenerator("law.c", {"with_export": False})
    generator.add(law)
    generator.add(linear)
    text = generator.dump()
    helpers = re.findall(
        r"^(?:static )?casadi_real casadi_\w+\(.*?\) *\{.*?\}$", text, re.MULTILINE
    )
    lines = [
        *(re.sub("^(static )?", "static ", one) for one in helpers),
        *_function(text, 0, f"{name}_law", "xvr"),
        *_function(text, 1, f"{name}_linear", (*"xvr", "x_seed", "v_seed")),
    ]
    return [
        re.sub(r"\bcasadi_(?!real)", f"{name}_", one).replace("casadi_real", "double")
        for one in lines
    ]


def _function(text: str, number: int, name: str, inputs: Sequence[str]) -> list[str]:
    """One function of CasADi's code, its arguments by name."""
    outputs = ("dx", "i")
    written = re.search(
        rf"static int casadi_f{number}\(.*?\) \{{\n(.*?)  return 0;\n\}}", text, re.DOTALL
    )
    if written is None:
        raise IbridError(
            "this version of CasADi writes C in another way; install casadi 3.6 or newer"
        )
    code = re.sub(
        r"arg\[(\d+)\]\? arg\[\1\]\[(\d+)\] : 0",
        lambda one: f"{inputs[int(one[1])]}[{one[2]}]",
        written[1],
    )
    code = re.sub(
        r"if \(res\[(\d+)\]!=0\) res\[\1\]\[(\d+)\]=",
        lambda one: f"{outputs[int(one[1])]}[{one[2]}]=",
        code,
    )
    declared = [f"const double {one}[]" for one in inputs] + [f"double {one}[]" for one in outputs]
    used = ", ".join(f"(void){one}" for one in inputs)
    return [
        f"static void {name}({', '.join(declared)})",
        "{",
        code.rstrip("\n"),
        f"  {used};",
        "}",
        "",
    ]
