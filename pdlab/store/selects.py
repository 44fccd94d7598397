"""The only SELECTs."""

import re
from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy.orm import Session, selectinload

from pdlab.errors import UnknownName
from pdlab.models import (
    Aggregate,
    Calibration,
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

_WITH_TESTS = (
    selectinload(Aggregate.sieve_analyses).selectinload(SieveAnalysis.results),
    selectinload(Aggregate.packing_tests),
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
    if not exact and not delivery and delivery not in found and len(found) == 1:
        return next(iter(found.values()))
    return found.get(delivery)


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
    return _named("aggregate", names, {row.name: row for row in session.scalars(query)})


def aggregates_by_id(session: Session, ids: Sequence[int]) -> list[Aggregate]:
    """Return aggregates, of whatever delivery, with their tests."""
    return list(session.scalars(sa.select(Aggregate).where(Aggregate.id.in_(ids)).options(*_WITH_TESTS)))


def all_deliveries(session: Session) -> list[Aggregate]:
    """Return every delivery of every aggregate with its tests, in the order of their coming."""
    return list(session.scalars(sa.select(Aggregate).options(*_WITH_TESTS).order_by(Aggregate.id)))


def mixtures(session: Session, names: Sequence[str] = ()) -> list[Mixture]:
    """Return mixtures with their components, all or the named. Raises UnknownName."""
    query = (
        sa.select(Mixture)
        .options(selectinload(Mixture.components).selectinload(MixtureComponent.aggregate))
        .options(selectinload(Mixture.packing_tests))
        .order_by(Mixture.id)
    )
    return _named("mixture", names, {row.name: row for row in session.scalars(query)})


def _named(kind: str, names: Sequence[str], found: dict[str, Any]) -> list[Any]:
    missing = [name for name in names if name not in found]
    if missing:
        known = ", ".join(sorted(found)[:8]) or "none yet"
        raise UnknownName(
            f"the store holds no {kind} named {', '.join(repr(name) for name in missing)} "
            f"(it holds: {known}); import it or correct the name"
        )
    return [found[name] for name in (dict.fromkeys(names) or found)]


def done_runs(session: Session, digests: Sequence[str]) -> dict[str, Run]:
    """Return the runs among ``digests`` that are done, by digest."""
    query = sa.select(Run).where(Run.specimen_hash.in_(digests), Run.state == "done")
    return {run.specimen_hash: run for run in session.scalars(query)}


def save_run(session: Session, run: Run, state: RunState | None) -> None:
    """Write a run, over an earlier unsuccessful try of the same specimen."""
    session.merge(run)
    session.flush()
    if state is not None:
        session.merge(state)


def runs(session: Session) -> list[Run]:
    """Return all runs, the newest first."""
    return list(session.scalars(sa.select(Run).order_by(Run.finished_at.desc(), Run.specimen_hash)))


def find_bed(session: Session, beginning: str) -> tuple[Run, RunState]:
    """Return the run whose specimen hash has this ``beginning``, 4 characters or more, and its bed.

    Raises UnknownName unless there is exactly one, and when it keeps no bed.
    """
    if not re.fullmatch("[0-9a-f]{4,64}", beginning):
        raise UnknownName(
            f"'{beginning}' cannot begin a run's hash, which takes 4 to 64 of the characters 0-9 and a-f; "
            "see 'pdlab ls runs'"
        )
    query = sa.select(Run).where(Run.specimen_hash.startswith(beginning)).order_by(Run.specimen_hash).limit(2)
    found = list(session.scalars(query))
    if not found:
        raise UnknownName(f"the store holds no run whose hash begins with {beginning}; see 'pdlab ls runs'")
    if len(found) > 1:
        raise UnknownName(
            f"the hashes of several runs begin with {beginning}, among them "
            f"{' and '.join(run.specimen_hash[: len(beginning) + 4] for run in found)}; give more characters"
        )
    bed = session.get(RunState, found[0].specimen_hash)
    if bed is None:
        raise UnknownName(
            f"run {found[0].specimen_hash[:12]} ({found[0].state}) keeps no bed; choose another, see 'pdlab ls runs'"
        )
    return found[0], bed


def calibrations(session: Session, aggregate_ids: Sequence[int] | None = None) -> list[Calibration]:
    """Return calibrations, done or failed, with their runs, the last asked for first."""
    query = (
        sa.select(Calibration)
        .where(Calibration.state.in_(ENDED))
        .options(selectinload(Calibration.runs), selectinload(Calibration.packing_test))
        .options(selectinload(Calibration.aggregate).options(*_WITH_TESTS))
        .order_by(Calibration.requested_at.desc(), Calibration.id.desc())
    )
    if aggregate_ids is not None:
        query = query.where(Calibration.aggregate_id.in_(aggregate_ids))
    return list(session.scalars(query))


def predictions(session: Session, mixture_ids: Sequence[int] | None = None) -> list[Prediction]:
    """Return predictions, done or failed, with what they rest on, the last asked for first."""
    query = (
        sa.select(Prediction)
        .where(Prediction.state.in_(ENDED))
        .options(
            selectinload(Prediction.runs),
            selectinload(Prediction.calibrations)
            .selectinload(PredictionCalibration.calibration)
            .selectinload(Calibration.aggregate)
            .options(*_WITH_TESTS),
        )
        .options(selectinload(Prediction.mixture).selectinload(Mixture.packing_tests))
        .options(
            selectinload(Prediction.mixture).selectinload(Mixture.components).selectinload(MixtureComponent.aggregate)
        )
        .order_by(Prediction.requested_at.desc(), Prediction.id.desc())
    )
    if mixture_ids is not None:
        query = query.where(Prediction.mixture_id.in_(mixture_ids))
    return list(session.scalars(query))


def newest_test(tests: Sequence[PackingTest]) -> PackingTest | None:
    """Return the current density test of a material."""
    return max(tests, key=lambda test: test.id, default=None)
