"""Operating points as the command line writes them."""

from math import isfinite

from ibrid.border import takes_kinds
from ibrid.errors import OperatingPointError
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.ranges import written_number


@takes_kinds
def operating_point(text: str) -> OperatingPoint:
    """An operating point from "p=1,q=0.3[,v=1]", per unit, delivered; its name is the text in a
    normal form.

    Raises OperatingPointError when the text has another form, p or q is missing, or v is not
    positive.
    """
    form = "an operating point is written p=1,q=0.3 or p=1,q=0.3,v=1.02"
    values: dict[str, float] = {}
    for part in text.split(","):
        key, mark, number = (piece.strip() for piece in part.partition("="))
        if not mark or key not in ("p", "q", "v") or key in values:
            raise OperatingPointError(f"{form}; found {text!r}.")
        try:
            values[key] = written_number(number)
        except ValueError:
            raise OperatingPointError(f"{form}; {number!r} is not a number.") from None
    if not {"p", "q"} <= set(values):
        raise OperatingPointError(f"{form}, with both p and q; found {text!r}.")
    if not all(isfinite(value) for value in values.values()) or values.get("v", 1.0) <= 0:
        raise OperatingPointError(f"{form}, with finite values and v above 0; found {text!r}.")
    v = values.get("v", 1.0)
    name = f"p={values['p']:g},q={values['q']:g}" + (f",v={v:g}" if v != 1.0 else "")
    return OperatingPoint(name, values["p"], values["q"], v)
