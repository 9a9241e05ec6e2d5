"""Every command that labctl tells a person to type, pasted into the same terminal: on rigs in virtual time."""

import shlex

import pytest

from labctl.doubles.faults import Faults

FIVE = ("run", "five-trial", "--pattern", "sphere", "--trials", "1")


@pytest.fixture
def told(monkeypatch):
    """The commands that texts have named so far, as a shell would split them."""
    commands = []
    join = shlex.join

    def listening(parts):
        parts = list(parts)
        if parts[0] == "labctl" and parts not in commands:
            commands.append(parts)
        return join(parts)

    monkeypatch.setattr("labctl.next_command.shlex.join", listening)
    return commands


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with blanks and umlauts in its name, and a ledger in it that is not the usual one."""
    folder = tmp_path / "Blätter für März"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.delenv("LABCTL_LEDGER", raising=False)
    return folder


def pasted(lab, commands, *names):
    """Run those of the commands, each as it was written; what is given of each must be in the text."""
    found = [command for command in commands if command[1] in names]
    assert {command[1] for command in found} == set(names), commands
    return [(shlex.join(command), lab(*command[1:])) for command in found]


def test_what_a_good_run_points_at_opens_that_very_run(lab, told, place):
    done = lab(*FIVE, "--rig", lab.rig, "--ledger", "mein Labor")
    assert done.code == 0, done.err
    assert done.out.splitlines()[-2:] == [
        "  labctl show 1 --ledger 'mein Labor'",
        "  labctl report 1 --ledger 'mein Labor'",
    ]
    for text, ended in pasted(lab, told, "show", "report"):
        assert ended.code == 0, (text, ended.err)
    assert (place / "report-0001.html").exists()


@pytest.mark.long
def test_an_inflation_that_is_kept_points_at_its_ledger_too(lab, told, place):
    done = lab("inflate", "--pattern", "sphere", "--keep", "--rig", lab.rig, "--ledger", "mein Labor")
    assert done.code == 0, done.err
    for text, ended in pasted(lab, told, "show", "report"):
        assert ended.code == 0, (text, ended.err)


def test_a_run_that_was_stopped_says_how_it_continues_and_does(lab, told, place):
    lab.at("trial 1: ramp", lab.press_ctrl_c)
    stopped = lab(*FIVE, "--rig", lab.rig, "--ledger", "mein Labor")
    assert stopped.code == 130
    assert (
        f"run 1 is kept: labctl run --continue 1 --rig {lab.rig} --ledger 'mein Labor' continues it"
        in stopped.err
    )
    ((text, ended),) = pasted(lab, told, "run")
    assert ended.code == 0, (text, ended.err)
    # It is finished now, and says where to look.
    told.clear()
    assert lab("run", "--continue", "1", "--rig", lab.rig, "--ledger", "mein Labor").code == 2
    ((text, ended),) = pasted(lab, told, "show")
    assert ended.code == 0, (text, ended.err)


@pytest.mark.long
def test_an_inflation_that_nobody_keeps_is_not_to_be_continued(lab, told, place):
    lab.at("trial 1: ramp", lab.press_ctrl_c)
    assert "--continue" not in lab("inflate", "--pattern", "sphere", "--rig", lab.rig).err


@pytest.mark.long
def test_a_run_that_failed_says_how_it_continues_and_does(lab_with, told, place):
    lab = lab_with("regulator=low-supply:2")
    failed = lab(*FIVE, "--attempts", "1", "--rig", lab.rig, "--ledger", "mein Labor")
    assert failed.code == 1
    lab.virtual.doubles.inject(Faults())
    ((text, ended),) = pasted(lab, told, "run")
    assert text in failed.err
    assert ended.code == 0, (text, ended.err)


def test_a_gauge_that_is_off_is_tared_by_the_command_that_is_named(lab_with, told, place):
    lab = lab_with("regulator=offset:0.4")
    assert lab("inflate", "--pattern", "sphere", "--rig", lab.rig).code == 2
    ((text, ended),) = pasted(lab, told, "tare")
    assert ended.code == 0, (text, ended.err)
    assert lab("inflate", "--pattern", "sphere", "--rig", lab.rig).code == 0


@pytest.mark.long
def test_a_paused_run_is_resumed_by_the_command_that_is_named(lab, told, place):
    ledger = ("--ledger", "mein Labor")
    lab.at("trial 1: jam", lambda: lab.second("pause", *ledger))

    def paste():
        (resume,) = [command for command in told if command[1] == "resume"]
        assert lab.second(*resume[1:]).code == 0

    lab.at("paused, the rig SAFE", lambda: lab.after(60, paste))
    done = lab("run", "five-trial", "--pattern", "sphere", "--trials", "2", "--rig", lab.rig, *ledger)
    assert done.code == 0, done.err


@pytest.mark.long
def test_doctor_names_the_vent_of_this_rig(lab, told, place):
    lab.leave_energised()
    doctor = lab("doctor", "--rig", lab.rig)
    assert f"labctl vent --rig {lab.rig}" in doctor.out
    ((text, ended),) = pasted(lab, told, "vent")
    assert ended.code == 0, (text, ended.err)
    lab.virtual.assert_safe()
