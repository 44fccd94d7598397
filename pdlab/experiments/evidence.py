"""Rows as a lab report shows them: sieve tables and density tests as entered, calibrations, runs, corrections."""

import datetime as dt
import itertools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy.orm import Session

from pdlab import density, grading, store
from pdlab.errors import InputError
from pdlab.experiments.addresses import row_key
from pdlab.experiments.descent import history
from pdlab.experiments.readings import (
    an_object,
    current_grading,
    kept,
    measured_test,
    particle_density,
    protocol_kept,
    sieve_table,
    specimen_kept,
)
from pdlab.grading import Grading
from pdlab.models import Aggregate, Base, Calibration, Correction, Mixture, PackingTest, Prediction, Run, SieveAnalysis
from pdlab.tables import DENSITY_KINDS


@dataclass(frozen=True)
class SieveLine:
    """A line of a sieve table: its ``aperture`` [mm], None for the pan, what was entered, and what that means.

    ``value``: in the unit of the table's kind; ``retained`` and ``passing`` [%], None where the table is no grading.
    """

    aperture: float | None
    raw_text: str
    value: float
    retained: float | None = None
    passing: float | None = None


@dataclass(frozen=True)
class SieveTest:
    """A sieve analysis as entered; ``kind`` as in ``grading.KINDS``, ``sample_mass`` [g], ``pan_lower`` [mm].

    ``current``: whether it is the newest; ``notes``: what was assumed, or why it is no grading.
    """

    key: int
    kind: str
    standard: str
    date: dt.date | None
    sample_mass: float | None
    pan_lower: float | None
    entered_at: dt.datetime
    current: bool
    lines: tuple[SieveLine, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class DensityTest:
    """A density test as entered, and the packing density ± its error [-] that it means, None where it means none.

    ``kind``: as in ``tables.DENSITY_KINDS``, the unit of ``value`` and ``standard_deviation``; container [mm].
    """

    key: int
    kind: str
    value: float
    compaction: str
    repeats: int | None
    standard_deviation: float | None
    container_diameter: float | None
    container_height: float | None
    moisture_percent: float | None
    standard: str
    date: dt.date | None
    raw_text: str
    entered_at: dt.datetime
    current: bool
    packing_density: float | None = None
    standard_error: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def voids_percent(self) -> float | None:
        """The voids [%] that it means."""
        return None if self.packing_density is None else density.voids_percent(self.packing_density)


@dataclass(frozen=True)
class ShownCorrection:
    """What was corrected in a row: ``row`` as it is addressed, a text of before and after, empty for none."""

    row: str
    column: str
    before: str
    after: str
    by: str
    reason: str
    at: dt.datetime


@dataclass(frozen=True)
class AggregateInputs:
    """What was entered of an aggregate: densities [kg/m³], absorption [%], angles [degrees], sieves, density tests.

    ``sieves``: the current analysis and those that are asked for; ``other_sieves``: how many there are beside them.
    """

    key: int
    name: str
    source: str
    shape: str
    particle_density: float | None
    density_basis: str
    water_absorption_percent: float | None
    oven_dry: float | None
    repose_angle_deg: float | None
    wall_angle_deg: float | None
    entered_at: dt.datetime
    version: int
    sieves: tuple[SieveTest, ...]
    other_sieves: int
    tests: tuple[DensityTest, ...]
    corrections: tuple[ShownCorrection, ...]
    grading: Grading | None = None


@dataclass(frozen=True)
class ShownRun:
    """A bed or heap that a result rests on; ``spheres``: count, diameter over the largest, μ and μr of each species."""

    digest: str
    seed: int
    spheres: tuple[tuple[int, float, float, float], ...]
    packing_density: float | None
    repose_angle_deg: float | None
    steps: int | None
    engine_version: int
    numba_version: str
    processor: str


@dataclass(frozen=True)
class ShownCalibration:
    """A calibration with its runs; ``friction`` and ``rolling``: value and interval [-], None for an open end.

    ``measured``: packing density [-]; ``angle`` [degrees]; ``settings``: those of the protocol by name.
    """

    key: int
    aggregate: str
    method: str
    state: str
    diameter: float
    rule: str
    leave_out: float | None
    sieve_analysis: int
    density_test: int | None
    measured: float | None
    angle: float | None
    friction: tuple[float | None, float | None, float | None]
    rolling: tuple[float | None, float | None, float | None]
    packing_density: float | None
    input_error: float | None
    curve_error: float | None
    engine_version: int | None
    finished_at: dt.datetime | None
    message: str
    warnings: tuple[str, ...]
    settings: Mapping[str, Any]
    runs: tuple[ShownRun, ...]


def aggregate_inputs(session: Session, row: Aggregate, analyses: Collection[int] = ()) -> AggregateInputs:
    """Return what was entered of an aggregate that came with its tests; ``analyses``: ids of sieve analyses to show."""
    newest = row.sieve_analyses[-1:]
    shown = [one for one in row.sieve_analyses if one.id in analyses or one in newest]
    parts: list[tuple[Base, dt.datetime]] = [(row, row.created_at)]
    parts += [(one, one.created_at) for one in shown] + [(one, one.created_at) for one in row.packing_tests]
    parts += [(line, one.created_at) for one in shown for line in one.results]
    return AggregateInputs(
        row.id, f"{row.name} {row.delivery}".strip(), row.source or "", row.shape or "",
        row.particle_density_kg_m3, row.density_basis or "", row.water_absorption_percent, _or_none(row),
        row.repose_angle_deg, row.wall_angle_deg, row.created_at, row.version,
        tuple(_sieve_test(one, one in newest) for one in shown), len(row.sieve_analyses) - len(shown),
        density_tests(row.packing_tests, _or_none(row)),
        corrections_of(session, parts), _grading_or_none(row),
    )  # fmt: skip


def density_tests(rows: Sequence[PackingTest], particle: float | None) -> tuple[DensityTest, ...]:
    """Return density tests of a material as entered, the newest last; ``particle``: oven-dry density [kg/m³]."""
    newest = store.newest_test(rows)
    return tuple(_density_test(row, particle, row is newest) for row in rows)


def corrections_of(session: Session, rows: Sequence[tuple[Base, dt.datetime]]) -> tuple[ShownCorrection, ...]:
    """Return what was corrected in rows since each was entered, the oldest first."""
    found = history(session, {(row.__tablename__, row_key(row)): entered for row, entered in rows})
    return tuple(map(_corrected, found))


def calibration_shown(row: Calibration) -> ShownCalibration:
    """Return a calibration that came with its descent."""
    return ShownCalibration(
        row.id, f"{row.aggregate.name} {row.aggregate.delivery}".strip(), row.method, row.state, row.diameter_mm,
        row.diameter_rule, row.leave_out_below_mm, row.sieve_analysis_id, row.packing_test_id,
        row.measured_packing_density, row.measured_angle_deg, (row.friction, row.friction_low, row.friction_high),
        (row.rolling_friction, row.rolling_friction_low, row.rolling_friction_high), row.packing_density,
        row.input_error, row.curve_error, row.engine_version, row.finished_at, row.message or "",
        tuple((row.warnings or "").splitlines()), protocol_kept(row).settings(),
        runs_shown([link.run for link in row.runs]),
    )  # fmt: skip


def runs_shown(rows: Sequence[Run]) -> tuple[ShownRun, ...]:
    """Return runs in the order of their spheres and seeds."""
    return tuple(sorted(map(_run, rows), key=lambda run: (run.spheres, run.seed, run.digest)))


def settings_of(row: Prediction) -> Mapping[str, Any]:
    """Return the protocol that a prediction's beds were made by, or what a geometric reference keeps of itself.

    Empty of a wish that failed before any bed.
    """
    return kept(row, "protocol", an_object) if row.protocol else {}


def mixture_corrections(session: Session, row: Mixture) -> tuple[ShownCorrection, ...]:
    """Return what was corrected in a mixture, its shares and its density tests, the oldest first."""
    tests = [(test, test.created_at) for test in row.packing_tests]
    return corrections_of(session, [*((one, row.created_at) for one in (row, *row.components)), *tests])


def _or_none(row: Aggregate) -> float | None:
    try:
        return particle_density(row)
    except InputError:  # which its density test says as well
        return None


def _grading_or_none(row: Aggregate) -> Grading | None:
    try:
        return current_grading(row)
    except InputError:  # which its sieve table says as well
        return None


def _sieve_test(row: SieveAnalysis, current: bool) -> SieveTest:
    table = sieve_table(row)
    try:
        made = grading.make_grading(table)
        passing, notes = _passing(row, made), made.warnings
    except InputError as error:
        passing, notes = {}, (str(error),)
    falling = sorted(passing, key=lambda aperture: -(aperture or 0.0))
    held = {fine: passing[coarse] - passing[fine] for coarse, fine in itertools.pairwise(falling)}
    lines = [
        SieveLine(
            one.aperture_mm, " ".join(one.raw_text.split()), getattr(one, row.kind),
            held.get(one.aperture_mm, 100.0 - passing[one.aperture_mm]) if passing else None,
            passing.get(one.aperture_mm),
        )
        for one in row.results
    ]  # fmt: skip
    return SieveTest(
        row.id, row.kind, row.standard or "", row.date, row.sample_mass_g, row.pan_lower_mm, row.created_at, current,
        tuple(lines), tuple(notes),
    )  # fmt: skip


def _passing(row: SieveAnalysis, made: Grading) -> dict[float | None, float]:
    """Return the percent that passes each sieve of an analysis, by its aperture [mm]."""
    return {
        one.aperture_mm: 0.0 if one.aperture_mm is None else 100.0 * grading.passing_at(made, one.aperture_mm)
        for one in row.results
    }


def _density_test(row: PackingTest, particle: float | None, current: bool) -> DensityTest:
    kind = next(name for name in DENSITY_KINDS if getattr(row, name) is not None)
    packing, error, notes = None, None, tuple[str, ...]()
    try:
        measured = measured_test(row, particle)
        packing, error, notes = measured.packing_density, measured.standard_error, measured.warnings
    except InputError as wrong:
        notes = (str(wrong),)
    return DensityTest(
        row.id, kind, getattr(row, kind), row.compaction, row.repeats, row.standard_deviation,
        row.container_diameter_mm, row.container_height_mm, row.moisture_percent, row.standard or "", row.date,
        " ".join(row.raw_text.split()), row.created_at, current, packing, error, notes,
    )  # fmt: skip


def _corrected(one: Correction) -> ShownCorrection:
    return ShownCorrection(
        f"{one.table_name}:{one.row_key}", one.column_name, one.old_value or "", one.new_value or "",
        one.corrected_by, one.reason or "", one.corrected_at,
    )  # fmt: skip


def _run(row: Run) -> ShownRun:
    species = specimen_kept(row).species
    spheres = tuple((kind.count, kind.diameter, kind.friction, kind.rolling) for kind in species)
    return ShownRun(
        row.specimen_hash, row.seed, spheres, row.packing_density, row.repose_angle_deg, row.steps,
        row.engine_version, row.numba_version or "", row.processor or "",
    )  # fmt: skip
