"""Every mistake that a person can make before anything moves: one clear message, exit code 2."""

import json
import os
import re
from importlib import resources

import pytest

from labctl.cli.main import run
from labctl.config.load import load_design
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings

KNOWN = (resources.files("labctl") / "designs" / "known.toml").read_text()


@pytest.fixture
def refused(capsys):
    """Run a command line that must be refused; returns its message."""

    def check(*arguments):
        code = run([str(argument) for argument in arguments])
        shown = capsys.readouterr()
        assert code == 2, shown.err
        assert shown.out == ""
        assert "Traceback" not in shown.err
        return shown.err

    return check


@pytest.fixture
def rig(tmp_path):
    """A rig.toml at whose ports nobody answers."""
    path = tmp_path / "rig.toml"
    settings = DoublesSettings(load_design("known"))
    path.write_text(rig_toml(settings, "/dev/ttyNOSUCH0", "/dev/ttyNOSUCH1", "127.0.0.1", 0))
    return path


@pytest.fixture
def design_file(tmp_path):
    """A design file: the known one with one text replaced."""

    def write(old, new):
        assert old in KNOWN
        path = tmp_path / "sheet.toml"
        path.write_text(KNOWN.replace(old, new, 1))
        return path

    return write


def test_unknown_pattern_lists_the_known_ones(refused):
    assert "has cylinder, sphere" in refused("inflate", "--pattern", "cube")


def test_unknown_design_lists_the_shipped_ones(refused):
    assert "known" in refused("inflate", "--pattern", "sphere", "--design", "nosuch")


def test_fiber_without_a_channel_is_named(refused, design_file):
    message = refused("inflate", "--pattern", "sphere", "--design", design_file("channel = 2\n", ""))
    assert "x70" in message
    assert "channel" in message


def test_two_fibers_on_one_channel_are_named(refused, design_file):
    message = refused("inflate", "--pattern", "sphere", "--design", design_file("channel = 2", "channel = 1"))
    assert "x35 and x70 are on one channel" in message


@pytest.mark.parametrize("pressure", ["-1 psi", "-0.1", "nan", "inf", "0 psi", "lots", "3.9 mm", ""])
def test_pressures_that_are_none(refused, rig, pressure):
    refused("inflate", "--pattern", "sphere", "--rig", rig, f"--pressure={pressure}")


def test_pressure_above_the_limit_names_the_limit_and_where_it_stands(refused, rig):
    message = refused("inflate", "--pattern", "sphere", "--rig", rig, "--pressure", "4.6 psi")
    assert "4.6 psi is above the rig's limit of 4 psi" in message
    assert "limits.max_pressure" in message


def test_pressures_may_carry_other_units(refused, rig):
    assert "4.35" in refused("inflate", "--pattern", "sphere", "--rig", rig, "--pressure", "30 kPa")


def test_malformed_toml_names_file_and_line(refused, tmp_path):
    path = tmp_path / "rig.toml"
    path.write_text('name = "bench A"\n[regulator\n')
    assert f"{path}:2" in refused("inflate", "--pattern", "sphere", "--rig", path)


def test_rig_file_that_is_not_there(refused):
    assert "no such file" in refused("inflate", "--pattern", "sphere", "--rig", "nowhere.toml")


def test_port_that_does_not_exist(refused, rig):
    message = refused("inflate", "--pattern", "sphere", "--rig", rig)
    assert "/dev/ttyNOSUCH0" in message
    assert "labctl energised nothing: regulator A could not be read" in message


def test_pattern_that_needs_more_valves_than_the_rig_has(refused, rig, design_file):
    rig.write_text(rig.read_text().replace("channels = 32", "channels = 8"))
    design = design_file("channel = 6", "channel = 9")
    assert "y105" in refused("inflate", "--pattern", "sphere", "--rig", rig, "--design", design)


@pytest.mark.parametrize("instrument", ["regulator", "valves", "markers"])
@pytest.mark.parametrize("fault", ["garbage", "silent"])
def test_instrument_that_answers_garbage_or_never(lab_with, instrument, fault):
    lab = lab_with(f"{instrument}={fault}")
    done = lab("inflate", "--pattern", "sphere", "--rig", lab.rig, "--json")

    assert done.code == 2, done.err
    assert re.search("Nothing was energised|labctl energised nothing", json.loads(done.out)["error"])
    assert "Traceback" not in done.err
    assert lab.plant.highest_psi == 0
    assert not lab.last()["coils"]
    assert not lab.last()["setpoint_psi"]


def test_measured_table_with_a_missing_point(refused, tmp_path):
    path = tmp_path / "measured.csv"
    path.write_text("point,x_mm,y_mm,z_mm_at_0_psi,z_mm_at_3_psi\n1,35,70,0,1\n3,70,70,0,1\n")
    message = refused("compare", "--pattern", "sphere", "--measured", path, "--points", "3")
    assert "at 3 psi 2 of 3 points have a height" in message


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--pattern", "sphere", "--strain", "9"), "outside 0 to 0.6"),
        (("--pattern", "sphere", "--strain", "nan"), "nan"),
        (("--pattern", "sphere", "--solver", "dynamic", "--strain", "0.1"), "own inflation"),
        (("--pattern", "sphere", "--pressure", "-1 psi"), "below 0"),
        ((), "either --pattern or --voxels"),
        (("--voxels", "nowhere.npz"), "nowhere.npz"),
        (("--voxels", os.devnull), "is not a file"),
        (("--pattern", "sphere", "--out", "shape.txt"), ".npz"),
        (("--pattern", "sphere", "--out", "nowhere/shape.npz"), "no folder"),
    ],
)
def test_what_cannot_be_simulated(refused, arguments, words):
    assert words in refused("simulate", *arguments)
