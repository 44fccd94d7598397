"""What a bed at rest shows, and what is no packing."""

from dataclasses import replace

import numpy as np
import pytest

from pdlab import packing
from pdlab.dem.neighbors import no_pairs
from pdlab.errors import RunDiverged, Segregated, TooSoft
from pdlab.specimen import Component, Protocol, Species, Specimen, in_cylinder

MIXED = Specimen((Species(1.0, 0.3, 40), Species(0.5, 0.3, 320)), 4.0, 2)


@pytest.fixture(scope="module")
def bed() -> packing.State:
    return packing.advance(MIXED, None, 10**9)


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
    with pytest.raises(Segregated, match=r"off the mixture's shares by .* the mixture segregates"):
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
