from itertools import permutations

import moocore
import numpy as np
import pytest
from evolve_doubles import member

from evolve.selection import dominates, nondominated, survivors

SEEDED = np.random.default_rng


def beats(one, other):
    """Dominance, written out: the oracle of this file."""
    if one.errors_m is None:
        return other.errors_m is None and one.id < other.id
    if other.errors_m is None:
        return True
    ours, theirs = [one.age, *one.errors_m], [other.age, *other.errors_m]
    worse = any(a > b for a, b in zip(ours, theirs, strict=True))
    better = any(a < b for a, b in zip(ours, theirs, strict=True))
    return not worse and (better or one.id < other.id)


def best(members):
    return [one for one in members if not any(beats(other, one) for other in members)]


def ids(members):
    return [each.id for each in members]


def crowds(count, largest=12):
    """Members with few different ages and errors, so ties abound, and some without errors; ids in any order."""
    rng = SEEDED(11)
    for _ in range(count):
        size, targets = rng.integers(2, largest + 1), rng.integers(1, 4)
        errors = [rng.integers(0, 3, targets) if rng.random() < 0.8 else () for _ in range(size)]
        yield [
            member(int(n), int(rng.integers(3)), *e)
            for n, e in zip(rng.permutation(size), errors, strict=True)
        ]


def test_younger_better_and_equal():
    base = member(5, 3, 1.0, 2.0)
    for better in (member(9, 2, 1.0, 2.0), member(9, 3, 0.9, 2.0), member(9, 3, 1.0, 1.9)):
        assert dominates(better, base)
        assert not dominates(base, better)
    for apart in (member(9, 2, 1.1, 2.0), member(9, 4, 0.5, 0.5), member(9, 3, 0.9, 2.1)):
        assert not dominates(apart, base)
        assert not dominates(base, apart)


def test_an_exact_tie_goes_to_the_older_id():
    older, younger = member(4, 3, 1.0, 2.0), member(9, 3, 1.0, 2.0)
    assert dominates(older, younger)
    assert not dominates(younger, older)
    assert nondominated([younger, older]) == [older]
    assert survivors([younger, older, member(11, 4, 3.0, 3.0)], 1, "twins", SEEDED(0)) == [older]


def test_a_failure_is_worse_than_anything_that_has_a_shape():
    failed, poor = member(0, 0), member(9, 80, 99.0, 99.0)
    assert dominates(poor, failed)
    assert not dominates(failed, poor)
    assert nondominated([failed, poor]) == [poor]


def test_dominance_is_the_oracle_s_and_a_strict_partial_order():
    for members in crowds(60, largest=7):
        assert not any(dominates(one, one) for one in members)
        for one, other in permutations(members, 2):
            assert dominates(one, other) == beats(one, other)
            assert not (dominates(one, other) and dominates(other, one))
        for a, b, c in permutations(members, 3):
            assert dominates(a, c) or not (dominates(a, b) and dominates(b, c))


def test_the_nondominated_are_the_oracle_s_in_their_order():
    for members in crowds(250):
        assert nondominated(members) == best(members)


@pytest.mark.parametrize("crowding", ["contribution", "twins"])
def test_survivors_are_as_many_as_requested_and_the_nondominated_go_last(crowding):
    rng = SEEDED(12)
    for members in crowds(250):
        size = int(rng.integers(1, len(members) + 1))
        kept = survivors(members, size, crowding, rng)
        assert len(kept) == size
        assert ids(kept) == sorted(set(ids(kept)))
        assert all(one in members for one in kept)
        front = best(members)
        if len(front) <= size:
            assert all(one in kept for one in front)
        else:
            assert all(one in front for one in kept)


def test_who_is_deleted_in_a_tournament_is_dominated_by_somebody_who_stays():
    rng = SEEDED(13)
    for members in crowds(200):
        size = int(rng.integers(len(best(members)), len(members) + 1))
        kept = survivors(members, size, "contribution", rng)
        for gone in members:
            assert gone in kept or any(beats(one, gone) for one in kept)


@pytest.mark.parametrize("seed", range(5))
def test_failures_go_first_down_to_the_nondominated(seed):
    # One that beats all others, two of the middle, three failures: the tournament draws pairs, so a failure may
    # outlive the middle; but never the best.
    members = [member(0, 0, 1.0), *(member(n, n, 2.0) for n in (1, 2)), *(member(n, 0) for n in (3, 4, 5))]
    assert member(0, 0, 1.0) in survivors(members, 3, "contribution", SEEDED(seed))
    assert survivors(members, 1, "contribution", SEEDED(seed)) == members[:1]


def test_of_failures_alone_the_oldest_stays():
    members = [member(n, 0) for n in (7, 3, 5)]
    assert nondominated(members) == [member(3, 0)]
    assert survivors(members, 1, "contribution", SEEDED(0)) == [member(3, 0)]
    assert survivors(members, 1, "twins", SEEDED(0)) == [member(3, 0)]
    kept = survivors(members, 2, "twins", SEEDED(0))
    assert len(kept) == 2
    assert member(3, 0) in kept


def test_every_dominated_member_may_be_drawn():
    front, rest = member(0, 0, 1.0), [member(n, n, 2.0 + n) for n in range(1, 5)]
    gone = {
        one.id
        for seed in range(40)
        for one in rest
        if one not in survivors([front, *rest], 4, "twins", SEEDED(seed))
    }
    assert gone == {1, 2, 3, 4}


def test_by_contribution_the_one_that_is_missed_least_goes():
    # In a row from corner to corner; number 2 stands close before number 1 and covers hardly any more.
    row = [member(0, 5, 0.0, 4.0), member(1, 5, 1.0, 2.0), member(2, 5, 1.01, 1.99), member(3, 5, 4.0, 0.0)]
    assert ids(survivors(row, 3, "contribution", SEEDED(0))) in ([0, 1, 3], [0, 2, 3])
    assert ids(survivors(row, 2, "contribution", SEEDED(0))) != [1, 2]


def hypervolume_by_boxes(values, reference):
    """The volume that points dominate, summed over the boxes of the grid that they span."""
    edges = [np.unique([*values[:, axis], reference]) for axis in range(values.shape[1])]
    total = 0.0
    for corner in np.ndindex(*(len(each) - 1 for each in edges)):
        low = np.array([each[n] for each, n in zip(edges, corner, strict=True)])
        high = np.array([each[n + 1] for each, n in zip(edges, corner, strict=True)])
        if (values <= low).all(axis=1).any():
            total += float(np.prod(high - low))
    return total


@pytest.mark.parametrize("seed", range(6))
def test_contribution_is_the_hypervolume_of_age_and_errors_in_shares_of_their_ranges(seed):
    rng = SEEDED(seed)
    crowd = [member(n, int(rng.integers(12)), *(rng.random(2) * (1.0, 40.0))) for n in range(14)]
    front = nondominated(crowd)
    values = np.array([(one.age, *one.errors_m) for one in front])
    shares = (values - values.min(axis=0)) / np.ptp(values, axis=0)
    # One after the other goes, each the one that is missed least by those who are left.
    for size in range(len(front) - 1, len(front) - 4, -1):
        volumes = [hypervolume_by_boxes(np.delete(shares, n, axis=0), 1.1) for n in range(len(front))]
        gone = int(np.argmax(volumes))
        front, shares = front[:gone] + front[gone + 1 :], np.delete(shares, gone, axis=0)
        assert survivors(crowd, size, "contribution", SEEDED(seed)) == front


def test_by_twins_the_worse_of_two_near_ones_goes():
    apart = [member(0, 9, 5.0, 1.0), member(1, 9, 1.0, 5.0)]
    # Alike to 0.1 mm in both errors, not in age; (1 + 2.09)(1 + 2.0) is the larger product.
    twins = [member(2, 3, 2.0, 2.05), member(3, 2, 2.09, 2.0)]
    worse = max(twins, key=lambda one: (1 + 1e3 * one.errors_m[0]) * (1 + 1e3 * one.errors_m[1]))
    for seed in range(5):
        kept = survivors([*apart, *twins], 3, "twins", SEEDED(seed))
        assert worse not in kept


def test_without_twins_any_one_may_go():
    row = [member(n, 4, float(n), 9.0 - n) for n in range(4)]
    # 0.1 mm apart in one error is not near.
    assert {*ids(row)} == {
        n for seed in range(40) for n in set(range(4)) - set(ids(survivors(row, 3, "twins", SEEDED(seed))))
    }


def test_by_twins_failures_are_not_asked_for_errors():
    members = [member(0, 1, 1.0, 2.0), member(1, 0, 2.0, 1.0), *(member(n, 0) for n in range(2, 6))]
    assert ids(survivors(members, 2, "twins", SEEDED(0))) == [0, 1]


def test_no_failure_may_reach_moocore():
    # As NaN, a newborn failure would delete the good member; as infinity it would stand beside it for its youth.
    good = [3, 0.001, 0.001]
    assert moocore.is_nondominated(np.array([good, [0, np.nan, np.nan]]), keep_weakly=True).tolist() == [
        False,
        True,
    ]
    assert moocore.is_nondominated(np.array([good, [0, np.inf, np.inf]]), keep_weakly=True).all()
    for crowd in ([member(0, 3, 1.0, 1.0), member(1, 0)], [member(0, 0), member(1, 3, 1.0, 1.0)]):
        assert nondominated(crowd) == [one for one in crowd if one.errors_m]


def test_the_same_generator_keeps_the_same():
    rng = SEEDED(3)
    crowd = [member(n, int(rng.integers(5)), *rng.random(2)) for n in range(40)]
    for crowding in ("contribution", "twins"):
        one, same = (survivors(crowd, 25, crowding, SEEDED(8)) for _ in range(2))
        assert one == same
