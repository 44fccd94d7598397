"""Sweeps over formula surfaces: few beds, the densest mix found, an error that holds, and what may go wrong."""

import functools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from surfaces import KINDS, Engine, Floats, Truth, shape

from pdlab.errors import EngineError, InputError, ProtocolError, Segregated, ShareError, SpecimenTooLarge, TooSoft
from pdlab.mixture import Part
from pdlab.plan import finish
from pdlab.specimen import RODDED
from pdlab.surface import share_grid
from pdlab.sweep import Measurement, Swept, sweeping

NUMBERS = range(5)


@functools.cache
def swept(kind: str, number: int, aggregates: int = 2, seed: int = 1) -> tuple[Swept, Engine, Truth]:
    parts, truth = shape(kind, number, aggregates)
    engine = Engine(parts, truth)
    return finish(sweeping(parts, seed=seed), engine), engine, truth


def at(truth: Truth, shares: Sequence[float]) -> float:
    return float(truth(np.array([shares]))[0])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("number", NUMBERS)
def test_at_most_12_beds_find_two_aggregates_densest_mix_within_0_003(kind: str, number: int) -> None:
    found, engine, truth = swept(kind, number)
    assert len(engine.asked) <= 12
    assert truth(found.shares).max() - at(truth, found.densest.shares) < 0.003


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("number", [0, 1])
def test_at_most_30_beds_find_three_aggregates_densest_mix_within_0_003(kind: str, number: int) -> None:
    found, engine, truth = swept(kind, number, 3)
    assert len(engine.asked) <= 30
    assert truth(found.shares).max() - at(truth, found.densest.shares) < 0.003


def test_stated_errors_and_intervals_hold_the_truth_as_often_as_they_say() -> None:
    found = [swept(kind, number) for kind in KINDS[:3] for number in range(12)]
    off = [
        (one.densest.packing_density - at(truth, one.densest.shares)) / one.densest.standard_error
        for one, _, truth in found
    ]
    assert 0.55 <= np.mean(np.abs(off) < 1.0) <= 0.85
    assert np.mean(np.abs(off) < 2.0) >= 0.9
    gains = [truth(one.shares).max() - at(truth, one.densest.shares) - one.densest.to_gain for one, _, truth in found]
    assert np.mean(np.array(gains) <= 1e-9) >= 0.9
    best = [one.shares[truth(one.shares).argmax()] for one, _, truth in found]
    inside = [one.densest.low[0] <= row[0] <= one.densest.high[0] for (one, *_), row in zip(found, best, strict=True)]
    assert np.mean(inside) >= 0.6


def test_the_curve_holds_the_truth_everywhere_as_often_as_it_says() -> None:
    off = np.concatenate(
        [
            (one.packing_density - truth(one.shares))[1:-1] / one.deviation[1:-1]
            for one, _, truth in (swept(kind, number) for kind in KINDS for number in NUMBERS)
        ]
    )
    assert np.mean(np.abs(off) < 2.0) >= 0.85


@pytest.mark.parametrize("kind", KINDS)
def test_another_seed_gives_the_same_within_its_error(kind: str) -> None:
    one, _, truth = swept(kind, 0)
    other, _, _ = swept(kind, 0, seed=2)
    error = math.hypot(one.densest.standard_error, other.densest.standard_error)
    assert abs(one.densest.packing_density - other.densest.packing_density) < 3.0 * error + 0.002
    assert abs(at(truth, one.densest.shares) - at(truth, other.densest.shares)) < 0.003
    assert {point.digest for point in one.points}.isdisjoint(point.digest for point in other.points)


def test_swapping_the_aggregates_mirrors_the_answer_and_asks_for_the_same_beds() -> None:
    parts, truth = shape("middle", 3, 3)
    turn = [2, 0, 1]
    engine, turned = Engine(parts, truth), Engine(parts, truth)
    one, other = finish(sweeping(parts), engine), finish(sweeping([parts[k] for k in turn]), turned)
    assert engine.asked == turned.asked
    assert other.aggregates == tuple(one.aggregates[k] for k in turn)
    assert other.densest.shares == tuple(one.densest.shares[k] for k in turn)
    assert one.next_test is not None
    assert other.next_test is not None
    assert other.next_test.shares == tuple(one.next_test.shares[k] for k in turn)
    values = {tuple(row): value for row, value in zip(one.shares.tolist(), one.packing_density, strict=True)}
    assert [values[row[1], row[2], row[0]] for row in other.shares.tolist()] == list(other.packing_density)


def test_a_sweep_asked_for_again_asks_for_the_same_beds() -> None:
    _, engine, _ = swept("middle", 1)
    _, again, _ = swept("middle", 1)
    assert [bed.digest(3) for bed in again.asked] == [bed.digest(3) for bed in engine.asked]


def test_a_smaller_wished_error_takes_more_beds_and_is_met_or_said_not_to_be() -> None:
    parts, truth = shape("middle", 2)
    few, many = Engine(parts, truth), Engine(parts, truth)
    rough = finish(sweeping(parts, 0.003), few)
    fine = finish(sweeping(parts, 0.0006, most_specimens=40), many)
    assert len(few.asked) < len(many.asked)
    assert rough.densest.standard_error <= 0.003
    assert fine.densest.standard_error <= 0.0006
    short = Engine(parts, truth)
    assert "after 4 beds" in finish(sweeping(parts, 0.0001, most_specimens=4), short).warnings[0]
    assert len(short.asked) == 4


def test_equal_aggregates_have_no_densest_mix_and_the_interval_says_so() -> None:
    part = Part("a", 1.0, ((10.0, 1.0),), 0.1, 0.6, 0.005)
    parts = [part, replace(part, aggregate="b", friction=0.11)]
    found = finish(sweeping(parts), Engine(parts, lambda shares: 0.6 + 0.0 * shares[:, 0]))
    assert found.densest.high[0] - found.densest.low[0] > 0.25
    assert found.densest.packing_density == pytest.approx(0.6, abs=0.003)


def test_errors_of_the_inputs_and_curves_are_carried_to_the_densest_mix() -> None:
    parts, truth = shape("middle", 0)
    exact = finish(sweeping(parts), Engine(parts, truth)).densest
    parts = [replace(parts[0], input_error=0.004, curve_error=0.002), replace(parts[1], input_error=0.003)]
    found = finish(sweeping(parts), Engine(parts, truth)).densest
    assert found.shares == exact.shares
    weight = [y * (found.packing_density / p.packing_density) ** 2 for y, p in zip(found.shares, parts, strict=True)]
    assert found.input_error == pytest.approx(math.hypot(weight[0] * 0.004, weight[1] * 0.003))
    assert found.standard_error == pytest.approx(math.hypot(exact.standard_error, weight[0] * 0.002))


def test_a_bed_that_fails_is_a_place_without_a_point_and_noted() -> None:
    parts, truth = shape("middle", 0)
    best = swept("middle", 0)[0].densest.shares[0]

    def fails(shares: Floats) -> EngineError | None:
        return Segregated("the mixture segregates") if best < shares[0] < best + 0.1 else None

    engine = Engine(parts, truth, fails=fails)
    found = finish(sweeping(parts), engine)
    assert any("no bed at shares" in text and "segregates" in text for text in found.warnings)
    assert len(found.points) < len(engine.asked) <= 12
    assert at(truth, found.densest.shares) > truth(found.shares).max() - 0.01


def test_where_every_bed_fails_the_reason_is_raised() -> None:
    parts, truth = shape("middle", 0)
    with pytest.raises(Segregated):
        finish(sweeping(parts), Engine(parts, truth, fails=lambda _: Segregated("the mixture segregates")))


def test_beds_that_are_too_soft_are_run_again_with_stiffer_contacts() -> None:
    parts, truth = shape("middle", 0)
    engine = Engine(parts, truth)

    def run(beds: Sequence[object]) -> list[object]:
        return [
            TooSoft("too soft") if bed.protocol.nominal_overlap > 0.0006 else packing
            for bed, packing in zip(beds, engine(beds), strict=True)
        ]

    found = finish(sweeping(parts), run)
    assert any("4 times as stiff" in text for text in found.warnings)
    assert not any("no bed" in text for text in found.warnings)
    assert {bed.protocol.nominal_overlap for bed in engine.asked} == {0.002, 0.001, 0.0005}
    assert len(engine.asked) <= 12


def test_proportions_that_need_too_many_spheres_are_left_out_and_counted() -> None:
    parts = [Part("a", 1.0, ((10.0, 1.0),), 0.1, 0.6), Part("b", 1.0, ((1.0, 1.0),), 0.2, 0.6)]
    engine = Engine(parts, lambda shares: 0.6 + 0.4 * shares[:, 0] * shares[:, 1])
    found = finish(sweeping(parts), engine)
    assert all(bed.spheres <= 200_000 for bed in engine.asked)
    assert any("of 101 proportions were left out" in text for text in found.warnings)
    tiny = replace(parts[1], sizes=((0.1, 1.0),))
    with pytest.raises(SpecimenTooLarge):
        finish(sweeping([parts[0], tiny]), engine)


def test_the_next_test_is_never_one_that_is_measured_and_lowers_the_error() -> None:
    parts, truth = shape("middle", 0)
    measured = list[Measurement]()
    for _ in range(4):
        found = finish(sweeping(parts, measured=measured), Engine(parts, truth))
        assert found.next_test is not None
        shares = found.next_test.shares
        others = [mix.shares for mix in measured] + [(1.0, 0.0), (0.0, 1.0)]
        assert min(abs(shares[0] - other[0]) for other in others) >= 0.02
        before, after = map(float, found.next_test.why.split(" from ")[1].split(" to "))
        assert after < before
        measured.append(Measurement(shares))
    first = finish(sweeping(parts), Engine(parts, truth))
    assert first.next_test is not None
    assert abs(first.next_test.shares[0] - first.densest.shares[0]) < 0.15


def test_only_what_is_measured_already_leaves_no_next_test() -> None:
    parts, truth = shape("middle", 0)
    everywhere = [Measurement((x, 1.0 - x)) for x in np.linspace(0.0, 1.0, 51)]
    assert finish(sweeping(parts, measured=everywhere), Engine(parts, truth)).next_test is None


def test_a_sweep_takes_two_to_five_aggregates_of_one_protocol_and_a_positive_error() -> None:
    parts, _ = shape("middle", 0)
    for wrong in (parts[:1], parts * 3):
        with pytest.raises(ShareError, match="2 to 5 aggregates"):
            next(sweeping(wrong))
    with pytest.raises(ProtocolError):
        next(sweeping([parts[0], replace(parts[1], protocol=RODDED)]))
    with pytest.raises(InputError, match="take both above 0"):
        next(sweeping(parts, 0.0))


@pytest.mark.parametrize(("aggregates", "places"), [(2, 101), (3, 861), (4, 1771), (5, 1001)])
def test_the_grid_holds_every_proportion_once(aggregates: int, places: int) -> None:
    shares = share_grid(aggregates)
    assert len(np.unique(shares, axis=0)) == len(shares) == places
    assert np.allclose(shares.sum(axis=1), 1.0)
    assert shares.min() == 0.0
    assert np.all(shares <= 1.0)


def test_four_and_five_aggregates_are_swept_too() -> None:
    for aggregates in (4, 5):
        parts, truth = shape("end", 0, aggregates)
        found = finish(sweeping(parts, 0.003, most_specimens=12), Engine(parts, truth))
        assert truth(found.shares).max() - at(truth, found.densest.shares) < 0.005
