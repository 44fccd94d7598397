"""Where a number comes from: a result → its calibrations → tests and sieves → runs, with every correction."""

import datetime as dt
from dataclasses import dataclass, field
from typing import Any

import sqlalchemy as sa
from sqlalchemy.orm import Session

from pdlab import store
from pdlab.experiments.addresses import address, find, row_key
from pdlab.experiments.readings import an_object, kept
from pdlab.experiments.references import REFERENCES
from pdlab.models import (
    CORRECTABLE,
    Aggregate,
    Base,
    Calibration,
    Correction,
    Mixture,
    PackingTest,
    Prediction,
    SieveAnalysis,
    Sweep,
)
from pdlab.store import Store

Facts = dict[str, Any]
"""A row as plain data, by column, with what it rests on nested inside."""
SHOWN = ("prediction", "sweep", "mixture", "calibration", "aggregate", "run", "sieve_analysis", "packing_test")
JSON_LISTS = ("slab_shares", "spheres")
JSON_COLUMNS = ("protocol", "specimen", "curve", "asked", *JSON_LISTS)


def show(target: Store, what: str) -> Facts:
    """Return a row and all that it rests on, as nested plain data (units stand in the columns' names).

    ``what``: as ``addresses.find`` reads it. The key ``address`` names each row; ``corrections`` lists what was
    corrected in it; ``rests_on_it`` of the row asked for names what was worked out from it. Raises UnknownName,
    and InputError where a bare name has several meanings.
    """
    with target.read() as session:
        row = _descended(session, find(session, what, SHOWN))
        tree = _Tree()
        facts = tree.whole(row)
        last = _last_result(session, row)
        if last is not None:
            facts[f"last_{last.__tablename__}"] = tree.whole(_descended(session, last))
            del facts[f"last_{last.__tablename__}"][row.__tablename__]  # it stands above
        tree.add_corrections(session)
        facts["rests_on_it"] = store.resting_on(session, row)
    return facts


def _descended(session: Session, row: Base) -> Base:
    """Return a row with all that it rests on, a geometric reference with the sieve tables of its aggregates."""
    found = store.with_descent(session, row)
    if isinstance(found, Prediction) and found.method in REFERENCES:
        store.aggregates_by_id(session, [part.aggregate_id for part in found.mixture.components])
    return found


def history(session: Session, entered: dict[tuple[str, str], dt.datetime]) -> list[Correction]:
    """Return the corrections of rows since they were entered, the oldest first.

    ``entered``: by table name and key. A database may give the key of a deleted row to a new one, which has no
    part in what happened before.
    """
    found = store.corrections(session, list(entered))
    return [one for one in found if one.corrected_at >= entered[one.table_name, one.row_key]]


def plain(row: Base, with_parents: bool = False) -> Facts:
    """Return a row's columns as plain data, without the keys of its parents unless they are asked for."""
    columns = [column for column in sa.inspect(type(row)).columns if with_parents or not column.foreign_keys]
    return {column.name: _plain(row, column.name) for column in columns}


def _plain(row: Base, name: str) -> Any:
    value = getattr(row, name)
    if isinstance(value, dt.date):
        return value.isoformat()
    if name not in JSON_COLUMNS or not isinstance(value, str):  # a run counts its spheres
        return value
    if not value:  # of a wish that waits
        return None
    return kept(row, name, list if name in JSON_LISTS else an_object)


def _last_result(session: Session, row: Base) -> Calibration | Prediction | None:
    if isinstance(row, Aggregate):
        return store.last_calibration(session, row.id)
    return store.last_prediction(session, row.id) if isinstance(row, Mixture) else None


@dataclass
class _Tree:
    """The rows that people may correct, as they become plain data, and when each was entered."""

    met: list[tuple[tuple[str, str], dt.datetime, Facts]] = field(default_factory=list)

    def alone(self, row: Base, entered: dt.datetime | None = None) -> Facts:
        """Return a row by itself; ``entered``: when, of a part that does not keep it."""
        facts: Facts = {"address": address(row), **plain(row)}
        if row.__tablename__ in CORRECTABLE:
            facts["corrections"] = []
            when = entered or row.created_at  # type: ignore[attr-defined]
            self.met.append(((row.__tablename__, row_key(row)), when, facts))
        return facts

    def whole(self, row: Base) -> Facts:
        """Return a row with what it rests on."""
        facts = self.alone(row)
        if isinstance(row, Prediction):
            facts["mixture"] = self.whole(row.mixture)
            facts["calibrations"] = [self.whole(link.calibration) for link in row.calibrations]
            if row.method in REFERENCES:
                facts["aggregates"] = [self._graded(part.aggregate) for part in row.mixture.components]
        elif isinstance(row, Sweep):
            facts["components"] = [
                self.alone(part) | {"aggregate": self.alone(part.aggregate)} for part in row.components
            ]
            facts["calibrations"] = [self.whole(link.calibration) for link in row.calibrations]
        elif isinstance(row, Calibration):
            facts["aggregate"] = self.alone(row.aggregate)
            facts["packing_test"] = None if row.packing_test is None else self.alone(row.packing_test)
            facts["sieve_analysis"] = self._sieved(row.sieve_analysis)
        elif isinstance(row, Mixture):
            facts["components"] = [
                self.alone(part, row.created_at) | {"aggregate": self.alone(part.aggregate)} for part in row.components
            ]
        elif isinstance(row, Aggregate):
            facts["sieve_analyses"] = [self._sieved(sieved) for sieved in row.sieve_analyses]
        elif isinstance(row, SieveAnalysis):
            facts["results"] = [self.alone(one, row.created_at) for one in row.results]
            facts["aggregate"] = self.alone(row.aggregate)
        elif isinstance(row, PackingTest):
            material = row.aggregate or row.mixture
            facts["material"] = None if material is None else self.alone(material)
        if isinstance(row, Mixture | Aggregate):
            facts["packing_tests"] = [self.alone(test) for test in row.packing_tests]
        if isinstance(row, Prediction | Calibration | Sweep):
            facts["runs"] = [self.alone(link.run) for link in row.runs]
        return facts

    def _graded(self, row: Aggregate) -> Facts:
        return self.alone(row) | {"sieve_analyses": [self._sieved(sieved) for sieved in row.sieve_analyses]}

    def _sieved(self, row: SieveAnalysis) -> Facts:
        return self.alone(row) | {"results": [self.alone(one, row.created_at) for one in row.results]}

    def add_corrections(self, session: Session) -> None:
        """Add to every row what was corrected in it."""
        entered = {key: when for key, when, _ in self.met}
        for one in history(session, entered):
            for key, _, facts in self.met:
                if key == (one.table_name, one.row_key):
                    facts["corrections"].append(plain(one))
