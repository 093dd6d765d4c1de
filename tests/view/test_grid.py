import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from rmll_view.grid import Panel, grid_figure
from rmll_view.palette import INK, PAPER


def drawn(values: list, better: str, fallen: list | None = None) -> Figure:
    shown = np.array(values, float)
    down = np.zeros(shown.shape, bool) if fallen is None else np.array(fallen)
    panel = Panel("adherence", shown, (0.0, 1.0), better, 1)  # pyright: ignore[reportArgumentType]
    rows, columns = shown.shape
    return grid_figure(range(rows), range(columns), [panel], down, "trot")


@pytest.mark.parametrize(("better", "inks"), [("high", [PAPER, INK]), ("low", [INK, PAPER])])
def test_the_better_end_is_pale_and_its_numbers_dark(better: str, inks: list[str]) -> None:
    (axes,) = drawn([[0.0, 1.0]], better).axes
    assert [to_rgb(text.get_color()) for text in axes.texts] == [to_rgb(ink) for ink in inks]


def test_rows_rise_upwards_and_gaps_are_dashes() -> None:
    (axes,) = drawn([[0.1, np.nan], [0.3, 0.4]], "high").axes
    places = {text.get_text(): text.get_position() for text in axes.texts}
    assert places == {"0.1": (0, 0), "-": (1, 0), "0.3": (0, 1), "0.4": (1, 1)}
    assert axes.get_ylim()[0] < axes.get_ylim()[1]


def test_falls_are_framed_and_explained() -> None:
    figure = drawn([[0.1, 0.2]], "high", [[False, True]])
    assert len(figure.axes[0].patches) == 1
    assert any("fell" in text.get_text() for text in figure.texts)
    assert not drawn([[0.1, 0.2]], "high").texts[1:]
