"""What a plot shows lies where it is, in pixels of the PNG."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from firstfix_builder.plot import BLUE, CROSS, GREEN, ORANGE, RED, SQUARE, Plot

EXTENT = (100.0, 150.0, -20.0, 20.0)  # 500 x 400 pixels of a tenth


def drawn(plot: Plot, folder: Path) -> NDArray[np.uint8]:
    plot.save(folder / "plot.png", x="x (m)", y="y (m)", title="a title")
    return np.asarray(Image.open(folder / "plot.png"))


def middle_of(
    picture: NDArray[np.uint8], colour: tuple[int, int, int], mixed: bool = False
) -> NDArray[np.float64]:
    """Middle column and row of the pixels of a colour, from the frame's upper left corner.

    Args:
        mixed: with white.
    """
    white = 255 - np.array(colour)
    share = (255 - picture.astype(float)) @ white / (white @ white)
    is_colour = np.abs(255 - share[..., None] * white - picture).max(axis=-1) < 2
    row, column = np.nonzero(is_colour & (share > (0.3 if mixed else 0.99)))
    assert len(row), "nothing has the colour"
    black = (picture == 0).all(axis=-1)
    left = int(np.argmax(black.sum(axis=0) > 300))  # the frame's sides are the longest lines
    top = int(np.argmax(black.sum(axis=1) > 300))
    return np.array([np.ptp(column) / 2 + column.min() - left - 1, np.ptp(row) / 2 + row.min() - top - 1])


@pytest.mark.parametrize("shape", [SQUARE, "disc", CROSS])
def test_a_mark_lies_at_its_place(tmp_path, shape):
    plot = Plot(EXTENT, 0.1)
    plot.marks(np.array([[110.0, 15.0, 3.0]]), RED, 4, shape=shape)
    assert middle_of(drawn(plot, tmp_path), RED) == pytest.approx([100, 50], abs=0.6)


def test_a_line_joins_its_ends_and_a_hatched_square_is_where_it_is(tmp_path):
    plot = Plot(EXTENT, 0.1)
    plot.lines(np.array([[110.0, 15.0]]), np.array([[130.0, 15.0]]), GREEN)
    plot.hatched(np.array([[120.0, 0.0]]), 4.0, BLUE, "")
    picture = drawn(plot, tmp_path)
    assert middle_of(picture, GREEN) == pytest.approx([200, 50], abs=0.6)
    assert middle_of(picture, BLUE, mixed=True) == pytest.approx([220, 180], abs=1)


def test_an_image_lies_on_the_plane_with_its_first_row_in_the_south(tmp_path):
    plot = Plot(EXTENT, 0.1)
    opacity = np.zeros((400, 500))
    opacity[:10, :20] = 1
    plot.image(np.broadcast_to(np.array(RED), (400, 500, 3)), opacity)
    assert middle_of(drawn(plot, tmp_path), RED) == pytest.approx([9.5, 394.5], abs=0.1)


def test_labels_get_rows_below_the_plane_and_marks_outside_of_it_nothing(tmp_path):
    plain = drawn(Plot(EXTENT, 0.1), tmp_path)
    plot = Plot(EXTENT, 0.1)
    plot.marks(np.array([[0.0, 0.0], [1e4, -1e4]]), ORANGE, 4)
    assert np.array_equal(drawn(plot, tmp_path), plain)
    plot.marks(np.zeros((0, 3)), GREEN, 4, label="nothing here")
    labelled = drawn(plot, tmp_path)
    assert len(labelled) > len(plain)
    assert (labelled[len(plain) :] == GREEN).all(axis=-1).any()


def test_a_plane_without_width_is_drawn(tmp_path):
    plot = Plot((1.0, 1.001, 2.0, 2.001), 1e-3)
    plot.marks(np.array([[1.0, 2.0]]), RED, 3)
    assert (drawn(plot, tmp_path) == RED).all(axis=-1).any()
