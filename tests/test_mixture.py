"""Proportions to specimens to a prediction with its errors."""

import math
from dataclasses import replace

import pytest
from conftest import formula_packing

from pdlab import mixture
from pdlab.errors import ProtocolError
from pdlab.mixture import Part
from pdlab.specimen import EQUAL_SPHERES, LOOSE, RODDED, Packing

PARTS = [
    Part("coarse", 0.6, ((40.0, 1.0),), 0.13, 0.600, 0.005, 0.001),
    Part("fine", 0.4, ((12.0, 1.0),), 0.22, 0.583, 0.004, 0.002),
]


def packings(*values: float) -> list[Packing]:
    base = formula_packing(mixture.next_specimens(PARTS, [])[0])
    return [replace(base, packing_density=value) for value in values]


def test_seeds_are_added_until_the_standard_error_is_small() -> None:
    first = mixture.next_specimens(PARTS, [], seeds=4)
    assert [bed.seed for bed in first] == [1, 2, 3, 4]
    assert mixture.next_specimens(PARTS, packings(0.66, 0.661, 0.659, 0.66)) == []
    more = mixture.next_specimens(PARTS, packings(0.62, 0.70, 0.64, 0.66))
    assert [bed.seed for bed in more] == [5, 6]
    assert mixture.next_specimens(PARTS, packings(*([0.60, 0.70] * 8))) == []


def test_the_standard_error_holds_seeds_and_curves_and_the_input_error_the_measurements() -> None:
    result = mixture.predict(PARTS, packings(0.66, 0.664, 0.656, 0.66))
    assert result.packing_density == pytest.approx(0.66)
    weights = [0.6 * (0.66 / 0.6) ** 2, 0.4 * (0.66 / 0.583) ** 2]
    seeds = math.sqrt((0.004**2 * 2) / 3) / 2.0
    assert result.standard_error == pytest.approx(math.hypot(seeds, weights[0] * 0.001 + weights[1] * 0.002))
    assert result.input_error == pytest.approx(math.hypot(weights[0] * 0.005, weights[1] * 0.004))


def test_tests_of_different_compaction_do_not_mix() -> None:
    with pytest.raises(ProtocolError, match="newest density tests are loose and rodded"):
        mixture.next_specimens([PARTS[0], replace(PARTS[1], protocol=RODDED)], [])


def test_calibrations_under_different_settings_do_not_mix() -> None:
    undamped = replace(PARTS[1], protocol=replace(LOOSE, local_damping=0.0))
    with pytest.raises(ProtocolError, match=r"different protocols \(local_damping differ\)"):
        mixture.next_specimens([PARTS[0], undamped], [])


def test_parts_of_several_sizes_and_of_rolling_spheres_share_one_bed() -> None:
    graded = replace(PARTS[0], sizes=((40.0, 0.25), (20.0, 0.75)))
    rolling = replace(PARTS[1], friction=1.0, rolling=0.3)
    bed = mixture.next_specimens([graded, rolling], [])[0]
    assert [(kind.diameter, kind.friction, kind.rolling) for kind in bed.species] == [
        (1.0, 0.13, 0.0), (0.5, 0.13, 0.0), (0.3, 1.0, 0.3),
    ]  # fmt: skip
    assert bed.shares == pytest.approx((0.15, 0.45, 0.4), abs=0.005)


def test_a_bed_scatters_over_seeds_as_so_many_spheres_as_bear() -> None:
    alone = replace(PARTS[0], share=1.0)
    assert mixture.scatter([alone], mixture.next_specimens([alone], [])[0], 0.6) == pytest.approx(0.0028, rel=1e-3)

    def scatter(coarse: float) -> float:
        parts = [replace(PARTS[0], share=coarse), replace(PARTS[1], share=1.0 - coarse)]
        return mixture.scatter(parts, mixture.next_specimens(parts, [])[0], 0.65)

    assert 0.0018 < scatter(0.6) < 0.0021  # thousands of fine spheres
    coarse = 0.8 * (0.65 / 0.6) ** 2 * 0.00214 * math.sqrt(EQUAL_SPHERES / 287)  # the coarse spheres of its bed
    assert scatter(0.8) == pytest.approx(math.hypot(coarse, 0.0018), rel=0.01)
