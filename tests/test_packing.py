"""What a bed at rest shows, and what is no packing."""

from dataclasses import replace

import numpy as np
import pytest

from pdlab import packing
from pdlab.dem import measures
from pdlab.dem.contact import MU
from pdlab.dem.neighbors import no_pairs
from pdlab.errors import RunDiverged, Segregated, TooSoft
from pdlab.specimen import PLACED, REPOSE, Component, Protocol, Species, Specimen, heap_spheres, in_cylinder

HEAP = heap_spheres(0.3, 1, protocol=replace(REPOSE, base_diameter=14.0, lift_speed=0.5))
MIXED = Specimen((Species(1.0, 0.3, 40), Species(0.5, 0.3, 320)), 4.0, 2)


@pytest.fixture(scope="module")
def bed() -> packing.State:
    return packing.advance(MIXED, None, 10**9)


@pytest.fixture(scope="module")
def heaped() -> packing.State:
    return packing.advance(HEAP, None, 10**9)


def sunk(bed: packing.State, count: int) -> packing.State:
    """The bed without contacts, with so many coarse spheres moved from its middle to its floor."""
    low, high = packing.measures.slab(bed.place)
    place = bed.place.copy()
    inside = np.flatnonzero((place[:, 2] > low) & (place[:, 2] < high) & (place[:, 3] == 0.5))
    place[inside[:count], 2] = 0.5
    return replace(bed, place=place, pairs=no_pairs())


def test_a_bed_reports_its_density_contacts_height_and_shares(bed: packing.State) -> None:
    out = packing.measure(MIXED, bed, 1.0)
    assert 0.55 < out.packing_density < 0.70
    assert 4.0 < out.coordination_number < 6.5
    assert sum(out.slab_shares) == pytest.approx(1.0)
    solids = sum(kind.count * kind.diameter**3 for kind in MIXED.species) * np.pi / 6.0
    assert out.height * MIXED.width**2 * out.packing_density == pytest.approx(solids, rel=0.06)
    assert out.digest == MIXED.digest(packing.VERSION)


def test_a_middle_of_other_shares_is_refused(bed: packing.State) -> None:
    with pytest.raises(Segregated, match=r"mixture segregates: .* off the mixture's, more than 0\.05"):
        packing.measure(MIXED, sunk(bed, 8), 1.0)


def test_spheres_that_overlap_too_much_are_refused(bed: packing.State) -> None:
    one, other, _ = packing.measures.contacts(packing.setup(MIXED), bed)
    i, j = one[0], other[0]
    place = bed.place.copy()
    toward = place[j, :3] - place[i, :3]
    toward[:2] -= MIXED.width * np.round(toward[:2] / MIXED.width)
    place[i, :3] += 0.1 * toward
    with pytest.raises(TooSoft, match=r"overlap by .* more than the limit of 2%"):
        packing.measure(MIXED, replace(bed, place=place), 1.0)


def test_a_filled_cylinder_reports_what_lies_below_its_rim() -> None:
    specimen = in_cylinder([Component(1.0, 0.3, 1.0)], 5.0, 4.0, 1, Protocol(container="cylinder"))
    bed = packing.advance(specimen, None, 10**9)
    out = packing.measure(specimen, bed, 1.0)
    # the wall makes it looser than a periodic bed of these spheres, 0.578
    assert 0.45 < out.packing_density < 0.56
    volume = np.pi / 4.0 * 5.0**2 * 4.0
    whole = bed.place[bed.place[:, 2] + 0.5 < 4.0]
    cut = bed.place[np.abs(bed.place[:, 2] - 4.0) < 0.5]
    assert len(whole) * np.pi / 6.0 < out.packing_density * volume < (len(whole) + len(cut)) * np.pi / 6.0
    assert out.height == 4.0


def test_a_measure_that_is_not_filled_is_refused() -> None:
    specimen = in_cylinder([Component(1.0, 0.3, 1.0)], 5.0, 4.0, 1, Protocol(container="cylinder"))
    sparse = replace(specimen, species=(replace(specimen.species[0], count=80),))
    bed = packing.advance(sparse, None, 10**9)
    with pytest.raises(RunDiverged, match=r"stands .* largest diameters above the rim, less than 1.5"):
        packing.measure(sparse, bed, 1.0)


def test_a_heap_reports_its_angle_and_no_packing_density(heaped: packing.State) -> None:
    out = packing.measure(HEAP, heaped, 1.0)
    assert out.repose_angle_deg is not None
    assert 10.0 < out.repose_angle_deg < 25.0
    assert np.isnan(out.packing_density)
    # from the lip, a diameter high, the flank rises to the top
    assert out.height == pytest.approx(1.0 + 7.0 * np.tan(np.radians(out.repose_angle_deg)), abs=1.0)
    assert out.slab_shares == (1.0,)
    assert 3.5 < out.coordination_number < 6.0
    assert heaped.species.size < HEAP.spheres


def test_a_packing_has_no_angle_of_repose(bed: packing.State) -> None:
    assert packing.measure(MIXED, bed, 1.0).repose_angle_deg is None


def test_a_heap_that_does_not_cover_its_base_is_refused(heaped: packing.State) -> None:
    off = np.hypot(*(heaped.place[:, :2] - 0.5 * packing.setup(HEAP).box).T)
    place = np.where((off > 5.5)[:, None] & (np.arange(4) == 2), -5.0, heaped.place)
    with pytest.raises(RunDiverged, match=r"0.00 largest diameters high at the edge of its base, less than 0.5; pour"):
        packing.measure(HEAP, replace(heaped, place=place, pairs=no_pairs()), 1.0)


def test_a_heap_that_still_stands_in_its_cylinder_is_refused(heaped: packing.State) -> None:
    place = heaped.place.copy()
    place[0, :3] = 0.5 * packing.setup(HEAP).box, 0.5 * packing.setup(HEAP).box, 8.0
    with pytest.raises(RunDiverged, match=r"stands 8.5 largest diameters high, in the cylinder that was lifted by 8;"):
        packing.measure(HEAP, replace(heaped, place=place, pairs=no_pairs()), 1.0)


def test_a_lopsided_heap_is_said(heaped: packing.State) -> None:
    place = heaped.place.copy()
    place[:, 2] += 0.8 * np.maximum(place[:, 0] - 0.5 * packing.setup(HEAP).box - 2.0, 0.0)
    place[:, 2] = np.minimum(place[:, 2], 7.0)
    out = packing.measure(HEAP, replace(heaped, place=place, pairs=no_pairs()), 1.0)
    assert any("the heap is lopsided" in warning for warning in out.warnings)
    assert packing.measure(HEAP, heaped, 1.0).warnings == ()


def placed(test: str) -> tuple[Specimen, packing.State]:
    specimen = Specimen((Species(1.0, 0.0, 60), Species(0.5, 0.0, 480)), 5.0, 2, Protocol(test))
    return specimen, packing.advance(specimen, None, 1)


def test_every_test_by_geometry_alone_is_placed_at_once() -> None:
    assert set(packing.PLACING) == set(PLACED)
    for test in PLACED:
        specimen, bed = placed(test)
        assert (bed.rest, bed.steps, bed.species.size) == ("placed", 0, specimen.spheres)
        assert packing.advance(specimen, bed, 1) is bed
        assert packing.progress(specimen, bed).share == 1.0


def test_spheres_that_fell_and_rolled_have_six_contacts_less_those_with_the_floor() -> None:
    specimen, bed = placed("drop_and_roll")
    out = packing.measure(specimen, bed, 1.0)
    assert 5.0 < out.coordination_number < 6.0
    assert out.packing_density == measures.solid_fraction(bed.place, 25.0, *measures.slab(bed.place))
    assert abs(out.largest_overlap) < 1e-9
    assert (out.rest, out.steps) == ("placed", 0)


def test_spheres_put_at_random_are_looser_and_do_not_touch() -> None:
    random, rolled = (packing.measure(*placed(test), 1.0) for test in ("static", "drop_and_roll"))
    assert random.coordination_number == 0.0
    assert random.packing_density < rolled.packing_density - 0.05


def test_a_placed_bed_whose_fines_ran_through_its_pores_is_refused() -> None:
    specimen = Specimen((Species(1.0, 0.0, 120), Species(0.1, 0.0, 8000)), 4.0, 1, Protocol("drop_and_roll"))
    with pytest.raises(Segregated, match=r"mixture segregates: .* off the mixture's, more than 0\.05"):
        packing.measure(specimen, packing.advance(specimen, None, 1), 1.0)


def test_placed_spheres_that_overlap_are_refused() -> None:
    specimen, bed = placed("drop_and_roll")
    place = bed.place.copy()
    place[:, 3] *= 1.03
    with pytest.raises(RunDiverged, match=r"overlap by .* more than the limit of 2%, and none may; take another seed"):
        packing.measure(specimen, replace(bed, place=place), 1.0)


def test_the_friction_of_a_pair_that_a_protocol_names_is_the_one_that_acts() -> None:
    kinds = (Species(1.0, 0.2, 40), Species(0.5, 0.8, 320))
    acting = {}
    for rule in ("minimum", "mean", "geometric_mean"):
        setup = packing.setup(Specimen(kinds, 4.0, 2, Protocol(pair_friction=rule)))
        acting[rule] = float(setup.laws[0][0, 1, MU])
    assert acting == {"minimum": 0.2, "mean": 0.5, "geometric_mean": pytest.approx(0.4)}
