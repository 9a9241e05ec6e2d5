from dataclasses import replace

import made_measurement as made
import pandas as pd
import pytest

from labctl.errors import LabError
from labctl.export.run_tables import meaning, run_tables


def tables_of(run, trials):
    return run_tables(run, trials, lambda trial: made.pressures(trial.pressures_psi))


def test_every_attempt_has_its_rows_and_whether_it_counts():
    run = made.run()
    tables = tables_of(run, made.five_trials(run))
    trials = tables["trials"]

    assert trials[["trial", "attempt", "outcome", "counts"]].to_numpy().tolist() == [
        [1, 1, "good", True],
        [2, 1, "good", True],
        [3, 1, "failed", False],
        [3, 2, "good", True],
        [4, 1, "good", True],
        [5, 1, "good", True],
    ]
    assert trials["begun"].tolist()[0] == "2026-11-20T14:01:00.000000+00:00"
    assert len(tables["points"]) == 6 * 16
    assert tables["points"].groupby("counts")["point"].count().to_dict() == {False: 16, True: 80}


def test_points_carry_what_the_result_holds():
    run = made.run()
    result = made.result(run, hidden=(2,))
    points = tables_of(run, [made.trial(run, derived=result)])["points"]

    assert points["height_mm"].isna().tolist() == [n == 2 for n in range(16)]
    assert points["height_mm"].dropna().tolist() == [
        each for each in result.levels[0].heights_mm if each is not None
    ]
    assert points["error_percent"].mean() == pytest.approx(result.levels[0].e_t_percent)
    assert points["marker_id"].tolist() == list(range(16))


def test_pressures_are_those_of_the_trials_that_recorded_any():
    run = made.run()
    trials = [made.trial(run, 1), made.trial(run, 2, outcome="aborted", derived=None, raw={})]
    pressures = tables_of(run, trials)["pressures"]

    assert set(pressures["trial"]) == {1}
    assert pressures["gauge_psi"].tolist() == made.pressures().gauge_psi.tolist()
    assert tables_of(run, trials[1:])["pressures"].empty


def test_a_raw_file_that_is_damaged_is_named():
    run = made.run()

    def read(trial):
        raise LabError("damaged")

    with pytest.raises(LabError, match="run 7, trial 1, attempt 1: damaged; labctl verify 7"):
        run_tables(run, [made.trial(run)], read)


def test_relaxation_and_calibration_have_tables_of_their_own():
    run = made.run("relaxation")
    trial = made.trial(run, derived=made.result(run, relaxation=made.relaxing()))
    assert tables_of(run, [trial])["relaxation"]["height_mm"].tolist() == list(made.relaxing().height_mm)

    run = made.run("calibration", pressures_psi=(2.0, 2.5))
    assert tables_of(run, [made.trial(run)])["calibration"].columns.tolist() == [
        *("point", "x_cm", "y_cm"),
        *("z_mm_at_0_psi", "z_mm_at_2_psi", "z_mm_at_2.5_psi"),
    ]
    assert "calibration" not in tables_of(run, [made.trial(run, outcome="failed")])


def test_every_column_has_a_unit_and_a_meaning():
    run = made.run("calibration")
    trial = made.trial(run, derived=made.result(run, relaxation=made.relaxing()))
    columns = {column for table in tables_of(run, [trial]).values() for column in table.columns}

    assert all(meaning(column) for column in columns)


def test_half_a_letter_becomes_a_question_mark():
    run = made.run()
    trial = replace(made.trial(run, outcome="failed"), reason="caf\udce9")
    table = tables_of(run, [trial])["trials"]

    assert table["reason"].tolist() == ["caf?"]
    assert isinstance(table, pd.DataFrame)
