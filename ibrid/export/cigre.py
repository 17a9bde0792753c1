"""The nonlinear model as a library of the IEEE/CIGRE interface for EMT programs (CIGRE Technical
Brochure 958).
"""

from dataclasses import dataclass
from math import sqrt

from ibrid.analysis.models.linear_model import LinearModel
from ibrid.assembly.averaged import NonlinearModel
from ibrid.export.c_source import renamed, template
from ibrid.export.compiling import WINDOWS, SharedLibrary, shared_library
from ibrid.export.modelica import identifiers
from ibrid.export.names import C, written_in
from ibrid.export.nonlinear_c import nonlinear_c

#: Seconds between two calls.
SAMPLE = 10e-6


@dataclass(frozen=True)
class CigreLibrary:
    """`source` : one C file. `library` : it compiled."""

    source: bytes
    library: SharedLibrary


def cigre(
    model: LinearModel, moving: NonlinearModel, name: str = "inverter", *, windows: bool = False
) -> CigreLibrary:
    """Instantaneous terminal voltages in, currents out; kV and kA where the bases are known, else
    per unit.

    name : of the C symbols and the ModelName. Parameters are the bases, the angle at time 0 and the
    references. windows : for Windows whatever this platform is.

    Raises IbridError as `nonlinear_c` and `shared_library`.
    """
    source = _source(model, moving, name)
    return CigreLibrary(
        source, shared_library({f"{name}.c": source}, f"{name}.c", WINDOWS if windows else None)
    )


@written_in(C)
def _source(model: LinearModel, moving: NonlinearModel, name: str) -> bytes:
    big, known = name.upper(), model.s_base_va is not None and model.v_base_v is not None
    peak = model.v_base_v * sqrt(2 / 3) if known and model.v_base_v else 1e3
    current = model.s_base_va / (1.5 * peak) if known and model.s_base_va else 1e3
    references = identifiers(
        ["V_base", "I_base", "theta_0", *(f"reference_{one}" for one in moving.references)]
    )[3:]
    numbers = [
        f'NUMBER("{word}", "references", "holds the operating point", "pu", {value!r}, -1e6, 1e6),'
        for word, value in zip(references, moving.r0.tolist(), strict=True)
    ]
    defined = {
        "V_UNIT": '"kV"' if known else '"pu"',
        "I_UNIT": '"kA"' if known else '"pu"',
        "V_BASE": repr(peak / 1e3),
        "I_BASE": repr(current / 1e3),
        "V_START": "{{{!r}, {!r}}}".format(*moving.v0.tolist()),
        "SAMPLE": repr(SAMPLE),
        "TITLE": f'"{name}"',
        "POINT": f'"at {model.op}: p = {model.p!r}, q = {model.q!r} at the {model.power_node}, v = '
        f'{model.v!r}"',
        "PARAMETERS": " ".join(numbers),
    }
    lines = "".join(f"#define {big}_{word} {value}\n" for word, value in defined.items())
    wrapper = renamed(template("cigre.c"), name)
    inner = nonlinear_c(model, moving, name).decode()
    return wrapper.replace(f'#include "{name}.c"\n', f"{inner}\n{lines}").encode()
