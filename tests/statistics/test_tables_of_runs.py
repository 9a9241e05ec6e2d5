import numpy as np
import pandas as pd
import pytest

from labctl.errors import BadInput
from labctl.simulation.measured_heights import read_measured
from labctl.statistics.summary import summarise
from labctl.statistics.tables import calibration_table, points_table, table_iii, trials_table


@pytest.fixture
def cells(make_trial, make_level):
    """Trials whose e_t are mean - sd and mean + sd, nearly: a cell of the table."""

    def make(placement, pattern, mean, sd, first, pressure_psi=3.9):
        return [
            make_trial(
                first + i,
                make_level(mean + off * sd / 2**0.5, pressure_psi=pressure_psi),
                placement=placement,
                pattern=pattern,
            )
            for i, off in enumerate((-1, 1))
        ]

    return make


def test_the_published_table_in_its_published_layout(run, cells):
    neat = cells("Cylinder Neat", "Cylinder", 17.1, 0.5, 1) + cells("Sphere Neat", "Sphere", 28.6, 0.9, 3)
    layered = [
        *cells("Cylinder on Sphere", "Cylinder", 25.3, 0.4, 1),
        *cells("Cylinder on Sphere", "Sphere", 31.1, 1.1, 3),
        *cells("Sphere on Cylinder", "Cylinder", 27.7, 0.6, 5),
        *cells("Sphere on Cylinder", "Sphere", 33.9, 1.0, 7),
    ]
    table = table_iii([summarise(run, neat), summarise(run, layered)])
    assert table.columns.tolist() == ["Cylinder e_t", "Sphere e_t"]
    assert table.to_dict(orient="index") == {
        "Cylinder Neat": {"Cylinder e_t": "17.1% ± 0.5%", "Sphere e_t": "—"},
        "Sphere Neat": {"Cylinder e_t": "—", "Sphere e_t": "28.6% ± 0.9%"},
        "Cylinder on Sphere": {"Cylinder e_t": "25.3% ± 0.4%", "Sphere e_t": "31.1% ± 1.1%"},
        "Sphere on Cylinder": {"Cylinder e_t": "27.7% ± 0.6%", "Sphere e_t": "33.9% ± 1.0%"},
    }


def test_a_placement_at_several_pressures_has_a_row_for_each(run, cells):
    trials = cells("neat", "sphere", 30.5, 1.5, 1, 2.6) + cells("neat", "sphere", 34.5, 1.4, 3, 3.0)
    table = table_iii([summarise(run, trials)])
    assert table.index.tolist() == ["neat, 2.6 psi", "neat, 3 psi"]
    assert table["sphere e_t"].tolist() == ["30.5% ± 1.5%", "34.5% ± 1.4%"]


def test_one_trial_has_no_spread_and_no_trial_no_table(run, make_trial, make_level):
    table = table_iii([summarise(run, [make_trial(1, make_level(12.34))])])
    assert table.loc["neat", "sphere e_t"] == "12.3%"
    assert table_iii([summarise(run, [])]).empty


def test_every_attempt_and_level_is_a_row(run, make_trial, make_level):
    trials = [
        make_trial(1, outcome="failed", reason="no frames", result=None),
        make_trial(1, make_level(1.0, pressure_psi=2.0), make_level(2.0), attempt=2, tau_s=1.5),
    ]
    table = trials_table(run, trials)
    assert table["attempt"].tolist() == [1, 2, 2]
    assert table["reason"].tolist() == ["no frames", "", ""]
    assert table["pressure_psi"].tolist() == [pd.NA, 2.0, 3.9]
    assert table["e_t_percent"].tolist() == [pd.NA, 1.0, 2.0]
    assert table["tau_s"].tolist() == [pd.NA, pd.NA, 1.5]


def test_every_point_of_every_level_is_a_row(run, make_trial, make_level):
    trials = [make_trial(1, make_level(5.0, (4.0, None, 2.0, 1.0), (1.0, None, 3.0, 4.0)))]
    table = points_table(run, trials)
    assert table["point"].tolist() == [1, 2, 3, 4]
    assert table["marker_id"].tolist() == [10, 11, 12, 13]
    assert table["x_mm"].tolist() == [35, 70, 105, 70]
    assert table["height_mm"].tolist() == [4, pd.NA, 2, 1]
    assert table["simulated_mm"].tolist() == [4, 8, 2, 1]
    assert table["error_percent"].tolist() == [1, pd.NA, 3, 4]
    assert table["frames"].tolist() == [240] * 4


def test_columns_keep_their_kind_where_they_hold_nothing(run, make_trial, make_level):
    full = [make_trial(1, make_level(5.0), tau_s=1.0)]
    nothing = [make_trial(1, outcome="failed", result=None)]
    for make in (trials_table, points_table):
        assert make(run, full).dtypes.tolist() == make(run, nothing).dtypes.tolist()


def test_the_calibration_table_is_one_that_compare_reads(run, make_trial, make_level, tmp_path):
    trials = [
        make_trial(
            number,
            make_level(1.0, (4.0 + off, 8.0, 2.0, 1.0), pressure_psi=2.5),
            make_level(2.0, (2.0, 4.0, 1.0, 0.125), pressure_psi=2.0),
        )
        for number, off in enumerate((-0.5, 1.0), start=1)
    ]
    path = tmp_path / "calibration.csv"
    calibration_table(run, trials).to_csv(path, index=False)
    assert path.read_text().splitlines()[:2] == [
        "point,x_cm,y_cm,z_mm_at_0_psi,z_mm_at_2_psi,z_mm_at_2.5_psi",
        "1,3.5,3.5,0.0,2.0,4.25",
    ]
    read = read_measured(path, 4)
    assert read.pressures_psi == (2.0, 2.5)
    assert read.points_mm.tolist() == [[35, 35], [70, 70], [105, 35], [70, 105]]
    assert read.heights_mm.tolist() == [[2, 4, 1, 0.125], [4.25, 8, 2, 1]]


def test_a_point_that_nobody_saw_is_blank_and_left_out(run, make_trial, make_level, tmp_path):
    path = tmp_path / "calibration.csv"
    trials = [make_trial(1, make_level(1.0, (4.0, None, 2.0, 1.0)))]
    calibration_table(run, trials).to_csv(path, index=False)
    read = read_measured(path)
    np.testing.assert_array_equal(read.heights_mm, [[4, np.nan, 2, 1]])
    assert read.unmeasured(0) == (2,)


def test_a_calibration_table_is_of_one_sheet_and_pattern(run, make_trial, make_level):
    with pytest.raises(BadInput, match="good trials of 0 kinds"):
        calibration_table(run, [])
    trials = [make_trial(1, make_level(1.0)), make_trial(2, make_level(1.0), pattern="cylinder")]
    with pytest.raises(BadInput, match="good trials of 2 kinds"):
        calibration_table(run, trials)
