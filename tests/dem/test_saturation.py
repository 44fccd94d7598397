"""Spheres put at random: no overlap, no place left, and the published saturation."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from pdlab.dem import measures, profiles, saturation
from pdlab.dem.bed import Setup
from pdlab.errors import ProtocolError

ONE = np.ones(1)
EQUAL = Setup(ONE, ONE, ONE, np.array([400]), 6.0, 1, 1.0)
PAIR = Setup(np.array([0.25, 1.0]), np.ones(2), np.ones(2), np.array([1200, 60]), 4.0, 1, 1.0)


def density(setup: Setup, place: np.ndarray) -> float:
    return measures.solid_fraction(place, setup.area, *measures.slab(place))


def full_box() -> tuple[Setup, np.ndarray, float]:
    """A box too low for its spheres, the places that it took, and its height."""
    setup = replace(EQUAL, count=np.array([6000]), width=12.0)
    height = 6000 * np.pi / 6.0 / setup.area / 0.42
    return setup, saturation.filled(setup, np.zeros(6000, np.int64), 0.42), height


@pytest.mark.parametrize("setup", [EQUAL, PAIR], ids=["equal", "ratio 4"])
def test_spheres_overlap_neither_each_other_nor_floor_nor_lid(setup: Setup) -> None:
    place, species = saturation.random_placement(setup)
    assert np.array_equal(np.bincount(species), setup.count)
    assert np.array_equal(place[:, 3], 0.5 * setup.diameter[species])
    assert (np.diff(place[:, 3]) <= 0.0).all()  # the largest first
    assert profiles.touching(place, setup.width)[2].size == 0
    assert (place[:, 2] >= place[:, 3]).all()


def test_equal_spheres_saturate_at_the_published_solid_fraction() -> None:
    setup, place, height = full_box()
    assert (place[:, 2] <= height - 0.5).all()
    assert density(setup, place) == pytest.approx(0.384, abs=0.004)  # 0.382 to 0.385 in the literature


def test_no_place_is_left_in_a_full_box() -> None:
    setup, place, height = full_box()
    point = np.random.default_rng(1).random((500_000, 3)) * [setup.width, setup.width, height - 1.0] + [0.0, 0.0, 0.5]
    tree = cKDTree(place[:, :3], boxsize=[setup.width, setup.width, 0.0])
    assert tree.query(point)[0].max() < 1.0


def test_places_are_uniform_as_those_of_plain_trials_are() -> None:
    """The second of two spheres lies anywhere but near the first: its distance has the trials' distribution."""
    setup = replace(EQUAL, count=np.array([2]), width=4.0)
    fraction = 2 * np.pi / 6.0 / setup.area / 2.0  # a box of height 2
    pairs = np.array([saturation.filled(replace(setup, seed=k), np.zeros(2, np.int64), fraction) for k in range(2000)])
    apart = pairs[:, 1, :3] - pairs[:, 0, :3]
    apart[:, :2] -= 4.0 * np.round(apart[:, :2] / 4.0)
    rng = np.random.default_rng(1)
    trial = (rng.random((100_000, 2, 3)) * [4.0, 4.0, 1.0]) @ np.eye(3)
    drawn = trial[:, 1] - trial[:, 0]
    drawn[:, :2] -= 4.0 * np.round(drawn[:, :2] / 4.0)
    expected = np.linalg.norm(drawn, axis=1)
    expected = expected[expected >= 1.0]
    for level in (0.1, 0.3, 0.5, 0.7, 0.9):
        below = (np.linalg.norm(apart, axis=1) < np.quantile(expected, level)).mean()
        assert below == pytest.approx(level, abs=4.0 * np.sqrt(level * (1.0 - level) / 2000))


def test_equal_seeds_give_equal_bytes_and_others_do_not() -> None:
    one, again, other = (saturation.random_placement(replace(PAIR, seed=seed))[0].tobytes() for seed in (1, 1, 2))
    assert one == again
    assert one != other


def test_fines_find_place_between_coarse_spheres() -> None:
    assert density(PAIR, saturation.random_placement(PAIR)[0]) > 0.45


@pytest.mark.parametrize("most", [0.02, 0.384, 0.62])
def test_the_box_is_the_lowest_but_for_a_thousandth(most: float, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[float] = []

    def filled(setup: Setup, species: np.ndarray, solid_fraction: float) -> np.ndarray:
        fits = min(1.0, most / solid_fraction)
        if fits == 1.0:
            taken.append(solid_fraction)
        return np.full((int(fits * species.size), 4), 0.5)

    monkeypatch.setattr(saturation, "filled", filled)
    place, _ = saturation.random_placement(EQUAL)
    assert len(place) == 400
    assert most * 0.999 <= taken[-1] <= most


def test_a_cylinder_is_refused() -> None:
    with pytest.raises(ProtocolError, match="take the container 'periodic'"):
        saturation.random_placement(replace(EQUAL, cylinder=True))
