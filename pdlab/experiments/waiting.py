"""How far a wish is, how long it will take, and whether anyone works on it."""

import datetime as dt
from dataclasses import dataclass

from sqlalchemy.orm import Session

from pdlab import store
from pdlab.models import Calibration, Prediction, Sweep, now
from pdlab.store import LEASE, Key, Store

Wished = Calibration | Prediction | Sweep

PATIENCE = 10.0
"""Seconds after which a runner, were there one, would have taken up a wish."""


@dataclass(frozen=True)
class Waiting:
    """What is wished for: its ``key``, its state (queued or running), how far it is [0 to 1].

    ``left``: seconds that it will take at most, at the pace since it was asked for, None where there is none yet.
    Of these it may have waited for a runner; ``Pace`` tells better what it looks at for a while.
    ``attended``: whether it may be waited for; False where no runner's heartbeat is there. ``before``: how many wishes
    a runner takes up before it, where it is queued.
    """

    key: Key
    method: str
    state: str
    progress: float
    left: float | None = None
    attended: bool = True
    before: int = 0


@dataclass(frozen=True)
class Pace:
    """How fast a wish goes on, told by two looks at it: seconds of any clock, and progress [0 to 1].

    ``begun``: when its progress was first seen to change, ``last``: when it last was; a change stands for all that
    was worked out since the change before, which the first look does not know.
    """

    seen: float
    begun: tuple[float, float] | None = None
    last: tuple[float, float] | None = None

    def look(self, moment: float, progress: float) -> "Pace":
        """Return the pace after another look; it begins anew where progress falls, as when another runner began."""
        if progress < self.seen:
            return Pace(progress)
        if progress == self.seen:
            return self
        return Pace(progress, self.begun or (moment, progress), (moment, progress))

    @property
    def left(self) -> float | None:
        """Return the seconds that are left at this pace, None before two changes."""
        if self.begun is None or self.last is None or self.last == self.begun:
            return None
        (first, before), (moment, progress) = self.begun, self.last
        return (moment - first) * (1.0 - progress) / (progress - before)


def waiting_of(session: Session, key: Key, row: Wished) -> Waiting:
    """Return how far a wish is that has not ended."""
    before = store.wishes_before(session, key[0], row) if row.state == "queued" else 0
    return Waiting(key, row.method, row.state, row.progress, _left(row), _is_attended(session, row), before)


def nobody_works(target: Store) -> bool:
    """Return whether something is wished for that no runner works on, nor on anything before it."""
    with target.read() as session:
        since = store.waits_since(session)
        return since is not None and not _may_be_taken_up(session, since)


def _left(row: Wished) -> float | None:
    if row.state != "running" or row.heartbeat is None or not row.progress > 0.0:
        return None
    return (row.heartbeat - row.requested_at).total_seconds() * (1.0 - row.progress) / row.progress


def _is_attended(session: Session, row: Wished) -> bool:
    if row.state == "running":
        return row.heartbeat is not None and now() - row.heartbeat <= dt.timedelta(seconds=LEASE)
    return _may_be_taken_up(session, row.requested_at)


def _may_be_taken_up(session: Session, asked: dt.datetime) -> bool:
    return now() - asked < dt.timedelta(seconds=PATIENCE) or store.is_attended(session)
