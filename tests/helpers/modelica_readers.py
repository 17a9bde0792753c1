"""Exported Modelica as pymoca reads it, which knows `input Real` but no connector of a type of its
own.
"""

from ibrid.export.modelica import INPUT, OUTPUT


def without_connectors(text: str) -> str:
    """The same model with signals of type Real."""
    return text.replace(f"  {INPUT} ", "  input Real ").replace(f"  {OUTPUT} ", "  output Real ")
