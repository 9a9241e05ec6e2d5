from dataclasses import replace

from made_recording import made_trial, run_of

from labctl.ledger.records import SimulatedHeights


def test_a_basis_is_what_the_runs_record_holds_of_a_pattern():
    trial = made_trial()
    run = run_of(trial)
    other = SimulatedHeights("cylinder", 3.9, (1.0,) * 16)
    run = replace(run, simulated_heights=(*run.simulated_heights, other))
    assert run.basis("sphere") == trial.basis
    assert run.basis("cylinder").simulated_mm == {3.9: (1.0,) * 16}
    assert run.basis("saddle").simulated_mm == {}
