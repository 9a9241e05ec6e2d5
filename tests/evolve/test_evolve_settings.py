import json
from dataclasses import replace

import pytest
from evolve_doubles import TARGETS, problem, settings

from evolve.constraints import Constraints
from evolve.errors import EvolveError
from evolve.problem import Physics, Problem
from evolve.selection import Member
from evolve.settings import Settings, differences, settings_from_json, settings_to_json
from evolve.variation import PUBLISHED_RATES, Variation
from sim.geometry import CENTRED, PUBLISHED
from sim.materials import Materials
from sim.score import Scoring
from sim.targets.shapes import saddle

BASE = settings()


def physics(**changed):
    return {"problem": replace(problem(), physics=replace(problem().physics, **changed))}


CENTRED_ALL = {
    "problem": Problem(Physics(CENTRED), (saddle(CENTRED, 0.02), saddle(CENTRED, 0.03))),
    "constraints": Constraints(CENTRED, 2),
}
CHANGES = {
    "seed": {"seed": 2},
    "population": {"population": 9},
    "crowding": {"crowding": "twins"},
    "rates": {"variation": Variation(PUBLISHED_RATES)},
    "one rate": {"variation": Variation({**BASE.variation.rates, "near": 0.31})},
    "representation": {"constraints": Constraints(PUBLISHED, 2, "exclusive")},
    "min_length_m": {"constraints": Constraints(PUBLISHED, 2, min_length_m=0.061)},
    "fibers_per_face": {"constraints": Constraints(PUBLISHED, 2, fibers_per_face=5)},
    "fibers_over_a_cell": {"constraints": Constraints(PUBLISHED, 2, fibers_over_a_cell=3)},
    "valves": {"constraints": Constraints(PUBLISHED, 2, valves=16)},
    "geometry": CENTRED_ALL,
    "materials": physics(materials=Materials(jammed_pa=1_330_689.0)),
    "bending": physics(materials=Materials(jammed_bending_pa=2e5)),
    "fibers_as": physics(fibers_as="elements"),
    "solver": physics(solver="dynamic"),
    "strain": physics(strain=0.1763355756877400001 + 1e-16),
    "precision": physics(precision="float64"),
    "surface": {"problem": replace(problem(), surface="bottom")},
    "columns": {"problem": replace(problem(), scoring=Scoring("every-20th"))},
    "rounding": {"problem": replace(problem(), scoring=Scoring(rounding="whole-mm"))},
    "alignment": {"problem": replace(problem(), scoring=Scoring(alignment="offset"))},
    "targets' order": {"problem": problem(2, TARGETS[1::-1])},
    "a target": {"problem": problem(2, (TARGETS[0], TARGETS[2]))},
    "a target's heights": {
        "problem": problem(2, (TARGETS[0], replace(TARGETS[1], heights_m=TARGETS[0].heights_m)))
    },
}


def through_a_file(of):
    return settings_from_json(json.loads(json.dumps(settings_to_json(of))))


@pytest.mark.parametrize("changed", [{}, *CHANGES.values()], ids=["as they are", *CHANGES])
def test_settings_come_back_from_a_file_the_same(changed):
    one = replace(BASE, **changed)
    same = through_a_file(one)
    assert same.digest == one.digest
    assert settings_to_json(same) == settings_to_json(one)
    assert same.constraints == one.constraints
    assert same.problem.physics == one.problem.physics
    assert same.problem.scoring == one.problem.scoring
    for a, b in zip(same.problem.targets, one.problem.targets, strict=True):
        assert a.heights_m.tobytes() == b.heights_m.tobytes()


def test_each_setting_changes_the_digest_to_its_own():
    digests = [replace(BASE, **changed).digest for changed in CHANGES.values()]
    assert len({BASE.digest, *digests}) == len(CHANGES) + 1


def test_notes_are_kept_and_change_nothing():
    noted = replace(BASE, notes={"design": "a.toml", "numpy": "2.0"})
    assert noted.digest == BASE.digest
    assert through_a_file(noted).notes == {"design": "a.toml", "numpy": "2.0"}
    assert differences(noted, BASE) == []


def test_nothing_that_is_kept_is_left_out_of_the_list():
    """A new field of the settings needs a line above, so that it is known to reach the digest."""
    names = set(settings_to_json(BASE)) | set(settings_to_json(BASE)["constraints"])
    names |= set(settings_to_json(BASE)["physics"]) | set(settings_to_json(BASE)["scoring"])
    apart = {"targets", "notes", "physics", "scoring", "constraints", "patterns"}
    assert names - apart <= set(CHANGES)
    assert set(Settings.__dataclass_fields__) == {
        *("problem", "constraints", "seed", "population", "crowding", "variation", "notes")
    }


def test_equal_settings_search_equally():
    one, same = BASE.engine(), through_a_file(BASE).engine()
    assert one.ask() == same.ask()
    for engine in (one, same):
        engine.tell([(1e-3 * n, 8e-3 - 1e-3 * n) for n in range(8)])
    assert one.ask() == same.ask()
    assert all(isinstance(member, Member) for member in one.population)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ("seed", ["seed (1 / 2)"]),
        ("fibers_per_face", ["fibers_per_face (6 / 5)"]),
        ("surface", ["surface (top / bottom)"]),
        ("one rate", ["near (0.3 / 0.31)"]),
    ],
)
def test_differences_are_named_with_both_values(changed, words):
    assert differences(BASE, replace(BASE, **CHANGES[changed])) == words


def test_other_targets_are_named():
    (difference,) = differences(BASE, replace(BASE, **CHANGES["a target"]))
    assert "monkey saddle" in difference
    assert "sphere cap" in difference


def test_targets_and_patterns_must_be_as_many():
    with pytest.raises(EvolveError, match="2 targets, but constraints for 3 patterns"):
        Settings(problem(2), Constraints(PUBLISHED, 3), 1)


@pytest.mark.parametrize("left_out", ["targets", "physics", "constraints", "seed", "rates"])
def test_settings_with_a_part_missing_are_refused(left_out):
    data = settings_to_json(BASE)
    del data[left_out]
    with pytest.raises(EvolveError, match=f"not those of a run .KeyError: '{left_out}'"):
        settings_from_json(data)


def test_settings_with_a_field_that_is_not_known_are_refused():
    data = settings_to_json(BASE)
    data["physics"]["gravity"] = 9.81
    with pytest.raises(EvolveError, match="gravity"):
        settings_from_json(data)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("seed", None),
        ("seed", [1]),
        ("seed", "x"),
        ("population", 2.5),
        ("population", float("nan")),
        ("crowding", "contributon"),
        ("surface", "x"),
        ("targets", 5),
        ("targets", [{}]),
        ("physics", None),
        ("constraints", []),
        ("rates", {"near": "x"}),
        ("notes", []),
    ],
)
def test_a_setting_of_another_type_is_refused(name, value):
    with pytest.raises(EvolveError):
        settings_from_json(settings_to_json(BASE) | {name: value})


@pytest.mark.parametrize(
    ("part", "name", "value"),
    [
        ("physics", "solver", "x"),
        ("physics", "strain", "x"),
        ("physics", "materials", {"jammed_pa": "x"}),
        ("physics", "materials", {"jammed": 1.0}),
        ("constraints", "fibers_per_face", 2.5),
        ("scoring", "columns", "some"),
    ],
)
def test_a_part_of_another_type_is_refused(part, name, value):
    data = settings_to_json(BASE)
    data[part][name] = value
    with pytest.raises(EvolveError):
        settings_from_json(data)
