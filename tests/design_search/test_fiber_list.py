import made_run
import pytest

from evolve.genome import FiberGene
from labctl.design_search.fiber_list import fiber_list
from sim.geometry import CENTRED, PUBLISHED

CHANNELS = range(1, 33)


def test_fibers_are_numbered_from_the_top_face_and_from_the_left():
    listed = fiber_list(made_run.GENOME, PUBLISHED, CHANNELS)

    assert [(fiber.number, fiber.face, fiber.start_mm, fiber.end_mm) for fiber in listed] == [
        (1, "top", (25.0, 35.0), (115.0, 50.0)),
        (2, "top", (85.0, 30.0), (100.0, 110.0)),
        (3, "bottom", (20.0, 45.0), (50.0, 105.0)),
    ]
    assert listed[2].length_mm == pytest.approx(67.082, abs=1e-3)
    assert listed[2].patterns == {0}


def test_the_order_of_the_genes_does_not_matter():
    assert fiber_list(made_run.GENOME[::-1], PUBLISHED, CHANNELS) == fiber_list(
        made_run.GENOME, PUBLISHED, CHANNELS
    )


def test_places_follow_the_geometry():
    (fiber,) = fiber_list((FiberGene("top", (3, 8), (9, 20), frozenset({0})),), CENTRED, CHANNELS)

    assert (fiber.start_mm, fiber.end_mm) == ((17.5, 42.5), (47.5, 102.5))


def test_channels_are_given_out_in_the_rigs_order():
    listed = fiber_list(made_run.GENOME, PUBLISHED, [1, 3, 4, 5])

    assert [(fiber.number, fiber.channel) for fiber in listed] == [(1, 1), (2, 3), (3, 4)]
