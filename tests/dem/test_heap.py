"""A heap: its cylinder, the base that it lies on, what falls off, and its angle."""

import math
import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from pdlab.dem import bed, heap, integrator, measures, neighbors, simulation, walls
from pdlab.dem.bed import Setup, Stage, State

sys.path.insert(0, str(Path(__file__).parent))
import beds

ONE = np.ones(1)
SMALL = Setup(
    ONE, ONE, np.array([0.5]), np.array([700]), 7.0, 1, 0.5, cylinder=True, base_diameter=14.0, lift_height=8.0,
    lift_speed=0.5,
)  # fmt: skip
NO_WEIGHT = replace(SMALL, gravity=np.zeros(3), steps_per_collision=100.0, lift_speed=0.2)


def run(setup: Setup, chunk: int = 10**9) -> State:
    state = None
    while state is None or not state.rest:
        state = simulation.advance(setup, state, chunk)
    return state


def flank(setup: Setup, state: State) -> heap.Flank:
    assert setup.base_diameter is not None
    return heap.flank(state.place - 0.5 * setup.box * np.array([1.0, 1.0, 0.0, 0.0]), 0.5 * setup.base_diameter)


@pytest.fixture(scope="module")
def small() -> State:
    return run(SMALL)


def single(setup: Setup, off: float, z: float, velocity: tuple[float, float, float], stage: int = 1) -> State:
    """One sphere at a distance from the axis; its velocity outward, around and up."""
    place = np.array([[0.5 * setup.box + off, 0.5 * setup.box, z, 0.5]])
    state = replace(bed.rest_free(place, np.zeros(1, np.int64)), stage=stage)
    state.motion[0, :3] = velocity
    return state


def cone(angle: float, radius: float, seed: int) -> np.ndarray:
    """A dense lattice, turned at random, cut by a cone whose foot is a layer of one diameter at the base's edge."""
    rng = np.random.default_rng(seed)
    number = np.stack(np.meshgrid(*[np.arange(-40, 41)] * 3), axis=-1).reshape(-1, 3)
    cell = np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]]) / math.sqrt(2.0)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    centre = number @ cell @ turn + rng.random(3)
    off = np.hypot(centre[:, 0], centre[:, 1])
    top = 1.0 + (radius - off) * math.tan(math.radians(angle))
    inside = (off < radius) & (centre[:, 2] > 0.5) & (centre[:, 2] < top - 0.5)
    return np.column_stack([centre[inside], np.full(inside.sum(), 0.5)])


@pytest.mark.parametrize("angle", [15.0, 20.0, 25.0, 30.0, 35.0, 40.0])
def test_a_cone_filled_with_spheres_has_its_angle(angle: float) -> None:
    found = heap.flank(cone(angle, 13.0, 1), 13.0)
    assert found.angle == pytest.approx(angle, abs=1.0)
    assert found.angle == pytest.approx(angle, abs=4.0 * found.standard_error)
    assert found.top == pytest.approx(1.0 + 13.0 * math.tan(math.radians(angle)), abs=1.2)


def test_a_layer_has_no_slope_and_a_lopsided_heap_no_sharp_one() -> None:
    layer = heap.flank(cone(0.0, 13.0, 1) * np.array([1.0, 1.0, 0.0, 1.0]) + np.array([0.0, 0.0, 0.5, 0.0]), 13.0)
    assert layer.angle == pytest.approx(0.0, abs=0.5)
    even = cone(20.0, 13.0, 1)
    tilted = even[even[:, 2] < 3.5 + 0.2 * even[:, 0]]
    assert heap.flank(tilted, 13.0).standard_error > 3.0 * heap.flank(even, 13.0).standard_error


def test_the_surface_is_the_topmost_sphere_or_the_base() -> None:
    place = np.array([[0.0, 0.0, 0.5, 0.5], [0.3, 0.0, 1.2, 0.5], [-2.0, 1.0, 0.25, 0.25]])
    points, height = heap.surface(place, 3.0)
    at = {tuple(point): value for point, value in zip(np.round(points, 6).tolist(), height, strict=True)}
    assert at[0.0, 0.0] == pytest.approx(1.2 + math.sqrt(0.25 - 0.09))
    assert at[-0.4, 0.0] == pytest.approx(0.5 + math.sqrt(0.25 - 0.16))
    assert at[-2.0, 1.0] == pytest.approx(0.5)
    assert at[2.0, 2.0] == 0.0
    assert np.hypot(*points.T).max() <= 3.0


@dataclass(frozen=True)
class Sleeve(Setup):
    """A closed cylinder made of the thin wall that a heap's cylinder is made of."""

    def container(self, stage: Stage) -> walls.Container:
        return walls.Container(sleeve=self.wall_radius)


def test_the_cylinder_of_a_heap_at_rest_is_the_closed_cylinder() -> None:
    closed = replace(beds.setups()[2], cylinder=True)
    same = Sleeve(**vars(closed))
    assert beds.sha(simulation.advance(same, None, 4000)) == beds.sha(simulation.advance(closed, None, 4000))


def test_a_sphere_below_the_rim_passes_and_one_above_it_bounces() -> None:
    height = 1.1 / NO_WEIGHT.lift_speed / NO_WEIGHT.time_step  # steps until the rim is above the whole sphere
    for steps, passes in ((0, False), (round(height), True)):
        state = replace(single(NO_WEIGHT, 2.9, 0.5, (0.5, 0.0, 0.0)), steps=steps)
        after = simulation.march(NO_WEIGHT, state, round(2.0 / NO_WEIGHT.time_step))
        off = after.place[0, 0] - 0.5 * NO_WEIGHT.box
        assert (off > 3.8) == passes
        assert after.motion[0, 0] == pytest.approx(0.5 if passes else -0.25, rel=0.02)


def test_the_rim_pushes_away_from_its_edge() -> None:
    setup = replace(NO_WEIGHT, restitution=0.5)
    for stage, off, z, edge in ((2, 3.5 + 0.3, 8.0 - 0.395, (3.5, 8.0)), (2, 7.0 + 0.3, 1.0 + 0.395, (7.0, 1.0))):
        after = simulation.march(setup, single(setup, off, z, (0.0, 0.0, 0.0), stage), 1)
        away = np.array([off - edge[0], 0.0, z - edge[1]])
        np.testing.assert_allclose(after.load[0, :3] / np.linalg.norm(after.load[0, :3]), away / np.linalg.norm(away))


def test_a_rising_cylinder_drags_what_touches_it() -> None:
    state = single(NO_WEIGHT, 3.01, 20.0, (0.0, 0.0, 0.0))
    state.motion[0, 0] = 0.05
    after = simulation.march(NO_WEIGHT, state, 300)
    assert after.motion[0, 0] < 0.0  # it has bounced
    assert 0.0 < after.motion[0, 2] < NO_WEIGHT.lift_speed
    assert after.motion[0, 5] != 0.0


def test_the_lip_holds_a_layer_and_the_base_ends_at_its_edge() -> None:
    held = simulation.march(SMALL, single(SMALL, 6.4, 0.5, (0.3, 0.0, 0.0), 2), 2000)
    assert held.place[0, 0] - 0.5 * SMALL.box < 6.51
    over = simulation.march(SMALL, single(SMALL, 7.2, 1.6, (1.0, 0.0, 0.0), 2), 2000)
    assert over.place[0, 2] < -1.0
    assert bed.without_fallen(SMALL, over).species.size == 0


def test_only_what_has_fallen_is_taken_away_and_the_rest_keeps_its_springs() -> None:
    settled = simulation.advance(SMALL, None, 8000)
    state = replace(settled, place=settled.place - np.array([0.0, 0.0, 4.0, 0.0]))  # half of it below the base
    left = bed.without_fallen(SMALL, state)
    stays = state.place[:, 2] >= -1.0
    assert 100 < stays.sum() < 600
    for name in ("place", "motion", "species", "load", "origin"):
        np.testing.assert_array_equal(getattr(left, name), getattr(state, name)[stays])

    def springs(one: State, number: np.ndarray) -> dict[tuple[int, int], list[float]]:
        of_pair = one.pairs.spring.reshape(-1, 3, 8)
        return {
            (int(number[one.pairs.owner[k]]), int(number[one.pairs.neighbor[k]])): of_pair[k // 8, :, k % 8].tolist()
            for k in range(one.pairs.owner.size)
            if of_pair[k // 8, :, k % 8].any()
        }

    every = springs(state, np.arange(len(stays)))
    kept = {pair: spring for pair, spring in every.items() if stays[list(pair)].all()}
    assert 100 < len(kept) < len(every) - 100
    assert springs(left, np.flatnonzero(stays)) == kept
    i, j, delta = measures.contacts(SMALL, left)
    assert (i != j).all()
    assert delta.size > 100
    assert delta.max() < 0.01
    raised = replace(left, place=left.place + np.array([0.0, 0.0, 4.0, 0.0]))
    again = simulation.march(SMALL, raised, 1)  # the list is made anew
    pairs = {tuple(pair) for pair in np.stack([again.pairs.owner, again.pairs.neighbor], axis=1).tolist()}
    assert neighbors.all_pairs(again.origin, np.zeros(len(left.species)), SMALL.box) <= pairs


def test_a_heap_loses_spheres_at_its_edge_alone_and_reaches_no_image_of_itself() -> None:
    setup, state, count = SMALL, None, 700
    while state is None or not state.rest:
        state = simulation.advance(setup, state, 211)
        off = np.hypot(*(state.place[:, :2] - 0.5 * setup.box).T)
        assert off.max() < 0.5 * setup.box - 4.0
        assert state.species.size <= count
        count = state.species.size if state.stage else count
        if not state.stage:
            assert state.species.size == 700
    assert 0 < count < 700


@pytest.mark.parametrize("chunk", [777, 5000])
def test_chunks_change_no_byte_of_a_heap(small: State, chunk: int) -> None:
    parts = run(SMALL, chunk)
    assert beds.sha(parts) == beds.sha(small)
    assert (parts.steps, parts.species.size) == (small.steps, small.species.size)
    assert np.array_equal(parts.history, small.history)


@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one core")
def test_two_threads_change_no_byte_of_a_heap() -> None:
    setup = replace(SMALL, count=np.array([300]), lift_speed=2.0)
    alone, shared = (simulation.advance(setup, None, 12_000, threads) for threads in (1, 2))
    assert alone.species.size < 300
    assert beds.sha(alone) == beds.sha(shared)


def test_the_cylinder_is_lifted_without_local_damping_and_the_heap_rests_without_it() -> None:
    poured, lifted, resting = SMALL.stages
    assert (poured.damping, lifted.damping, resting.damping) == (0.7, 0.0, 0.0)
    assert lifted.lift * lifted.duration == pytest.approx(8.0)  # type: ignore[operator]
    assert (lifted.rim, resting.rim, resting.lift) == (0.0, 8.0, 0.0)


def test_the_cylinder_is_lifted_until_it_is_clear_of_all_spheres_and_no_farther(small: State) -> None:
    looks = small.history[:, 0]
    lifted = small.stage_began * SMALL.time_step
    assert (small.stage, looks[-1] > lifted) == (2, True)
    state, began = None, None
    while state is None or state.stage < 2:
        before, state = state, simulation.advance(SMALL, state, SMALL.check_steps)
        began = state.stage_began if state.stage == 1 else began
    assert before is not None
    assert state.stage_began == small.stage_began
    for one, clear in ((before, False), (state, True)):
        rim = SMALL.lift_speed * (one.steps - began) * SMALL.time_step
        assert (rim > (one.place[:, 2] + one.place[:, 3]).max()) == clear
    assert rim < SMALL.lift_height


def test_a_heap_gains_no_energy_once_the_cylinder_is_away() -> None:
    setup, state, energies = SMALL, None, []
    while state is None or not state.rest:
        state = simulation.advance(setup, state, 200)
        if state.stage == 2:
            weight = setup.mass[state.species]
            kinetic = integrator.kinetic_energy(state.motion, state.species, setup.body)
            energies.append(kinetic + float((weight * state.place[:, 2]).sum()))
    assert len(energies) > 5
    # what springs hold is weight times some overlap, 0.002 of a diameter
    assert np.diff(energies).max() < 1e-3 * float(setup.mass[0])


def test_more_friction_makes_a_steeper_heap() -> None:
    steep, flat = (flank(SMALL, run(replace(SMALL, friction=np.array([mu]), wall_friction=mu))) for mu in (0.5, 0.02))
    assert steep.angle - flat.angle > 3.0
    assert flat.foot > 0.5
