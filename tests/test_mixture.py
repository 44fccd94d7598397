"""Proportions to specimens to a prediction with its errors."""

import math
from dataclasses import replace

import pytest
from conftest import formula_packing

from pdlab import mixture
from pdlab.errors import ProtocolError
from pdlab.mixture import Part
from pdlab.specimen import Packing

PARTS = [
    Part("coarse", 0.6, 40.0, 0.13, 0.600, 0.005, 0.001, "loose"),
    Part("fine", 0.4, 12.0, 0.22, 0.583, 0.004, 0.002, "unstated"),
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
    with pytest.raises(ProtocolError, match="tested loose and rodded"):
        mixture.next_specimens([PARTS[0], replace(PARTS[1], compaction="rodded")], [])
