import numpy as np
import pytest
from evolve_doubles import member

from evolve.front import Front


def crowd(seed, count=40, targets=2):
    rng = np.random.default_rng(seed)
    return [
        member(n, int(rng.integers(9)), *(rng.integers(1, 12, targets) if rng.random() < 0.9 else ()))
        for n in range(count)
    ]


def best(members):
    """By the errors alone, whatever the age; of equals the oldest: the oracle of this file."""
    scored = [one for one in members if one.errors_m]

    def beaten(one):
        return any(
            all(a <= b for a, b in zip(other.errors_m, one.errors_m, strict=True))
            and (other.errors_m != one.errors_m or other.id < one.id)
            for other in scored
        )

    return sorted((one for one in scored if not beaten(one)), key=lambda one: one.errors_m)


@pytest.mark.parametrize("targets", [1, 2, 3])
@pytest.mark.parametrize("seed", range(8))
def test_the_front_is_what_no_other_beats_in_any_order_and_in_any_portions(seed, targets):
    members = crowd(seed, targets=targets)
    expected = tuple(best(members))
    assert Front().with_(members).members == expected
    assert Front().with_(members[::-1]).members == expected
    assert Front().with_(members[:15]).with_(members[15:]).members == expected
    assert Front().with_(members).with_(members).members == expected


def test_age_does_not_help_onto_the_front():
    young, good = member(1, 0, 2.0, 2.0), member(0, 50, 1.0, 1.0)
    assert Front().with_([young, good]).members == (good,)


def test_failures_are_passed_over():
    assert Front().with_([member(0, 0), member(1, 0)]).members == ()
    assert Front().with_([member(0, 0), member(1, 0, 5.0)]).members == (member(1, 0, 5.0),)
    assert Front().hypervolume((1e-3,)) == 0.0


def test_the_hypervolume_is_the_share_of_the_reference_box():
    front = Front().with_([member(0, 0, 1.0, 6.0), member(1, 0, 2.0, 2.0)])
    # Of 4 mm x 8 mm: (4 - 1)(8 - 6) + (4 - 2)(8 - 2) less the overlap (4 - 2)(8 - 6).
    assert front.hypervolume((4e-3, 8e-3)) == pytest.approx((6 + 12 - 4) / 32)
    assert Front().with_([member(0, 0, 1.0)]).hypervolume((4e-3,)) == pytest.approx(0.75)
    assert Front().with_([member(0, 0, 5.0, 1.0)]).hypervolume((4e-3, 8e-3)) == 0.0


@pytest.mark.parametrize("targets", [1, 2, 3])
def test_the_hypervolume_never_falls(targets):
    rng = np.random.default_rng(6)
    front, volumes = Front(), [0.0]
    for n in range(300):
        front = front.with_([member(n, 0, *(10 * rng.random(targets) ** 2))])
        volumes.append(front.hypervolume((8e-3,) * targets))
    assert volumes == sorted(volumes)
    assert volumes[-1] > 0.8
