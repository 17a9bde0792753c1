"""A figure that shows itself where it is the answer of a notebook's cell."""

import io

from matplotlib.figure import Figure

#: Dots per inch of the picture in a notebook: 1100 points of a wide figure, some 60 kB.
DPI = 100


class DisplayedFigure(Figure):
    """A matplotlib figure with a picture of its own.

    Notebooks draw figures once pyplot was imported; this one is drawn without it, and by
    pyplot's way, once, where it was.
    """

    def _repr_png_(self) -> bytes:
        buffer = io.BytesIO()
        self.savefig(buffer, format="png", dpi=DPI)
        return buffer.getvalue()
