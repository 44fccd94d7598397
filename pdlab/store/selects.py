"""The only SELECTs."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, TypeVar

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite
from sqlalchemy.orm import Session, selectinload

from pdlab.errors import UnknownName
from pdlab.models import (
    Aggregate,
    Base,
    Calibration,
    Comparison,
    Draft,
    Mixture,
    MixtureComponent,
    PackingTest,
    Prediction,
    PredictionCalibration,
    Run,
    RunState,
    SieveAnalysis,
)

ENDED = ("done", "failed")
MOST_VALUES = 10_000
"""Values in one statement; SQLite takes 32 766, PostgreSQL 65 535."""

T = TypeVar("T")
Named = TypeVar("Named", Aggregate, Mixture)
Result = TypeVar("Result", Calibration, Prediction)

_WITH_TESTS = (
    selectinload(Aggregate.sieve_analyses).selectinload(SieveAnalysis.results),
    selectinload(Aggregate.packing_tests),
)
_MIXTURES = (
    sa.select(Mixture)
    .options(selectinload(Mixture.components).selectinload(MixtureComponent.aggregate))
    .options(selectinload(Mixture.packing_tests))
)
_CALIBRATIONS = (
    sa.select(Calibration)
    .options(selectinload(Calibration.runs), selectinload(Calibration.packing_test))
    .options(selectinload(Calibration.aggregate).options(*_WITH_TESTS))
    .order_by(Calibration.requested_at.desc(), Calibration.id.desc())
)
_PREDICTIONS = (
    sa.select(Prediction)
    .options(
        selectinload(Prediction.runs),
        selectinload(Prediction.calibrations)
        .selectinload(PredictionCalibration.calibration)
        .options(selectinload(Calibration.aggregate).options(*_WITH_TESTS), selectinload(Calibration.packing_test)),
    )
    .options(selectinload(Prediction.mixture).selectinload(Mixture.packing_tests))
    .options(selectinload(Prediction.mixture).selectinload(Mixture.components).selectinload(MixtureComponent.aggregate))
    .order_by(Prediction.requested_at.desc(), Prediction.id.desc())
)


def add_all(session: Session, rows: Sequence[Any]) -> None:
    """Add rows and give them their keys."""
    session.add_all(rows)
    session.flush()


def find_aggregate(session: Session, name: str, delivery: str, exact: bool = False) -> Aggregate | None:
    """Return one delivery of an aggregate; None where the store holds none.

    An empty delivery is the one without a name, or, unless ``exact``, the only one there is.
    """
    found = {row.delivery: row for row in session.scalars(sa.select(Aggregate).where(Aggregate.name == name))}
    return choose_delivery(found, delivery, exact)


def choose_delivery(found: Mapping[str, Aggregate], delivery: str, exact: bool = False) -> Aggregate | None:
    """Return one of an aggregate's deliveries, as ``find_aggregate`` does; ``found``: all of them, by their names."""
    if not exact and not delivery and delivery not in found and len(found) == 1:
        return next(iter(found.values()))
    return found.get(delivery)


def aggregates_named(session: Session, names: Sequence[str]) -> dict[str, dict[str, Aggregate]]:
    """Return all deliveries of those of the named aggregates that the store holds, with their tests.

    By name and delivery, the deliveries in the order of their coming.
    """
    out = dict[str, dict[str, Aggregate]]()
    query = sa.select(Aggregate).options(*_WITH_TESTS).order_by(Aggregate.id)
    for row in (row for part in parts(names) for row in session.scalars(query.where(Aggregate.name.in_(part)))):
        out.setdefault(row.name, {})[row.delivery] = row
    return out


def mixtures_named(session: Session, names: Sequence[str], with_tests: bool = False) -> dict[str, Mixture]:
    """Return those of the named mixtures that the store holds, by name, with their components."""
    query = sa.select(Mixture).options(selectinload(Mixture.components).selectinload(MixtureComponent.aggregate))
    if with_tests:
        query = query.options(selectinload(Mixture.packing_tests))
    found = (row for part in parts(names) for row in session.scalars(query.where(Mixture.name.in_(part))))
    return {row.name: row for row in found}


def deliveries(session: Session, name: str) -> list[str]:
    """Return the deliveries of an aggregate that the store holds, in the order of their coming."""
    return list(session.scalars(sa.select(Aggregate.delivery).where(Aggregate.name == name).order_by(Aggregate.id)))


def find_mixture(session: Session, name: str) -> Mixture | None:
    """Return a mixture by its name; None where the store holds none."""
    return session.scalars(sa.select(Mixture).where(Mixture.name == name)).first()


def aggregates(session: Session, names: Sequence[str] = ()) -> list[Aggregate]:
    """Return the newest delivery of each aggregate, of all or of the named. Raises UnknownName."""
    newest = sa.select(sa.func.max(Aggregate.id)).group_by(Aggregate.name)
    query = sa.select(Aggregate).where(Aggregate.id.in_(newest)).options(*_WITH_TESTS).order_by(Aggregate.id)
    return _named(session, Aggregate, names, query)


def aggregates_by_id(session: Session, ids: Sequence[int]) -> list[Aggregate]:
    """Return aggregates, of whatever delivery, with their tests, in the order of their coming."""
    query = sa.select(Aggregate).options(*_WITH_TESTS).order_by(Aggregate.id)
    return [row for part in parts(sorted(ids)) for row in session.scalars(query.where(Aggregate.id.in_(part)))]


def all_deliveries(session: Session) -> list[Aggregate]:
    """Return every delivery of every aggregate with its tests, in the order of their coming."""
    return list(session.scalars(sa.select(Aggregate).options(*_WITH_TESTS).order_by(Aggregate.id)))


def mixtures(session: Session, names: Sequence[str] = ()) -> list[Mixture]:
    """Return mixtures with their components, the oldest first, all or the named. Raises UnknownName."""
    return _named(session, Mixture, names, _MIXTURES.order_by(Mixture.id))


def mixtures_by_id(session: Session, ids: Sequence[int]) -> list[Mixture]:
    """Return mixtures with their components, the oldest first."""
    query = _MIXTURES.order_by(Mixture.id)
    return [row for part in parts(sorted(ids)) for row in session.scalars(query.where(Mixture.id.in_(part)))]


def _named(session: Session, table: type[Named], names: Sequence[str], query: sa.Select[Named]) -> list[Named]:
    """Return the rows of a query that are named, in the order of the names; all of them without names."""
    if not names:
        return list(session.scalars(query))
    found = {row.name: row for part in parts(names) for row in session.scalars(query.where(table.name.in_(part)))}
    missing = [name for name in names if name not in found]
    if missing:
        kind = table.__tablename__
        known = session.scalars(sa.select(table.name).distinct().order_by(table.name).limit(8))
        raise UnknownName(
            f"the store holds no {kind} named {', '.join(repr(name) for name in missing)} "
            f"(it holds: {', '.join(known) or 'none yet'}); import it or correct the name"
        )
    return [found[name] for name in dict.fromkeys(names)]


def parts(values: Sequence[T]) -> Iterator[Sequence[T]]:
    """Cut values into parts of as many as one statement takes."""
    return (values[k : k + MOST_VALUES] for k in range(0, len(values), MOST_VALUES))


def done_runs(session: Session, digests: Sequence[str]) -> dict[str, Run]:
    """Return the runs among ``digests`` that are done, by digest."""
    query = sa.select(Run).where(Run.state == "done")
    found = (run for part in parts(digests) for run in session.scalars(query.where(Run.specimen_hash.in_(part))))
    return {run.specimen_hash: run for run in found}


def newest_done(session: Session, engine_version: int, most: int) -> list[tuple[str, int, float | None, str | None]]:
    """Return the specimen, steps, seconds [s] and processor of the newest runs that an engine version has done."""
    query = (
        sa.select(Run.specimen, Run.steps, Run.seconds, Run.processor)
        .where(Run.state == "done", Run.engine_version == engine_version, Run.steps.is_not(None))
        .order_by(Run.finished_at.desc())
    )
    return [
        (specimen, steps or 0, seconds, there) for specimen, steps, seconds, there in session.execute(query.limit(most))
    ]


def done_digests(session: Session, digests: Sequence[str]) -> set[str]:
    """Return which runs are done."""
    query = sa.select(Run.specimen_hash).where(Run.state == "done")
    found = (session.scalars(query.where(Run.specimen_hash.in_(part))) for part in parts(digests))
    return {digest for some in found for digest in some}


def save_run(session: Session, run: Run, state: RunState | None) -> None:
    """Write a run, over an earlier unsuccessful try of the same specimen."""
    upsert(session, Run, [columns_of(run)])
    if state is not None:
        upsert(session, RunState, [columns_of(state)])


def add_runs(session: Session, rows: Sequence[Run]) -> None:
    """Write runs that the store has none of yet; whatever it knows of the others stays, also that one is under way."""
    digests = [row.specimen_hash for row in rows]
    known = sa.select(Run.specimen_hash)
    there = {digest for part in parts(digests) for digest in session.scalars(known.where(Run.specimen_hash.in_(part)))}
    add_all(session, [row for row in rows if row.specimen_hash not in there])


def columns_of(row: Base) -> dict[str, Any]:
    """Return the columns of a row that were set, by name."""
    return {name: value for name, value in vars(row).items() if not name.startswith("_")}


def upsert(session: Session, table: type[Base], rows: Sequence[dict[str, Any]]) -> None:
    """Write rows with the same columns each, over those that are there with the same key."""
    if not rows:
        return
    insert: Any = {"sqlite": sqlite.insert, "postgresql": postgresql.insert}[session.get_bind().dialect.name](table)
    keys = [key.name for key in sa.inspect(table).primary_key]
    changed = {name: insert.excluded[name] for name in rows[0] if name not in keys}
    session.execute(insert.on_conflict_do_update(index_elements=keys, set_=changed), list(rows))


def runs(session: Session) -> list[Run]:
    """Return all runs, the newest first."""
    return list(session.scalars(sa.select(Run).order_by(Run.finished_at.desc(), Run.specimen_hash)))


def find_run(session: Session, beginning: str) -> Run:
    """Return the run whose specimen hash has this ``beginning``, 4 characters or more.

    Raises UnknownName unless there is exactly one.
    """
    if not re.fullmatch("[0-9a-f]{4,64}", beginning):
        raise UnknownName(
            f"'{beginning}' cannot begin a run's hash, which takes 4 to 64 of the characters 0-9 and a-f; "
            "see 'pdlab ls runs'"
        )
    within = (Run.specimen_hash >= beginning) & (Run.specimen_hash < beginning + "g")  # which an index answers
    query = sa.select(Run).where(within).order_by(Run.specimen_hash).limit(2)
    found = list(session.scalars(query))
    if not found:
        raise UnknownName(f"the store holds no run whose hash begins with {beginning}; see 'pdlab ls runs'")
    if len(found) > 1:
        raise UnknownName(
            f"the hashes of several runs begin with {beginning}, among them "
            f"{' and '.join(run.specimen_hash[: len(beginning) + 4] for run in found)}; give more characters"
        )
    return found[0]


def find_bed(session: Session, beginning: str) -> tuple[Run, RunState]:
    """Return the run that ``find_run`` finds, and its bed. Raises UnknownName, also when it keeps no bed."""
    run = find_run(session, beginning)
    bed = session.get(RunState, run.specimen_hash)
    if bed is None:
        raise UnknownName(
            f"run {run.specimen_hash[:12]} ({run.state}) keeps no bed; choose another, see 'pdlab ls runs'"
        )
    return run, bed


def newest_engine(session: Session) -> int | None:
    """Return the newest engine version that any run of the store is of, None without runs."""
    return session.scalar(sa.select(sa.func.max(Run.engine_version)).where(Run.engine_version > sa.literal_column("0")))


def calibrations(session: Session, aggregate_ids: Sequence[int] | None = None) -> list[Calibration]:
    """Return calibrations, done or failed, with their runs, the last asked for first."""
    query = _CALIBRATIONS.where(Calibration.state.in_(ENDED))
    if aggregate_ids is not None:
        query = query.where(Calibration.aggregate_id.in_(aggregate_ids))
    return list(session.scalars(query))


def calibrations_by_id(session: Session, ids: Sequence[int]) -> list[Calibration]:
    """Return calibrations, whatever their state, with their aggregates and runs."""
    return [row for part in parts(ids) for row in session.scalars(_CALIBRATIONS.where(Calibration.id.in_(part)))]


def done_calibrations(session: Session, aggregate_ids: Sequence[int], engine_version: int) -> list[Calibration]:
    """Return calibrations of aggregates that are done, by an engine version, the last asked for first, and no more."""
    query = (
        sa.select(Calibration)
        .options(selectinload(Calibration.packing_test))
        .where(Calibration.state == "done", Calibration.engine_version == engine_version)
        .order_by(Calibration.requested_at.desc(), Calibration.id.desc())
    )
    return [
        row for part in parts(aggregate_ids) for row in session.scalars(query.where(Calibration.aggregate_id.in_(part)))
    ]


def newest_calibrations(session: Session, aggregate_ids: Sequence[int]) -> set[int]:
    """Return the ids of the calibrations of aggregates that were asked for last and have ended; no variant."""
    last = (
        sa.func.row_number()
        .over(
            partition_by=Calibration.aggregate_id,
            order_by=(Calibration.requested_at.desc(), Calibration.id.desc()),
        )
        .label("place")
    )
    ended = sa.select(Calibration.id, last).where(Calibration.variant == "", Calibration.state.in_(ENDED))
    out = set[int]()
    for part in parts(aggregate_ids):
        ranked = ended.where(Calibration.aggregate_id.in_(part)).subquery()
        out.update(session.scalars(sa.select(ranked.c.id).where(ranked.c.place == 1)))
    return out


def predictions_by_id(session: Session, ids: Sequence[int]) -> list[Prediction]:
    """Return predictions with what they rest on."""
    return [row for part in parts(ids) for row in session.scalars(_PREDICTIONS.where(Prediction.id.in_(part)))]


def done_predictions(
    session: Session, mixture_ids: Sequence[int], method: str, variant: str, engine_version: int
) -> dict[int, list[Prediction]]:
    """Return, by mixture, the predictions by a method that are done, the last asked for first, with their links.

    By an engine version, or by none where nothing was simulated.
    """
    query = (
        sa.select(Prediction)
        .options(selectinload(Prediction.runs), selectinload(Prediction.calibrations))
        .where(Prediction.state == "done", Prediction.method == method, Prediction.variant == variant)
        .where(sa.or_(Prediction.engine_version == engine_version, Prediction.engine_version.is_(None)))
        .order_by(Prediction.requested_at.desc(), Prediction.id.desc())
    )
    out = dict[int, list[Prediction]]()
    for part in parts(mixture_ids):
        for row in session.scalars(query.where(Prediction.mixture_id.in_(part))):
            out.setdefault(row.mixture_id, []).append(row)
    return out


def not_newest(session: Session, ids: Sequence[int]) -> list[int]:
    """Return those of these predictions that are not the ones last asked for of their mixtures and methods."""
    out = list[int]()
    for part in parts(ids):
        shown = sa.select(Comparison.prediction_id).where(Comparison.prediction_id.in_(part))
        older = sa.select(Prediction.id).where(Prediction.id.in_(part), Prediction.variant == "")
        out += session.scalars(older.where(Prediction.id.not_in(shown)))
    return out


def predictions(session: Session, mixture_ids: Sequence[int] | None = None) -> list[Prediction]:
    """Return predictions, done or failed, with what they rest on, the last asked for first."""
    query = _PREDICTIONS.where(Prediction.state.in_(ENDED))
    if mixture_ids is not None:
        query = query.where(Prediction.mixture_id.in_(mixture_ids))
    return list(session.scalars(query))


def newest_predictions(session: Session, mixture_ids: Sequence[int]) -> dict[int, list[Prediction]]:
    """Return, by mixture, each method's prediction last asked for, done or failed, with what it rests on.

    The oldest stands first. Variants are left out.
    """
    newest = sa.select(Comparison.prediction_id)
    queries = (
        _PREDICTIONS.where(Prediction.id.in_(newest.where(Comparison.mixture_id.in_(part))))
        for part in parts(mixture_ids)
    )
    out = dict[int, list[Prediction]]()
    for row in sorted((row for query in queries for row in session.scalars(query)), key=lambda row: row.id):
        out.setdefault(row.mixture_id, []).append(row)
    return out


def equal_results(session: Session, table: type[Result], facts: dict[str, Any], digests: set[str]) -> list[Result]:
    """Return the stored results, last asked for first, that have these facts and rest on exactly these runs."""
    query = sa.select(table).filter_by(**facts).order_by(table.requested_at.desc(), table.id.desc())
    rows = session.scalars(query.options(selectinload(table.runs)))
    return [row for row in rows if {link.specimen_hash for link in row.runs} == digests]


def newest_test(tests: Sequence[PackingTest]) -> PackingTest | None:
    """Return the current density test of a material."""
    return max(tests, key=lambda test: test.id, default=None)


def drafts(session: Session, kind: str, most: int) -> list[Draft]:
    """Return the drafts of a kind that were saved last, the newest first."""
    newest = sa.select(Draft).where(Draft.kind == kind).order_by(Draft.saved_at.desc(), Draft.id.desc())
    return list(session.scalars(newest.limit(most)))


def delete_draft(session: Session, draft_id: int) -> None:
    """Delete a draft where there is one."""
    session.execute(sa.delete(Draft).where(Draft.id == draft_id))
