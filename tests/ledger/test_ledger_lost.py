import random
import shutil

import pytest
from made_ledger import Notices, a_run, a_trial, changed_bytes, check_files_agree, no_notice

from labctl.errors import BadInput
from labctl.ledger.ledger import Ledger
from labctl.ledger.writer import LedgerWriter


def test_what_is_gone_from_both_is_named_and_the_rest_is_kept(kept, notices):
    with changed_bytes(kept.journal) as data:
        data[data.index(b'"kind":"trial","run":1,"trial":3') + 400] ^= 1
    with changed_bytes(kept.sqlite) as data:
        at = data.index(b'{"run":1,"number":3,')
        data[at + 400] ^= 1
    rest = tuple(trial for trial in kept.trials if trial.number != 3)

    with Ledger.open(kept.folder, notices) as reader:
        assert reader.trials(1) == rest
    assert (
        "gone from both files: row 6 (trial 3, attempt 1, of run 1); everything else is there" in notices.text
    )

    with LedgerWriter.open(kept.folder, notices) as writer:
        assert writer.trials(1) == rest
        lost = [event for event in writer.events(None) if event.kind == "lost"]
        writer.add_trial(a_trial(1, 3, 2))
    assert lost[0].detail["rows"] == {"6": "trial 3, attempt 1, of run 1"}
    with LedgerWriter.open(kept.folder, no_notice) as writer:
        assert len(writer.trials(1)) == len(kept.trials)
    check_files_agree(kept.folder)


def test_trials_of_a_lost_run_are_kept_and_its_number_is_not_given_again(kept, notices):
    with changed_bytes(kept.journal) as data:
        data[data.index(b'"kind":"run"') + 400] ^= 1
    with changed_bytes(kept.sqlite) as data:
        data[data.index(b'{"number":1,"protocol"') + 400] ^= 1

    with LedgerWriter.open(kept.folder, notices) as writer:
        assert "row 1 (the beginning of run 1)" in notices.text
        assert writer.trials(1) == kept.trials
        with pytest.raises(BadInput, match="the beginning of run 1 is lost"):
            writer.run(1)
        assert writer.begin_run(a_run()).number == 2
    check_files_agree(kept.folder)


def test_trials_of_a_lost_run_come_back_into_an_older_sqlite(kept, notices, tmp_path):
    LedgerWriter.open(tmp_path / "new", no_notice).close()
    shutil.copy(tmp_path / "new" / "ledger.sqlite", kept.sqlite)
    with changed_bytes(kept.journal) as data:
        data[data.index(b'"kind":"run"') + 400] ^= 1

    with LedgerWriter.open(kept.folder, notices) as writer:
        assert writer.trials(1) == kept.trials
    check_files_agree(kept.folder)


def test_a_number_that_was_given_is_not_given_again(kept, notices):
    for path in kept.folder.glob("ledger.*"):
        path.unlink()
    with LedgerWriter.open(kept.folder, no_notice) as writer:
        assert writer.begin_run(a_run()).number == 2
    shutil.rmtree(kept.folder / "raw")
    with LedgerWriter.open(kept.folder, no_notice) as writer:
        assert writer.begin_run(a_run()).number == 3


@pytest.mark.parametrize("cut", ["at a line", "inside a line"])
def test_of_both_files_cut_short_the_rows_that_are_gone_are_reported(kept, notices, cut):
    with changed_bytes(kept.journal) as data:
        at = data.index(b'\n{"sha256"', data.index(b'"kind":"trial","run":1,"trial":5')) + 1
        del data[at if cut == "at a line" else at - 300 :]
    kept.sqlite.write_bytes(kept.sqlite.read_bytes()[:3000])

    with LedgerWriter.open(kept.folder, notices) as writer:
        there = writer.trials(1)

    if cut == "at a line":
        assert there == kept.trials[:5]
        assert "rows 11 to 13 (of unknown kind)" in notices.text
    else:
        assert there == kept.trials[:4]
        assert "row 10 (trial 5, attempt 1, of run 1), rows 11 to 13 (of unknown kind)" in notices.text
    check_files_agree(kept.folder)


def test_both_damaged_at_random_lose_only_what_is_reported(copy_kept):
    for seed in range(25):
        chance = random.Random(seed)
        kept, notices = copy_kept(seed), Notices()
        with changed_bytes(kept.journal) as data:
            for _ in range(chance.randrange(4)):
                at = chance.randrange(len(data))
                data[at : at + 40] = chance.randbytes(40)
        with changed_bytes(kept.sqlite) as data:
            at = chance.randrange(len(data))
            data[at : at + 2000] = chance.randbytes(2000)

        with LedgerWriter.open(kept.folder, notices) as writer:
            there = {(trial.number, trial.attempt) for trial in writer.trials(1)}
            gone = {
                seq for event in writer.events(None) if event.kind == "lost" for seq in event.detail["rows"]
            }
        missing = {
            str(2 * trial.number) for trial in kept.trials if (trial.number, trial.attempt) not in there
        }
        assert missing <= gone, f"seed {seed}: {notices.text}"
        check_files_agree(kept.folder)
