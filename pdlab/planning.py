"""What runs cost before they are run: steps and seconds of each bed, learnt from the runs that a store holds.

The steps of a test that its own times ask for are known: the cloud's fall, the drops, the shaking, at the time step
that follows from the smallest sphere and the bed's weight. How many times as many a bed takes until it is at rest is
learnt from the nearest runs, as is the speed: by what decides them, in logarithms. Where a store knows nothing near,
runs measured once on an idle machine stand in. This module runs nothing.
"""

import heapq
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from pdlab.specimen import (
    LOOSE,
    PLACED,
    RODDED,
    VIBRATED,
    Component,
    Protocol,
    Specimen,
    equal_spheres,
    heap_spheres,
    mixed_spheres,
)

NEIGHBORS = 8
"""Runs that an estimate rests on: as many as a node of a calibration curve has seeds."""
ALIKE = 0.02
"""Distance below which two beds are the same but for their seed."""
NEAREST = 0.1
"""Distance at which a neighbour has a quarter of the weight of an equal bed."""
SCATTER, DRIFT, LOAD, FOREIGN = 0.15, 0.35, 0.2, 0.5
"""Standard deviations of logarithms before any run is known: of the steps of equal beds; of steps and speed at a
distance of one; of the speed from hour to hour; and of the speed of a machine that none was run on."""
PSEUDO = 5
"""Runs that these standard deviations count as."""
SPELL = 10
"""Runs in a row that found the machine's load alike."""
DRAWS, QUANTILE = 100, 0.9
"""Draws by which a range is found, and the share of them inside it."""
NORMAL_90 = 1.645
"""Standard deviations within which 90 % of a normal distribution lie."""
SOFT_RATIO = 1.5
"""Size ratio beyond which a bed's contacts are stiffer, as in the engine."""
PROBE = equal_spheres(0.3, 1)
"""A bed of a second or two, to be run where no speed is known of a machine."""


@dataclass(frozen=True)
class Ran:
    """A run that is done: its specimen, its steps, and its seconds [s], None where another machine took them."""

    specimen: Specimen
    steps: int
    seconds: float | None


class Range(NamedTuple):
    """An estimate, and the ends of the interval in which 90 % of what comes out should lie."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Estimate:
    """What runs will cost. Arrays of shape (R,), a value for each run.

    ``count``: spheres; ``steps``; ``run_seconds`` [s] on a core at the machine's usual load. Standard deviations of
    logarithms: ``scatter`` of the steps, of each run for itself; ``drift`` of the steps, of all runs together, since
    they rest on the same neighbours; ``load`` of the machine's speed. ``hindered`` (K,): logarithms of how many times
    as long as expected single runs took. ``measured``: whether any run was timed on this machine.
    """

    count: np.ndarray
    steps: np.ndarray
    run_seconds: np.ndarray
    scatter: np.ndarray
    drift: np.ndarray
    load: float
    hindered: np.ndarray
    measured: bool

    @property
    def runs(self) -> int:
        """Runs in all, equal specimens once."""
        return len(self.count)

    @property
    def spheres(self) -> int:
        """Spheres of all runs."""
        return int(self.count.sum())

    @cached_property
    def sphere_steps(self) -> Range:
        """Spheres times steps, of all runs."""
        return _range([float(np.sum(self.count * self.steps * factor)) for factor in self._draws()])

    def seconds(self, workers: int = 1, cores: int | None = None) -> Range:
        """Return the seconds [s] by the clock on so many workers, the longest runs first.

        ``cores`` that the workers share, None where each has one: more workers than cores take as much longer.
        """
        order = np.argsort(-self.run_seconds, kind="stable")
        shared, draw = max(1.0, workers / cores) if cores else 1.0, np.random.default_rng(2)
        found = []
        for factor in self._draws():
            slower = np.exp(draw.choice(self.hindered, self.runs) + self.load * draw.standard_normal())
            found.append(shared * makespan((self.run_seconds * factor * slower)[order], workers))
        return _range(found)

    def _draws(self) -> Iterable[np.ndarray]:
        """Give factors, shape (R,), by which the runs' steps may differ from their estimates."""
        draw = np.random.default_rng(1)
        for _ in range(DRAWS):
            alone = self.scatter * draw.standard_normal(self.runs)
            yield np.exp(alone + self.drift * draw.standard_normal())


class Compared(NamedTuple):
    """An estimate beside what it took: runs, sphere-steps, and seconds [s] by the clock."""

    runs: int
    runs_taken: int
    sphere_steps: Range
    sphere_steps_taken: float
    seconds: Range
    seconds_taken: float

    @property
    def ratio(self) -> float:
        """The estimated seconds over those that it took."""
        return self.seconds.value / self.seconds_taken if self.seconds_taken > 0.0 else math.nan

    @property
    def within(self) -> bool:
        """Whether the seconds lie in the estimate's interval."""
        return self.seconds.low <= self.seconds_taken <= self.seconds.high


def compare(
    estimate: Estimate, ran: Sequence[Ran], seconds: float, workers: int = 1, cores: int | None = None
) -> Compared:
    """Return an estimate beside the runs that were made, in so many ``seconds`` [s] by the clock."""
    taken = float(sum(run.steps * run.specimen.spheres for run in ran))
    expected = estimate.seconds(workers, cores)
    return Compared(estimate.runs, len(ran), estimate.sphere_steps, taken, expected, seconds)


def makespan(seconds: Sequence[float] | np.ndarray, workers: int) -> float:
    """Return the time by the clock of jobs that each free worker takes the next of, in order (Graham, 1966)."""
    free = [0.0] * max(1, workers)
    for job in map(float, seconds):
        heapq.heapreplace(free, free[0] + job)
    return max(free)


def _range(draws: list[float]) -> Range:
    low, value, high = np.quantile(draws, (0.5 - 0.5 * QUANTILE, 0.5, 0.5 + 0.5 * QUANTILE))
    return Range(float(value), float(low), float(high))


def asked_time(specimen: Specimen) -> float:
    """Return the time [sqrt(d/g)] that a test asks for, without that until its bed is at rest."""
    way = specimen.protocol
    floor = specimen.width**2 * (math.pi / 4.0 if way.container == "cylinder" else 1.0)
    layers = way.layers if way.compaction == "rodded" else 1
    cloud = _solids(specimen) / floor / way.cloud_fraction / layers
    time = layers * math.sqrt(2.0 * cloud / (1.0 - way.local_damping))
    if way.compaction == "rodded":
        time += layers * way.drops * (math.sqrt(2.0 * way.drop_height) + way.drop_pause)
    if way.compaction == "vibrated":
        time += 2.0 * math.pi * way.shake_periods * math.sqrt(way.shake_amplitude / way.shake_acceleration)
    if way.compaction == "repose":
        time += (specimen.height or 0.0) / way.lift_speed
    return time


def asked_steps(specimen: Specimen) -> float:
    """Return the steps of the time that a test asks for.

    A step is a part of the time in which the lightest sphere hits another one, of which each bears what the bed weighs.
    """
    way, kinds = specimen.protocol, specimen.species
    floor = specimen.width**2 * (math.pi / 4.0 if way.container == "cylinder" else 1.0)
    weight = math.pi / 6.0 * sum(kind.count * kind.density * kind.diameter**3 for kind in kinds)
    modulus = weight / floor / way.nominal_overlap * max(1.0, _ratio(specimen) / SOFT_RATIO)
    collision = math.pi * min(kind.diameter * math.sqrt(math.pi / 12.0 * kind.density / modulus) for kind in kinds)
    return asked_time(specimen) * way.steps_per_collision / collision


def _solids(specimen: Specimen) -> float:
    return math.pi / 6.0 * sum(kind.count * kind.diameter**3 for kind in specimen.species)


def _ratio(specimen: Specimen) -> float:
    diameters = [kind.diameter for kind in specimen.species]
    return max(diameters) / min(diameters)


TESTS = ("loose", "rodded", "vibrated", "repose", *PLACED)


def features(specimen: Specimen) -> list[float]:
    """Return what decides a bed's steps and speed, so that a distance of one is a considerable difference.

    The test and its container; the least friction and rolling friction, damping; the size ratio, the share of the
    coarsest, the spheres.
    """
    way, kinds, spread = specimen.protocol, specimen.species, math.log(_ratio(specimen))
    placed = way.compaction in PLACED
    coarsest = max(range(len(kinds)), key=lambda k: kinds[k].diameter)
    return [
        *(3.0 * (way.compaction == test) for test in TESTS),
        float(way.container == "cylinder"),
        0.0 if placed else math.log(min(kind.friction for kind in kinds) + 0.02),
        0.0 if placed else 0.5 * math.log(min(kind.rolling for kind in kinds) + 0.05),
        0.0 if placed else 2.0 * way.local_damping,
        0.5 * spread,
        1.5 * min(1.0, spread) * specimen.shares[coarsest],
        0.3 * math.log(specimen.spheres),
    ]


def _log_steps(run: Ran) -> float:
    """Return by how much a run's steps exceed those asked for; 0 of a bed by geometry alone, which takes none."""
    return math.log(run.steps / asked_steps(run.specimen)) if run.steps > 0 else 0.0


def _log_pace(run: Ran) -> float:
    """Return the seconds of a sphere-step, of a bed by geometry alone those of a sphere; NaN where not known."""
    if run.seconds is None or run.seconds <= 0.0:
        return math.nan
    return math.log(run.seconds / (run.specimen.spheres * max(run.steps, 1)))


def _bed(friction: float, protocol: Protocol = LOOSE, rolling: float = 0.0) -> Specimen:
    return equal_spheres(friction, 1, protocol, rolling)


def _mix(*parts: tuple[float, float, float], protocol: Protocol = LOOSE) -> Specimen:
    """Return the bed of a mixture of diameters, frictions and shares."""
    return mixed_spheres([Component(*part) for part in parts], 1, protocol)


@lru_cache(maxsize=1)
def built_in() -> tuple[Ran, ...]:
    """Return runs measured on one idle core of a Rocket Lake processor: specimen, steps, sphere-steps a second."""
    moved = [
        (_bed(0.0), 61_500, 22.7e6), (_bed(0.02), 31_700, 24.2e6), (_bed(0.05), 25_200, 25.6e6),
        (_bed(0.1), 20_400, 27.0e6), (_bed(0.3), 18_600, 29.3e6), (_bed(1.0), 22_700, 28.9e6),
        (_bed(1.0, rolling=0.1), 18_100, 30.5e6), (_bed(1.0, rolling=0.3), 17_300, 32.7e6),
        (_bed(1.0, rolling=1.0), 19_400, 35.7e6),
        (_bed(0.0, RODDED), 306_000, 31.8e6), (_bed(0.05, RODDED), 201_400, 33.6e6),
        (_bed(0.3, RODDED), 177_400, 33.4e6), (_bed(1.0, RODDED), 195_800, 35.5e6),
        (_bed(1.0, RODDED, 0.3), 178_300, 33.0e6),
        (_bed(0.0, VIBRATED), 166_900, 22.0e6), (_bed(0.3, VIBRATED), 143_500, 22.4e6),
        (_bed(1.0, VIBRATED), 148_800, 22.4e6), (heap_spheres(0.3, 1), 120_400, 21.5e6),
        (_mix((3.5, 0.1258, 0.4), (1.0, 0.2232, 0.6)), 57_000, 29.0e6),
        (_mix((3.5, 0.1258, 0.675), (1.0, 0.2232, 0.325)), 80_800, 29.0e6),
        (_mix((3.5, 0.1258, 0.9), (1.0, 0.2232, 0.1)), 121_900, 29.0e6),
        (_mix((3.0, 0.0, 0.6), (1.0, 0.0, 0.4)), 186_100, 25.0e6),
        (_mix((4.0, 0.3, 0.4), (2.0, 0.1, 0.3), (1.0, 0.2, 0.3)), 104_300, 28.0e6),
        (_mix((2.0, 0.3, 0.5), (1.0, 0.1, 0.5)), 26_600, 28.0e6),
        (_mix((1.5, 0.5, 0.3), (1.0, 0.7, 0.7)), 20_800, 28.0e6),
        (_mix((2.0, 0.3, 0.5), (1.0, 0.1, 0.5), protocol=RODDED), 344_400, 30.0e6),
    ]  # fmt: skip
    placed = [
        (_bed(0.0, Protocol("static")), 8.4e-4), (_bed(0.0, Protocol("drop_and_roll")), 8.5e-6),
    ]  # fmt: skip
    runs = [Ran(bed, steps, bed.spheres * steps / speed) for bed, steps, speed in moved]
    return (*runs, *(Ran(bed, 0, bed.spheres * each) for bed, each in placed))


@dataclass(frozen=True)
class _Known:
    """Runs to learn from: ``at`` (N, F), logarithms of steps over those asked for (N,) and of the pace (N,)."""

    at: np.ndarray
    steps: np.ndarray
    pace: np.ndarray

    @classmethod
    def of(cls, runs: Sequence[Ran]) -> "_Known":
        at = np.array([features(run.specimen) for run in runs]).reshape(len(runs), len(features(PROBE)))
        return cls(at, np.array([_log_steps(run) for run in runs]), np.array([_log_pace(run) for run in runs]))

    def beside(self, other: "_Known", pace: float) -> "_Known":
        """Return these runs and the others, whose pace is multiplied by exp(``pace``)."""
        return _Known(
            np.concatenate([self.at, other.at]),
            np.concatenate([self.steps, other.steps]),
            np.concatenate([self.pace, other.pace + pace]),
        )


def _median(at: np.ndarray, known: _Known, values: np.ndarray, apart: float = -1.0) -> tuple[float, float]:
    """Return the nearest runs' median of ``values`` (N,), weighted, and the distance of the nearest one.

    ``at`` (F,); runs that are not farther ``apart`` are left out, and those of no value.
    """
    distance = np.sqrt(np.sum((known.at - at) ** 2, axis=1))
    usable = np.flatnonzero((distance > apart) & np.isfinite(values))
    near = usable[np.argsort(distance[usable], kind="stable")[:NEIGHBORS]]
    order = near[np.argsort(values[near])]
    weights = 1.0 / (1.0 + distance[order] / NEAREST) ** 2
    behind = np.cumsum(weights) - 0.5 * weights
    return float(np.interp(0.5 * weights.sum(), behind, values[order])), float(distance[near[0]])


def _residuals(known: _Known, values: np.ndarray, learned: int, apart: float) -> np.ndarray:
    """Return, shape (L, 2), by how much runs are off what the others say of them, and the distance of those."""
    out = []
    for k in range(learned):
        if np.isfinite(values[k]):
            held = values.copy()
            held[k] = math.nan
            estimate, distance = _median(known.at[k], known, held, apart)
            out.append((values[k] - estimate, distance))
    return np.array(out).reshape(-1, 2)


def _spread(residuals: np.ndarray, before: float) -> float:
    """Return a standard deviation by which 90 % of the residuals lie within; ``before``: known of it before any."""
    pseudo = before * NORMAL_90 * np.linspace(0.2, 1.1, PSEUDO)
    return float(np.quantile(np.concatenate([np.abs(residuals), pseudo]), QUANTILE)) / NORMAL_90


@dataclass(frozen=True)
class Model:
    """What was learnt of runs: the runs, and how far off they were of what the others said of them.

    ``scatter`` of equal beds' steps, ``drift`` of them over a distance of one, ``load`` of a machine's speed: standard
    deviations of logarithms; ``hindered`` (K,): those of how many times as long runs took as the others let expect.
    ``measured``: whether any run was timed on this machine.
    """

    known: _Known
    scatter: float
    drift: float
    load: float
    hindered: np.ndarray
    measured: bool

    def run(self, specimen: Specimen) -> tuple[float, float, float]:
        """Return a specimen's steps, its seconds [s] and the distance of the nearest run."""
        at = np.array(features(specimen))
        excess, near = _median(at, self.known, self.known.steps)
        steps = 0.0 if specimen.protocol.compaction in PLACED else asked_steps(specimen) * math.exp(excess)
        pace, _ = _median(at, self.known, self.known.pace)
        return steps, specimen.spheres * max(steps, 1.0) * math.exp(pace), near


def learn(history: Sequence[Ran]) -> Model:
    """Return what runs teach; of none, what is built in."""
    own, prior = _Known.of(history), _Known.of(built_in())
    measured = bool(np.isfinite(own.pace).any())
    slower = [
        pace - _median(at, prior, prior.pace)[0] for at, pace in zip(own.at, own.pace, strict=True) if np.isfinite(pace)
    ]
    known = own.beside(prior, float(np.median(slower)) if slower else 0.0)
    steps = _residuals(known, known.steps, len(history), -1.0)[:, 0]
    pace = _residuals(known, known.pace, len(history), -1.0)[:, 0]
    apart = _residuals(known, known.steps, len(history), ALIKE)
    spells = [float(np.median(pace[k : k + SPELL])) for k in range(0, len(pace), SPELL)]
    return Model(
        known,
        scatter=_spread(steps, SCATTER),
        drift=_spread(apart[:, 0] / np.maximum(apart[:, 1], 5.0 * NEAREST), DRIFT),
        load=_spread(np.array(spells), LOAD if measured else FOREIGN),
        hindered=np.concatenate([pace, [0.0]]),
        measured=measured,
    )


def estimate(specimens: Sequence[Specimen], history: Sequence[Ran] | Model) -> Estimate:
    """Return what specimens that are new will cost, each once, by what a store's runs of the same engine teach.

    ``history``: the runs, or what was learnt of them.
    """
    model = history if isinstance(history, Model) else learn(history)
    beds = list(dict.fromkeys(specimens))
    found = np.array([model.run(bed) for bed in beds]).reshape(-1, 3)
    return Estimate(
        count=np.array([bed.spheres for bed in beds], dtype=float),
        steps=found[:, 0],
        run_seconds=found[:, 1],
        scatter=np.full(len(beds), model.scatter),
        drift=model.drift * found[:, 2],
        load=model.load,
        hindered=model.hindered,
        measured=model.measured,
    )


def joined(estimates: Sequence[Estimate]) -> Estimate:
    """Return the estimate of all runs of estimates by one model, which share no run."""
    count, steps, seconds, scatter, drift = (
        np.concatenate(arrays)
        for arrays in zip(*((e.count, e.steps, e.run_seconds, e.scatter, e.drift) for e in estimates), strict=True)
    )
    return replace(estimates[0], count=count, steps=steps, run_seconds=seconds, scatter=scatter, drift=drift)
