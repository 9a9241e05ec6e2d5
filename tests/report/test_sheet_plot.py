import warnings
from dataclasses import replace

import numpy as np
import pytest

from labctl.report.sheet.plot import sheet_figure, write_sheet_plot
from sim.sheet import rest_positions_m


def texts(figure):
    return "\n".join(text.get_text() for text in [*figure.texts, figure._suptitle])


def magnification(surface):
    """How large x, y and z are drawn, against x."""
    limits = (surface.get_xlim(), surface.get_ylim(), surface.get_zlim())
    scale = surface.get_box_aspect() / np.ptp(limits, axis=1)
    return scale / scale[0]


def test_the_height_map_has_x_to_the_right_and_y_up(slanted):
    _, height_map, _ = sheet_figure(slanted).axes
    cells = height_map.collections[0]
    x_mm, y_mm = cells.get_coordinates()[7, 20] + 2.5

    # An image's first index goes up the page: row 7, column 20 is the sheet's j = 7, i = 20.
    assert cells.get_array()[7, 20] == pytest.approx(20.7)
    assert (x_mm, y_mm) == pytest.approx((105.0, 40.0))
    assert height_map.get_xlim()[0] < height_map.get_xlim()[1]
    assert height_map.get_ylim()[0] < height_map.get_ylim()[1]
    assert height_map.get_aspect() == 1


def test_the_surface_has_true_proportions_but_for_the_stated_height(slanted):
    figure = sheet_figure(slanted)

    assert magnification(figure.axes[0]) == pytest.approx([1, 1, 1])
    assert "Top face, deformed (to scale)" in texts(figure)


def test_a_low_shape_is_drawn_higher_and_says_how_much(slanted):
    rest_m = rest_positions_m(slanted.input.sheet)
    low = replace(
        slanted, shape=replace(slanted.shape, positions_m=rest_m + (slanted.shape.positions_m - rest_m) / 4)
    )

    figure = sheet_figure(low)

    assert magnification(figure.axes[0]) == pytest.approx([1, 1, 4])
    assert "z drawn 4 times larger" in texts(figure)


def test_says_what_it_shows(slanted):
    figure = sheet_figure(slanted)

    assert "design slanted, pattern one\nheld at strain 0.0000 (1.95 psi), solver equilibrium" in texts(
        figure
    )
    assert "solver dynamic" in texts(sheet_figure(replace(slanted, solver="dynamic")))
    assert [axes.get_ylabel() for axes in figure.axes] == [
        "y, mm",
        "y on the uninflated sheet, mm",
        "height above rest, mm",
    ]


def test_the_title_says_what_is_not_as_published(slanted):
    materials = replace(slanted.input.sheet.materials, jammed_bending_pa=137_800.0)
    sheet = replace(slanted.input.sheet, materials=materials)

    figure = sheet_figure(replace(slanted, input=replace(slanted.input, sheet=sheet)))

    assert figure._suptitle.get_text().endswith("\na jammed fiber bends with 137.8 kPa")


def test_jammed_and_unjammed_above_and_underneath_are_distinct_without_colour(slanted):
    (legend,) = sheet_figure(slanted).legends
    jammed, idle = legend.get_lines()

    assert [text.get_text() for text in legend.get_texts()] == [
        "jammed fiber, top face",
        "unjammed fiber, underneath",
    ]
    assert jammed.get_linewidth() > 1.5 * idle.get_linewidth()
    assert jammed.get_linestyle() == "-"
    assert idle.get_linestyle() == "--"


@pytest.mark.parametrize(("suffix", "begins"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_every_format_is_written(slanted, tmp_path, suffix, begins):
    path = tmp_path / f"sheet{suffix}"
    write_sheet_plot(path, slanted)

    assert path.read_bytes().startswith(begins)
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_an_uninflated_sheet_with_a_strange_name_can_be_drawn(slanted, tmp_path):
    given = replace(slanted.input, name="$a_{1}$ {" + "long " * 40)
    shape = replace(slanted.shape, positions_m=rest_positions_m(given.sheet))
    flat = replace(slanted, input=given, shape=shape)

    write_sheet_plot(tmp_path / "flat.png", flat)

    assert (tmp_path / "flat.png").stat().st_size > 10_000


def test_letters_that_the_font_lacks_warn_nobody(slanted, tmp_path):
    given = replace(slanted.input, name="design \u677f, pattern one")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write_sheet_plot(tmp_path / "sheet.png", replace(slanted, input=given))


def test_a_long_name_is_shortened_in_its_middle(slanted):
    given = replace(slanted.input, name="begins " + "long " * 40 + "ends")

    name = sheet_figure(replace(slanted, input=given))._suptitle.get_text().splitlines()[0]

    assert len(name) == 80
    assert name.startswith("begins ")
    assert name.endswith(" ends")
    assert "..." in name
