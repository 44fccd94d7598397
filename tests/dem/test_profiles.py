"""Profiles, pair distribution and contacts of beds whose answer is known."""

import math

import numpy as np
import pytest

from pdlab.dem import measures, profiles, simulation
from pdlab.dem.bed import Setup
from pdlab.errors import InputError

BALL = 4.0 * math.pi / 3.0


def spheres(count: int, seed: int, size: tuple[float, float, float], radius: tuple[float, float]) -> np.ndarray:
    """Random spheres in a box, whatever their overlaps."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.random((count, 3)) * size, rng.uniform(*radius, count)])


def simple_cubic(along: int, up: int) -> np.ndarray:
    x, y, z = (axis.ravel() + 0.5 for axis in np.meshgrid(range(along), range(along), range(up), indexing="ij"))
    return np.column_stack([x, y, z, np.full(x.size, 0.5)])


def test_layers_of_a_lattice_have_its_cells_density_and_cut_spheres_that_of_caps() -> None:
    place = simple_cubic(3, 4)
    assert profiles.height_profile(place, 9.0, np.arange(5.0)) == pytest.approx(np.full(4, math.pi / 6.0))
    caps = profiles.height_profile(place, 9.0, np.array([0.0, 0.25, 0.75]))  # a cap of height h: π h² (3r - h)/3
    assert caps[0] == pytest.approx(math.pi * 0.25**2 * (1.5 - 0.25) / 3.0 / 0.25)
    assert caps[1] == pytest.approx((math.pi / 6.0 - 2.0 * math.pi * 0.25**2 * (1.5 - 0.25) / 3.0) / 0.5)


def test_the_height_profile_holds_all_solids() -> None:
    place = spheres(200, 1, (4.0, 4.0, 6.0), (0.1, 0.5))
    edges = np.linspace(-1.0, 7.0, 41)
    solids = (profiles.height_profile(place, 16.0, edges) * 16.0 * np.diff(edges)).sum()
    assert solids == pytest.approx(BALL * (place[:, 3] ** 3).sum(), rel=1e-12)


def test_a_cylinder_through_the_edge_of_a_sphere_cuts_vivianis_solid() -> None:
    sphere = np.array([[0.3, 0.4, 2.0, 1.0]])  # the axis halfway from its centre to its surface
    for low, high, part in ((-9.0, 9.0, 1.0), (2.0, 9.0, 0.5), (-9.0, 2.0, 0.5)):
        volume = profiles.solids_in_cylinder(sphere, 0.5, low, high)
        assert volume == pytest.approx([part * (2.0 * math.pi / 3.0 - 8.0 / 9.0)], rel=1e-9)


@pytest.mark.parametrize("rho", [0.0, 0.05, 0.5, 0.99, 1.0, 1.5])
def test_a_sphere_on_the_axis_is_cut_to_a_napkin_ring(rho: float) -> None:
    volume = profiles.solids_in_cylinder(np.array([[0.0, 0.0, 0.0, 1.0]]), rho, -2.0, 2.0)
    assert volume == pytest.approx([BALL * (1.0 - max(0.0, 1.0 - rho**2) ** 1.5)], abs=1e-9)


def test_a_sphere_off_the_axis_between_two_planes_has_the_volume_that_points_count() -> None:
    sphere, rho, low, high = np.array([[0.4, 0.0, 0.0, 0.7]]), 0.6, -0.1, 0.5
    point = np.random.default_rng(1).uniform(-0.7, 0.7, (1_000_000, 3)) + sphere[0, :3]
    inside = ((point - sphere[0, :3]) ** 2).sum(axis=1) < 0.49
    inside &= (np.hypot(point[:, 0], point[:, 1]) < rho) & (point[:, 2] > low) & (point[:, 2] < high)
    counted = inside.mean() * 1.4**3
    error = 1.4**3 * math.sqrt(inside.mean() / len(point))
    assert profiles.solids_in_cylinder(sphere, rho, low, high)[0] == pytest.approx(counted, abs=4.0 * error)


def test_a_cut_sphere_is_integrated_to_the_error_that_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    place = spheres(2000, 2, (3.0, 0.0, 2.0), (0.1, 1.5))
    coarse = [profiles.solids_in_cylinder(place, rho, 0.4, 1.5) for rho in (0.03, 0.7, 1.9)]
    monkeypatch.setattr(profiles, "NODES", 200)
    fine = [profiles.solids_in_cylinder(place, rho, 0.4, 1.5) for rho in (0.03, 0.7, 1.9)]
    assert np.abs((np.array(coarse) - fine) / (BALL * place[:, 3] ** 3)).max() < 1e-8


def test_rings_hold_all_solids_of_the_cylinder_and_none_beyond() -> None:
    place = spheres(300, 3, (8.0, 8.0, 5.0), (0.2, 0.5)) - [4.0, 4.0, 0.0, 0.0]
    within = np.hypot(place[:, 0], place[:, 1]) + place[:, 3] < 3.0
    edges = np.append(np.arange(0.0, 3.0, 0.17), 3.0)
    rings = math.pi * np.diff((3.0 - edges) ** 2) * -2.0
    whole = measures.solids_between(place[within], 1.0, 3.0).sum()
    assert (profiles.wall_profile(place[within], 3.0, 1.0, 3.0, edges) * rings).sum() == pytest.approx(whole, rel=1e-8)
    outside = np.hypot(place[:, 0], place[:, 1]) - place[:, 3] > 3.0
    assert not profiles.wall_profile(place[outside], 3.0, 1.0, 3.0, edges).any()


def test_a_layer_of_spheres_at_the_wall_is_densest_a_radius_from_it() -> None:
    turn = np.linspace(0.0, 2.0 * math.pi, 19)[:-1]  # 18 spheres of diameter 1 touch the wall from within
    place = np.column_stack([3.0 * np.cos(turn), 3.0 * np.sin(turn), np.full(18, 0.5), np.full(18, 0.5)])
    rings = profiles.wall_profile(place, 3.5, 0.0, 1.0, np.arange(0.0, 1.65, 0.1))
    assert np.argmax(rings) in (4, 5)
    assert rings[0] < 0.2
    assert rings.max() > 0.6
    assert rings[10:].max() < 1e-12


def test_random_points_have_a_pair_distribution_of_one_even_in_a_thin_slab() -> None:
    place = spheres(6000, 4, (10.0, 10.0, 6.0), (0.5, 0.5))
    edges = np.linspace(0.0, 5.0, 26)
    g = profiles.pair_distribution(place, 10.0, 2.0, 4.0, edges)
    shell = BALL * np.diff(edges**3)  # half the shell's volume lies inside, or less
    noise = 1.0 / np.sqrt(0.5 * 2000.0 * 10.0 * np.minimum(shell, 4.0 * math.pi * edges[1:] * 0.2))
    assert (np.abs(g - 1.0) < 5.0 * noise).all()
    assert np.abs(g[5:] - 1.0).max() < 0.04
    assert g[10:].mean() == pytest.approx(1.0, abs=0.005)


def test_a_cubic_lattice_has_its_pairs_at_the_roots_of_1_2_and_3() -> None:
    edges = np.linspace(0.5, 1.9, 57)
    place = simple_cubic(6, 8)
    g = profiles.pair_distribution(place, 6.0, 2.0, 6.0, edges)
    peaks = np.flatnonzero(g)
    assert [0.5 * (edges[k] + edges[k + 1]) for k in peaks] == pytest.approx([1.0, 2.0**0.5, 3.0**0.5], abs=0.026)
    moved = place + np.array([2.3, -1.7, 0.0, 0.0])
    assert profiles.pair_distribution(moved, 6.0, 2.0, 6.0, edges + 1e-4) == pytest.approx(
        profiles.pair_distribution(place, 6.0, 2.0, 6.0, edges + 1e-4), rel=1e-12
    )


def test_the_pairs_counted_are_those_of_brute_force() -> None:
    place, low, high = spheres(60, 5, (4.0, 4.0, 5.0), (0.5, 0.5)), 1.0, 4.0
    edges = np.array([0.0, 0.7, 1.3, 2.0])
    inside = place[(place[:, 2] >= low) & (place[:, 2] <= high), :3]
    apart = inside[:, None] - inside[None]
    apart[..., :2] -= 4.0 * np.round(apart[..., :2] / 4.0)
    distance = np.sqrt((apart**2).sum(axis=-1))[~np.eye(len(inside), dtype=bool)]
    pairs = np.histogram(distance, edges)[0]
    expected = []
    for centre in inside:  # the shells' parts in the slab, by the area of a sphere between two planes, 2π r h
        r = (np.arange(20_000) + 0.5) * 1e-4
        zone = np.minimum(high - centre[2], r) + np.minimum(centre[2] - low, r)
        expected.append(np.histogram(r, edges, weights=2.0 * math.pi * r * zone * 1e-4)[0])
    random = (len(inside) - 1) / (16.0 * 3.0) * np.sum(expected, axis=0)
    assert profiles.pair_distribution(place, 4.0, low, high, edges) == pytest.approx(pairs / random, rel=1e-6)


def test_fewer_than_two_spheres_have_no_pair_distribution() -> None:
    assert np.isnan(profiles.pair_distribution(simple_cubic(2, 1), 2.0, 5.0, 6.0, np.array([0.5, 1.0]))).all()


def brute_contacts(place: np.ndarray, width: float | None) -> dict[tuple[int, int], float]:
    apart = place[:, None, :3] - place[None, :, :3]
    if width is not None:
        apart[..., :2] -= width * np.round(apart[..., :2] / width)
    overlap = place[:, None, 3] + place[None, :, 3] - np.sqrt((apart**2).sum(axis=-1))
    return {(i, j): overlap[i, j] for i, j in zip(*np.nonzero(np.triu(overlap > 0.0, 1)), strict=True)}


@pytest.mark.parametrize("width", [5.0, None])
def test_contacts_are_those_of_brute_force_for_many_sizes_and_any_image(width: float | None) -> None:
    place = spheres(400, 6, (5.0, 5.0, 5.0), (0.5, 0.5))
    place[:, 3] = np.random.default_rng(7).choice([0.5, 0.31, 0.1], 400)
    moved = place + np.array([12.0, -7.0, 0.0, 0.0])
    i, j, overlap = profiles.touching(moved, width)
    found = dict(zip(zip(i.tolist(), j.tolist(), strict=True), overlap, strict=True))
    wanted = brute_contacts(place, width)
    assert list(found) == sorted(wanted)
    assert [found[pair] for pair in sorted(wanted)] == pytest.approx([wanted[pair] for pair in sorted(wanted)])


def test_spheres_that_just_touch_press_on_none() -> None:
    assert [len(part) for part in profiles.touching(simple_cubic(3, 3), 3.0)] == [0, 0, 0]


def test_spheres_within_a_gap_are_in_contact_and_those_beyond_it_are_not() -> None:
    place = np.array([[0.5, 1.0, 0.5, 0.5], [1.51, 1.0, 0.5, 0.5], [2.53, 1.0, 0.5, 0.5]])
    i, j, overlap = profiles.touching(place, 4.0, gap=0.015)
    assert (i.tolist(), j.tolist()) == ([0], [1])
    assert overlap == pytest.approx([-0.01])


def test_a_sphere_just_left_of_the_box_is_brought_into_it() -> None:
    place = np.array([[-1e-20, 4.0, 0.5, 0.5], [3.2, -0.5, 0.5, 0.5]])
    inside = profiles.into_box(place, 4.0)
    assert ((inside[:, :2] >= 0.0) & (inside[:, :2] < 4.0)).all()
    assert profiles.touching(place, 4.0)[2] == pytest.approx([1.0 - math.hypot(0.8, 0.5)])


def test_contacts_by_species_of_a_settled_bed_give_its_coordination_number() -> None:
    setup = Setup(np.array([1.0, 0.5]), np.ones(2), np.full(2, 0.3), np.array([40, 320]), 4.0, 1, 0.3)
    state = simulation.advance(setup, None, 10**9)
    i, j, overlap = profiles.touching(state.place, 4.0)
    *engine, engine_overlap = measures.contacts(setup, state)
    assert len(i) == len(engine_overlap) > 500
    assert overlap.sum() == pytest.approx(engine_overlap.sum())
    low, high = measures.slab(state.place)
    counted = (state.place[:, 2] >= low) & (state.place[:, 2] <= high)
    matrix = profiles.contacts_by_species(i, j, state.species, counted, 2)
    number = np.bincount(state.species[counted])
    mean = (matrix.sum(axis=1) * number).sum() / number.sum()
    assert mean == pytest.approx(measures.contacts_per_sphere(state.place, *engine, low, high))
    assert matrix[0, 1] > matrix[0, 0] > matrix[1, 0]  # a coarse sphere has many fine ones about it


def test_contacts_by_species_count_from_the_counted_sphere_to_any_other() -> None:
    i, j = np.array([0, 0, 1]), np.array([1, 2, 2])  # 0 and 1 of species 0, 2 of species 1, 3 a rattler of 1
    species, counted = np.array([0, 0, 1, 1]), np.array([True, False, True, True])
    matrix = profiles.contacts_by_species(i, j, species, counted, 3)
    assert matrix[:2] == pytest.approx(np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 0.0]]))
    assert np.isnan(matrix[2]).all()


def test_what_cannot_be_profiled_is_refused_with_value_and_limit() -> None:
    place = simple_cubic(4, 4)
    with pytest.raises(InputError, match=r"bin edges \[0.0, 1.0, 1.0\] do not rise"):
        profiles.height_profile(place, 16.0, np.array([0.0, 1.0, 1.0]))
    with pytest.raises(InputError, match=r"a distance of 2.5 from the wall .* axis, 2 away"):
        profiles.wall_profile(place, 2.0, 1.0, 3.0, np.array([0.0, 2.5]))
    with pytest.raises(InputError, match=r"a distance of -1 between centres is negative"):
        profiles.pair_distribution(place, 4.0, 1.0, 3.0, np.array([-1.0, 1.0]))
    with pytest.raises(InputError, match=r"a reach of 2.1 is more than half the periodic width of 4"):
        profiles.pair_distribution(place, 4.0, 1.0, 3.0, np.array([0.5, 2.1]))
    with pytest.raises(InputError, match=r"a reach of 1 is more than half the periodic width of 1.5"):
        profiles.touching(place, 1.5)
