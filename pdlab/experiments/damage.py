"""Damaged rows: what went wrong is told as the row that it comes from, where it comes from one."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import sqlalchemy as sa

from pdlab import store
from pdlab.errors import DamagedRow, PdlabError
from pdlab.experiments.calibrations import spheres_of
from pdlab.experiments.drafts import fields_of
from pdlab.experiments.evidence import settings_of
from pdlab.experiments.readings import CANNOT_BE, REMEDY, packing_of, protocol_kept, specimen_kept
from pdlab.experiments.references import REFERENCES
from pdlab.experiments.sweeps import result_of
from pdlab.experiments.ways import way_kept, way_of
from pdlab.models import Base, Calibration, Draft, Prediction, Run, Sweep
from pdlab.store import Store


def _prediction(row: Prediction) -> None:
    if row.protocol:
        (settings_of if row.method in REFERENCES else protocol_kept)(row)


READERS: dict[type[Base], tuple[Callable[[Any], Any], ...]] = {
    Calibration: (way_of, way_kept, spheres_of, protocol_kept),
    Prediction: (way_kept, _prediction),
    Sweep: (way_kept, lambda row: result_of(row) if row.state == "done" else None),
    Run: (packing_of, lambda row: specimen_kept(row) if row.state == "done" else None),
    Draft: (fields_of,),
}
"""What reads the columns of a row that hold more than a value."""


def damages(target: Store) -> Iterator[str]:
    """Yield what is wrong with rows of a store, one sentence each: what only a damaged or edited database holds."""
    with target.read() as session:
        for table, key, said in store.damaged_rows(session):
            yield f"{table}:{key}: {said}; {REMEDY}"
        for table_class, readers in READERS.items():
            for row in session.scalars(sa.select(table_class)).yield_per(1000):
                for read in readers:
                    try:
                        read(row)
                    except PdlabError as error:
                        yield str(error)


@contextmanager
def damage_named(target: Store) -> Iterator[None]:
    """Raise DamagedRow, naming the row, for what goes wrong in the block because of a damaged row."""
    try:
        yield
    except (*CANNOT_BE, sa.exc.SQLAlchemyError) as error:
        said = next(damages(target), None)
        if said is None:
            raise
        raise DamagedRow(said) from error
