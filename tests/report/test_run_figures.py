from dataclasses import replace
from itertools import pairwise

import made_measurement as made
import numpy as np
import pytest

from labctl.config.load import load_design
from labctl.measurement.result import RelaxationResult
from labctl.report.run.errors import errors_figure
from labctl.report.run.heights import (
    difference_figure,
    heights_figure,
    point_order,
    signed_difference_percent,
)
from labctl.report.run.pressures import ROWS_A_FIGURE, pressure_figures
from labctl.report.run.relaxation import fit_mm, relaxation_figure
from labctl.report.run.sheet_faces import face_figure
from labctl.report.run.view import run_view


def view_of(run, trials):
    return run_view(run, "finished", trials, (), lambda trial: made.pressures(trial.pressures_psi))


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.fixture(scope="module")
def five():
    run = made.run()
    return view_of(run, made.five_trials(run))


def test_the_sheet_has_its_fibers_and_points_where_they_are():
    figure = face_figure(load_design("known"), "cylinder", "top", made.POINTS)
    (axes,) = figure.axes
    lines = {tuple(line.get_xydata().ravel().tolist()): line for line in axes.lines}

    jammed, idle = lines[(35.0, 10.0, 35.0, 130.0)], lines[(10.0, 35.0, 130.0, 35.0)]
    assert jammed.get_linewidth() > 1.5 * idle.get_linewidth()
    assert (17.5, 52.5) in lines
    assert {"0", "15", "x35", "y105"} <= {text.get_text() for text in axes.texts}
    assert legend(figure) == [
        "jammed fiber, top face",
        "unjammed fiber, top face",
        "measuring point, marker id",
    ]


def test_heights_rise_with_the_simulated_ones_and_carry_their_spread(five):
    (group,) = five.summary.groups
    trials_mm = [each.level(3.9).heights_mm for each in five.counted(group)]
    figure = heights_figure(group, five.points, trials_mm)
    (axes,) = figure.axes

    ids = [int(label.get_text()) for label in axes.get_xticklabels()]
    assert ids == point_order(group).tolist()
    simulated = next(line for line in axes.lines if line.get_label() == "simulated").get_ydata()
    assert (np.diff(simulated) >= 0).all()
    bars = axes.containers[0]
    assert bars.lines[0].get_ydata() == pytest.approx([group.heights_mean_mm[n] for n in ids])
    low, high = np.array([segment[:, 1] for segment in bars.lines[2][0].get_segments()]).T
    assert (high - low) / 2 == pytest.approx([group.heights_sd_mm[n] for n in ids])
    assert len(trials_mm) == 5
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("marker id", "height above the uninflated sheet, mm")


def test_without_a_simulation_the_points_are_in_the_order_of_their_measured_heights():
    run = made.run(simulated_heights=())
    (group,) = view_of(run, [made.trial(run)]).summary.groups

    assert (np.diff(np.array(group.heights_mean_mm)[point_order(group)]) >= 0).all()
    assert np.isnan(signed_difference_percent(group)).all()
    # It can be drawn all the same.
    figure = heights_figure(group, run.points, [group.heights_mean_mm])
    assert legend(figure) == ["measured"]


def test_the_map_shows_what_e_t_is_made_of(five):
    """For one trial, the mean of the map's sizes is that trial's e_t."""
    run = five.run
    view = view_of(run, [made.trial(run, derived=made.result(run, hidden=(4, 9)))])
    (group,) = view.summary.groups
    percent = signed_difference_percent(group)

    assert np.nanmean(np.abs(percent)) == pytest.approx(group.e_t_mean_percent)
    assert np.flatnonzero(np.isnan(percent)).tolist() == [4, 9]
    axes = difference_figure(group, view.points, 140.0).axes[0]
    assert axes.get_legend().get_texts()[0].get_text() == "not compared"
    drawn = {tuple(line.get_xydata()[0].tolist()) for line in axes.lines}
    assert {(point.x_mm, point.y_mm) for point in view.points} <= drawn


def test_seventy_two_markers_have_room(five):
    run = made.run(points=made.grid_points(72))
    (group,) = view_of(run, [made.trial(run)]).summary.groups
    figure = heights_figure(group, run.points, [group.heights_mean_mm])
    figure.draw_without_rendering()
    boxes = [label.get_window_extent() for label in figure.axes[0].get_xticklabels()]

    assert len(boxes) == 72
    assert all(left.x1 <= right.x0 + 0.5 for left, right in pairwise(boxes))


def test_one_group_shows_each_trial_and_those_of_which_none_counts():
    run = made.run()
    trials = [made.trial(run, 1), made.trial(run, 2), made.trial(run, 3, outcome="failed", reason="x")]
    figure = errors_figure(view_of(run, trials))
    lines = {line.get_label(): line for line in figure.axes[0].lines}

    good = [made.result(run, seed=10 * n + 1).levels[0].e_t_percent for n in (1, 2)]
    assert lines["trial that counts"].get_xydata().tolist() == [
        [1, pytest.approx(good[0])],
        [2, pytest.approx(good[1])],
    ]
    assert lines["no attempt counts"].get_xdata().tolist() == [3]
    assert lines["mean"].get_ydata()[0] == pytest.approx(np.mean(good))


def test_several_pressures_are_drawn_against_the_pressure():
    run = made.run("pressure-sweep", pressures_psi=(3.5, 2.6))
    trials = [made.trial(run, n, pressures_psi=(psi,)) for n, psi in enumerate((3.5, 2.6, 3.5, 2.6), start=1)]
    figure = errors_figure(view_of(run, trials))
    (axes,) = figure.axes

    assert axes.get_xlabel() == "pressure held, psi"
    through = next(line for line in axes.lines if line.get_linewidth() == 1.2)
    assert through.get_xdata().tolist() == [2.6, 3.5]


def test_without_an_e_t_there_is_no_figure_of_it():
    run = made.run(simulated_heights=())
    assert errors_figure(view_of(run, [made.trial(run)])) is None


def test_pressures_show_band_windows_and_how_well_the_level_was_held(five):
    (figure,) = pressure_figures(five.attempts, five.tolerance_psi)
    assert len(figure.axes) == 2 * 6
    whole, near = figure.axes[:2]

    band = next(patch for patch in whole.patches if patch.get_height() == pytest.approx(0.2))
    assert band.get_y() == pytest.approx(3.8)
    spans = sorted(patch.get_x() for patch in whole.patches if patch is not band)
    first_s = five.attempts[0].pressures.time_s[0]
    assert [x + first_s for x in spans] == pytest.approx(
        [window.start_s for window in five.attempts[0].record.windows]
    )
    (trace,) = near.lines
    assert np.abs(trace.get_ydata()).max() < 0.1
    assert trace.get_xdata()[0] == pytest.approx(-3.0, abs=0.06)
    assert figure.axes[4].get_title(loc="left") == "trial 3: failed"
    assert legend(figure) == ["pressure", "setpoint", "band to hold", "baseline window", "measuring window"]


def test_many_attempts_are_spread_over_pages(five):
    seven = [replace(five.attempts[0]) for _ in range(ROWS_A_FIGURE + 1)]
    assert [len(figure.axes) for figure in pressure_figures(seven, 0.1)] == [2 * ROWS_A_FIGURE, 2]
    assert pressure_figures([replace(five.attempts[0], pressures=None)], 0.1) == []


def test_relaxation_shows_heights_and_fit():
    run = made.run("relaxation")
    fitted = made.relaxing(tau_s=1.6)
    unfitted = RelaxationResult((0.1, 0.4), (3.0, None), None, None, None, None, None)
    trials = [
        made.trial(run, n, derived=made.result(run, relaxation=each))
        for n, each in enumerate((fitted, unfitted), 1)
    ]
    figure = relaxation_figure(view_of(run, trials).attempts)

    assert legend(figure) == ["trial 1: τ = 1.600 ± 0.020 s", "trial 2: no fit"]
    assert figure.axes[0].get_xlim() == (0.0, pytest.approx(16.0))
    assert figure.axes[1].lines[0].get_xdata()[-1] == pytest.approx(fitted.time_s[-1])
    assert fit_mm(fitted) == pytest.approx(np.array(fitted.height_mm))
    assert fit_mm(unfitted) is None
    assert relaxation_figure(view_of(run, [made.trial(run)]).attempts) is None
