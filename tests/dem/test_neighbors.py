"""The cell list finds what brute force finds."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pdlab.dem import neighbors, walls


def random_bed(seed: int, count: int, ratio: float, width: float, height: float) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    radii = 0.5 * np.array([1.0, 1.0 / np.sqrt(ratio), 1.0 / ratio])
    species = rng.integers(0, 3, count)
    place = np.column_stack([rng.uniform(0, width, (count, 2)), rng.uniform(0, height, count), radii[species]])
    allowance = rng.uniform(0.0, 0.3, count) * (rng.random(count) < 0.5)
    return place, allowance, neighbors.size_classes(radii)[species]


def pairs(first: np.ndarray, neighbor: np.ndarray) -> list[tuple[int, int]]:
    owner = np.repeat(np.arange(first.size - 1), np.diff(first))
    return [(min(int(i), int(j)), max(int(i), int(j))) for i, j in zip(owner, neighbor, strict=True)]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    count=st.integers(1, 250),
    ratio=st.floats(1.0, 12.0),
    width=st.floats(3.5, 12.0),
    height=st.floats(0.1, 20.0),
)
def test_the_list_holds_each_pair_of_brute_force_once(
    seed: int, count: int, ratio: float, width: float, height: float
) -> None:
    place, allowance, sizes = random_bed(seed, count, ratio, width, height)
    found = pairs(*neighbors.verlet_list(place, allowance, sizes, int(sizes.max()) + 1, width))
    assert len(found) == len(set(found))
    assert set(found) == neighbors.all_pairs(place, allowance, width)


def test_springs_of_touching_pairs_are_carried_into_a_new_list() -> None:
    place, allowance, sizes = random_bed(1, 200, 3.0, 5.0, 8.0)
    classes = int(sizes.max()) + 1
    old = neighbors.verlet_list(place, allowance * 0.0, sizes, classes, 5.0)
    rng = np.random.default_rng(2)
    touching = (rng.random(old[1].size) < 0.7).astype(np.uint8)
    spring = rng.random((old[1].size, 3)) * touching[:, None]
    new = neighbors.verlet_list(place, allowance + 0.1, sizes, classes, 5.0)
    carried, springs = neighbors.carry_springs(*old, touching, spring, *new)
    before = {pair: tuple(spring[k]) for k, pair in enumerate(pairs(*old)) if touching[k]}
    after = {pair: tuple(springs[k]) for k, pair in enumerate(pairs(*new)) if carried[k]}
    assert before == after
    assert not springs[carried == 0].any()


def test_wrapping_brings_spheres_back_into_the_box() -> None:
    place = np.array([[-0.1, 5.0, 1.0, 0.5], [12.3, -7.0, 2.0, 0.5], [4.0, 4.0, 3.0, 0.5]])
    walls.wrap(place, 5.0)
    np.testing.assert_allclose(place[:, :2], [[4.9, 0.0], [2.3, 3.0], [4.0, 4.0]])
