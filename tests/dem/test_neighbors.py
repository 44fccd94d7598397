"""The cell list finds what brute force finds."""

import numpy as np
import pytest
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


def listed(found: neighbors.PairList) -> list[tuple[int, int]]:
    count = int(found.total[0])
    return [(int(i), int(j)) for i, j in zip(found.owner[:count], found.neighbor[:count], strict=True)]


def make_list(
    place: np.ndarray, allowance: np.ndarray, sizes: np.ndarray, width: float, old: neighbors.PairList, springs: int = 1
) -> neighbors.PairList:
    classes = int(sizes.max()) + 1
    return neighbors.verlet_list(place, allowance, sizes, classes, sizes, classes, width, springs, old, None)  # type: ignore[no-any-return]


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
    found = listed(make_list(place, allowance, sizes, width, neighbors.no_pairs()))
    assert len(found) == len(set(found))
    assert set(found) == neighbors.all_pairs(place, allowance, width)


def test_a_list_made_in_parts_is_the_same() -> None:
    place, allowance, sizes = random_bed(3, 240, 4.0, 6.0, 5.0)
    alone = neighbors.all_found(place, allowance, sizes, int(sizes.max()) + 1, 6.0, 0, None)
    parted = neighbors.all_found(place, allowance, sizes, int(sizes.max()) + 1, 6.0, 0, 3)
    assert np.array_equal(alone, parted)


@pytest.mark.parametrize("springs", [1, 2])
def test_springs_of_touching_pairs_are_carried_into_a_new_list(springs: int) -> None:
    place, allowance, sizes = random_bed(1, 200, 3.0, 5.0, 8.0)
    old = make_list(place, allowance * 0.0, sizes, 5.0, neighbors.no_pairs(), springs)
    count, rng = int(old.total[0]), np.random.default_rng(2)
    of_pair = old.spring.reshape(springs, -1, 3, 8)
    for k in range(count):
        of_pair[:, k // 8, :, k % 8] = rng.random((springs, 3)) * (rng.random() < 0.7)
    new = make_list(place, allowance + 0.1, sizes, 5.0, old, springs)

    def springs_of(pairs: neighbors.PairList) -> dict[tuple[int, int], bytes]:
        held = pairs.spring.reshape(springs, -1, 3, 8)
        parts = {pair: held[:, k // 8, :, k % 8].copy() for k, pair in enumerate(listed(pairs))}
        return {pair: part.tobytes() for pair, part in parts.items() if part.any()}

    assert springs_of(old) == springs_of(new)
    assert 0 < len(springs_of(new)) < count < int(new.total[0])
    groups = {k // 8 for k, pair in enumerate(listed(new)) if pair in springs_of(new)}
    assert set(np.flatnonzero(new.touched)) == groups


def test_wrapping_brings_spheres_back_into_the_box() -> None:
    place = np.array([[-0.1, 5.0, 1.0, 0.5], [12.3, -7.0, 2.0, 0.5], [4.0, 4.0, 3.0, 0.5]])
    walls.wrap(place, 5.0)
    np.testing.assert_allclose(place[:, :2], [[4.9, 0.0], [2.3, 3.0], [4.0, 4.0]])
