"""Proportions of several aggregates → the beds that tell most of the densest mix. This module runs nothing.

A plan (see ``plan``): beds of one seed each at proportions on a grid, the next where it tells most, until the densest
mix's packing density is as well known as wished.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pdlab import theory
from pdlab.errors import EngineError, InputError, ShareError, SpecimenTooLarge, TooSoft
from pdlab.mixture import STIFFER, STIFFEST, Part, common_protocol, next_specimens, scatter, sensitivities, stiffened
from pdlab.plan import Plan
from pdlab.specimen import Packing, Specimen, on_grid
from pdlab.surface import Floats, Surface, fitted, pinned, share_grid, vertices

T = TypeVar("T")

WISHED_ERROR = 0.001
"""Standard error [-] of the densest mix's PD at which no more beds are run."""
MOST = {2: 12, 3: 30, 4: 50, 5: 70}
"""Beds of a sweep at most, by the number of aggregates, where nothing else is asked for."""
BENDS = (0.0, 0.1, 0.2, 0.3)
"""How far from Toufar's theory towards Furnas's bound, which has a corner where the voids are full, simulation is."""
FILLED = (0.92, 1.0, 1.08)
"""Factors on the packing densities that say where that corner lies: grains loosen each other, and the voids fill."""
FIRST, AT_ONCE = 2, 2
"""Beds run together at first, for each aggregate; and in every later round."""
CERTAIN, TIMES = 0.95, 2.0
"""Probability with which no other proportions are denser by more than so many wished errors, at the end."""
INTERVAL = (0.16, 0.84)
"""Ends of the intervals of the densest mix's shares, as probabilities."""
AROUND = 0.05
"""Difference of shares around a bed that failed within which no other is tried."""
MEASURED = 0.02
"""Difference of shares within which a mixture counts as measured already."""
TEST_ERROR, METHOD_ERROR, METHOD_LENGTH = 0.005, 0.02, 0.5
"""Errors in PD [-] of a density test and of the method where nothing else is known, and the shares over which the
method's error changes."""


@dataclass(frozen=True)
class Point:
    """A bed of a sweep: ``shares`` [-] of the aggregates, its PD [-], the digest of its run."""

    shares: tuple[float, ...]
    packing_density: float
    standard_error: float
    digest: str


@dataclass(frozen=True)
class Densest:
    """The densest mix: ``shares`` [-], each between ``low`` and ``high`` in 68 of 100 cases, and its PD [-].

    ``standard_error``: of the simulation, beds and calibration curves. ``input_error``: of the measured PDs.
    ``to_gain``: PD [-] by which, with a probability of 0.95, no other proportions are denser.
    """

    shares: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    packing_density: float
    standard_error: float
    input_error: float
    to_gain: float


@dataclass(frozen=True)
class NextTest:
    """The mix to test in the laboratory next: ``shares`` [-], its PD [-] with all ``error``, and ``why``."""

    shares: tuple[float, ...]
    packing_density: float
    error: float
    why: str


@dataclass(frozen=True)
class Swept:
    """A sweep: its ``points``; PD with its deviation over all ``shares``, shape (M, S), (M,), (M,); the densest mix.

    ``deviation`` is of the beds alone. ``next_test``: None where all that may be the densest is measured.
    """

    aggregates: tuple[str, ...]
    points: tuple[Point, ...]
    shares: Floats
    packing_density: Floats
    deviation: Floats
    densest: Densest
    next_test: NextTest | None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Measurement:
    """A mixture that was measured: ``shares`` [-] of the sweep's aggregates in their order, the error of its PD [-]."""

    shares: tuple[float, ...]
    standard_error: float = TEST_ERROR

    def turned(self, order: Sequence[int]) -> "Measurement":
        """Return the mixture with its aggregates in another order."""
        return replace(self, shares=tuple(self.shares[k] for k in order))


@dataclass
class _Sweep:
    """A sweep on its way: a grid of shares with what theory says there, and by place on it what became of its bed.

    ``beds``: those that can be simulated; ``scatter``: their PD's over seeds, shape (M,); ``too_large``: why the others
    cannot; ``stiffer``: how many times as stiff as
    in the calibrations contacts are by now; ``asked``: beds that were asked for.
    """

    parts: list[Part]
    shares: Floats
    theories: list[Floats]
    beds: dict[int, Specimen]
    scatter: Floats
    too_large: list[InputError]
    done: dict[int, Packing] = field(default_factory=dict)
    failed: dict[int, EngineError] = field(default_factory=dict)
    stiffer: float = 1.0
    asked: int = 0

    def allowed(self) -> NDArray[np.intp]:
        """Return the places that were or can be simulated, and the aggregates alone."""
        near = {k for at in self.failed for k in np.flatnonzero(_apart(self.shares, self.shares[at]) < AROUND)}
        return np.array(sorted({*vertices(self.shares), *self.done, *(self.beds.keys() - near)}))

    def surface(self) -> Surface:
        """Return what the beds say by now."""
        values = [bed.packing_density for bed in self.done.values()]
        return fitted(self.shares, self.theories, list(self.done), values, self.scatter[list(self.done)].tolist())

    def next(self, surface: Surface, beds: int) -> list[int]:
        """Return the places whose beds tell most, one after the other, as if each was run before the next."""
        allowed, out = self.allowed(), list[int]()
        chances = surface.densest_chances(allowed)
        free = np.setdiff1d(allowed, [*vertices(self.shares), *self.done])
        while len(out) < beds and free.size:
            best = int(free[np.argmax(surface.telling(chances, self.scatter)[free])])
            out.append(best)
            free, surface = free[free != best], surface.told(best, float(self.scatter[best]))
        return out

    def running(self, wanted: Sequence[int], most: int) -> Plan[None]:
        """Run the beds of places; where one is too soft, it and all later ones with stiffer contacts."""
        while wanted:
            self.asked += len(wanted)
            beds = [self.beds[at] for at in wanted]
            outcomes = yield [replace(bed, protocol=stiffened(bed.protocol, self.stiffer)) for bed in beds]
            soft = list[int]()
            for at, outcome in zip(wanted, outcomes, strict=True):
                if isinstance(outcome, Packing):
                    self.done[at] = outcome
                elif isinstance(outcome, TooSoft) and self.stiffer < STIFFEST and self.asked + len(soft) < most:
                    soft.append(at)
                else:
                    self.failed[at] = outcome
            wanted = soft
            self.stiffer *= STIFFER if soft else 1.0

    def densest(self, surface: Surface) -> Densest:
        """Return the densest mix, as far as it is known by now."""
        allowed = self.allowed()
        draws = surface.draws(allowed)
        best = int(np.argmax(surface.mean[allowed]))
        at, mixes = int(allowed[best]), self.shares[allowed[np.argmax(draws, axis=1)]]
        parts = [replace(part, share=share) for part, share in zip(self.parts, self.shares[at].tolist(), strict=True)]
        weight = sensitivities(parts, float(surface.mean[at]))
        curves = math.fsum(weight * [part.curve_error for part in parts])  # they add up, see ``mixture.predict``
        low, high = np.quantile(mixes, INTERVAL, axis=0)
        return Densest(
            shares=_tuple(self.shares[at]),
            low=_tuple(np.minimum(low, self.shares[at])),
            high=_tuple(np.maximum(high, self.shares[at])),
            packing_density=float(surface.mean[at]),
            standard_error=math.hypot(float(surface.deviation[at]), curves),
            input_error=float(np.linalg.norm(weight * [part.input_error for part in parts])),
            to_gain=float(np.quantile(draws.max(axis=1) - draws[:, best], CERTAIN)),
        )

    def is_known(self, densest: Densest, surface: Surface, wished_error: float) -> bool:
        """Return whether the densest mix is known as well as wished, by the beds alone."""
        at = int(np.argmin(_apart(self.shares, np.array(densest.shares))))
        return float(surface.deviation[at]) <= wished_error and densest.to_gain <= TIMES * wished_error


def check_aggregates(aggregates: int) -> None:
    """Raise ShareError unless the proportions of so many aggregates can be swept."""
    if aggregates not in MOST:
        raise ShareError(f"a sweep goes over {min(MOST)} to {max(MOST)} aggregates, not {aggregates}; name so many")


def check_wish(wished_error: float, most_specimens: int) -> None:
    """Raise InputError unless a sweep with this wished error [-] and so many beds can end."""
    if not wished_error > 0.0 or most_specimens < 1:
        raise InputError(
            f"a wished error of {wished_error:g} and {most_specimens} beds at most end no sweep; take both above 0"
        )


def sweeping(
    parts: Sequence[Part],
    wished_error: float = WISHED_ERROR,
    most_specimens: int | None = None,
    measured: Sequence[Measurement] = (),
    method_error: float = METHOD_ERROR,
    seed: int = 1,
) -> Plan[Swept]:
    """Sweep the proportions of calibrated aggregates, whose shares are ignored, for the densest mix.

    It ends when the densest mix's PD is known to ``wished_error`` [-] and no others are likely to be denser by twice as
    much, or with ``most_specimens``, each a bed of this ``seed``. ``measured`` and ``method_error`` [-] decide what to
    test next. A bed that fails is a place without a point, and noted. Raises InputError, ProtocolError, DensityError,
    SpecimenTooLarge where no proportions can be simulated, and EngineError where every bed failed.
    """
    check_aggregates(len(parts))
    most = MOST[len(parts)] if most_specimens is None else most_specimens
    check_wish(wished_error, most)
    order = sorted(range(len(parts)), key=lambda k: _rank(parts[k]))  # on which the answer does not depend
    one = _opened([parts[k] for k in order], seed)
    surface = one.surface()
    wanted = one.next(surface, min(FIRST * len(parts), most))
    while wanted:
        yield from one.running(wanted, most)
        surface = one.surface()
        beds = 0 if one.is_known(one.densest(surface), surface, wished_error) else min(AT_ONCE, most - one.asked)
        wanted = one.next(surface, beds)
    if not one.done and one.failed:
        raise next(iter(one.failed.values()))
    test = _next_test(one, surface, [mix.turned(order) for mix in measured], method_error)
    return _turned(_swept(one, surface, test, wished_error), np.argsort(order))


def _swept(one: _Sweep, surface: Surface, test: NextTest | None, wished_error: float) -> Swept:
    """Return the result of a sweep, its aggregates in the order of its own."""
    densest = one.densest(surface)
    return Swept(
        aggregates=tuple(part.aggregate for part in one.parts),
        points=tuple(
            Point(_tuple(one.shares[at]), bed.packing_density, float(one.scatter[at]), bed.digest)
            for at, bed in one.done.items()
        ),
        shares=one.shares,
        packing_density=surface.mean,
        deviation=surface.deviation,
        densest=densest,
        next_test=test,
        warnings=tuple(_warnings(one, densest, surface, wished_error)),
    )


def _opened(parts: list[Part], seed: int) -> _Sweep:
    """Return a sweep of which no bed is run yet. Raises as ``sweeping`` does."""
    common_protocol(parts)
    shares = share_grid(len(parts))
    theories = _theories(parts, shares)
    beds, seeds, too_large = dict[int, Specimen](), np.zeros(len(shares)), list[InputError]()
    for at in np.setdiff1d(np.arange(len(shares)), vertices(shares)).tolist():
        mix = [replace(part, share=on_grid(share)) for part, share in zip(parts, shares[at].tolist(), strict=True)]
        present = [part for part in mix if part.share > 0.0]
        try:
            beds[at] = replace(next_specimens(present, [], seeds=1)[0], seed=seed)
            seeds[at] = scatter(present, beds[at], float(theories[0][at]))
        except (SpecimenTooLarge, ShareError) as error:
            too_large.append(error)
    if not beds:
        raise too_large[0]
    return _Sweep(parts, shares, theories, beds, seeds, too_large)


def _theories(parts: Sequence[Part], shares: Floats) -> list[Floats]:
    """Return PD over the grid [-] by Toufar, and by him with so much of Furnas's bend at each of its places."""
    toufar, bends = np.zeros(len(shares)), list[Floats]()
    for filled in FILLED:
        materials = [theory.Material(_diameter(part), filled * part.packing_density) for part in parts]
        lower = theory.toufar(materials, shares)
        bends.append(theory.furnas(materials, shares) - lower)
        toufar = lower if filled == 1.0 else toufar
    return [toufar, *(toufar + bend * one for bend in BENDS for one in bends if bend > 0.0)]


def _diameter(part: Part) -> float:
    """Return the log-mean diameter of an aggregate's spheres [mm]."""
    return math.exp(math.fsum(share * math.log(size) for size, share in part.sizes))


def _rank(part: Part) -> tuple[float, ...]:
    """Return by what the parts of a sweep are put in order: coarse to fine."""
    return (-_diameter(part), part.friction, part.rolling, part.packing_density, part.curve_error, part.input_error)


def _apart(shares: Floats, row: Floats) -> Floats:
    """Return the largest difference of a share between each place and one, shape (M,)."""
    return np.asarray(np.max(np.abs(shares - row), axis=1), dtype=np.float64)


def _tuple(row: Floats) -> tuple[float, ...]:
    return tuple(on_grid(share) for share in row.tolist())


def _next_test(one: _Sweep, surface: Surface, measured: Sequence[Measurement], method_error: float) -> NextTest | None:
    """Return the mix whose density test tells most of the densest, none within 0.02 of what is measured already.

    By the same rule as the next bed, but with all errors: of the inputs, the curves, and the method, which is taken as
    a Gaussian process of ``method_error`` that is none for the aggregates alone; what is measured is taken in first.
    """
    alone, allowed = vertices(one.shares), one.allowed()
    known = [int(np.argmin(_apart(one.shares, np.array(mix.shares)))) for mix in measured]
    wide = surface.with_more(_all_errors(one, surface) + pinned(one.shares, method_error, METHOD_LENGTH))
    for at, mix in zip(known, measured, strict=True):
        wide = wide.told(at, mix.standard_error)
    rows = [*(one.shares[at] for at in alone), *(np.array(mix.shares) for mix in measured)]
    free = np.array([at for at in allowed if min(_apart(np.array(rows), one.shares[at])) >= MEASURED], dtype=np.intp)
    if not free.size:
        return None
    chances = wide.densest_chances(allowed)
    at = int(free[np.argmax(wide.telling(chances, TEST_ERROR)[free])])
    before, after = (math.sqrt(chances @ one_.deviation**2) for one_ in (wide, wide.told(at, TEST_ERROR)))
    return NextTest(
        _tuple(one.shares[at]),
        float(wide.mean[at]),
        float(wide.deviation[at]),
        f"of the mixes not measured yet it tells most: a test good to {TEST_ERROR:g} would lower the error of the "
        f"densest mix's PD, with inputs and method, from {before:.4f} to {after:.4f}",
    )


def _all_errors(one: _Sweep, surface: Surface) -> Floats:
    """Return the covariance of PD by the errors of the aggregates' tests and curves, shape (M, M)."""
    alone = np.array([part.packing_density for part in one.parts])
    weight = one.shares * (surface.mean[:, None] / alone) ** 2
    inputs = weight * [part.input_error for part in one.parts]
    curves = weight @ [part.curve_error for part in one.parts]
    return np.asarray(inputs @ inputs.T + np.outer(curves, curves), dtype=np.float64)


def _warnings(one: _Sweep, densest: Densest, surface: Surface, wished_error: float) -> list[str]:
    """Return what there is to say of a sweep."""
    out = list[str]()
    if not one.is_known(densest, surface, wished_error):
        out.append(
            f"after {one.asked} beds the densest mix is known to ± {densest.standard_error:.4f}, and other proportions "
            f"may give {densest.to_gain:.4f} more; {wished_error:g} was wished: allow more beds by 'pdlab sweep --most'"
        )
    if one.too_large:
        out.append(f"{len(one.too_large)} of {len(one.shares)} proportions were left out: {one.too_large[0]}")
    out += [f"no bed at shares {' / '.join(f'{x:g}' for x in one.shares[at])}: {e}" for at, e in one.failed.items()]
    if one.stiffer > 1.0:
        out.append(
            f"contacts are up to {one.stiffer:g} times as stiff as in the calibrations, since beds were too soft"
        )
    said = [text for bed in one.done.values() for text in bed.warnings]
    return out + ([f"{said[-1]} (one of {len(said)} such notes on {len(one.done)} beds)"] if said else [])


def _turned(swept: Swept, order: NDArray[np.intp]) -> Swept:
    """Return a sweep with its aggregates in another order."""

    def turn(row: Sequence[T]) -> tuple[T, ...]:
        return tuple(row[k] for k in order)

    shares = swept.shares[:, order]
    rows = np.lexsort(shares.T[::-1])[::-1]
    densest, test = swept.densest, swept.next_test
    return Swept(
        turn(swept.aggregates),
        tuple(replace(point, shares=turn(point.shares)) for point in swept.points),
        shares[rows],
        swept.packing_density[rows],
        swept.deviation[rows],
        replace(densest, shares=turn(densest.shares), low=turn(densest.low), high=turn(densest.high)),
        None if test is None else replace(test, shares=turn(test.shares)),
        swept.warnings,
    )
