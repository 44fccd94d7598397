"""A bed as a whole: reproducible, divisible, at rest, and honest when it fails."""

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pdlab import dem
from pdlab.dem import bed, measures, neighbors, simulation
from pdlab.dem.bed import Setup
from pdlab.errors import InputError, NotAtRest, RunDiverged

sys.path.insert(0, str(Path(__file__).parent))
import beds


def small(**changes: object) -> Setup:
    return replace(beds.setups()[0], **changes)  # type: ignore[arg-type]


def test_the_version_is_raised_when_the_bytes_of_a_bed_change() -> None:
    recorded, now = json.loads(beds.RECORD.read_text(encoding="utf-8")), beds.record()
    hint = "the engine's bytes changed: raise dem.VERSION and run python tests/dem/beds.py"
    assert recorded["version"] == dem.VERSION, "dem.VERSION changed: run python tests/dem/beds.py"
    assert np.allclose(recorded["coarse"], now["coarse"], rtol=1e-5), hint
    if recorded["fingerprint"] == now["fingerprint"]:  # another processor rounds in its own way
        assert recorded["exact"] == now["exact"], hint
        assert recorded["placed"] == now["placed"], hint


def test_two_processes_give_equal_bytes_for_an_equal_seed() -> None:
    code = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import beds; print(beds.record()['exact'])"
    printed = {
        subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
        for _ in range(2)
    }
    assert printed == {f"{beds.record()['exact']}\n"}


@pytest.mark.parametrize("chunk", [1, 137, 1000])
def test_chunks_change_no_byte(chunk: int) -> None:
    setup = beds.setups()[1]
    whole, parts = simulation.advance(setup, None, 1500), None
    while parts is None or parts.steps < 1500:
        parts = simulation.advance(setup, parts, min(chunk, 1500 - (parts.steps if parts else 0)))
    assert beds.sha(parts) == beds.sha(whole)
    assert np.array_equal(parts.history, whole.history)


def test_sorting_spheres_by_place_changes_their_order_and_nothing_else() -> None:
    setup = replace(beds.setups()[1], rolling=np.array([0.1, 0.3]), width=9.0)
    state = simulation.march(setup, bed.start(setup), 3000)
    assert (setup.parts, setup.columns) == (2, 2)
    ordered, order = bed.in_order(setup, state), bed.by_place(setup, state.place)
    assert not np.array_equal(order, np.arange(len(order)))
    for name in ("place", "motion", "species", "load", "origin"):
        np.testing.assert_array_equal(getattr(ordered, name), getattr(state, name)[order])
    assert np.array_equal(bed.by_place(setup, ordered.place), np.arange(len(order)))

    def strained(one: bed.State, number: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
        """Springs' forces and moments on the sphere of the smaller number in the first order."""
        out = {}
        springs = one.pairs.spring.reshape(2, -1, 3, 8)
        for k in np.flatnonzero(one.pairs.kind < 4):
            i, j = number[one.pairs.owner[k]], number[one.pairs.neighbor[k]]
            of_pair = springs[:, k // 8, :, k % 8]
            if of_pair.any():
                out[min(i, j), max(i, j)] = of_pair if i < j else -of_pair
        return out

    before, after = strained(state, np.arange(len(order))), strained(ordered, order)
    assert len(before) > 100
    assert before.keys() == after.keys()
    assert all(np.array_equal(before[pair], after[pair]) for pair in before)
    walls = [dict(zip(np.repeat(n, np.diff(one.near.first)), one.near.spring.tolist(), strict=True))
             for one, n in ((state, np.arange(len(order))), (ordered, order))]  # fmt: skip
    assert walls[0] == walls[1]
    # the same forces act after one step, but for the order in which they are added up
    one, other = (simulation.march(setup, each, 1) for each in (state, ordered))
    np.testing.assert_allclose(other.load, one.load[order], rtol=1e-9, atol=1e-6)


def test_another_seed_gives_another_bed() -> None:
    assert beds.sha(bed.start(small())) != beds.sha(bed.start(small(seed=2)))


@pytest.mark.parametrize("k", [0, 1, 2])
def test_a_cloud_has_its_fraction_and_no_overlap(k: int) -> None:
    setup = beds.setups()[k]
    place = bed.start(setup).place
    solids = float((4.0 / 3.0 * math.pi * place[:, 3] ** 3).sum())
    assert solids / setup.width**2 / setup.cloud_height == pytest.approx(0.25)
    assert neighbors.all_pairs(place, np.zeros(len(place)), setup.width) == set()
    assert (place[:, 2] >= place[:, 3]).all()
    assert (place[:, 2] <= setup.cloud_height - place[:, 3]).all()


def test_contacts_are_stiffer_in_proportion_to_the_size_ratio_beyond_one_and_a_half() -> None:
    pair = replace(small(), density=np.ones(2), friction=np.full(2, 0.3), count=np.array([10, 100]))
    weights = {}
    for ratio in (1.2, 1.5, 3.0, 6.0):
        setup = replace(pair, diameter=np.array([1.0, 1.0 / ratio]))
        weights[ratio] = setup.modulus * setup.nominal_overlap * setup.area / float((setup.count * setup.mass).sum())
    assert list(weights.values()) == pytest.approx([1.0, 1.0, 2.0, 4.0])


def test_a_cloud_without_room_is_a_named_error() -> None:
    with pytest.raises(RunDiverged, match=r"found no place .* choose a smaller cloud fraction"):
        bed.start(small(cloud_fraction=0.6))


@pytest.mark.parametrize("k", [0, 1])
def test_a_bed_comes_to_rest_with_small_overlaps_and_its_weight_on_the_floor(k: int) -> None:
    setup = beds.setups()[k]
    state = simulation.advance(setup, None, 200_000)
    assert state.rest
    assert state.steps * setup.time_step >= setup.fall_time
    assert 0.0 < measures.largest_overlap(state.place, *measures.contacts(setup, state)) < 0.01
    depth = np.maximum(state.place[:, 3] - state.place[:, 2], 0.0)
    push = float((setup.laws[1][state.species, 0] * depth).sum())
    assert push == pytest.approx(float((setup.count * setup.mass).sum()), rel=0.02)
    assert 0.5 < measures.solid_fraction(state.place, setup.area, *measures.slab(state.place)) < 0.7405


def test_a_bed_that_goes_on_moving_is_a_named_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(simulation, "PATIENCE", 0.2)
    with pytest.raises(NotAtRest, match="still moves after"):
        simulation.advance(small(), None, 100_000)


def test_a_number_lost_is_a_named_error_and_never_a_packing() -> None:
    setup = small()
    state = simulation.advance(setup, None, 100)
    state.motion[7, 1] = math.nan
    with pytest.raises(RunDiverged, match=r"sphere 7 left the container or lost its number"):
        simulation.advance(setup, state, 100)


def test_a_sphere_below_the_floor_is_a_named_error() -> None:
    setup = small()
    state = simulation.advance(setup, None, 100)
    state.motion[3, 2] = -1e5
    with pytest.raises(RunDiverged, match=r"sphere 3 left"):
        simulation.advance(setup, state, 100)


def test_the_solid_fraction_between_planes_cuts_spheres_exactly() -> None:
    place = np.array([[1.0, 1.0, 1.0, 0.5], [3.0, 3.0, 2.0, 0.5]])
    volume = math.pi / 6.0
    parts = measures.solids_between(place, 1.0, 2.25)
    cap = math.pi * 0.25**2 * (3 * 0.5 - 0.25) / 3.0  # above the upper plane
    np.testing.assert_allclose(parts, [volume / 2.0, volume - cap], rtol=1e-14)
    assert measures.solids_between(place, -5.0, 9.0).sum() == pytest.approx(2.0 * volume)


def test_contacts_per_sphere_of_a_row_of_three() -> None:
    setup = small(gravity=np.zeros(3))
    place = np.array([[0.5, 1.0, 1.0, 0.5], [1.499, 1.0, 1.0, 0.5], [2.498, 1.0, 1.0, 0.5]])
    state = simulation.march(setup, bed.rest_free(place, np.zeros(3, np.int64)), 1)
    i, j, delta = measures.contacts(setup, state)
    assert measures.contacts_per_sphere(state.place, i, j, 0.0, 2.0) == pytest.approx(4.0 / 3.0)
    assert measures.largest_overlap(state.place, i, j, delta) == pytest.approx(0.001, rel=0.1)


def test_contacts_are_counted_of_spheres_in_the_slab_only() -> None:
    setup = small(gravity=np.zeros(3))
    place = np.array([[1.0, 1.0, z, 0.5] for z in (1.0, 1.999, 2.998)])
    state = simulation.march(setup, bed.rest_free(place, np.zeros(3, np.int64)), 1)
    i, j, _ = measures.contacts(setup, state)
    assert measures.contacts_per_sphere(state.place, i, j, 2.5, 4.0) == 1.0
    assert measures.contacts_per_sphere(state.place, i, j, 1.5, 2.5) == 2.0


def test_a_still_bed_is_looked_at_twice_and_not_before_the_fall_time() -> None:
    setup = small(seed=2)
    calm = simulation.advance(setup, None, 200_000)
    moved = np.array([[0.0, 0.1]])  # the middle has moved since, so that the bed does not creep
    again = replace(calm, rest="", quiet_looks=0, history=moved)
    once = simulation.look(setup, again)
    assert (once.rest, once.quiet_looks) == ("", 1)
    assert simulation.look(setup, replace(once, history=moved)).rest == "still"
    early = simulation.look(setup, replace(again, steps=int(0.9 * setup.fall_time / setup.time_step)))
    assert early.quiet_looks == 0


def variants() -> dict[str, Setup]:
    plain, mixed, _ = beds.setups()
    return {
        "mixed": mixed,
        "four parts": replace(plain, width=26.0, count=np.array([1200])),
        "rolling in a cylinder": replace(mixed, cylinder=True, width=5.0, rolling=np.array([0.1, 0.3])),
        "rodded": replace(plain, layers=3, drops=2, drop_pause=0.3, count=np.array([100])),
        "vibrated": replace(plain, shake_periods=2, count=np.array([60])),
    }


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core")
@pytest.mark.parametrize("name", variants())
def test_two_threads_change_no_byte(name: str) -> None:
    setup = variants()[name]
    alone, shared = (simulation.advance(setup, None, 2500, threads) for threads in (1, 2))
    assert beds.sha(alone) == beds.sha(shared)
    assert np.array_equal(alone.load, shared.load)


@pytest.mark.parametrize("name", ["rodded", "vibrated"])
def test_chunks_change_no_byte_of_a_compacted_bed(name: str) -> None:
    setup, parts = variants()[name], None
    whole = simulation.advance(setup, None, 200_000)
    while parts is None or not parts.rest:
        parts = simulation.advance(setup, parts, 777)
    assert beds.sha(parts) == beds.sha(whole)
    assert (parts.steps, parts.stage) == (whole.steps, whole.stage)


def test_more_threads_than_cores_are_refused() -> None:
    with pytest.raises(InputError, match=r"9999 threads lie outside \[1, \d+\]"):
        simulation.advance(small(), None, 10, 9999)


def test_a_rodded_test_pours_its_layers_and_drops_after_each() -> None:
    setup = variants()["rodded"]
    kinds = ["pour" if stage.layer is not None else "fall" if not stage.gravity else "strike" for stage in setup.stages]
    assert kinds[:-1] == ["pour", "fall", "strike", "fall", "strike"] * 3
    assert setup.stages[-1].duration is None
    state = None
    spheres = set()
    while state is None or not state.rest:
        state = simulation.advance(setup, state, 500)
        spheres.add(state.species.size)
    assert spheres == {33, 66, 100}
    # free fall over half a diameter takes one sqrt(d/g) and ends at one sqrt(g d)
    assert setup.stages[1].duration == pytest.approx(1.0)
    assert setup.stages[2].kick == pytest.approx(1.0)


def test_local_damping_acts_while_spheres_settle_and_not_while_they_are_compacted() -> None:
    for setup in (variants()["rodded"], variants()["vibrated"]):
        assert {stage.damping for stage in setup.stages if stage.duration is None} == {0.7}
        assert {stage.damping for stage in setup.stages if stage.duration is not None} == {0.0}


def test_shaking_is_a_sine_of_the_stated_acceleration_and_amplitude() -> None:
    setup = variants()["vibrated"]
    shake = setup.stages[1]
    assert shake.swing == 3.0
    assert shake.swing / shake.frequency**2 == pytest.approx(0.1)
    assert shake.duration == pytest.approx(2 * 2.0 * math.pi / shake.frequency)
    # a free sphere feels it as gravity that swings
    state = replace(bed.rest_free(np.array([[2.0, 2.0, 50.0, 0.5]]), np.zeros(1, np.int64)), stage=1)
    quarter = round(0.25 * 2.0 * math.pi / shake.frequency / setup.time_step)
    after = simulation.march(setup, state, quarter)
    time = quarter * setup.time_step
    assert after.motion[0, 2] == pytest.approx(-time - 3.0 / shake.frequency, rel=2e-2)


def test_compaction_makes_beds_denser() -> None:
    loose = replace(beds.setups()[0], count=np.array([300]), width=5.0)
    density = []
    for setup in (loose, replace(loose, drops=10), replace(loose, shake_periods=20)):
        state = simulation.advance(setup, None, 10**6)
        density.append(measures.solid_fraction(state.place, setup.area, *measures.slab(state.place)))
    assert density[1] > density[0] + 0.01
    assert density[2] > density[0] + 0.01


def test_a_cylinder_keeps_its_spheres() -> None:
    setup = replace(small(), cylinder=True, width=5.0)
    cloud = bed.start(setup)
    state = simulation.advance(setup, None, 200_000)
    for place in (cloud.place, state.place):
        off = np.hypot(*(place[:, :2] - 0.5 * setup.box).T)
        assert (off + place[:, 3]).max() < 2.5 * 1.004
    assert state.rest


def test_a_dropped_container_strikes_its_spheres_and_layers_fall_from_other_places() -> None:
    setup = variants()["rodded"]
    before = replace(bed.start(setup), stage=1)  # in free fall
    struck = simulation.next_stage(setup, before)
    np.testing.assert_allclose(struck.motion[:, 2] - before.motion[:, 2], -1.0)
    poured = bed.pour(setup, before, 1)
    first, second = poured.place[:33], poured.place[33:66]
    assert not np.isin(second[:, 0], first[:, 0]).any()
    assert (second[:, 2] - 0.5).min() >= (first[:, 2] + 0.5).max()
