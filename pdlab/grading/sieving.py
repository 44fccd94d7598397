"""Sieves → size distribution.

A sieve class lies between two apertures; its size is their geometric mean, its share is by solid
volume. Grains of one rock have one density, so shares by mass are shares by solid volume.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from pdlab.errors import GradingError

KINDS = ("retained_g", "retained_percent", "passing_percent")
LOSS_LIMIT = 0.01
"""Share of the sample mass by which the sieved masses may be off."""
PAN_LIMIT = 0.10
"""Share that may fall into a pan without a lower size."""
SMALLEST, LARGEST = 1e-4, 1e4
"""Apertures in mm outside which an entry is a typing error."""


@dataclass(frozen=True)
class SieveRow:
    """One line of a sieve table: ``aperture`` [mm], None for the pan, and its value."""

    aperture: float | None
    value: float


@dataclass(frozen=True)
class SieveTable:
    """A sieve analysis as entered: rows of one ``kind`` (retained_g, retained_percent, passing_percent).

    ``sample_mass`` [g], ``pan_lower`` [mm], the smallest grain in the pan, where they are known.
    """

    rows: tuple[SieveRow, ...]
    kind: str
    sample_mass: float | None = None
    pan_lower: float | None = None


@dataclass(frozen=True)
class Grading:
    """A size distribution between K + 1 apertures.

    ``apertures`` [mm], shape (K + 1,), falling, the limits of K classes; ``shares`` [-], shape (K,),
    of the solid volume, their sum 1; ``sieves``: how many of the apertures were sieves of the table.
    """

    apertures: tuple[float, ...]
    shares: tuple[float, ...]
    sieves: int
    warnings: tuple[str, ...] = ()

    @property
    def sizes(self) -> np.ndarray:
        """Geometric mean of each class's apertures [mm], shape (K,)."""
        apertures = np.array(self.apertures)
        return np.asarray(np.sqrt(apertures[:-1] * apertures[1:]), dtype=np.float64)

    @property
    def passing(self) -> np.ndarray:
        """Share that passes each aperture [-], shape (K + 1,), from 1 at the coarsest to 0."""
        remaining = 1.0 - np.cumsum(self.shares)
        return np.asarray(np.clip([1.0, *remaining], 0.0, 1.0), dtype=np.float64)


def check(table: SieveTable) -> list[GradingError]:
    """Return everything that is wrong in a sieve table, each with its row; empty when it is sound."""
    sieves = [(k, row) for k, row in enumerate(table.rows) if row.aperture is not None]
    if table.kind not in KINDS:
        return [GradingError(f"'{table.kind}' is no sieve value; use one of {', '.join(KINDS)}")]
    if not sieves:
        return [GradingError("the sieve table is empty; enter at least one sieve with its aperture in mm")]
    wrong = check_rows(table) + _check_order(sieves)
    if not wrong:
        wrong = _check_passing(sieves) if table.kind == "passing_percent" else _check_retained(table)
    return wrong or _check_limits(table)


def check_rows(table: SieveTable) -> list[GradingError]:
    """Return what is wrong in single rows of a sieve table, each with its row."""
    wrong, seen, pans = [], set[float](), 0
    most = math.inf if table.kind == "retained_g" else 100.0
    for k, row in enumerate(table.rows):
        if row.aperture is None:
            pans += 1
            if pans > 1:
                wrong.append(GradingError("the pan stands twice; keep one pan row", k))
        elif not SMALLEST <= row.aperture <= LARGEST:
            limits = "be above 0" if row.aperture <= 0.0 else f"lie between {SMALLEST:g} and {LARGEST:g}"
            wrong.append(GradingError(f"aperture {row.aperture:g} mm must {limits}; correct it", k))
        elif row.aperture in seen:
            wrong.append(GradingError(f"aperture {row.aperture:g} mm stands twice; keep one of the rows", k))
        else:
            seen.add(row.aperture)
        if not 0.0 <= row.value <= most:
            limits = "at least 0" if most == math.inf else "between 0 and 100"
            wrong.append(GradingError(f"{table.kind} {row.value:g} must be {limits}; correct it", k))
        elif row.aperture is None and table.kind == "passing_percent" and row.value != 0.0:
            wrong.append(GradingError(f"{row.value:g} % pass the pan; nothing does: enter 0", k))
    return wrong


def _check_order(sieves: list[tuple[int, SieveRow]]) -> list[GradingError]:
    sieves = [(k, row) for k, row in sieves if (row.aperture or 0.0) > 0.0]  # the others are named already
    apertures = [row.aperture or 0.0 for _, row in sieves]
    rising = len(apertures) > 1 and apertures[-1] > apertures[0]
    for (k, _), before, now in zip(sieves[1:], apertures[:-1], apertures[1:], strict=True):
        if now != before and (now > before) != rising:
            return [
                GradingError(
                    f"aperture {now:g} mm after {before:g} mm is out of order; "
                    "list the sieves from coarse to fine or from fine to coarse", k,
                )
            ]  # fmt: skip
    return []


def _check_passing(sieves: list[tuple[int, SieveRow]]) -> list[GradingError]:
    falling = sorted(sieves, key=lambda item: -(item[1].aperture or 0.0))
    return [
        GradingError(
            f"{fine.value:g} % pass {fine.aperture:g} mm but only {coarse.value:g} % pass "
            f"{coarse.aperture:g} mm; percent passing must not rise towards finer sieves", k,
        )
        for (_, coarse), (k, fine) in itertools.pairwise(falling)
        if fine.value > coarse.value
    ]  # fmt: skip


def _check_retained(table: SieveTable) -> list[GradingError]:
    total = math.fsum(row.value for row in table.rows)
    whole, unit = (table.sample_mass, "g") if table.kind == "retained_g" else (100.0, "%")
    if whole is not None and not (math.isfinite(whole) and whole > 0.0):
        return [GradingError(f"sample mass {whole:g} g must be above 0; leave it empty when unknown")]
    if total <= 0.0:
        return [GradingError("nothing was retained on any sieve or in the pan; enter what each holds")]
    if whole is not None and abs(total - whole) > LOSS_LIMIT * whole:
        what = "the sample mass of " if table.kind == "retained_g" else ""
        return [
            GradingError(
                f"the retained values sum to {total:g} {unit}, {100 * abs(total / whole - 1):.2g} % off {what}"
                f"{whole:g} {unit}, more than the limit of {100 * LOSS_LIMIT:g} %; weigh again, or add the "
                "pan row if it is missing"
            )
        ]
    return []


def _check_limits(table: SieveTable) -> list[GradingError]:
    """Check that the coarsest material has an upper and the pan, when it counts, a lower size."""
    apertures, passing, pan_row = _cumulative(table)
    coarsest = next(k for k, row in enumerate(table.rows) if row.aperture == apertures[0])
    wrong = []
    if passing[0] < 1.0 - 1e-12:
        wrong.append(
            GradingError(
                f"{100 * (1 - passing[0]):.3g} % lie on the coarsest sieve, {apertures[0]:g} mm, and have no "
                "upper size limit; add the next larger sieve, which everything passes", coarsest,
            )
        )  # fmt: skip
    if table.pan_lower is not None and not 0.0 < table.pan_lower < apertures[-1]:
        wrong.append(
            GradingError(
                f"the pan's lower size {table.pan_lower:g} mm must lie between 0 and the finest aperture, "
                f"{apertures[-1]:g} mm; correct it", pan_row,
            )
        )  # fmt: skip
    elif table.pan_lower is None and passing[-1] > PAN_LIMIT:
        wrong.append(
            GradingError(
                f"{100 * passing[-1]:.3g} % fell into the pan, more than {100 * PAN_LIMIT:g} %, without a lower "
                "size; add finer sieves or state the pan's lower size", pan_row,
            )
        )  # fmt: skip
    return wrong


def _cumulative(table: SieveTable) -> tuple[list[float], list[float], int | None]:
    """Return apertures falling, the share passing each, and the pan's row."""
    sieves = sorted((row.aperture, row.value) for row in table.rows if row.aperture is not None)[::-1]
    pan_row = next((k for k, row in enumerate(table.rows) if row.aperture is None), None)
    apertures = [aperture for aperture, _ in sieves]
    if table.kind == "passing_percent":
        return apertures, [value / 100.0 for _, value in sieves], pan_row
    total = math.fsum(row.value for row in table.rows)
    held = np.cumsum([value for _, value in sieves]) / total
    passing = [max(0.0, 1.0 - float(share)) for share in held]
    if pan_row is None or table.rows[pan_row].value == 0.0:
        passing[-1] = 0.0  # what is left is rounding
    return apertures, passing, pan_row


def make_grading(table: SieveTable, pan_factor: float = 1.0) -> Grading:
    """Return the size distribution of a sieve table. Raises the first GradingError of ``check``.

    A pan without a lower size takes half the finest aperture, times ``pan_factor`` [-].
    """
    wrong = check(table)
    if wrong:
        raise wrong[0]
    apertures, passing, _ = _cumulative(table)
    sieves, warnings = len(apertures), list[str]()
    if passing[-1] > 0.0:
        lower = table.pan_lower
        if lower is None:
            lower = apertures[-1] / 2.0 * pan_factor
            warnings.append(
                f"the pan's {100 * passing[-1]:.3g} % have no lower size: half the finest aperture, "
                f"{lower:g} mm, is taken; a factor of 2 in it changes the log-mean diameter by "
                f"{100 * (2 ** (passing[-1] / 2) - 1):.2g} %"
            )
        apertures, passing = [*apertures, lower], [*passing, 0.0]
    total = math.fsum(row.value for row in table.rows)
    whole = table.sample_mass if table.kind == "retained_g" else 100.0
    if table.kind != "passing_percent" and whole is not None and abs(total / whole - 1.0) > 1e-6:
        warnings.append(f"the retained values sum to {total:g} of {whole:g}; shares are of the sum")
    first = max(k for k, share in enumerate(passing) if share >= 1.0 - 1e-12)
    last = next((k for k, share in enumerate(passing) if share <= 1e-12), len(passing) - 1)
    kept = passing[first : last + 1]
    shares = tuple(coarse - fine for coarse, fine in itertools.pairwise(kept))
    sieves = min(sieves, last + 1) - first
    return Grading(tuple(apertures[first : last + 1]), shares, sieves, tuple(warnings))


def sieve_classes(grading: Grading, finest: float = 0.0) -> tuple[tuple[float, float], ...]:
    """Return size [mm] and share [-] of each class that holds something, coarse to fine, the shares' sum 1.

    ``finest``: classes whose size lies below it [mm] are left out. Raises GradingError when nothing is left.
    """
    kept = [(float(d), w) for d, w in zip(grading.sizes, grading.shares, strict=True) if w > 0.0 and d >= finest]
    if not kept:
        raise GradingError(f"nothing is left of the grading above {finest:g} mm; leave out less")
    whole = math.fsum(share for _, share in kept)
    return tuple((size, share / whole) for size, share in kept)


def assumes_pan(table: SieveTable) -> bool:
    """Return whether something fell into a pan whose lower size is not stated and has to be assumed."""
    return table.pan_lower is None and _cumulative(table)[1][-1] > 0.0


def passing_at(grading: Grading, aperture: float) -> float:
    """Return the share [-] that passes an ``aperture`` [mm], interpolated over its logarithm."""
    rising, log_aperture = grading.passing[::-1], np.log(grading.apertures)[::-1]
    return float(np.interp(math.log(aperture), log_aperture, rising, left=0.0, right=1.0))
