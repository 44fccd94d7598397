"""Spheres that fall and roll: no overlap, every one at rest, and the published packing density."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls

from pdlab.dem import deposition, measures, profiles
from pdlab.dem.bed import Setup
from pdlab.dem.cells import empty_cells, put
from pdlab.errors import ProtocolError, RunDiverged

ONE = np.ones(1)
EQUAL = Setup(ONE, ONE, ONE, np.array([1500]), 8.0, 1, 1.0)
PAIR = Setup(np.array([1.0, 0.25]), np.ones(2), np.ones(2), np.array([110, 3000]), 5.0, 1, 1.0)
THREE = Setup(np.array([1.0, 0.7, 0.1]), np.ones(3), np.ones(3), np.array([40, 80, 4000]), 4.0, 3, 1.0)
BEDS = pytest.mark.parametrize("setup", [EQUAL, PAIR, THREE], ids=["equal", "ratio 4", "ratio 10"])


def packing_density(setup: Setup) -> float:
    place, _ = deposition.drop_and_roll(setup)
    return measures.solid_fraction(place, setup.area, *measures.slab(place))


def settled(lying: np.ndarray, r: float, x: float, y: float, width: float) -> tuple[bool, np.ndarray]:
    """Where a sphere dropped on spheres ``lying`` rests."""
    n = len(lying)
    cells = empty_cells(lying[:, 3], np.zeros(n, np.int64), width, 4.0)
    for i in range(n):
        put(cells, lying, i)
    work = np.empty(n, np.int64), np.empty(n, np.int64), np.empty((n, 3))
    rests, p = deposition.settled((x, y, 9.0), r, lying, cells, *work)
    return rests, np.array(p)


@BEDS
def test_no_two_spheres_overlap_and_none_lies_below_the_floor(setup: Setup) -> None:
    place, species = deposition.drop_and_roll(setup)
    assert np.array_equal(np.bincount(species), setup.count)
    assert np.array_equal(place[:, 3], 0.5 * setup.diameter[species])
    assert profiles.touching(place, setup.width)[2].max(initial=0.0) < 1e-9
    assert (place[:, 2] - place[:, 3]).min() > -1e-12
    assert ((place[:, :2] >= 0.0) & (place[:, :2] < setup.width)).all()


@BEDS
def test_every_sphere_rests_on_the_floor_or_on_three_spheres_that_came_before_it(setup: Setup) -> None:
    place, _ = deposition.drop_and_roll(setup)
    swollen = place + np.array([0.0, 0.0, 0.0, 1e-9])
    i, j, _ = profiles.touching(swollen, setup.width)
    apart = place[j, :3] - place[i, :3]  # i came before j
    apart[:, :2] -= setup.width * np.round(apart[:, :2] / setup.width)
    normal = apart / np.linalg.norm(apart, axis=1)[:, None]
    for n in np.flatnonzero(place[:, 2] - place[:, 3] > 1e-9):
        force, residue = nnls(normal[j == n].T, np.array([0.0, 0.0, 1.0]))
        assert residue < 1e-6, n
        assert (force > 0.0).sum() == 3, n


def test_a_bed_of_equal_seed_is_equal_to_the_byte_and_another_seed_gives_another() -> None:
    one, again, other = (deposition.drop_and_roll(replace(PAIR, seed=seed)) for seed in (1, 1, 2))
    assert one[0].tobytes() == again[0].tobytes()
    assert np.array_equal(one[1], again[1])
    assert one[0].tobytes() != other[0].tobytes()


def test_the_order_of_the_cells_changes_no_byte() -> None:
    _, species = deposition.drop_and_roll(PAIR)
    radius, beds = 0.5 * PAIR.diameter[species], []
    for sizes, height in ((species, PAIR.cloud_height), (np.zeros_like(species), 2.0), (1 - species, 30.0)):
        cells = empty_cells(radius, sizes, PAIR.width, height)
        place, placed, _ = deposition.pile(radius, cells, np.random.Generator(np.random.PCG64(5)))
        assert placed == species.size
        beds.append(place.tobytes())
    assert beds[0] == beds[1] == beds[2]


def test_equal_spheres_pack_as_visscher_and_bolsterli_found() -> None:
    large = replace(EQUAL, count=np.array([30_000]), width=22.0)
    assert packing_density(large) == pytest.approx(0.582, abs=0.002)


def test_equal_spheres_have_six_contacts_as_each_rests_on_three() -> None:
    place, _ = deposition.drop_and_roll(EQUAL)
    i, j, _ = profiles.touching(place + np.array([0.0, 0.0, 0.0, 1e-9]), EQUAL.width)
    count = np.bincount(np.concatenate([i, j]), minlength=len(place))
    low, high = measures.slab(place)
    assert count[(place[:, 2] > low) & (place[:, 2] < high)].mean() == pytest.approx(6.0, abs=0.05)


def test_fines_make_a_bed_denser() -> None:
    mixture = replace(PAIR, count=np.array([180, round(180 * 64 * 0.3 / 0.7)]))
    assert packing_density(mixture) > packing_density(EQUAL) + 0.05


def test_a_single_sphere_falls_to_the_floor_where_it_was_dropped() -> None:
    place, _ = deposition.drop_and_roll(replace(EQUAL, count=np.array([1])))
    x, y = np.random.Generator(np.random.PCG64(EQUAL.seed)).random(2) * EQUAL.width  # a permutation of one draws none
    assert place[0] == pytest.approx([x, y, 0.5, 0.5], abs=1e-12)


@pytest.mark.parametrize("r", [0.05, 0.3, 0.5])
def test_a_sphere_rolls_off_another_and_falls_from_its_equator(r: float) -> None:
    rests, p = settled(np.array([[3.9, 2.0, 0.5, 0.5]]), r, 4.0, 2.0, 6.0)
    assert rests
    assert p == pytest.approx([3.9 + 0.5 + r, 2.0, r], abs=1e-12)


def test_a_sphere_dropped_right_on_the_top_of_another_rolls_off_it() -> None:
    rests, p = settled(np.array([[2.0, 2.0, 0.5, 0.5]]), 0.1, 2.0, 2.0, 4.0)
    assert rests
    assert p[2] == pytest.approx(0.1)


@pytest.mark.parametrize("r", [0.5, 0.2])
def test_a_sphere_between_three_rests_as_the_tip_of_a_pyramid(r: float) -> None:
    angle = 2.0 * math.pi / 3.0 * np.arange(3) + 0.1
    far = 1.0 / math.sqrt(3.0)  # three spheres that touch each other, about the corner of the periodic box
    lying = np.column_stack([far * np.cos(angle) % 4.0, far * np.sin(angle) % 4.0, np.full((3, 2), 0.5)])
    for x, y in ((0.1, 3.9), (3.7, 0.2), (0.01, 0.05)):
        rests, p = settled(lying, r, x, y, 4.0)
        assert rests
        assert np.minimum(p[:2], 4.0 - p[:2]) == pytest.approx([0.0, 0.0], abs=1e-12)
        assert p[2] == pytest.approx(0.5 + math.sqrt((0.5 + r) ** 2 - far**2))


def test_ties_of_four_supports_are_no_trouble() -> None:
    x, y = (axis.ravel() + 0.5 for axis in np.meshgrid(np.arange(4.0), np.arange(4.0)))
    lying = np.column_stack([x, y, np.full((16, 2), 0.5)])
    rng = np.random.default_rng(1)
    for _ in range(200):
        rests, p = settled(lying, 0.5, *(4.0 * rng.random(2)), 4.0)
        assert rests
        assert np.round(p[:2]) == pytest.approx(p[:2], abs=1e-7)  # over the middle of four
        assert p[2] == pytest.approx(0.5 + math.sqrt(0.5), abs=1e-7)


def test_a_sphere_that_finds_no_rest_is_a_named_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(radius: np.ndarray, *_: object) -> tuple[np.ndarray, int, int]:
        return np.empty((radius.size, 4)), 7, deposition.REPEATS

    monkeypatch.setattr(deposition, "pile", nowhere)
    with pytest.raises(RunDiverged, match=r"sphere 8 of 1500 found no rest in 100 drops; take another seed"):
        deposition.drop_and_roll(EQUAL)


def test_a_cylinder_and_a_narrow_box_are_refused() -> None:
    with pytest.raises(ProtocolError, match="take the container 'periodic'"):
        deposition.drop_and_roll(replace(EQUAL, cylinder=True))
    with pytest.raises(ProtocolError, match=r"a box 3.9 wide is narrower than 4 .* take a wider one"):
        deposition.drop_and_roll(replace(EQUAL, width=3.9))
