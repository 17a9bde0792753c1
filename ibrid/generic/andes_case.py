"""A case that ANDES reads (JSON): the generic model at one bus, a line, and a stiff grid.

Law: ANDES limits the input of the lag by Rrpwr, Iqrmax and Iqrmin, so that the state moves by the
limit over Tg; they are written times Tg where the values are of the state. It calls Vbias Vref1.
"""

from collections.abc import Mapping

from ibrid.generic.block import LawBlock
from ibrid.writing import json_lines

#: Of the line, per unit; powers of the case, MVA.
X_LINE, BASE = 0.1, 100.0
_OF_LAG = ("Rrpwr", "Iqrmax", "Iqrmin")
_CALLED = {"Vbias": "Vref1"}
_LEFT = ("Accel",)


def andes_case(
    blocks: tuple[LawBlock, ...],
    values: Mapping[str, float],
    rest: tuple[float, float, float],
    f0_hz: float,
    rate_over_tg: bool,
) -> str:
    """The text of the file. rest : p, q, v. rate_over_tg : whether rates are those of ANDES
    already.
    """
    p, q, v = rest
    scale = 1.0 if rate_over_tg else values["Tg"]
    own = {name: value * scale if name in _OF_LAG else value for name, value in values.items()}
    line = {"idx": "L1", "bus1": 1, "bus2": 2, "Vn1": 110, "Vn2": 110, "Sn": BASE, "fn": f0_hz}
    slack = {"idx": "S1", "bus": 1, "Sn": BASE, "Vn": 110, "v0": v, "a0": 0.0}
    static = {"idx": "G2", "bus": 2, "Sn": BASE, "Vn": 110, "p0": p, "q0": q, "v0": v}
    case = {
        "Bus": [{"idx": k, "name": f"Bus {k}", "Vn": 110, "v0": v} for k in (1, 2)],
        "Line": [{**line, "r": 0.0, "x": X_LINE}],
        "Slack": [slack],
        "PV": [{**static, "qmax": 9.0, "qmin": -9.0}],
        "GENCLS": [{"idx": "GEN1", "bus": 1, "gen": "S1", "Sn": BASE, "Vn": 110, "M": 1e6}],
    }
    for block in blocks:
        links = (
            {"bus": 2, "gen": "G2", "Sn": BASE} if block.dyr == "REGCA1" else {"reg": "REGCA1_1"}
        )
        numbers = {_CALLED.get(name, name): own[name] for name in block.names if name not in _LEFT}
        case[block.dyr] = [{"idx": f"{block.dyr}_1", **links, **numbers}]
    return json_lines(case)
