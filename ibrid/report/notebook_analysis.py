"""How the answers of `predict` and `stability` show themselves in notebooks: verdict, curves, and to unfold the rest."""

from ibrid.analysis.modes import QUANTILE
from ibrid.analysis.prediction import Prediction
from ibrid.analysis.stability import Stability
from ibrid.measurement.quantities import hertz
from ibrid.report.bode import Curves, bode_figures
from ibrid.report.markup import bullets, data, folded, page_header, paragraph, stable_or_not
from ibrid.report.notebook_output import output, tag
from ibrid.report.numbers import percent
from ibrid.report.stability_page import modes_table, stability_facts, stability_sections

#: Parts of a stability study that are shown at once; all others are to be unfolded.
OPEN = ("critical", "grids")


def prediction_html(found: Prediction) -> str:
    """Whether it is stable, how wide the bands are, warnings, the four admittances with bands; to unfold: the modes."""
    worst = "no band: the record holds no covariance"
    facts = [("on an ideal grid", stable_or_not(found.stable))]
    if (band := found.relative_band) is not None:
        widest = int(band.argmax())
        worst = f"± {percent(float(band[widest]))} of |Y| at {hertz(float(found.frequency[widest]))} at most"
    facts += [("95 % band", data(None if band is None else float(band.max()), worst)), ("states", str(len(found.A)))]
    parts = [f"<header>{page_header('Prediction', found.op.name, _setpoint(found), facts)}</header>"]
    parts += [bullets(found.warnings)] if found.warnings else []
    half_width = None if found.sigma is None else QUANTILE * found.sigma
    line = Curves(found.op.name, 0, None, found.frequency, found.admittance, half_width)
    parts.append(paragraph("Line: model." if half_width is None else "Line: model. Shaded: its 95 % band.", "note"))
    parts.append(bode_figures([line], tag(repr((found.op, found.A.tolist()))), f" at {found.op.name}", zoom=False))
    return output([*parts, folded("Modes", modes_table(found.op.name, found.modes))])


def stability_html(found: Stability) -> str:
    """The answer in sentences, the table over the grids; to unfold: root locus, eigenloci, passivity, modes."""
    words = f"{'; '.join(found.sentences)}."
    parts = [
        f"<header>{page_header('Identified inverter', 'Stability in a grid', words, stability_facts(found))}</header>"
    ]
    for name, heading, body in stability_sections(found, f"{tag(repr(found.plain()))}-", zoom=False):
        parts.append(body if name in OPEN else folded(heading, body))
    return output(parts)


def _setpoint(found: Prediction) -> str:
    op = found.op
    return f"p = {op.p:g}, q = {op.q:g}, v = {op.v:g} per unit; {len(found.frequency)} frequencies"
