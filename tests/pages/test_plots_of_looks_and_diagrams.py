"""Inspections and diagrams are drawn with matplotlib, on axes of one's own too."""

import pytest
from matplotlib.figure import Figure

import ibrid


def test_an_inspection_is_drawn_with_a_row_for_each_operating_point():
    look = ibrid.inspect("paper_like")
    figure = look.plot()
    (axes,) = figure.axes
    assert len(axes.get_yticks()) == len(look.points)
    low, high = axes.get_xlim()
    assert low <= min(point.lowest for point in look.points)
    assert high >= max(point.highest for point in look.points)
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_a_diagram_is_drawn_with_the_name_of_each_module_that_its_page_names():
    diagram = ibrid.textbook("gfl_pll_filter_exact")
    figure = diagram.plot()
    words = {text.get_text() for text in figure.axes[0].texts}
    assert {"pll_filter", "plant"} <= words
    assert figure._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "thing", [ibrid.inspect("paper_like"), ibrid.textbook("gfl_l_filter")], ids=("look", "diagram")
)
def test_on_axes_of_ones_own_the_axes_come_back(thing):
    axes = Figure(figsize=(6, 4)).subplots()
    assert thing.plot(axes) is axes
    assert axes.lines
    with pytest.raises(ibrid.IbridError, match="ax must be one axes"):
        thing.plot(3)


def test_what_cannot_be_drawn_says_so():
    with pytest.raises(ibrid.IbridError, match="modules are drawn; found 0"):
        ibrid.Diagram().plot()
