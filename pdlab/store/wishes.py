"""Wishes: what is asked for and not worked out yet, and which runner works on it.

A runner claims a wish, or a run, for the time of a lease and renews it with its heartbeat; what a dead runner held is
free again when its lease ends. Lists show what has ended alone, so that nothing here is compared anew.
"""

import datetime as dt
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import sqlalchemy as sa
from sqlalchemy.orm import Session

from pdlab.errors import ClaimLost
from pdlab.models import Calibration, Prediction, Run, RunState, Sweep, now
from pdlab.store.selects import columns_of, parts, upsert

LEASE = 60.0
"""Seconds for which a claim holds without a heartbeat."""
KINDS: dict[str, type[Calibration] | type[Prediction] | type[Sweep]] = {
    "calibration": Calibration, "prediction": Prediction, "sweep": Sweep,
}  # fmt: skip
WAITING = ("queued", "running")
UNCOMPARED = {"compared": False}
"""Execution option of statements that change nothing that lists show."""

Wished = TypeVar("Wished", Calibration, Prediction, Sweep)
Key = tuple[str, int]
"""A wish's table and id."""


@dataclass(frozen=True)
class Claim:
    """A wish that a runner works on: its id and the runner's name."""

    id: int
    who: str


def claimed(session: Session, table: type[Wished], claim: Claim) -> Wished:
    """Return the row of a claimed wish. Raises ClaimLost where it is the runner's no more."""
    row = session.get(table, claim.id, populate_existing=True)
    if row is None or row.state != "running" or row.claimed_by != claim.who:
        state = "deleted" if row is None else row.state
        raise ClaimLost(f"{table.__tablename__} {claim.id} is {state}, and {claim.who} holds it no more")
    return row


def ask(
    session: Session, kind: str, rows: Sequence[Mapping[str, Any]], same: Sequence[str]
) -> tuple[list[int], list[int]]:
    """Write wishes; return their ids in order, and of these the new ones.

    One that waits already with the ``same`` columns is not asked twice.
    """
    table = KINDS[kind]
    columns = [getattr(table, name) for name in same]
    waiting = sa.select(table.id, *columns).where(table.state.in_(WAITING))
    known = {tuple(row[1:]): row[0] for row in session.execute(waiting)}
    keys = [tuple(row[name] for name in same) for row in rows]
    new = {key: dict(row) for key, row in zip(keys, rows, strict=True) if key not in known}
    ids = list[int]()
    if new:
        moment = {"state": "queued", "requested_at": now(), "priority": 0, "progress": 0.0, "variant": ""}
        insert = sa.insert(table).returning(table.id, sort_by_parameter_order=True)
        ids += session.scalars(insert, [moment | row for row in new.values()], execution_options=UNCOMPARED)
        known |= dict(zip(new, ids, strict=True))
    return [known[key] for key in keys], ids


def claim_wishes(
    session: Session,
    who: str,
    most: int,
    is_gone: Callable[[str], bool],
    ids: Mapping[str, Sequence[int]] | None = None,
) -> list[Key]:
    """Claim so many wishes for a runner, of all that wait or of these ids: first by priority, then the oldest.

    ``is_gone``: tells of a runner's name that it has ended, so that its lease need not be waited for.
    """
    found = list[tuple[int, dt.datetime, Key]]()
    for kind, table in KINDS.items():
        for some in parts(ids.get(kind, ())) if ids is not None else (None,):
            query = sa.select(table.id, table.priority, table.requested_at).where(_free(session, table, is_gone))
            if some is not None:
                query = query.where(table.id.in_(some))
            oldest = query.order_by(table.priority.desc(), table.requested_at, table.id).limit(most)
            found += [(-priority, asked, (kind, key)) for key, priority, asked in session.execute(oldest)]
    taken = [key for *_, key in sorted(found)[:most]]
    for kind, table in KINDS.items():
        mine = [key for of, key in taken if of == kind]
        change = {"state": "running", "claimed_by": who, "heartbeat": now(), "progress": 0.0, "message": None}
        if mine:
            update = sa.update(table).where(table.id.in_(mine)).values(change)
            session.execute(update, execution_options=UNCOMPARED | {"synchronize_session": False})
    return taken


def _free(session: Session, table: Any, is_gone: Callable[[str], bool]) -> sa.ColumnElement[bool]:
    """Return the condition that a wish, or a run, is nobody's: it waits, or who had it has let its lease end."""
    names = session.scalars(sa.select(table.claimed_by).where(table.state == "running").distinct())
    gone = [name for name in names if name is not None and is_gone(name)]
    ended = now() - dt.timedelta(seconds=LEASE)
    lost = sa.or_(table.heartbeat.is_(None), table.heartbeat < ended, table.claimed_by.in_(gone))
    return sa.or_(table.state == "queued", sa.and_(table.state == "running", lost))


def beat(session: Session, who: str, progress: Mapping[Key, float]) -> set[Key]:
    """Renew a runner's leases and say how far some of its wishes are [0 to 1]; return all that it still holds."""
    held, options = set[Key](), UNCOMPARED | {"synchronize_session": False}
    for kind, table in KINDS.items():
        mine = sa.and_(table.claimed_by == who, table.state == "running")
        held |= {(kind, key) for key in session.scalars(sa.select(table.id).where(mine))}
        session.execute(sa.update(table).where(mine).values(heartbeat=now()), execution_options=options)
    for (kind, key), share in progress.items():
        if (kind, key) in held:
            told = sa.update(KINDS[kind]).where(KINDS[kind].id == key).values(progress=min(max(share, 0.0), 1.0))
            session.execute(told, execution_options=options)
    runs = sa.update(Run).where(Run.claimed_by == who, Run.state == "running").values(heartbeat=now())
    session.execute(runs, execution_options=options)
    return held


def end_wish(session: Session, key: Key, who: str, state: str, message: str | None) -> bool:
    """Set the state of a wish that a runner holds and did not write a result of; return whether it held it."""
    kind, row_id = key
    row = cast("Calibration | Prediction | Sweep | None", session.get(KINDS[kind], row_id, populate_existing=True))
    if row is None or row.state != "running" or row.claimed_by != who:
        return False
    row.state, row.message = state, message
    if state in ("failed", "cancelled"):
        row.finished_at = now()
    return True


def release(session: Session, who: str) -> None:
    """Let go of the wishes that a runner holds: they wait again."""
    for table in KINDS.values():
        mine = sa.update(table).where(table.claimed_by == who, table.state == "running")
        change = mine.values(state="queued", claimed_by=None, heartbeat=None, progress=0.0)
        session.execute(change, execution_options=UNCOMPARED | {"synchronize_session": False})


def cancel(session: Session, keys: Iterable[Key], message: str) -> int:
    """Cancel wishes that have not ended; return how many that were."""
    count = 0
    for kind, table in KINDS.items():
        for some in parts([key for of, key in keys if of == kind]):
            waiting = sa.update(table).where(table.id.in_(some), table.state.in_(WAITING))
            change = waiting.values(state="cancelled", message=message, finished_at=now())
            done = session.execute(change, execution_options=UNCOMPARED | {"synchronize_session": False})
            count += int(done.rowcount)  # type: ignore[attr-defined]
    return count


def wish_states(session: Session, keys: Sequence[Key]) -> dict[Key, str]:
    """Return the states of wishes; one that was deleted is missing."""
    out = dict[Key, str]()
    for kind, table in KINDS.items():
        for some in parts([key for of, key in keys if of == kind]):
            rows = session.execute(sa.select(table.id, table.state).where(table.id.in_(some)))
            out |= {(kind, key): state for key, state in rows}
    return out


def claim_runs(
    session: Session, rows: Sequence[Run], who: str, is_gone: Callable[[str], bool]
) -> dict[str, tuple[Run, RunState] | None]:
    """Claim runs that nobody works on and that are not done; return those that are the runner's now, by digest.

    Each with the bed that a runner before left of it, None where it begins anew.
    """
    digests = [row.specimen_hash for row in rows]
    there = session.execute(sa.select(Run.specimen_hash, Run.state).where(Run.specimen_hash.in_(digests)))
    states = dict(there.all())
    held = {digest for digest, state in states.items() if state == "done"}
    if "running" in states.values():
        others = sa.and_(Run.state == "running", ~_free(session, Run, is_gone), Run.claimed_by != who)
        held.update(session.scalars(sa.select(Run.specimen_hash).where(Run.specimen_hash.in_(digests), others)))
    mine = [row for row in rows if row.specimen_hash not in held]
    begun = [digest for digest, state in states.items() if state in WAITING and digest not in held]
    beds = (
        sa.select(Run, RunState)
        .join(RunState, RunState.specimen_hash == Run.specimen_hash)
        .where(Run.specimen_hash.in_(begun))
    )
    left = {run.specimen_hash: (run, bed) for run, bed in session.execute(beds)} if begun else {}
    claim = {"state": "running", "claimed_by": who, "heartbeat": now()}
    upsert(session, Run, [columns_of(row) | claim for row in mine if row.specimen_hash not in left])
    if left:
        session.execute(sa.update(Run).where(Run.specimen_hash.in_(left)).values(claim))
    return {row.specimen_hash: left.get(row.specimen_hash) for row in mine}


def free_runs(session: Session, digests: Sequence[str], who: str) -> None:
    """Leave runs that a runner holds to others; those of which no bed is kept have not begun, and are forgotten."""
    mine = sa.and_(Run.specimen_hash.in_(digests), Run.claimed_by == who, Run.state == "running")
    begun = sa.select(RunState.specimen_hash).where(RunState.specimen_hash == Run.specimen_hash).exists()
    options = UNCOMPARED | {"synchronize_session": False}
    session.execute(sa.delete(Run).where(mine, ~begun), execution_options=options)
    session.execute(
        sa.update(Run).where(mine).values(state="queued", claimed_by=None, heartbeat=None), execution_options=options
    )


def waiting_calibration(session: Session, aggregate_id: int) -> Calibration | None:
    """Return the calibration of an aggregate that waits or is worked on, the last asked for; no variant."""
    waiting = sa.and_(Calibration.state.in_(WAITING), Calibration.variant == "")
    query = sa.select(Calibration).where(Calibration.aggregate_id == aggregate_id, waiting)
    return session.scalars(query.order_by(Calibration.id.desc()).limit(1)).first()


def waiting_prediction(session: Session, mixture_id: int) -> Prediction | None:
    """Return the prediction of a mixture that waits or is worked on, the last asked for; no variant."""
    waiting = sa.and_(Prediction.state.in_(WAITING), Prediction.variant == "")
    query = sa.select(Prediction).where(Prediction.mixture_id == mixture_id, waiting)
    return session.scalars(query.order_by(Prediction.id.desc()).limit(1)).first()


def waiting_mixtures(session: Session) -> dict[int, str]:
    """Return the mixtures whose prediction waits or is worked on, with the state of its wish; no variant."""
    waiting = sa.and_(Prediction.state.in_(WAITING), Prediction.variant == "")
    found = sa.select(Prediction.mixture_id, sa.func.max(Prediction.state)).where(waiting)  # 'running' after 'queued'
    return dict(session.execute(found.group_by(Prediction.mixture_id)).all())


def wishes_before(session: Session, kind: str, row: Calibration | Prediction | Sweep) -> int:
    """Return how many wishes wait that a runner claims before this one, which waits too."""
    count = 0
    for name, table in KINDS.items():
        first = sa.true() if name < kind else sa.and_(sa.literal(name == kind), table.id < row.id)
        older = sa.or_(table.requested_at < row.requested_at, sa.and_(table.requested_at == row.requested_at, first))
        before = sa.or_(table.priority > row.priority, sa.and_(table.priority == row.priority, older))
        counted = sa.select(sa.func.count()).select_from(table).where(table.state == "queued", before)
        count += session.scalar(counted) or 0
    return count


def waits_since(session: Session) -> dt.datetime | None:
    """Return when the oldest wish was asked for that waits or is worked on, None where there is none."""
    oldest = [
        session.scalar(sa.select(sa.func.min(table.requested_at)).where(table.state.in_(WAITING)))
        for table in KINDS.values()
    ]
    return min((moment for moment in oldest if moment is not None), default=None)


def is_attended(session: Session) -> bool:
    """Return whether a runner works on any wish, told by a heartbeat within the lease."""
    fresh = now() - dt.timedelta(seconds=LEASE)
    return any(
        session.scalar(sa.select(sa.exists().where(table.state == "running", table.heartbeat >= fresh)))
        for table in KINDS.values()
    )
