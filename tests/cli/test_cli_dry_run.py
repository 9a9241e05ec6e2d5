import pytest

from labctl.cli.main import run as labctl


@pytest.mark.parametrize(("trials", "planned"), [("1", "1 trial, usually "), ("2", "2 trials, usually ")])
def test_a_dry_run_counts_its_trials(tmp_path, capsys, trials, planned):
    ledger = tmp_path / "ledger"
    arguments = ["run", "five-trial", "--pattern", "sphere", "--trials", trials, "--dry-run"]

    assert labctl([*arguments, "--ledger", str(ledger)]) == 0

    assert f": {planned}" in capsys.readouterr().out
    assert not ledger.exists()
