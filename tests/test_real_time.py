"""A test in real time is repeated when the machine was late, and never passed silently."""

import textwrap

import pytest
import real_time

pytest_plugins = ["pytester"]


@pytest.fixture
def tried(pytester, monkeypatch):
    """Run a marked test that fails `failures` times, beside a sleeper that is late by these seconds in turn."""

    def run(failures, *late_s):
        pytester.makepyfile(
            textwrap.dedent(f"""
            import pytest

            tries = []

            @pytest.fixture
            def fresh():
                return []

            @pytest.mark.real_time(margin_s=0.05)
            def test_it(fresh):
                fresh.append(1)
                tries.append(1)
                assert len(fresh) == 1
                assert len(tries) > {failures}
            """)
        )
        asked = iter([each for late in late_s for each in (0.0, late)])
        monkeypatch.setattr(real_time.Sleeper, "worst_s", lambda _: next(asked))
        return pytester.inline_run("-p", "real_time", "-p", "no:cacheprovider"), asked

    return run


@pytest.mark.parametrize(
    ("failures", "late_s", "passed"),
    [
        (0, (0.01,), True),
        (0, (0.3,), True),
        (1, (0.3, 0.01), True),
        (2, (0.3, 0.3, 0.3), True),
        (1, (0.01,), False),
        (2, (0.3, 0.01), False),
        (9, (0.3, 0.3, 0.3), False),
    ],
    ids=["on time", "late and good", "repeated", "repeated twice", "failed", "failed again", "always late"],
)
def test_only_a_failure_beside_a_late_machine_is_repeated(tried, failures, late_s, passed):
    run, asked = tried(failures, *late_s)
    run.assertoutcome(passed=int(passed), failed=int(not passed))
    assert list(asked) == []


def test_what_was_repeated_and_what_was_late_is_reported(pytester, tried, capsys):
    tried(1, 0.3, 0.2)
    shown = capsys.readouterr().out
    assert "the machine was later than a test's margin" in shown
    assert "repeated: " in shown
    assert "try 1, 300 ms late" in shown
    assert "passed all the same: 1 tests, at worst 200 ms late" in shown


def test_the_sleeper_knows_how_late_it_was():
    sleeper = real_time.Sleeper()
    try:
        sleeper.worst_s()
        assert 0 <= sleeper.worst_s() < 5
    finally:
        sleeper.close()
