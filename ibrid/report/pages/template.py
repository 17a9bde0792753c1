"""Pages from Jinja2 templates: every fact is escaped on its way into one, but for what a figure
made (`markupsafe.Markup`); controls are shown as escapes.

A template extends a layout, `page.html` or `notebook.html`, and gives `title`, `sections` as (name,
heading, whether it is there), a block for each of them, and a block `header`.
"""

from collections.abc import Mapping
from functools import cache
from hashlib import sha256
from typing import TYPE_CHECKING, Any

from ibrid.foreign_text import show_controls
from ibrid.measurement.sweeps.quantities import hertz, set_point, span
from ibrid.measurement.sweeps.sweep import ENTRIES
from ibrid.report.facts.bands import band_in_hz
from ibrid.report.facts.evidence import evidence_now
from ibrid.report.look import numbers
from ibrid.report.look.figure import content_policy, script
from ibrid.report.look.style import SHAPES, heat, notebook_style_sheet, series_line, style_sheet

if TYPE_CHECKING:
    from jinja2 import Environment


def page(template: str, facts: Mapping[str, Any], package: str = "ibrid.report") -> str:
    """A whole document. package : whose folder `templates` holds the template."""
    filled = (
        _environment(package)
        .get_template(template)
        .render(facts, layout="page.html", evidence=evidence_now(_program(facts)))
    )
    return show_controls(filled)


def _program(facts: Mapping[str, Any]) -> str:
    """Text of the program that the page shows; "" where it shows none."""
    shown = facts.get("record") or facts.get("gap") or getattr(facts.get("run"), "answer", None)
    return getattr(shown, "program", "")


def output(template: str, facts: Mapping[str, Any], shown: tuple[str, ...]) -> str:
    """An output of a notebook: one element whose style reaches nothing else. shown : sections that
    are not folded.
    """
    filled = (
        _environment("ibrid.report")
        .get_template(template)
        .render(facts, layout="notebook.html", shown=shown)
    )
    return show_controls(filled)


def tag(text: str) -> str:
    """A name for the figures of an output, from what the output is about: outputs on one page share
    no identifier.
    """
    return f"n{sha256(text.encode()).hexdigest()[:10]}"


def shortened(text: str, longest: int = 160) -> str:
    """One line of at most `longest` characters."""
    text = " ".join(text.split())
    return text if len(text) <= longest else text[: longest - 1].rstrip() + "…"


@cache
def _environment(package: str) -> "Environment":
    from jinja2 import (
        ChoiceLoader,
        Environment,
        PackageLoader,
        StrictUndefined,
    )  # only pages need it

    jinja = Environment(
        loader=ChoiceLoader(
            [PackageLoader(name) for name in dict.fromkeys((package, "ibrid.report"))]
        ),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    jinja.filters |= {
        name: getattr(numbers, name)
        for name in ("number", "error", "p_value", "percent", "seconds")
    }
    jinja.filters |= {
        "hertz": hertz,
        "set_point": set_point,
        "heat": heat,
        "exact": lambda value: repr(float(value)),
        "plus_minus": lambda text: text.replace("+-", "±"),
        "sentence": _sentence,
        "shortened": shortened,
    }
    functions = (
        span,
        band_in_hz,
        series_line,
        style_sheet,
        notebook_style_sheet,
        content_policy,
        script,
    )
    jinja.globals |= {
        "ENTRIES": list(ENTRIES),
        "shapes": SHAPES,
        **{one.__name__: one for one in functions},
    }
    return jinja


def _sentence(text: str) -> str:
    """Words that begin with a capital letter and end with a full stop."""
    text = text[:1].upper() + text[1:]
    return text if not text or text[-1] in ".!?" else f"{text}."
