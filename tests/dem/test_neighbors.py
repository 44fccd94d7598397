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


def listed(found: neighbors.PairList) -> dict[tuple[int, int], int]:
    """Pairs and their numbers in the list, without those that fill groups up."""
    real = np.flatnonzero(found.kind < 9)
    return {(int(found.owner[k]), int(found.neighbor[k])): int(k) for k in real}


def make_list(
    place: np.ndarray,
    allowance: np.ndarray,
    sizes: np.ndarray,
    width: float,
    old: neighbors.PairList,
    springs: int = 1,
    parts: int = 4,
) -> neighbors.PairList:
    classes = int(sizes.max()) + 1
    return neighbors.verlet_list(place, allowance, sizes, 3, sizes, classes, width, parts, springs, old, None)  # type: ignore[no-any-return]


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    count=st.integers(1, 250),
    ratio=st.floats(1.0, 12.0),
    width=st.floats(3.5, 12.0),
    height=st.floats(0.1, 20.0),
    parts=st.sampled_from([1, 2, 4, 10]),
)
def test_the_list_holds_each_pair_of_brute_force_once(
    seed: int, count: int, ratio: float, width: float, height: float, parts: int
) -> None:
    place, allowance, sizes = random_bed(seed, count, ratio, width, height)
    found = make_list(place, allowance, sizes, width, neighbors.no_pairs(), parts=parts)
    assert len(listed(found)) == (found.kind < 9).sum()
    assert set(listed(found)) == neighbors.all_pairs(place, allowance, width)


@pytest.mark.parametrize("parts", [1, 2, 4, 6])
def test_chapters_that_are_worked_on_at_once_share_no_sphere(parts: int) -> None:
    place, allowance, sizes = random_bed(5, 240, 2.0, 8.0, 3.0)
    order = np.argsort(place[:, 0])
    found = make_list(place[order], allowance[order] + 0.1, sizes[order], 8.0, neighbors.no_pairs(), parts=parts)
    ends = np.array([n * 240 // parts for n in range(parts + 1)])
    part = np.searchsorted(ends, np.arange(240), side="right") - 1
    spheres = [
        set(found.owner[8 * a : 8 * b]) | set(found.neighbor[8 * a : 8 * b])
        for a, b in zip(found.begin[:-1], found.begin[1:], strict=True)
    ]
    assert all((part[list(inside)] == p).all() for p, inside in enumerate(spheres[:parts]))
    for together in (spheres[parts : parts + parts // 2], spheres[parts + parts // 2 : 2 * parts]):
        assert sum(len(one) for one in together) == len(set().union(*together))
    borders = [set(part[list(inside)]) for inside in spheres[parts : 2 * parts]]
    assert all(len(between) == 2 for between in borders if between)
    if parts > 2:
        assert sum(len(between) for between in borders) == 2 * parts  # the box is periodic: as many borders as parts
    assert found.begin[-1] == found.touched.size == found.owner.size // 8


def test_a_list_made_in_parts_is_the_same() -> None:
    place, allowance, sizes = random_bed(3, 240, 4.0, 6.0, 5.0)
    alone = neighbors.all_found(place, allowance, sizes, int(sizes.max()) + 1, 6.0, 0, None)
    parted = neighbors.all_found(place, allowance, sizes, int(sizes.max()) + 1, 6.0, 0, 3)
    assert np.array_equal(alone, parted)


@pytest.mark.parametrize("springs", [1, 2])
def test_springs_of_touching_pairs_are_carried_into_a_new_list(springs: int) -> None:
    place, allowance, sizes = random_bed(1, 200, 3.0, 5.0, 8.0)
    old = make_list(place, allowance * 0.0, sizes, 5.0, neighbors.no_pairs(), springs)
    rng, of_pair = np.random.default_rng(2), old.spring.reshape(springs, -1, 3, 8)
    for k in listed(old).values():
        of_pair[:, k // 8, :, k % 8] = rng.random((springs, 3)) * (rng.random() < 0.7)
        old.touched[k // 8] |= of_pair[:, k // 8, :, k % 8].any()
    new = make_list(place, allowance + 0.1, sizes, 5.0, old, springs)

    def springs_of(pairs: neighbors.PairList) -> dict[tuple[int, int], bytes]:
        held = pairs.spring.reshape(springs, -1, 3, 8)
        parts = {pair: held[:, k // 8, :, k % 8].copy() for pair, k in listed(pairs).items()}
        return {pair: part.tobytes() for pair, part in parts.items() if part.any()}

    assert springs_of(old) == springs_of(new)
    assert 0 < len(springs_of(new)) < len(listed(old)) < len(listed(new))
    groups = {k // 8 for pair, k in listed(new).items() if pair in springs_of(new)}
    assert set(np.flatnonzero(new.touched)) == groups


def test_wrapping_brings_spheres_back_into_the_box() -> None:
    place = np.array([[-0.1, 5.0, 1.0, 0.5], [12.3, -7.0, 2.0, 0.5], [4.0, 4.0, 3.0, 0.5]])
    walls.wrap(place, 5.0)
    np.testing.assert_allclose(place[:, :2], [[4.9, 0.0], [2.3, 3.0], [4.0, 4.0]])
