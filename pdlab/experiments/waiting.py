"""How far a wish is, how long it will take, and whether anyone works on it."""

import datetime as dt
from dataclasses import dataclass

from sqlalchemy.orm import Session

from pdlab import store
from pdlab.models import Calibration, Prediction, Sweep, now
from pdlab.store import LEASE, Key

Wished = Calibration | Prediction | Sweep

PATIENCE = 10.0
"""Seconds after which a runner, were there one, would have taken up a wish."""


@dataclass(frozen=True)
class Waiting:
    """What is wished for: its ``key``, its state (queued or running), how far it is [0 to 1].

    ``left``: seconds that it will take at the pace since it was asked for, None where there is none yet.
    ``attended``: whether it may be waited for; False where no runner's heartbeat is there.
    """

    key: Key
    method: str
    state: str
    progress: float
    left: float | None = None
    attended: bool = True


def waiting_of(session: Session, key: Key, row: Wished) -> Waiting:
    """Return how far a wish is that has not ended."""
    return Waiting(key, row.method, row.state, row.progress, _left(row), _is_attended(session, row))


def _left(row: Wished) -> float | None:
    if row.state != "running" or row.heartbeat is None or not row.progress > 0.0:
        return None
    return (row.heartbeat - row.requested_at).total_seconds() * (1.0 - row.progress) / row.progress


def _is_attended(session: Session, row: Wished) -> bool:
    if row.state == "running":
        return row.heartbeat is not None and now() - row.heartbeat <= dt.timedelta(seconds=LEASE)
    return now() - row.requested_at < dt.timedelta(seconds=PATIENCE) or store.is_attended(session)
