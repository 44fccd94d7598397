"""A bed: its cloud, its motion by so many steps, its rest, and the packing density of its middle."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pdlab.dem import contact, insertion, integrator, neighbors, walls
from pdlab.dem.jit import kernel
from pdlab.errors import NotAtRest, RunDiverged

CHECK_EVERY = 0.5
"""Time between two looks whether the bed rests, in sqrt(d/g)."""
CREEP_OVER, CREEP_PD, CREEP_ENERGY = 20.0, 2e-4, 1e-4
"""A bed that hardly rests is done when its PD moved by less over this time, at this energy."""
REST_ENERGY, REST_FORCE = 1e-6, 1e-3
PATIENCE = 40.0
"""Fall times after which a bed that still moves is given up."""
MAX_OVERLAP = 0.02
SKIN, LOOKAHEAD = 0.04, 20.0
"""A list's allowance: a share of the smallest diameter, and so many steps at the present speed."""


@dataclass(frozen=True)
class Setup:
    """All that decides a bed, in reduced units (length d_max, density ρ, time sqrt(d_max/g)).

    ``diameter``, ``density``, ``friction``: shape (S,). ``count``: shape (S,), spheres of each species.
    ``width``: of the periodic box. ``local_damping``: PFC3D's α; ``moment_damping`` is not offered.
    ``nominal_overlap``: weight of all spheres on the floor over the contact modulus.
    """

    diameter: np.ndarray
    density: np.ndarray
    friction: np.ndarray
    count: np.ndarray
    width: float
    seed: int
    wall_friction: float
    restitution: float = 0.5
    local_damping: float = 0.7
    nominal_overlap: float = 0.002
    cloud_fraction: float = 0.25
    steps_per_collision: float = 10.0
    gravity: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, -1.0]))
    rotation_held: bool = False

    @cached_property
    def mass(self) -> np.ndarray:
        """Mass of one sphere of each species, shape (S,)."""
        return np.asarray(self.density * math.pi / 6.0 * self.diameter**3)

    @cached_property
    def body(self) -> np.ndarray:
        """Mass and inverse moment of inertia of each species, shape (S, 2)."""
        inertia = 0.1 * self.mass * self.diameter**2
        spin = np.zeros_like(inertia) if self.rotation_held else 1.0 / inertia
        return np.stack([self.mass, spin], axis=1)

    @cached_property
    def modulus(self) -> float:
        """Contact modulus E, force per area, at which the bed's weight gives the nominal overlap."""
        return float((self.count * self.mass).sum() / self.width**2 / self.nominal_overlap)

    @cached_property
    def zeta(self) -> float:
        """Damping ratio that gives the restitution."""
        return contact.damping_ratio(self.restitution)

    @cached_property
    def laws(self) -> tuple[np.ndarray, np.ndarray]:
        """Contact parameters between species (S, S, 5) and at the floor (S, 5)."""
        return contact.law_tables(self.diameter, self.mass, self.friction, self.wall_friction, self.modulus, self.zeta)

    @cached_property
    def time_step(self) -> float:
        """Time step in sqrt(d/g)."""
        return integrator.time_step(self.laws[0], self.mass, self.zeta, self.steps_per_collision)

    @cached_property
    def cloud_height(self) -> float:
        """Height in which the solids make the cloud's fraction."""
        solids = float((self.count * math.pi / 6.0 * self.diameter**3).sum())
        return solids / self.width**2 / self.cloud_fraction

    @cached_property
    def fall_time(self) -> float:
        """Time in which a sphere falls through the cloud's height, local damping included."""
        return math.sqrt(2.0 * self.cloud_height / (1.0 - self.local_damping))

    @cached_property
    def check_steps(self) -> int:
        """Steps from one look at the rest to the next."""
        return math.ceil(CHECK_EVERY / self.time_step)


@dataclass(frozen=True)
class State:
    """A bed at one step: all that the next step needs, so that chunks change no byte.

    Of N spheres: ``place`` (N, 4) x, y, z, radius; ``motion`` (N, 8) velocity, 0, angular velocity,
    0; ``species`` (N,); ``load`` (N, 8) force, 0, torque, 0 of the last step; ``floor_spring``
    (N, 3); ``origin`` (N, 3) and ``allowance`` (N,) of the list; of its P pairs ``first`` (N + 1,),
    ``neighbor`` (P,), ``touching`` (P,), ``spring`` (P, 3). ``history`` (K, 2): time and PD of the
    middle at each look. ``rest``: "" while it moves, else "still" or "creeping".
    """

    place: np.ndarray
    motion: np.ndarray
    species: np.ndarray
    load: np.ndarray
    floor_spring: np.ndarray
    origin: np.ndarray
    allowance: np.ndarray
    first: np.ndarray
    neighbor: np.ndarray
    touching: np.ndarray
    spring: np.ndarray
    steps: int = 0
    stale: bool = True
    mean_force: float = 0.0
    quiet_looks: int = 0
    history: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    rest: str = ""


def start(setup: Setup) -> State:
    """Return the cloud that a bed begins with: uniform, no overlap, at the cloud's solid fraction.

    Raises RunDiverged when a sphere finds no place.
    """
    order = np.argsort(-setup.diameter, kind="stable")
    species = np.repeat(order, setup.count[order]).astype(np.int64)
    radius = 0.5 * setup.diameter[species]
    rng = np.random.Generator(np.random.PCG64(setup.seed))
    place, found = insertion.cloud(radius, setup.width, setup.cloud_height, insertion.ATTEMPTS, rng)
    n = radius.size
    if found < n:
        raise RunDiverged(
            f"sphere {found + 1} of {n} found no place in {insertion.ATTEMPTS} attempts in a cloud of "
            f"solid fraction {setup.cloud_fraction:g}; choose a smaller cloud fraction"
        )
    # neighbours in space become neighbours in memory
    layer = np.lexsort((place[:, 0], np.floor(place[:, 1]), np.floor(place[:, 2])))
    return rest_free(place[layer], species[layer])


def rest_free(place: np.ndarray, species: np.ndarray) -> State:
    """Return the state of spheres at ``place`` (N, 4), of ``species`` (N,), that do not move yet."""
    n = place.shape[0]
    return State(
        place=np.ascontiguousarray(place, dtype=np.float64),
        motion=np.zeros((n, 8)),
        species=np.ascontiguousarray(species, dtype=np.int64),
        load=np.zeros((n, 8)),
        floor_spring=np.zeros((n, 3)),
        origin=place[:, :3].copy(),
        allowance=np.zeros(n),
        first=np.zeros(n + 1, np.int64),
        neighbor=np.zeros(0, np.int32),
        touching=np.zeros(0, np.uint8),
        spring=np.zeros((0, 3)),
    )


def advance(setup: Setup, state: State | None, steps: int) -> State:
    """Return the bed after at most ``steps`` more steps; fewer when it comes to rest before.

    ``state`` None begins with the cloud. A pure function: how the steps are cut into calls changes
    no byte of the result. Raises RunDiverged and NotAtRest.
    """
    state = start(setup) if state is None else state
    end = state.steps + steps
    while state.steps < end and not state.rest:
        check = setup.check_steps
        state = march(setup, state, min(end, (state.steps // check + 1) * check) - state.steps)
        if state.steps % check == 0:
            state = look(setup, state)
    return state


def march(setup: Setup, state: State, steps: int) -> State:
    """Return the bed ``steps`` steps later, without a look whether it rests. Raises RunDiverged."""
    place, motion, load = state.place.copy(), state.motion.copy(), state.load.copy()
    floor_spring = state.floor_spring.copy()
    classes = neighbors.size_classes(0.5 * setup.diameter)
    pair_law, floor_law = setup.laws
    out = _march(
        steps, setup.time_step, setup.gravity, setup.local_damping, setup.width, pair_law, floor_law,
        setup.body, state.species, classes[state.species], int(classes.max()) + 1,
        SKIN * float(setup.diameter.min()), place, motion, load, floor_spring,
        state.origin.copy(), state.allowance.copy(),
        state.first, state.neighbor, state.touching.copy(), state.spring.copy(), state.stale,
    )  # fmt: skip
    origin, allowance, first, neighbor, touching, spring, stale, mean_force, lost = out
    if lost >= 0:
        raise RunDiverged(
            f"sphere {lost} left the container or lost its number near step {state.steps + steps}; "
            f"raise steps per collision above {setup.steps_per_collision:g}"
        )
    return replace(
        state, place=place, motion=motion, load=load, floor_spring=floor_spring, origin=origin,
        allowance=allowance, first=first, neighbor=neighbor, touching=touching, spring=spring,
        stale=bool(stale), mean_force=float(mean_force), steps=state.steps + steps,
    )  # fmt: skip


@kernel
def _march(  # type: ignore[no-untyped-def]
    steps, dt, gravity, alpha, width, pair_law, floor_law, body, species, sizes, classes, skin, place, motion, load,
    floor_spring, origin, allowance, first, neighbor, touching, spring, stale,
):  # fmt: skip
    """Run the time loop; return the list, whether it is stale, the mean F_n, and a lost sphere or -1."""
    contacts, total = 0, 0.0
    for _ in range(steps):
        if stale:
            for i in range(place.shape[0]):
                if not (-place[i, 3] < place[i, 2] < 1e6 and abs(place[i, 0]) < 1e6 and abs(place[i, 1]) < 1e6):
                    return origin, allowance, first, neighbor, touching, spring, stale, 0.0, i
            walls.wrap(place, width)
            for i in range(place.shape[0]):
                speed = math.sqrt(motion[i, 0] ** 2 + motion[i, 1] ** 2 + motion[i, 2] ** 2)
                allowance[i] = min(skin + LOOKAHEAD * dt * speed, 0.5 * place[i, 3] + skin)
                origin[i, 0], origin[i, 1], origin[i, 2] = place[i, 0], place[i, 1], place[i, 2]
            new_first, new_neighbor = neighbors.verlet_list(place, allowance, sizes, classes, width)
            touching, spring = neighbors.carry_springs(first, neighbor, touching, spring, new_first, new_neighbor)
            first, neighbor = new_first, new_neighbor
        load[:] = 0.0
        contacts, total = contact.add_pair_loads(
            place, motion, species, pair_law, width, first, neighbor, touching, spring, dt, load
        )
        more, push = walls.add_floor_loads(place, motion, species, floor_law, floor_spring, dt, load)
        contacts, total = contacts + more, total + push
        stale = integrator.move(place, motion, species, body, load, gravity, alpha, dt, origin, allowance)
    return origin, allowance, first, neighbor, touching, spring, stale, total / max(contacts, 1), -1


def look(setup: Setup, state: State) -> State:
    """Return the state with this look's verdict on its rest. Raises NotAtRest.

    Still: twice in a row, not before the fall time, hardly any kinetic energy and forces in balance.
    Creeping: the middle's PD moved by less than 2e-4 over 20 sqrt(d/g) at little energy.
    """
    time = state.steps * setup.time_step
    middle = slab(state.place)
    history = np.vstack([state.history, [time, solid_fraction(state.place, setup.width, *middle)]])
    weight = float((setup.count * setup.mass).sum())
    energy = float(integrator.kinetic_energy(state.motion, state.species, setup.body))
    unbalance = integrator.mean_resultant(state.load, state.species, setup.body, setup.gravity)
    calm = energy < REST_ENERGY * weight * float(setup.diameter.min())
    calm = calm and unbalance < REST_FORCE * state.mean_force and time >= setup.fall_time
    quiet = state.quiet_looks + 1 if calm else 0
    before = history[history[:, 0] <= time - CREEP_OVER + 1e-9]
    creeping = (
        time >= setup.fall_time + CREEP_OVER
        and float(np.ptp(history[len(before) - 1 :, 1])) < CREEP_PD
        and energy < CREEP_ENERGY * weight
    )
    rest = "still" if quiet >= 2 else "creeping" if creeping else ""
    if not rest and time > PATIENCE * setup.fall_time:
        raise NotAtRest(
            f"the bed still moves after {time:.0f} sqrt(d/g), more than {PATIENCE:g} fall times, with a "
            f"kinetic energy of {energy / weight:.1e} of weight times diameter; raise the local damping "
            f"above {setup.local_damping:g} or the friction coefficient"
        )
    return replace(state, history=history, quiet_looks=quiet, rest=rest)


def slab(place: np.ndarray) -> tuple[float, float]:
    """Return the middle half of a bed, from a quarter to three quarters of its height.

    ``place`` (N, 4). The height is twice that of the solids' centre of mass.
    """
    solid = place[:, 3] ** 3
    height = 2.0 * float((solid * place[:, 2]).sum() / solid.sum())
    return 0.25 * height, 0.75 * height


def solids_between(place: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return each sphere's volume between two planes, shape (N,), cut spheres by exact segments."""
    r, z = place[:, 3], place[:, 2]
    below = np.clip(high - z, -r, r), np.clip(low - z, -r, r)
    upper, lower = (math.pi / 3.0 * (r + t) ** 2 * (2.0 * r - t) for t in below)
    return np.asarray(upper - lower)


def solid_fraction(place: np.ndarray, width: float, low: float, high: float) -> float:
    """Return the solid fraction between two planes of a periodic bed of ``width``."""
    return float(solids_between(place, low, high).sum()) / (width**2 * (high - low))


def contacts_per_sphere(state: State, low: float, high: float) -> float:
    """Return the mean contacts, floor excluded, of the spheres centred between two planes."""
    count = np.zeros(state.place.shape[0])
    owner = np.repeat(np.arange(count.size), np.diff(state.first))
    touch = state.touching.astype(bool)
    np.add.at(count, owner[touch], 1.0)
    np.add.at(count, state.neighbor[touch], 1.0)
    inside = (state.place[:, 2] >= low) & (state.place[:, 2] <= high)
    return float(count[inside].mean())


def largest_overlap(setup: Setup, state: State) -> float:
    """Return the largest overlap of two spheres over the smaller one's diameter."""
    touch = state.touching.astype(bool)
    i = np.repeat(np.arange(state.place.shape[0]), np.diff(state.first))[touch]
    j = state.neighbor[touch]
    apart = state.place[i, :3] - state.place[j, :3]
    apart[:, :2] -= setup.width * np.round(apart[:, :2] / setup.width)
    delta = state.place[i, 3] + state.place[j, 3] - np.sqrt((apart**2).sum(axis=1))
    smaller = 2.0 * np.minimum(state.place[i, 3], state.place[j, 3])
    return float((delta / smaller).max(initial=0.0))
