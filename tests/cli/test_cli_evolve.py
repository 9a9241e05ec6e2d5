import json
import os
import time

import pytest
from distributed import LocalCluster
from labctl_process import wait_until

from evolve.run_folder import RunFolder
from labctl.cli.main import run
from labctl.config.load import load_design
from labctl.design_search.search_run import run_folders
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings
from labctl.simulation.sheets import pattern_sheet

ONE_EACH = ("--representation", "exclusive", "--fibers-per-face", "1")
SEARCH = ("--targets", "cylinder,sphere", "--population", "6", "--generations", "3", "--seed", "4")


@pytest.fixture(scope="module")
def searched(tmp_path_factory, labctl):
    """A short search that nothing interrupted, and the JSON that it printed."""
    folder = tmp_path_factory.mktemp("searched") / "a"
    ended = labctl("evolve", *SEARCH, "--out", folder, "--workers", 2, "--json")
    assert ended.code == 0, ended.err
    return folder, json.loads(ended.out)


def bytes_of(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def fails(capsys, *arguments):
    """The one message of a command that is refused."""
    assert run(["evolve", *map(str, arguments)]) == 2
    message = capsys.readouterr().err
    assert message.startswith("labctl: ")
    assert "Traceback" not in message
    return message


def test_a_search_reports_what_it_found(searched):
    folder, shown_json = searched
    (found,) = shown_json["runs"]

    assert found["generations"] == 3
    assert found["sheets"] == 2 * (100 + 3 * 6)
    assert 0 < found["simulated"] <= found["sheets"]
    assert found["failed"] == 0
    assert 0 <= found["hypervolume"] < 1
    assert found["picks"]["paper"] in found["front"]
    assert sum(found["picks"]["paper"]["errors_mm"].values()) == pytest.approx(
        min(sum(member["errors_mm"].values()) for member in found["front"])
    )
    assert (folder / "index.html").stat().st_size > 1000


def test_a_pick_is_the_sheet_that_was_scored(searched, capsys):
    folder, _ = searched
    out = folder.parent / "picked.toml"

    assert run(["evolve", "pick", str(folder), "--out", str(out), "--json"]) == 0

    shown_json = json.loads(capsys.readouterr().out)
    checkpoint, (settings, _) = RunFolder(folder).checkpoint(), RunFolder(folder).load()
    (member,) = (each for each in checkpoint.front.members if each.id == shown_json["member"])
    design = load_design(out)
    assert sorted(design.patterns) == ["cylinder", "sphere"]
    for pattern, voxel_map in zip(("cylinder", "sphere"), settings.problem.maps(member.genome), strict=True):
        assert pattern_sheet(design, pattern).material.tobytes() == voxel_map.material
        errors_mm = {name: error / 1e3 for name, error in shown_json["errors_mm"].items()}
        index = ("cylinder", "sphere").index(pattern)
        assert settings.problem.score(voxel_map).errors_m[index] == pytest.approx(
            errors_mm[pattern], rel=1e-12
        )


def test_a_member_is_picked_by_its_id(searched, capsys):
    folder, shown_json = searched
    member = shown_json["runs"][0]["front"][-1]["member"]

    assert run(["evolve", "pick", str(folder), "--member", str(member), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["member"] == member
    assert (folder / f"member-{member}.toml").exists()

    assert run(["evolve", "pick", str(folder), "--member", "99999"]) == 2
    assert "is not on the front" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["run.json", "checkpoint.json", "population.json", "index.html", "lock"])
def test_a_pick_replaces_picks_only(searched, capsys, name):
    folder, _ = searched
    before = (folder / name).read_bytes()

    assert "is no picked design" in fails(capsys, "pick", folder, "--out", folder / name)

    assert (folder / name).read_bytes() == before
    for _ in range(2):
        assert run(["evolve", "pick", str(folder), "--out", str(folder.parent / "again.toml")]) == 0


@pytest.mark.parametrize(
    "command",
    [
        [*SEARCH, "--out", ""],
        ["--resume", "--out", ""],
        ["show", ""],
        ["pick", ""],
        ["pick", "a", "--out", ""],
    ],
)
def test_an_empty_name_is_not_this_folder(tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)

    assert "it is empty: write a name, or . for this folder" in fails(capsys, *command)
    assert not list(tmp_path.iterdir())


def test_a_folder_whose_name_is_too_long(capsys):
    for command in (["show", "x" * 300], [*SEARCH, "--out", "x" * 300]):
        assert "File name too long" in fails(capsys, *command)


@pytest.mark.parametrize("name", ["run.json", "checkpoint.json"])
def test_a_file_of_endless_brackets_is_refused(searched, tmp_path, capsys, name):
    folder, _ = searched
    for each in ("run.json", "checkpoint.json"):
        (tmp_path / each).write_bytes((folder / each).read_bytes())
    (tmp_path / name).write_bytes(b"[" * 100_000)

    assert "damaged" in fails(capsys, "show", tmp_path)


@pytest.mark.long
def test_show_scores_the_published_way_too(searched, capsys):
    folder, shown_json = searched

    assert run(["evolve", "show", str(folder), "--published", "--json"]) == 0

    (shown,) = json.loads(capsys.readouterr().out)["runs"]
    assert shown["front"] == shown_json["runs"][0]["front"]
    assert {each["member"] for each in shown["published"]} == {each["member"] for each in shown["front"]}
    assert len(shown["front"]) <= 20
    for each in shown["published"]:
        # 31 heights in whole mm: the mean of their differences is a multiple of 1/31 mm.
        assert all(
            31 * error == pytest.approx(round(31 * error), abs=1e-6) for error in each["errors_mm"].values()
        )


# It must still search when it is killed.
@pytest.mark.real_time
@pytest.mark.long
@pytest.mark.parametrize("after", [0.0, 0.3])
def test_a_killed_search_ends_as_if_nothing_had_been(searched, start, tmp_path, capsys, after):
    folder, _ = searched
    running = start("evolve", *SEARCH, "--out", tmp_path / "b", "--workers", 2)
    wait_until((tmp_path / "b" / "checkpoint.json").exists)
    time.sleep(after)
    running.signal(9)
    running.end()

    assert run(["evolve", "--resume", "--out", str(tmp_path / "b"), "--workers", "1"]) == 0

    assert "seed 4: continuing from the last checkpoint" in capsys.readouterr().err
    assert (tmp_path / "b" / "population.json").read_bytes() == (folder / "population.json").read_bytes()


@pytest.mark.long
def test_a_search_on_a_cluster_ends_as_on_this_machine(searched, tmp_path, capsys):
    out = tmp_path / "b"
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", memory_limit=0) as cluster:
        assert run(["evolve", *SEARCH, "--out", str(out), "--cluster", cluster.scheduler_address]) == 0, (
            capsys.readouterr().err
        )
    assert (out / "population.json").read_bytes() == (searched[0] / "population.json").read_bytes()


def test_ctrl_c_keeps_the_generations(start, tmp_path):
    running = start("evolve", *SEARCH[:-3], "400", "--out", tmp_path / "c", "--workers", 2)
    running.wait_for("generation 1 of 400")
    running.signal()
    running.wait_for("every finished generation is kept")

    assert running.end().code == 130
    assert RunFolder(tmp_path / "c").checkpoint().state.generation >= 0


# The second signal must find the workers starting.
@pytest.mark.real_time
def test_more_ctrl_c_while_the_workers_end_adds_nothing(start, tmp_path):
    running = start("evolve", *SEARCH, "--out", tmp_path / "c", "--workers", 2)
    running.wait_for("random layouts first")
    running.signal()
    running.wait_for("Ctrl-C: stopping")
    # The workers are starting still, and are waited for.
    time.sleep(0.6)
    running.signal()
    running.wait_for("every finished generation is kept")
    running.signal()
    ended = running.end()
    running.read_rest()

    assert ended.code == 130
    assert "still stopping" in running.err
    assert "Traceback" not in running.err


# The signal must come before the page is drawn and the program gone.
@pytest.mark.real_time
@pytest.mark.long
def test_ctrl_c_after_the_last_generation_keeps_the_run(start, tmp_path):
    once = ("--targets", "saddle:20mm", "--population", "2", "--generations", "1", "--workers", "1")
    running = start("evolve", *once, "--out", tmp_path / "c")
    running.wait_for("generation 1 of 1")
    # Whether the signal finds the last words of the search, or the page half drawn.
    running.signal()
    ended = running.end()
    running.read_rest()

    assert ended.code == 130
    assert "kept" in running.err
    assert "labctl evolve show" in running.err or "labctl evolve --resume" in running.err
    assert sorted(bytes_of(tmp_path / "c"))[0] == "checkpoint.json"
    assert "index.html" not in bytes_of(tmp_path / "c")


def test_ctrl_c_while_the_page_is_drawn_is_reported(searched, monkeypatch, capsys):
    folder, _ = searched

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("labctl.report.search.page.evolution_page", interrupted)

    assert run(["evolve", "show", str(folder)]) == 130
    assert f"labctl evolve show {folder} draws its page" in capsys.readouterr().err


def test_a_page_that_cannot_be_written_hides_no_result(searched, tmp_path, capsys):
    folder, _ = searched
    for name in ("run.json", "checkpoint.json"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    (tmp_path / "index.html").mkdir()

    assert run(["evolve", "show", str(tmp_path)]) == 1

    printed = capsys.readouterr()
    assert "3 of 3 generations of 6" in printed.out
    assert "paper" in printed.out
    assert "index.html: is there already and is not a file" in printed.err
    assert "the run is kept" in printed.err


@pytest.mark.long
def test_more_generations_and_several_seeds(tmp_path, capsys):
    out = tmp_path / "several"
    short = ["--targets", "saddle:20mm", "--population", "2", "--workers", "1", "--out", str(out), "--json"]

    assert run(["evolve", *short, "--generations", "1", "--seeds", "7,3"]) == 0
    assert (
        run(["evolve", "--resume", "--out", str(out), "--generations", "2", "--workers", "1", "--json"]) == 0
    )

    shown_json = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert [(each["seed"], each["generations"]) for each in shown_json["runs"]] == [(3, 2), (7, 2)]
    assert [folder.path.name for folder in run_folders(out)] == ["seed-3", "seed-7"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--targets", "cylindre"], "no target is called 'cylindre'"),
        (["--targets", "cylinder,,sphere"], "a target is missing"),
        (["--targets", "cylinder,cylinder"], "is there twice"),
        (["--targets", "saddle:2000km"], "2000km"),
        (["--targets", "none.csv"], "none.csv"),
        (["--min-length", "150 mm"], "the longest that fits"),
        (["--min-length", "40 mm"], "shortest fiber that can be fabricated"),
        (["--min-length", "60 parsnips"], "--min-length"),
        (["--fibers-per-face", "17"], "32 valves"),
        (
            [
                "--targets",
                "cylinder,sphere,saddle",
                "--representation",
                "exclusive",
                "--fibers-per-face",
                "1",
            ],
            "at least 3",
        ),
        (["--rates", "near=x"], "near=x"),
        (["--rates", "nera=1"], "nera=1"),
        (["--rates", "near=0"], "every operator is off"),
        (["--rates", "near=1", "--without", "near"], "leave one on"),
        (["--without", "nera"], "no such operator"),
        (["--rates", "near=1,near=2"], "near is there twice"),
        (["--rates", "near=1e308,count=1e308"], "too large"),
        (["--seeds", "1,1"], "--seeds"),
        (["--seeds", "9" * 5000], "at most 18 digits"),
        (["--seeds", "1," + "7" * 300], "at most 18 digits"),
        (["--targets", "saddle:20mm,saddle"], "is there already"),
        (["--seeds", "1", "--seed", "2"], "not both"),
        (["--scoring", "published", "--surface", "top"], "--surface"),
        (["--workers", "0"], "--workers"),
        (["--workers", "2", "--cluster", "tcp://127.0.0.1:1"], "--cluster"),
        pytest.param(["--cluster", "tcp://127.0.0.1:1"], "127.0.0.1:1", marks=pytest.mark.long),
        (["--design", "nothing"], "no design named"),
        (["--rig", "nothing.toml"], "nothing.toml"),
        (["--resume"], "holds no run to resume"),
    ],
)
def test_bad_input_is_refused_and_leaves_no_folder(tmp_path, monkeypatch, capsys, options, words):
    monkeypatch.chdir(tmp_path)
    given = (
        options if "--targets" in options or "--resume" in options else ["--targets", "cylinder", *options]
    )

    assert words in fails(capsys, *given, "--out", "a")
    assert not (tmp_path / "a").exists()


def test_a_rig_with_few_valves_bounds_the_fibers(tmp_path, capsys):
    rig = tmp_path / "rig.toml"
    settings = DoublesSettings(load_design("known"), relay_channels=8, dump_channel=8)
    rig.write_text(rig_toml(settings, "/dev/ttyUSB0", "/dev/ttyUSB1", "127.0.0.1", 1))

    message = fails(capsys, "--targets", "cylinder", "--rig", rig, "--out", tmp_path / "a")

    assert "6 fibers per face are up to 12 fibers" in message
    assert "the rig has 7 valves: use at most 3 fibers per face" in message


def test_a_folder_with_another_run_is_left_alone(searched, capsys):
    folder, _ = searched
    before = bytes_of(folder)

    assert "holds another run" in fails(capsys, *SEARCH, "--out", folder)
    assert "population (7 / 6)" in fails(
        capsys, "--resume", *SEARCH[:2], "--population", "7", "--seed", "4", "--out", folder
    )
    assert "leave --population out" in fails(capsys, "--resume", "--population", "7", "--out", folder)
    assert "more than --generations 1" in fails(capsys, "--resume", "--generations", "1", "--out", folder)
    assert bytes_of(folder) == before


def test_a_folder_with_other_files_is_left_alone(tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("years of work")

    assert "thesis.tex" in fails(capsys, *SEARCH, "--out", tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize("damage", ["truncated", "foreign"])
def test_a_damaged_checkpoint_is_refused_and_kept(searched, tmp_path, capsys, damage):
    folder, _ = searched
    (tmp_path / "d").mkdir()
    for name in ("run.json", "checkpoint.json"):
        (tmp_path / "d" / name).write_bytes((folder / name).read_bytes())
    whole = (folder / "checkpoint.json").read_bytes()
    content = whole[: len(whole) // 2] if damage == "truncated" else whole.replace(b'"run": "', b'"run": "0')
    (tmp_path / "d" / "checkpoint.json").write_bytes(content)

    message = fails(capsys, "--resume", "--out", tmp_path / "d")

    assert "nothing was overwritten" in message
    assert ("cut short" if damage == "truncated" else "other settings") in message
    assert (tmp_path / "d" / "checkpoint.json").read_bytes() == content


def test_two_processes_do_not_work_on_one_run(searched, capsys):
    folder, _ = searched
    with RunFolder(folder).locked():
        assert "another process" in fails(capsys, "--resume", "--generations", "9", "--out", folder)


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_that_cannot_be_written(tmp_path, capsys):
    tmp_path.chmod(0o500)
    assert "cannot be written" in fails(capsys, *SEARCH, "--out", tmp_path / "a")
