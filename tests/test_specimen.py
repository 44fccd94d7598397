"""What is to be run: planning, the grid, the canonical form and its hash."""

import json
import math
from dataclasses import replace

import pytest

from pdlab.errors import ProtocolError, ShareError, SpecimenTooLarge
from pdlab.specimen import (
    LOOSE,
    PLACED,
    REPOSE,
    RODDED,
    VIBRATED,
    Component,
    Protocol,
    Species,
    Specimen,
    components,
    equal_spheres,
    from_canonical,
    heap_spheres,
    in_cylinder,
    mixed_spheres,
    on_grid,
    protocol_of,
)


def test_equal_aggregates_of_any_size_are_one_specimen() -> None:
    small = mixed_spheres([Component(3.0, 0.30001, 1.0)], 1)
    large = mixed_spheres([Component(30.0, 0.29999, 1.0)], 1)
    assert small == large == equal_spheres(0.3, 1)
    assert small.digest(1) == large.digest(1)


def test_the_order_of_components_does_not_change_the_hash() -> None:
    parts = [Component(40.0, 0.1, 0.3), Component(10.0, 0.4, 0.7)]
    assert mixed_spheres(parts, 1).digest(1) == mixed_spheres(parts[::-1], 1).digest(1)


def test_seed_protocol_and_engine_version_change_the_hash() -> None:
    bed = equal_spheres(0.3, 1)
    others = [replace(bed, seed=2), equal_spheres(0.3, 1, Protocol(local_damping=0.0)), equal_spheres(0.3001, 1)]
    digests = [bed.digest(1), bed.digest(2), *(other.digest(1) for other in others)]
    assert len(set(digests)) == 5


def test_the_canonical_form_names_all_that_decides_a_run() -> None:
    content = json.loads(equal_spheres(0.3, 7).canonical(4))
    assert content["engine_version"] == 4
    assert content["seed"] == 7
    assert content["species"] == [{"diameter": 1.0, "friction": 0.3, "count": 2500, "density": 1.0, "rolling": 0.0}]
    assert content["protocol"]["wall_friction"] == 0.3
    assert content["width"] == 10.0


@pytest.mark.parametrize(("value", "grid"), [(0.123456, 0.1235), (0.0, 0.0), (12.3456, 12.35), (1.0, 1.0)])
def test_the_grid_has_four_significant_digits(value: float, grid: float) -> None:
    assert on_grid(value) == grid


@pytest.mark.parametrize("ratio", [1.2, 2.0, 3.5, 4.5])
@pytest.mark.parametrize("share", [0.15, 0.5, 0.85])
def test_a_mixture_meets_width_height_counts_and_shares(ratio: float, share: float) -> None:
    bed = mixed_spheres([Component(ratio, 0.2, share), Component(1.0, 0.4, 1.0 - share)], 1)
    solids = sum(kind.count * kind.diameter**3 for kind in bed.species) * 3.14159265 / 6.0
    assert bed.width >= 5.0
    assert solids / bed.width**2 / 0.74 >= 10.0
    assert min(kind.count for kind in bed.species) >= 150
    assert bed.spheres >= 2500
    assert bed.shares == pytest.approx((share, 1.0 - share), abs=0.004)


def test_too_many_spheres_are_refused_with_their_number() -> None:
    with pytest.raises(SpecimenTooLarge, match=r"takes [\d,]+ spheres, more than the cap of 200,000"):
        mixed_spheres([Component(30.0, 0.2, 0.5), Component(1.0, 0.2, 0.5)], 1)


def test_a_measure_is_planned_to_stand_full_beyond_its_rim() -> None:
    protocol = Protocol(container="cylinder")
    bed = in_cylinder([Component(20.0, 0.3, 1.0)], 228.0, 228.0, 1, protocol)
    assert (bed.width, bed.height) == (11.4, 11.4)
    solids = bed.spheres * math.pi / 6.0
    assert solids / (math.pi / 4.0 * bed.width**2) / 0.66 >= 11.4 + 1.5
    assert json.loads(bed.canonical(1))["height"] == 11.4


def test_a_measure_that_takes_too_many_spheres_or_is_too_narrow_is_refused() -> None:
    protocol = Protocol(container="cylinder")
    with pytest.raises(SpecimenTooLarge, match=r"takes [\d,]+ spheres, .* take a smaller measure"):
        in_cylinder([Component(1.0, 0.3, 1.0)], 228.0, 228.0, 1, protocol)
    with pytest.raises(ProtocolError, match=r"is 2.5 of the largest diameter wide"):
        in_cylinder([Component(20.0, 0.3, 1.0)], 50.0, 228.0, 1, protocol)


@pytest.mark.parametrize(("container", "height"), [("periodic", 10.0), ("cylinder", None)])
def test_a_cylinder_has_a_height_and_a_periodic_box_has_none(container: str, height: float | None) -> None:
    with pytest.raises(ProtocolError, match=r"correct one of them"):
        Specimen((Species(1.0, 0.3, 100),), 10.0, 1, Protocol(container=container), height)


def test_a_heap_is_planned_with_more_than_its_steepest_slope_takes() -> None:
    for base in (20.0, 26.0, 40.0):
        heap = heap_spheres(0.30001, 1, 0.1, protocol=replace(REPOSE, base_diameter=base))
        assert (heap.width, heap.height) == (0.5 * base, 0.5 * base + 1.0)  # 45 degrees over a lip of one diameter
        cone = math.pi * (0.5 * base) ** 2 * (1.0 + 0.5 * base / 3.0)
        assert heap.spheres * math.pi / 6.0 == pytest.approx(1.1 * 0.6 * cone, rel=1e-3)
        assert heap.species[0].friction == 0.3
        assert heap.species[0].rolling == 0.1


def test_a_heap_has_its_own_settings_and_its_own_walls() -> None:
    heap = heap_spheres(0.3, 1)
    others = [heap_spheres(0.3, 1, protocol=replace(REPOSE, **{name: value})) for name, value in
              (("base_diameter", 27.0), ("lip_height", 1.5), ("lift_speed", 0.1))]  # fmt: skip
    others += [heap_spheres(0.3, 1, wall_friction=0.2), heap_spheres(0.3, 2), heap_spheres(0.3, 1, 0.2)]
    assert len({one.digest(3) for one in [heap, *others]}) == 7
    assert heap_spheres(0.3, 1, wall_friction=0.3).digest(3) == heap.digest(3)  # the smallest present is the default
    assert from_canonical(heap.canonical(3)).digest(3) == heap.digest(3)
    settings = json.loads(equal_spheres(0.3, 1).canonical(3))["protocol"]
    assert not {"base_diameter", "lip_height", "lift_speed"} & settings.keys()


@pytest.mark.parametrize("test", PLACED)
def test_nothing_but_sizes_and_numbers_tells_two_placed_beds_apart(test: str) -> None:
    plain = Specimen((Species(1.0, 0.0, 60), Species(0.5, 0.0, 480)), 5.0, 1, Protocol(test))
    rough = Specimen(
        (Species(1.0, 0.4, 60, 0.9, 0.1), Species(0.5, 0.2, 480)), 5.0, 1,
        Protocol(test, local_damping=0.0, restitution=0.9, wall_friction=0.3, pair_friction="mean"),
    )  # fmt: skip
    assert rough.digest(3) == plain.digest(3)
    assert from_canonical(rough.canonical(3)) == plain
    others = [replace(plain, seed=2), replace(plain, width=6.0), replace(plain, protocol=LOOSE)]
    others += [replace(plain, species=plain.species[:1])]
    assert len({one.digest(3) for one in [plain, *others]}) == 5


def test_only_settings_of_its_own_compaction_tell_two_protocols_apart() -> None:
    assert equal_spheres(0.3, 1, Protocol(drops=3)).digest(1) == equal_spheres(0.3, 1).digest(1)
    assert equal_spheres(0.3, 1, Protocol("rodded", drops=3)).digest(1) != equal_spheres(0.3, 1, RODDED).digest(1)
    assert len({equal_spheres(0.3, 1, protocol).digest(1) for protocol in (LOOSE, RODDED, VIBRATED)}) == 3
    assert protocol_of("unstated") == LOOSE


def test_ten_sieve_classes_are_a_specimen_like_any_other() -> None:
    parts = [Component(1.2**-k, 0.3, 0.1) for k in range(10)]
    bed = mixed_spheres(parts, 1)
    assert len(bed.species) == 10
    assert bed.shares == pytest.approx([0.1] * 10, abs=0.001)
    assert min(kind.count for kind in bed.species) >= 150


def test_rolling_resistance_is_part_of_a_sphere() -> None:
    parts = [Component(2.0, 1.0, 0.5, rolling=0.1), Component(2.0, 1.0, 0.2, rolling=0.1), Component(2.0, 1.0, 0.3)]
    bed = mixed_spheres(parts, 1)
    assert [(kind.friction, kind.rolling) for kind in bed.species] == [(1.0, 0.1), (1.0, 0.0)]
    assert mixed_spheres([Component(3.0, 1.0, 1.0, rolling=0.2)], 1) == equal_spheres(1.0, 1, rolling=0.2)


def test_the_friction_of_a_pair_tells_beds_of_two_aggregates_apart_and_no_others() -> None:
    mean, usual = Protocol(pair_friction="mean"), Protocol()
    two = [Component(2.0, 0.1, 0.5), Component(1.0, 0.4, 0.5)]
    assert mixed_spheres(two, 1, mean).digest(1) != mixed_spheres(two, 1, usual).digest(1)
    assert from_canonical(mixed_spheres(two, 1, mean).canonical(1)).protocol.pair_friction == "mean"
    alike = [Component(2.0, 0.1, 0.5), Component(1.0, 0.1, 0.5)]
    assert mixed_spheres(alike, 1, mean).digest(1) == mixed_spheres(alike, 1, usual).digest(1)
    assert equal_spheres(0.3, 1, mean).digest(1) == equal_spheres(0.3, 1, usual).digest(1)


def test_a_class_of_a_graded_aggregate_needs_fewer_spheres_than_an_aggregate() -> None:
    sizes = ((1.0, 0.1), (0.5, 0.9))
    graded, alone = mixed_spheres(components(sizes, 0.3), 1), mixed_spheres(components(((1.0, 1.0),), 0.3), 1)
    assert 30 <= graded.species[0].count < 150
    assert alone == equal_spheres(0.3, 1)


def test_densities_count_only_above_twenty_percent() -> None:
    light = mixed_spheres([Component(2.0, 0.2, 0.5, 2600.0), Component(1.0, 0.3, 0.5, 2200.0)], 1)
    heavy = mixed_spheres([Component(2.0, 0.2, 0.5, 2600.0), Component(1.0, 0.3, 0.5, 5200.0)], 1)
    assert [kind.density for kind in light.species] == [1.0, 1.0]
    assert [kind.density for kind in heavy.species] == [1.0, 2.0]


@pytest.mark.parametrize("shares", [(0.5, 0.6), (0.5, 0.49), (1.2, -0.2), (1.0, 0.0)])
def test_shares_that_are_no_proportions_are_refused(shares: tuple[float, float]) -> None:
    with pytest.raises(ShareError, match=r"correct"):
        mixed_spheres([Component(2.0, 0.2, shares[0]), Component(1.0, 0.2, shares[1])], 1)


@pytest.mark.parametrize(
    "change",
    [
        {"compaction": "stamped"},
        {"container": "cube"},
        {"drops": 2000},
        {"local_damping": 1.0},
        {"restitution": 0.0},
        {"restitution": 0.3},
        {"pair_friction": "largest"},
        {"compaction": "repose"},
        {"compaction": "static", "container": "cylinder"},
        {"compaction": "repose", "container": "cylinder", "lip_height": 0.1},
        {"compaction": "repose", "container": "cylinder", "lift_speed": 0.0},
    ],
)
def test_a_protocol_outside_its_limits_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(ProtocolError):
        Protocol(**change)  # type: ignore[arg-type]
