from dataclasses import replace

import made_run
import numpy as np
import pytest

from evolve.genome import FiberGene
from labctl.design_search.fiber_list import fiber_list
from labctl.design_search.layout_shape import LayoutShape
from labctl.design_search.pick import all_picks, front_members
from labctl.report.search.fibers import fiber_figure, number_places_mm
from labctl.report.search.front import front_figure
from labctl.report.search.progress import progress_figure
from labctl.report.search.shapes import shape_figure
from sim.geometry import PUBLISHED
from sim.score import simulation_error

CHANNELS = range(1, 33)


def front_axes(*runs):
    figure = front_figure(runs, front_members(runs), all_picks(runs))
    return figure, [axes for axes in figure.axes if axes.get_xlabel()]


def picked(axes):
    """The places of the rings around picked designs, by marker."""
    return {
        line.get_marker(): tuple(float(value[0]) for value in line.get_data())
        for line in axes.lines
        if line.get_fillstyle() == "none"
    }


def lines_of(axes):
    return {tuple(line.get_xydata().ravel().tolist()): line for line in axes.lines}


def test_both_faces_are_drawn_in_the_sheet_frame_seen_from_the_top():
    figure = fiber_figure(fiber_list(made_run.GENOME, PUBLISHED, CHANNELS), 0, "saddle")
    top, bottom = figure.axes

    assert set(lines_of(top)) == {(25.0, 35.0, 115.0, 50.0), (85.0, 30.0, 100.0, 110.0)}
    assert set(lines_of(bottom)) == {(20.0, 45.0, 50.0, 105.0)}
    for axes in figure.axes:
        assert axes.get_xlim()[0] < axes.get_xlim()[1]
        assert axes.get_ylim()[0] < axes.get_ylim()[1]
        assert axes.get_aspect() == 1
        assert (axes.get_xlabel(), axes.get_ylabel()) == ("x, mm", "y, mm")
    assert bottom.get_title() == "bottom face, seen through the sheet from the top"


def test_jammed_and_unjammed_fibers_are_distinct_without_colour():
    figure = fiber_figure(fiber_list(made_run.GENOME, PUBLISHED, CHANNELS), 0, "saddle")
    lines = lines_of(figure.axes[0])

    jammed, idle = lines[(25.0, 35.0, 115.0, 50.0)], lines[(85.0, 30.0, 100.0, 110.0)]
    assert jammed.get_linewidth() > 1.5 * idle.get_linewidth()
    assert figure._suptitle.get_text() == "saddle: jammed 1, 3"
    assert {text.get_text(): text.get_fontweight() for text in figure.axes[0].texts} == {
        "1": "bold",
        "2": "normal",
    }


def test_numbers_stand_at_their_fibers_and_clear_of_one_another():
    genome = tuple(FiberGene("top", (3 + n, 8), (4 + n, 21), frozenset({0})) for n in range(6))
    fibers = fiber_list(genome, PUBLISHED, CHANNELS)
    places = np.array(number_places_mm(fibers))

    apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1)) + 99 * np.eye(len(places))
    assert apart.min() > 7
    for fiber, place in zip(fibers, places, strict=True):
        ends = np.array([fiber.start_mm, fiber.end_mm])
        around = np.hypot(*(ends - place).T).sum()
        assert around <= fiber.length_mm + 13


def test_a_face_without_fibers_says_so():
    (fiber,) = fiber_list(made_run.GENOME[1:2], PUBLISHED, CHANNELS)

    bottom = fiber_figure([fiber], 0, "saddle").axes[1]

    assert [text.get_text() for text in bottom.texts] == ["no fiber on this face"]


def test_picks_are_marked_at_their_errors():
    figure, axes = front_axes(made_run.run((0.0, 10.0), (0.1, 6.0), (1.0, 0.0)))

    for panel in axes:
        assert picked(panel) == {"o": pytest.approx((1.0, 0.0)), "s": pytest.approx((0.1, 6.0))}
    assert {text.get_text() for text in axes[1].texts} == {"paper", "knee"}
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[-2:] == ["pick (paper): 1.00 / 0.00 mm", "pick (knee): 0.10 / 6.00 mm"]


def test_the_front_is_coloured_by_its_distance_from_random_layouts():
    _, (whole, near) = front_axes(made_run.run((1.0, 4.0), (3.0, 3.0), random_mm=(9.0, 7.0)))

    for panel in (whole, near):
        random, front = panel.collections
        assert random.get_offsets().tolist() == [pytest.approx([8.5, 6.5]), pytest.approx([9.5, 7.5])]
        assert front.get_offsets().tolist() == [pytest.approx([1.0, 4.0]), pytest.approx([3.0, 3.0])]
        assert front.get_array().tolist() == pytest.approx([8 + 3, 6 + 4])
        means = [line.get_xdata()[0] for line in panel.lines if line.get_linestyle() == ":"]
        assert means[0] == pytest.approx(9.0)


@pytest.mark.parametrize(("targets", "panels"), [(1, 1), (2, 2), (3, 6)])
def test_the_front_has_panels_for_every_pair_of_targets(targets, panels):
    names = ("saddle", "monkey", "sphere")[:targets]
    run = made_run.run((1.0, 2.0, 3.0)[:targets], names=names, random_mm=(9.0, 7.0, 8.0))

    _, axes = front_axes(run)

    assert len(axes) == panels
    for panel in axes:
        assert len(picked(panel)) == 2
    expected = {1: (1.0, 0.0), 2: (1.0, 2.0), 3: (2.0, 3.0)}[targets]
    assert picked(axes[-1])["o"] == pytest.approx(expected)


def test_seeds_have_marks_of_their_own():
    figure, (whole, _) = front_axes(made_run.run((1.0, 4.0)), made_run.run((2.0, 2.0), seed=2))

    _, first, second = whole.collections
    assert first.get_offsets().tolist() == [pytest.approx([1.0, 4.0])]
    assert second.get_offsets().tolist() == [pytest.approx([2.0, 2.0])]
    assert not np.array_equal(first.get_paths()[0].vertices, second.get_paths()[0].vertices)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[:2] == ["front of seed 1", "front of seed 2"]


def test_progress_of_one_run_has_the_spread_of_its_population():
    saddle, monkey, hypervolume = progress_figure([made_run.run((1.0, 2.0))]).axes

    band = saddle.collections[0].get_paths()[0].vertices
    assert (band[:, 1].min(), band[:, 1].max()) == pytest.approx((6.5, 9.5))
    population, best, random = saddle.lines
    assert population.get_ydata() == pytest.approx([9.0, 8.0, 7.0])
    assert best.get_ydata() == pytest.approx([5.0, 4.0, 3.0])
    assert random.get_ydata()[0] == pytest.approx(9.0)
    assert hypervolume.lines[0].get_ydata() == pytest.approx([0.0, 0.1, 0.2])
    assert (saddle.get_title(), monkey.get_title()) == ("saddle", "monkey")


def test_progress_of_several_seeds_is_their_mean_as_far_as_all_have_come():
    runs = [made_run.run((1.0, 2.0)), made_run.run((1.0, 2.0), seed=3, records=2)]
    saddle = progress_figure(runs).axes[0]

    first, second, mean = saddle.lines[:3]
    assert (len(first.get_ydata()), len(second.get_ydata())) == (3, 2)
    assert mean.get_ydata() == pytest.approx([10.0, 9.0])
    band = saddle.collections[0].get_paths()[0].vertices
    # Errors of 9 and 11 mm: the sample's standard deviation is the root of 2.
    assert band[:, 1].max() == pytest.approx(10.0 + np.sqrt(2))
    assert mean.get_label() == "population's mean error, mean ± sd of 2 seeds"


def test_a_generation_without_a_shape_is_a_gap():
    run = made_run.run((1.0, 2.0))
    lost = replace(run.checkpoint.records[0], mean_m=(np.inf,) * 2, sd_m=(np.inf,) * 2)
    records = (lost, *run.checkpoint.records[1:])

    figure = progress_figure([replace(run, checkpoint=replace(run.checkpoint, records=records))])

    assert np.isnan(figure.axes[0].lines[0].get_ydata()[0])


def test_evolved_and_target_share_their_colours_and_the_difference_is_even():
    target = made_run.settings().problem.targets[0]
    heights_mm = 1e3 * target.heights_m
    heights_mm[20, 7] += 3.0
    figure = shape_figure(LayoutShape(target, heights_mm, simulation_error(heights_mm / 1e3, target)))
    maps = {axes.get_title(): axes.collections[0] for axes in figure.axes if axes.get_title()}

    assert maps["target"].get_clim() == maps["evolved"].get_clim()
    assert maps["evolved less target"].get_clim() == pytest.approx((-3.0, 3.0))
    # Rows of an image go up the page: row 7, column 20 is the sheet's j = 7, i = 20.
    difference_mm = maps["evolved less target"].get_array()
    assert difference_mm[7, 20] == pytest.approx(3.0)
    assert difference_mm[20, 7] == pytest.approx(0.0)
    assert maps["evolved"].get_array()[7, 20] == pytest.approx(heights_mm[20, 7])
