"""A bed: all that decides it, and its state at one step."""

import math
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from pdlab.dem import contact, insertion, integrator, neighbors, walls
from pdlab.dem.neighbors import PairList
from pdlab.dem.simd import PAIRS
from pdlab.dem.walls import Container, WallList
from pdlab.errors import RunDiverged

CHECK_EVERY = 0.5
"""Time between two looks whether the bed rests, in sqrt(d/g)."""
SLICE, NARROWEST_PART = 8.0, 2.5
"""Width of a slice of the bed whose spheres follow each other in memory, in diameters of the mean sphere
volume, and the least of a part, in largest diameters: pairs reach no farther than the next part."""
SOFT_RATIO = 1.5
"""Size ratio beyond which contacts are made stiffer."""
MARGIN = 3.0
"""Free width of the box that a cylinder stands in, in largest diameters."""
SURROUNDINGS = 20.0
"""The same around a heap's base: what flies off must fall past the base's next image."""
FALLEN = 1.0
"""Largest diameters below its base, or beyond the edge, at which a sphere has left a heap for good."""


@dataclass(frozen=True)
class Stage:
    """A part of a test's way, in the frame of the container.

    ``duration``: time, None until the bed rests. ``layer``: which layer of spheres is poured in at the
    beginning, None for none. ``damping``: local damping α. ``gravity``: factor of gravity, 0 in free
    fall. ``kick``: velocity along gravity that all spheres get at the beginning. ``swing`` and
    ``frequency``: peak acceleration over g of a vertical sine, and its angular frequency. ``rim`` and
    ``lift``: height of a heap's cylinder above its base at the beginning, and the speed at which it rises.
    """

    duration: float | None = None
    layer: int | None = None
    damping: float = 0.0
    gravity: float = 1.0
    kick: float = 0.0
    swing: float = 0.0
    frequency: float = 0.0
    rim: float = 0.0
    lift: float = 0.0


@dataclass(frozen=True)
class Setup:
    """All that decides a bed, in reduced units (length d_max, density ρ, time sqrt(d_max/g)).

    ``diameter``, ``density``, ``friction``: shape (S,). ``count``: shape (S,), spheres of each species.
    ``rolling``: rolling friction coefficients, shape (S,), None for no rolling resistance. ``width``: of
    the periodic box, or inner diameter of the ``cylinder``. ``local_damping``: PFC3D's α, on
    moments too with ``moment_damping``. ``nominal_overlap``: weight of all spheres on the floor over the
    contact modulus, which is higher for size ratios above 1.5. ``pair_friction``: between two species the
    minimum, mean or geometric_mean of theirs.

    The spheres fall in ``layers`` layers. After each the container is lifted ``drop_height`` and dropped
    ``drops`` times, with ``drop_pause`` between; after the last it is shaken for ``shake_periods`` at a
    peak acceleration of ``shake_acceleration`` g and an amplitude of ``shake_amplitude``.

    With a ``base_diameter`` the cylinder stands on a round base with a lip of ``lip_height`` at its edge, and is
    lifted by ``lift_height`` at ``lift_speed``: a heap forms, and what falls off the base is taken away.
    """

    diameter: np.ndarray
    density: np.ndarray
    friction: np.ndarray
    count: np.ndarray
    width: float
    seed: int
    wall_friction: float
    rolling: np.ndarray | None = None
    cylinder: bool = False
    restitution: float = 0.5
    local_damping: float = 0.7
    moment_damping: bool = False
    nominal_overlap: float = 0.002
    cloud_fraction: float = 0.25
    steps_per_collision: float = 10.0
    layers: int = 1
    drops: int = 0
    drop_height: float = 0.5
    drop_pause: float = 2.5
    shake_periods: int = 0
    shake_acceleration: float = 3.0
    shake_amplitude: float = 0.1
    pair_friction: str = "minimum"
    base_diameter: float | None = None
    lip_height: float = 1.0
    lift_height: float = 0.0
    lift_speed: float = 0.05
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
    def area(self) -> float:
        """Area of the floor."""
        return self.width**2 * (math.pi / 4.0 if self.cylinder else 1.0)

    @cached_property
    def box(self) -> float:
        """Width of the periodic box, which for a cylinder keeps its images out of reach."""
        if self.base_diameter is not None:
            return self.base_diameter + SURROUNDINGS
        return self.width + MARGIN if self.cylinder else self.width

    @cached_property
    def wall_radius(self) -> float:
        """Radius of the cylinder in the middle of the box; infinite where there is none."""
        return 0.5 * self.width if self.cylinder else math.inf

    @cached_property
    def modulus(self) -> float:
        """Contact modulus E, force per area, at which the bed's weight gives the nominal overlap.

        Fine spheres bear what coarse ones weigh: beyond a size ratio of 1.5, E grows with the ratio.
        """
        ratio = float(self.diameter.max() / self.diameter.min())
        return float((self.count * self.mass).sum() / self.area / self.nominal_overlap) * max(1.0, ratio / SOFT_RATIO)

    @cached_property
    def zeta(self) -> float:
        """Damping ratio that gives the restitution."""
        return contact.damping_ratio(self.restitution)

    @cached_property
    def laws(self) -> tuple[np.ndarray, np.ndarray]:
        """Contact parameters between species (S, S, 4) and at the walls (S, 4)."""
        rolling = np.zeros_like(self.friction) if self.rolling is None else self.rolling
        return contact.law_tables(
            self.diameter, self.mass, self.friction, rolling, self.wall_friction, self.modulus, self.zeta,
            self.pair_friction,
        )  # fmt: skip

    @cached_property
    def time_step(self) -> float:
        """Time step in sqrt(d/g)."""
        return integrator.time_step(self.laws[0], self.mass, self.zeta, self.steps_per_collision)

    @cached_property
    def cloud_height(self) -> float:
        """Height in which all solids make the cloud's fraction; a layer's cloud is its part of it."""
        solids = float((self.count * math.pi / 6.0 * self.diameter**3).sum())
        return solids / self.area / self.cloud_fraction

    @cached_property
    def fall_time(self) -> float:
        """Time in which a sphere falls through a layer's cloud, local damping included."""
        return math.sqrt(2.0 * self.cloud_height / self.layers / (1.0 - self.local_damping))

    @cached_property
    def columns(self) -> int:
        """Columns that the bed's spheres are sorted into along y."""
        return max(1, round(self.box / self._slice))

    @cached_property
    def parts(self) -> int:
        """Parts that the bed is cut into along x, 1 or an even number: threads work on them at once."""
        return max(1, 2 * round(0.5 * self.box / max(self._slice, NARROWEST_PART)))

    @cached_property
    def _slice(self) -> float:
        return SLICE * float(np.cbrt((self.count * self.diameter**3).sum() / self.count.sum()))

    @cached_property
    def check_steps(self) -> int:
        """Steps from one look at the rest to the next."""
        return math.ceil(CHECK_EVERY / self.time_step)

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """The test's way. Compaction runs without local damping, pouring and settling with it."""
        speed = math.sqrt(2.0 * self.drop_height)  # in free fall over the drop height, which takes as long
        drop = (Stage(speed, gravity=0.0), Stage(self.drop_pause, kick=speed))
        way: list[Stage] = []
        for layer in range(self.layers):
            way += [Stage(layer=layer, damping=self.local_damping), *(drop * self.drops)]
        if self.shake_periods:
            frequency = math.sqrt(self.shake_acceleration / self.shake_amplitude)
            lasting = 2.0 * math.pi * self.shake_periods / frequency
            way.append(Stage(lasting, swing=self.shake_acceleration, frequency=frequency))
        if way[-1].duration is not None:
            way.append(Stage(damping=self.local_damping))
        if self.base_diameter is not None:
            way += [Stage(self.lift_height / self.lift_speed, lift=self.lift_speed), Stage(rim=self.lift_height)]
        return tuple(way)

    def container(self, stage: Stage) -> Container:
        """Return the walls in a stage."""
        if self.base_diameter is None:
            return Container(self.wall_radius)
        return Container(math.inf, self.wall_radius, stage.lift, 0.5 * self.base_diameter, self.lip_height)

    def layer_counts(self, layer: int) -> np.ndarray:
        """Spheres of each species that the layer brings, shape (S,)."""
        return np.asarray(self.count * (layer + 1) // self.layers - self.count * layer // self.layers)


@dataclass(frozen=True)
class State:
    """A bed at one step: all that the next step needs, so that chunks change no byte.

    Of N spheres: ``place`` (N, 4) x, y, z, radius; ``motion`` (N, 8) velocity, 0, angular velocity,
    0; ``species`` (N,); ``load`` (N, 8) force, 0, torque, 0 of the last step; ``origin`` (N, 4) where
    the list was made, and radius less allowance. ``pairs`` and ``near``: who may touch whom, with the
    springs. ``history`` (K, 2): time and PD of the middle at each look. ``stage``: number in
    ``Setup.stages``, begun at step ``stage_began``. ``rest``: "" while it moves, else "still" or
    "creeping"; "placed" of spheres that never moved.
    """

    place: np.ndarray
    motion: np.ndarray
    species: np.ndarray
    load: np.ndarray
    origin: np.ndarray
    pairs: PairList
    near: WallList
    steps: int = 0
    stale: bool = True
    quiet_looks: int = 0
    history: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    stage: int = 0
    stage_began: int = 0
    rest: str = ""


def rest_free(place: np.ndarray, species: np.ndarray) -> State:
    """Return the state of spheres at ``place`` (N, 4), of ``species`` (N,), that do not move yet."""
    n = place.shape[0]
    return State(
        place=np.ascontiguousarray(place, dtype=np.float64),
        motion=np.zeros((n, 8)),
        species=np.ascontiguousarray(species, dtype=np.int64),
        load=np.zeros((n, 8)),
        origin=np.zeros((n, 4)),
        pairs=neighbors.no_pairs(),
        near=walls.no_walls(n),
    )


def start(setup: Setup) -> State:
    """Return the cloud that a bed begins with: uniform, no overlap, at the cloud's solid fraction.

    Raises RunDiverged when a sphere finds no place.
    """
    return in_order(setup, rest_free(*_cloud(setup, 0, 0.0)))


def pour(setup: Setup, state: State, layer: int) -> State:
    """Return the bed with a further layer's cloud above it. Raises RunDiverged."""
    place, species = _cloud(setup, layer, float((state.place[:, 2] + state.place[:, 3]).max()))
    more = rest_free(place, species)

    def both(name: str) -> np.ndarray:
        return np.concatenate([getattr(state, name), getattr(more, name)])

    first = np.concatenate([state.near.first, np.full(len(species), state.near.first[-1])])
    state = replace(
        state, near=state.near._replace(first=first), place=both("place"), motion=both("motion"),
        species=both("species"), load=both("load"), origin=both("origin"),
    )  # fmt: skip
    return in_order(setup, state)


def _cloud(setup: Setup, layer: int, bottom: float) -> tuple[np.ndarray, np.ndarray]:
    """Return places (N, 4) and species (N,) of a layer's spheres above ``bottom``."""
    order, count = np.argsort(-setup.diameter, kind="stable"), setup.layer_counts(layer)
    species = np.repeat(order, count[order]).astype(np.int64)
    rng = np.random.Generator(np.random.PCG64([setup.seed, layer]))
    top = bottom + setup.cloud_height / setup.layers
    place, found = insertion.cloud(
        0.5 * setup.diameter[species], setup.box, setup.wall_radius, bottom, top, insertion.ATTEMPTS, rng
    )
    if found < species.size:
        raise RunDiverged(
            f"sphere {found + 1} of {species.size} found no place in {insertion.ATTEMPTS} attempts in a cloud of "
            f"solid fraction {setup.cloud_fraction:g}; choose a smaller cloud fraction"
        )
    return place, species


def in_order(setup: Setup, state: State) -> State:
    """Return the bed with its spheres in the order of their places: neighbours share the cache.

    The bed is cut into its parts along x, each of as many spheres, these into columns along y, and a
    column's spheres stand from below. The list is stale then.
    """
    return _only(setup, state, by_place(setup, state.place))


def without_fallen(setup: Setup, state: State) -> State:
    """Return the bed without the spheres that have fallen off a heap's base."""
    if setup.base_diameter is None:
        return state
    x, y, z = state.place[:, :3].T
    off = np.hypot(x - 0.5 * setup.box, y - 0.5 * setup.box)
    fallen = (off > 0.5 * setup.base_diameter + FALLEN) | (z < -FALLEN)
    return _only(setup, state, np.flatnonzero(~fallen)) if fallen.any() else state


def _only(setup: Setup, state: State, order: np.ndarray) -> State:
    """Return the bed with the spheres of these numbers alone, in this ``order`` (M,), and a stale list."""
    rank = np.full(len(state.species), -1)
    rank[order] = np.arange(order.size)
    pairs, near = state.pairs, state.near
    owner, neighbor = rank[pairs.owner], rank[pairs.neighbor]
    kept = (owner >= 0) & (neighbor >= 0)
    owner, neighbor = np.where(kept, owner, 0), np.where(kept, neighbor, 0)
    sign = np.where(owner < neighbor, 1.0, -1.0) * kept  # what acts on i acts the other way on j
    signs = np.resize(np.repeat(sign.reshape(-1, 1, PAIRS), 3, axis=1), pairs.spring.size)
    count = np.diff(near.first)[order]
    first = np.concatenate([[0], np.cumsum(count)])
    entry = np.arange(first[-1]) + np.repeat(near.first[order] - first[:-1], count)
    return replace(
        state, stale=True, place=state.place[order], motion=state.motion[order], species=state.species[order],
        load=state.load[order], origin=state.origin[order],
        pairs=pairs._replace(
            owner=np.minimum(owner, neighbor).astype(np.uint32), neighbor=np.maximum(owner, neighbor).astype(np.uint32),
            kind=np.where(kept, pairs.kind, setup.diameter.size**2).astype(np.uint32), spring=pairs.spring * signs,
        ),
        near=WallList(first, near.wall[entry], near.spring[entry]),
    )  # fmt: skip


def by_place(setup: Setup, place: np.ndarray) -> np.ndarray:
    """Return the order, shape (N,), of spheres at ``place`` (N, 4) that ``in_order`` brings them into."""
    n, x = len(place), np.mod(place[:, 0], setup.box)
    part = np.empty(n, np.int64)
    part[np.argsort(x, kind="stable")] = np.arange(n) * setup.parts // n
    column = np.floor(np.mod(place[:, 1], setup.box) / setup.box * setup.columns)
    return np.lexsort((place[:, 2], column, part))
