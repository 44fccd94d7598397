"""A bed's way: its motion by so many steps, the stages of its test, its rest."""

import math
import threading
from dataclasses import dataclass, replace
from typing import Any

import numba
import numpy as np
from numba import prange

from pdlab.dem import contact, integrator, measures, neighbors, walls
from pdlab.dem.bed import Setup, Stage, State, in_order, pour, start, without_fallen
from pdlab.dem.jit import alone_and_shared, kernel
from pdlab.errors import InputError, NotAtRest, RunDiverged

CREEP_OVER, CREEP_PD, CREEP_ENERGY = 20.0, 2e-4, 1e-4
"""A bed that hardly rests is done when its PD moved by less over this time, at this energy."""
REST_ENERGY, REST_FORCE = 1e-6, 1e-3
PATIENCE = 40.0
"""Fall times of the whole cloud after which a bed that still moves is given up."""
SKIN, LOOKAHEAD = 0.025, 20.0
"""A list's allowance: a share of the smallest diameter, and so many steps at the present speed."""
SORT_EVERY = 4
"""Looks from one sorting of the spheres by place to the next: order in memory is lost while they fall."""

SETTLING = 10.0
"""Time in which a compacted bed settles, for the progress shown and nothing else."""

_one_at_a_time = threading.Lock()
"""Threads of one bed and those of another in the same process would end it."""


def advance(setup: Setup, state: State | None, steps: int, threads: int = 1) -> State:
    """Return the bed after at most ``steps`` more steps; fewer when it comes to rest before.

    ``state`` None begins with the cloud. ``threads`` share the work of each step, which pays from some
    10 000 spheres on and idle cores only. A pure function: neither threads nor how the steps are cut
    into calls change a byte of the result. Raises RunDiverged, NotAtRest, and InputError for more
    threads than this process may use.
    """
    options: Any = numba.config
    most = options.NUMBA_NUM_THREADS
    if not 1 <= threads <= most:
        raise InputError(f"{threads} threads lie outside [1, {most}], the cores of this process; choose fewer")
    state = start(setup) if state is None else state
    end, check = state.steps + steps, setup.check_steps
    while state.steps < end and not state.rest:
        over = stage_end(setup, state)
        state = march(setup, state, min(end, over, (state.steps // check + 1) * check) - state.steps, threads)
        if state.steps % check == 0:
            state = look(setup, without_fallen(setup, state))
            if state.steps % (SORT_EVERY * check) == 0:
                state = in_order(setup, state)
        if state.steps == stage_end(setup, state):
            state = next_stage(setup, state)
    return state


@dataclass(frozen=True)
class Progress:
    """How far a bed is: ``steps`` done, and a guess at the ``share`` of its time that lies behind it.

    ``kinetic_energy`` over the bed's weight times the largest diameter; ``out_of_balance``: mean resultant
    over the mean contact force, infinite while nothing touches.
    """

    steps: int
    share: float
    kinetic_energy: float
    out_of_balance: float


def progress(setup: Setup, state: State) -> Progress:
    """Return how far a bed is."""
    expected = [_expected(setup, stage) for stage in setup.stages]
    spent = (state.steps - state.stage_began) * setup.time_step
    inside = expected[state.stage] * spent / (spent + 0.2 * expected[state.stage])  # never quite done
    behind = sum(expected[: state.stage]) + min(spent, inside)
    return Progress(
        steps=state.steps,
        share=1.0 if state.rest else behind / sum(expected),
        kinetic_energy=_energy(setup, state),
        out_of_balance=_out_of_balance(setup, state),
    )


def _expected(setup: Setup, stage: Stage) -> float:
    """Return about how long a stage lasts: beds rest after some two fall times."""
    if stage.duration is not None:
        return stage.duration
    return 2.0 * setup.fall_time if stage.layer is not None else SETTLING


def stage_end(setup: Setup, state: State) -> int:
    """Return the step at which the present stage is over, beyond all steps where it lasts until rest."""
    duration = setup.stages[state.stage].duration
    return 2**62 if duration is None else state.stage_began + math.ceil(duration / setup.time_step)


def next_stage(setup: Setup, state: State) -> State:
    """Return the bed at the beginning of the next stage: poured on, or struck. Raises RunDiverged."""
    state = replace(state, stage=state.stage + 1, stage_began=state.steps, quiet_looks=0, rest="")
    stage = setup.stages[state.stage]
    if stage.layer is not None:
        state = pour(setup, state, stage.layer)
    if stage.kick:
        motion = state.motion.copy()
        motion[:, :3] += stage.kick * setup.gravity
        state = replace(state, motion=motion)
    return state


def march(setup: Setup, state: State, steps: int, threads: int = 1) -> State:
    """Return the bed ``steps`` steps later, without a look whether it rests. Raises RunDiverged."""
    stage = setup.stages[state.stage]
    if threads == 1:
        out = _call(setup, stage, state, steps, None)
    else:
        with _one_at_a_time:
            numba.set_num_threads(threads)
            out = _call(setup, stage, state, steps, threads)
    place, motion, load, origin, pairs, near, stale, lost = out
    if lost >= 0:
        raise RunDiverged(
            f"sphere {lost} left the container or lost its number near step {state.steps + steps}; "
            f"raise steps per collision above {setup.steps_per_collision:g}",
            state,
        )
    return replace(
        state, place=place, motion=motion, load=load, origin=origin, pairs=pairs, near=near, stale=bool(stale),
        steps=state.steps + steps,
    )  # fmt: skip


def _call(setup: Setup, stage: Stage, state: State, steps: int, threads: int | None) -> tuple:  # type: ignore[type-arg]
    classes = neighbors.size_classes(0.5 * setup.diameter)
    between, at_walls = setup.laws
    kinds = setup.diameter.size
    law = np.zeros((kinds * kinds + 1, 4))  # the last row, of no stiffness, fills a list's last group up
    law[:-1] = between.reshape(-1, 4)
    pairs, near = state.pairs, state.near
    return tuple(
        _march(
            steps, setup.time_step, stage.gravity * setup.gravity, stage.swing, stage.frequency * setup.time_step,
            state.steps - state.stage_began, stage.damping,
            stage.damping if setup.moment_damping else 0.0, setup.box, setup.container(stage), stage.rim, law, at_walls,
            setup.body, state.species, kinds, classes[state.species], int(classes.max()) + 1,
            SKIN * float(setup.diameter.min()), setup.parts, state.place, state.motion, state.load, state.origin,
            pairs._replace(spring=pairs.spring.copy(), touched=pairs.touched.copy()),
            near._replace(spring=near.spring.copy()), state.stale,
            None if setup.rolling is None else True, threads,
        )
    )  # fmt: skip


@kernel
def _march(  # type: ignore[no-untyped-def]
    steps, dt, gravity, swing, turn, begun, alpha, beta, width, container, rim, law, wall_law, body, species, kinds,
    sizes, classes, skin, parts, place, motion, load, origin, pairs, near, stale, rolling, threads,
):  # fmt: skip
    """Run the time loop; return what changed, whether the list is stale, and a lost sphere or -1.

    ``swing``, ``turn``, ``begun``: gravity's factor is 1 + swing sin(turn (begun + k)) at step k. ``container``:
    a ``walls.Container``, whose sleeve's rim was at the height ``rim`` at step -begun.
    ``alpha``, ``beta``: local damping of forces and of moments. ``rolling``: None where nothing resists
    rolling. ``parts``: of the bed; those and the borders between them may be worked on at once.
    ``threads``: None, or how many do.
    """
    n, springs = place.shape[0], 1 if rolling is None else 2
    place, motion, load, origin = place.copy(), motion.copy(), load.copy(), origin.copy()
    flat_place, flat_motion, flat_load, flat_origin, flat_law = (
        place.reshape(-1), motion.reshape(-1), load.reshape(-1), origin.reshape(-1), law.reshape(-1),
    )  # fmt: skip
    late = np.zeros(parts, np.bool_)
    for step in range(steps):
        edge = rim + container.speed * dt * (begun + step)
        if stale:
            lost = lost_sphere(place, width, container)
            if lost >= 0:
                return place, motion, load, origin, pairs, near, stale, lost
            walls.wrap(place, width)
            allowance = np.empty(n)
            for i in range(n):
                speed = math.sqrt(motion[i, 0] ** 2 + motion[i, 1] ** 2 + motion[i, 2] ** 2)
                allowance[i] = min(skin + LOOKAHEAD * dt * speed, 0.5 * place[i, 3] + skin)
                origin[i] = place[i]
                origin[i, 3] -= allowance[i]
            pairs = neighbors.verlet_list(
                place, allowance, species, kinds, sizes, classes, width, parts, springs, pairs, threads
            )
            near = walls.wall_list(place, allowance, width, container, edge, near)
        factor = 1.0 + swing * math.sin(turn * (begun + step))
        gx, gy, gz = factor * gravity[0], factor * gravity[1], factor * gravity[2]
        if threads is None:
            step_alone(
                parts, flat_place, flat_motion, species, body, flat_law, wall_law, width, container, edge, pairs, near,
                rolling, gx, gy, gz, alpha, beta, dt, flat_origin, flat_load, late,
            )  # fmt: skip
        else:
            step_shared(
                parts, flat_place, flat_motion, species, body, flat_law, wall_law, width, container, edge, pairs, near,
                rolling, gx, gy, gz, alpha, beta, dt, flat_origin, flat_load, late,
            )  # fmt: skip
        stale = late.any()
    return place, motion, load, origin, pairs, near, stale, -1


def _one_step(  # type: ignore[no-untyped-def]
    parts, place, motion, species, body, law, wall_law, width, container, edge, pairs, near, rolling,
    gx, gy, gz, alpha, beta, dt, origin, load, late,
):  # fmt: skip
    """Take one step; ``late`` (parts,): whose spheres went farther than the list allows. Arrays flat.

    Parts share no sphere, nor do the borders of one chapter; what is left comes last. So the order in which
    a sphere's loads are added up does not depend on who works on what.
    """
    n = species.size
    for part in prange(parts):
        integrator.wall_loads(
            n * part // parts, n * (part + 1) // parts, place, motion, species, wall_law, near, width, container, edge,
            dt, load,
        )  # fmt: skip
        contact.add_pair_loads(
            pairs.begin[part], pairs.begin[part + 1], place, motion, law, width, pairs, rolling, dt, load
        )
    for border in prange(parts, parts + parts // 2):
        contact.add_pair_loads(
            pairs.begin[border], pairs.begin[border + 1], place, motion, law, width, pairs, rolling, dt, load
        )
    for border in prange(parts + parts // 2, 2 * parts):
        contact.add_pair_loads(
            pairs.begin[border], pairs.begin[border + 1], place, motion, law, width, pairs, rolling, dt, load
        )
    contact.add_pair_loads(
        pairs.begin[2 * parts], pairs.begin[2 * parts + 1], place, motion, law, width, pairs, rolling, dt, load
    )
    for part in prange(parts):
        late[part] = integrator.move(
            n * part // parts, n * (part + 1) // parts, place, motion, species, body, load, gx, gy, gz, alpha, beta,
            dt, origin,
        )  # fmt: skip


step_alone, step_shared = alone_and_shared(_one_step)
"""The same step on one thread and on several."""


@kernel
def lost_sphere(place, width, container):  # type: ignore[no-untyped-def]
    """Return a sphere that is no number, or whose centre lies outside the container, or -1.

    What has fallen off the floor's edge is not lost.
    """
    for i in range(place.shape[0]):
        x, y, z, r = place[i, 0] - 0.5 * width, place[i, 1] - 0.5 * width, place[i, 2], place[i, 3]
        off = math.sqrt(x * x + y * y)
        above = z > -r or off > container.base
        if not (above and abs(z) < 1e6 and abs(x) < 1e6 and abs(y) < 1e6 and off < container.side + r):
            return i
    return -1


def look(setup: Setup, state: State) -> State:
    """Return the state with this look's verdict on its rest. Raises NotAtRest.

    Still: twice in a row, not before the fall time, hardly any kinetic energy and forces in balance.
    Creeping: the middle's PD, of a heap its centre of mass, moved by less than 2e-4 over 20 sqrt(d/g) at little
    energy. A bed that rests before its test is over goes on to the next stage, a heap once its cylinder is clear of it.
    """
    stage, time = setup.stages[state.stage], state.steps * setup.time_step
    history = np.vstack([state.history, [time, _watched(setup, state)]])
    if stage.duration is not None:
        state = replace(state, history=history)
        return next_stage(setup, state) if _is_clear(setup, state) else state
    energy = _energy(setup, state)
    spent = (state.steps - state.stage_began) * setup.time_step
    fallen = setup.fall_time if stage.layer is not None else 0.0
    quiet = state.quiet_looks + 1 if spent >= fallen and _calm(setup, state, energy) else 0
    before = history[history[:, 0] <= time - CREEP_OVER + 1e-9]
    creeping = (
        spent >= fallen + CREEP_OVER
        and float(np.ptp(history[len(before) - 1 :, 1])) < CREEP_PD
        and energy < CREEP_ENERGY
    )
    rest = "still" if quiet >= 2 else "creeping" if creeping else ""
    state = replace(state, history=history, quiet_looks=quiet)
    if rest:
        last = state.stage == len(setup.stages) - 1
        return replace(state, rest=rest) if last else next_stage(setup, state)
    patience = PATIENCE * setup.fall_time * math.sqrt(setup.layers)
    if spent > patience:
        raise NotAtRest(
            f"the bed still moves after {spent:.0f} sqrt(d/g), more than {PATIENCE:g} fall times, with a "
            f"kinetic energy of {energy:.1e} of weight times diameter; raise the steps per collision above "
            f"{setup.steps_per_collision:g}, the local damping above {setup.local_damping:g} or the friction",
            state,
        )
    return state


def _watched(setup: Setup, state: State) -> float:
    """Return what a bed that creeps does not change: the middle's PD; of a heap, how high its solids lie."""
    middle = measures.slab(state.place)
    if setup.base_diameter is not None:
        return 2.0 / 3.0 * middle[1]
    return measures.solid_fraction(state.place, setup.area, *middle)


def _is_clear(setup: Setup, state: State) -> bool:
    """Return whether a heap's cylinder has been lifted above all spheres: how it goes on does not matter then."""
    rim = setup.stages[state.stage].lift * (state.steps - state.stage_began) * setup.time_step
    return rim > float((state.place[:, 2] + state.place[:, 3]).max())


def _calm(setup: Setup, state: State, energy: float) -> bool:
    """Return whether hardly anything moves and forces are in balance."""
    return energy < REST_ENERGY * float(setup.diameter.min()) and _out_of_balance(setup, state) < REST_FORCE


def _energy(setup: Setup, state: State) -> float:
    """Return the kinetic energy over the weight of all spheres times the largest diameter."""
    weight = float(setup.mass[state.species].sum())
    return float(integrator.kinetic_energy(state.motion, state.species, setup.body)) / weight


def _out_of_balance(setup: Setup, state: State) -> float:
    """Return the mean resultant over the mean contact force."""
    force = measures.mean_force(setup, state)
    resultant = integrator.mean_resultant(state.load, state.species, setup.body, setup.gravity)
    return resultant / force if force > 0.0 else math.inf
