"""What the store knows of the effort of runs: of which planning learns."""

from pdlab import store
from pdlab.planning import Ran
from pdlab.specimen import from_canonical
from pdlab.store import Store

MOST = 1000
"""Runs that are learnt from: the newest, since machines and their load change."""


def known_runs(target: Store, engine_version: int | None = None, processor: str | None = None) -> list[Ran]:
    """Return the newest runs done by an engine version, by default the newest in the store, the last one first.

    ``processor``: whose seconds are known, None for all; of another's runs only the steps are.
    """
    with target.read() as session:
        version = engine_version or store.newest_engine(session)
        rows = store.newest_done(session, version or 0, MOST)
    return [
        Ran(from_canonical(specimen), steps, seconds if processor in (None, there) else None)
        for specimen, steps, seconds, there in rows
    ]
