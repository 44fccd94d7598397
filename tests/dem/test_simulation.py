"""A bed as a whole: reproducible, divisible, at rest, and honest when it fails."""

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pdlab import dem
from pdlab.dem import neighbors, simulation
from pdlab.dem.simulation import Setup
from pdlab.errors import NotAtRest, RunDiverged

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


def test_another_seed_gives_another_bed() -> None:
    assert beds.sha(simulation.start(small())) != beds.sha(simulation.start(small(seed=2)))


@pytest.mark.parametrize("k", [0, 1, 2])
def test_a_cloud_has_its_fraction_and_no_overlap(k: int) -> None:
    setup = beds.setups()[k]
    place = simulation.start(setup).place
    solids = float((4.0 / 3.0 * math.pi * place[:, 3] ** 3).sum())
    assert solids / setup.width**2 / setup.cloud_height == pytest.approx(0.25)
    assert neighbors.all_pairs(place, np.zeros(len(place)), setup.width) == set()
    assert (place[:, 2] >= place[:, 3]).all()
    assert (place[:, 2] <= setup.cloud_height - place[:, 3]).all()


def test_a_cloud_without_room_is_a_named_error() -> None:
    with pytest.raises(RunDiverged, match=r"found no place .* choose a smaller cloud fraction"):
        simulation.start(small(cloud_fraction=0.6))


@pytest.mark.parametrize("k", [0, 1])
def test_a_bed_comes_to_rest_with_small_overlaps_and_its_weight_on_the_floor(k: int) -> None:
    setup = beds.setups()[k]
    state = simulation.advance(setup, None, 200_000)
    assert state.rest
    assert state.steps * setup.time_step >= setup.fall_time
    assert 0.0 < simulation.largest_overlap(setup, state) < 0.01
    depth = np.maximum(state.place[:, 3] - state.place[:, 2], 0.0)
    push = float((setup.laws[1][state.species, 0] * depth).sum())
    assert push == pytest.approx(float((setup.count * setup.mass).sum()), rel=0.02)
    assert 0.5 < simulation.solid_fraction(state.place, setup.width, *simulation.slab(state.place)) < 0.7405


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
    parts = simulation.solids_between(place, 1.0, 2.25)
    cap = math.pi * 0.25**2 * (3 * 0.5 - 0.25) / 3.0  # above the upper plane
    np.testing.assert_allclose(parts, [volume / 2.0, volume - cap], rtol=1e-14)
    assert simulation.solids_between(place, -5.0, 9.0).sum() == pytest.approx(2.0 * volume)


def test_contacts_per_sphere_of_a_row_of_three() -> None:
    setup = small(gravity=np.zeros(3))
    place = np.array([[0.5, 1.0, 1.0, 0.5], [1.499, 1.0, 1.0, 0.5], [2.498, 1.0, 1.0, 0.5]])
    state = simulation.march(setup, simulation.rest_free(place, np.zeros(3, np.int64)), 1)
    assert simulation.contacts_per_sphere(state, 0.0, 2.0) == pytest.approx(4.0 / 3.0)
    assert simulation.largest_overlap(setup, state) == pytest.approx(0.001, rel=0.1)


def test_contacts_are_counted_of_spheres_in_the_slab_only() -> None:
    setup = small(gravity=np.zeros(3))
    place = np.array([[1.0, 1.0, z, 0.5] for z in (1.0, 1.999, 2.998)])
    state = simulation.march(setup, simulation.rest_free(place, np.zeros(3, np.int64)), 1)
    assert simulation.contacts_per_sphere(state, 2.5, 4.0) == 1.0
    assert simulation.contacts_per_sphere(state, 1.5, 2.5) == 2.0


def test_a_still_bed_is_looked_at_twice_and_not_before_the_fall_time() -> None:
    setup = small()
    bed = simulation.advance(setup, None, 200_000)
    moved = np.array([[0.0, 0.1]])  # the middle has moved since, so that the bed does not creep
    again = replace(bed, rest="", quiet_looks=0, history=moved)
    once = simulation.look(setup, again)
    assert (once.rest, once.quiet_looks) == ("", 1)
    assert simulation.look(setup, replace(once, history=moved)).rest == "still"
    early = simulation.look(setup, replace(again, steps=int(0.9 * setup.fall_time / setup.time_step)))
    assert early.quiet_looks == 0
