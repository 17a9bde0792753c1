"""Draws the picture of the page about searching, a diagram that grows while its error falls, from a
search that was run:

ibrid search paper_like --start naive --budget 40 --workers 1 --out RUN
python docs/making/growing.py RUN
"""

import re
import sys
from html import escape
from pathlib import Path

import numpy as np
from ibrid_search.report.page import lineage
from ibrid_search.report.run_data import read_run
from ibrid_search.run.store import Store
from ibrid_search.step import Step

from ibrid.modules.vocabulary import Vocabulary
from ibrid.report.block_diagrams.block_diagram import block_diagram_svg
from ibrid.report.facts.parameter_rows import values_of
from ibrid.structure.diagrams.program import parse_program

#: Of the picture; what is left for the diagram; seconds for each frame; frames at most.
WIDTH, HEIGHT, DRAWING, SECONDS, MOST = 1000, 470, 360, 1.6, 12
_STYLE = """svg{font-family:system-ui,sans-serif}text{fill:#16202c;text-anchor:middle;font-size:12px}
.kind{fill:#56636f;font-size:11px}.name{font-weight:650}.port{font-size:10px}.start{text-anchor:start}.end{text-anchor:end}
.said{text-anchor:start;font-size:17px}rect,.sum circle{fill:#eef1f4;stroke:#3b4856;stroke-width:1.1}
.sum circle,.terminal rect{fill:#fff}.terminal rect{stroke-width:2}.rule{stroke:#3b4856;stroke-width:.7;opacity:.6}
.net path{fill:none;stroke:#3b4856;stroke-width:1.15}.net.vector path{stroke-width:2.1}.net .tip{fill:#3b4856;stroke:none}
.net circle{fill:#3b4856}.family-physical-plant rect{fill:#fde3cf}.family-dynamic-control rect{fill:#dbe8fa}
.value{font-size:11px}.sign{font-size:13px;font-weight:650}
.loop rect{fill:#1f5fa8;fill-opacity:.05;stroke:#1f5fa8;stroke-dasharray:6 4}
.loop text{text-anchor:start;fill:#1f5fa8;font-size:11.5px;font-weight:650;paint-order:stroke;stroke:#fff;stroke-width:3px}
.family-synchronisation rect{fill:#ecdcf5}.family-operating-point rect{fill:#d8efe3}
.page{fill:#fff;stroke:none}.bar{fill:#1f5fa8;stroke:none}.frame{opacity:0;animation:show %(all).2fs infinite step-end}
@keyframes show{0%%{opacity:1}%(share).4f%%{opacity:0}100%%{opacity:0}}
.last{animation-name:stay}@keyframes stay{0%%{opacity:1}%(stay).4f%%{opacity:0}100%%{opacity:0}}
@media (prefers-reduced-motion:reduce){.frame{animation:none}.last{opacity:1}}"""


def growing_svg(folder: Path) -> str:
    """The line of descent of a run's answer, a frame for each step that made it better."""
    with Store.open(folder / "archive.sqlite", read_only=True) as store:
        run = read_run(store)
    steps = (
        [ancestor.step for ancestor in lineage(run.steps, run.answer.number)] if run.answer else []
    )
    steps = [step for step in steps if step.nrmse is not None]
    better = [
        step for k, step in enumerate(steps) if all(step.nrmse < one.nrmse for one in steps[:k])
    ]
    chosen = [
        better[k]
        for k in sorted({round(k) for k in np.linspace(0, len(better) - 1, min(MOST, len(better)))})
    ]
    count = len(chosen) + 2  # the last frame stays longer
    ends = chosen[0].nrmse, chosen[-1].nrmse
    with Store.open(folder / "archive.sqlite", read_only=True) as store:
        values = [values_of(store.record(step.number, run.kinds)) for step in chosen]
    frames = [_frame(step, run.kinds, k, ends, values[k]) for k, step in enumerate(chosen)]
    style = _STYLE % {"all": count * SECONDS, "share": 100 / count, "stay": 300 / count}
    first, last = chosen[0].nrmse, chosen[-1].nrmse
    label = (
        f"The first edits of a search of a simulated inverter: error {first:.2g} at first, "
        f"{last:.1g} at the end."
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'aria-label="{escape(label)}">'
        f"<style>{style}</style>{''.join(frames)}</svg>"
    )


def _frame(
    step: Step,
    kinds: Vocabulary,
    number: int,
    ends: tuple[float, float],
    values: dict[str, list[str]],
) -> str:
    """A step; the bar is the logarithm of its error between those at both ends."""
    first, last = ends
    drawing = str(block_diagram_svg(parse_program(step.program), kinds, values=values))
    wide, high = (float(size) for size in re.search(r'viewBox="0 0 (\d+) (\d+)"', drawing).groups())
    inner = re.sub(r"<title>.*?</title>", "", re.sub(r"^<svg[^>]*>|</svg>$", "", drawing))
    scale = min((WIDTH - 40) / wide, DRAWING / high, 1.35)
    left, top = (WIDTH - wide * scale) / 2, 84 + (DRAWING - high * scale) / 2
    bar = (
        np.log(max(step.nrmse, 1e-12) / max(last / 2, 5e-13))
        / np.log(first / max(last / 2, 5e-13))
        * (WIDTH - 40)
    )
    words = f"evaluation {step.number}: error {step.nrmse:.2g}"
    return (
        f'<g class="frame{" last" if step.nrmse == last else ""}" '
        f'style="animation-delay:{number * SECONDS:.2f}s">'
        f'<rect class="page" width="{WIDTH}" height="{HEIGHT}"/><text class="said" x="20" '
        f'y="34">{escape(words)}</text>'
        f'<rect class="bar" x="20" y="50" height="8" width="{bar:.0f}"/>'
        f'<g transform="translate({left:.1f} {top:.1f}) scale({scale:.3f})">{inner}</g></g>'
    )


if __name__ == "__main__":
    target = Path(__file__).resolve().parents[1] / "images" / "growing.svg"
    target.write_text(growing_svg(Path(sys.argv[1])) + "\n", encoding="utf-8")
