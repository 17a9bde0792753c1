"""The catalogue as a table for people: what each effect is, where it is tried, how it shows, what
tells it apart.
"""

from collections.abc import Sequence

from ibrid_bench.markdown import markdown_table
from laws import law_in_a_line

from ibrid.parts.editing.practice import Effect

HEADER = ("id", "law", "tried", "shows", "looks like", "told apart by")


def effects_table(catalogue: Sequence[Effect]) -> str:
    """A Markdown table with a row for each effect, in the order of the catalogue."""
    rows = [
        (
            f"`{one.id}`",
            law_in_a_line(one.law),
            one.places,
            one.signature,
            ", ".join(f"`{other}`" for other in one.confused_with),
            one.told_apart_by,
        )
        for one in catalogue
    ]
    return markdown_table(HEADER, rows)


def effects_list(effects: Sequence[Effect]) -> str:
    """The same as a list, for effects that no edit of a program describes."""
    return "".join(
        f"- `{one.id}`: {one.law}. Tried: {one.places}. Shows: {one.signature}. Looks like: "
        f"{', '.join(f'`{other}`' for other in one.confused_with)}. Told apart by: "
        f"{one.told_apart_by}.\n"
        for one in effects
    )
