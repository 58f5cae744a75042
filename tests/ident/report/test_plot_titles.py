"""Titles of figures stay within them."""

from __future__ import annotations

import pytest

import lrm_ident as lrm
from lrm_ident.report.plots.diagnosis import draw_report
from lrm_ident.report.plots.style import finish

LONG = "Anatomy: a free function of the angle of joint 1 and the angle of joint 5 at joint 5, or of the base beside it"


@pytest.mark.long
@pytest.mark.parametrize(("width", "panels"), [(13.0, 2), (19.0, 3)])
def test_a_long_title_is_broken_and_stays_within_the_figure(width: float, panels: int) -> None:
    plt = pytest.importorskip("matplotlib.pyplot")
    figure = plt.figure(figsize=(width, 4.6), layout="constrained")
    axes = figure.subplots(1, panels)[-1]
    finish(axes, "q1, deg", "acts like a turn of joint 5, deg", LONG, legend=False)
    figure.canvas.draw()
    box = axes.title.get_window_extent()
    plt.close(figure)
    assert figure.bbox.x0 <= box.x0
    assert box.x1 <= figure.bbox.x1
    assert axes.title.get_text().split() == LONG.split()


@pytest.mark.long
def test_no_line_goes_through_the_number_at_a_bar(example_diagnosis: lrm.DiagnosisReport) -> None:
    """The error of today is a line across the bars, which the numbers of some lie on."""
    pytest.importorskip("matplotlib")
    figure = draw_report(example_diagnosis, None)
    numbers = [text for text in figure.axes[0].texts if "." in text.get_text()]
    line = max(one.get_zorder() for one in figure.axes[0].lines)
    assert numbers
    for one in numbers:
        box = one.get_bbox_patch()
        assert box is not None, one.get_text()
        assert one.get_zorder() > line
