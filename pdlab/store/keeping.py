"""Keeps what lists read in step with what is written: sizes with the sieve analyses, and the table of comparisons.

Whoever writes through the store need not know of it: what a session writes says what to work out anew.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any
from uuid import uuid4

import sqlalchemy as sa
from sqlalchemy.orm import ORMExecuteState, Session

from pdlab.errors import GradingError
from pdlab.grading import SieveRow, SieveTable, equivalent_diameter, make_grading
from pdlab.models import (
    Aggregate,
    Comparison,
    Mark,
    Mixture,
    MixtureComponent,
    Prediction,
    SieveAnalysis,
    SieveResult,
)
from pdlab.specimen import LOOSE, RODDED, VIBRATED
from pdlab.store.selects import parts

COLUMNS = [column.name for column in Comparison.__table__.columns if column.name != "simulated"]
VIEW = sa.table("predicted_vs_measured", *map(sa.column, COLUMNS))
SIMULATED = sa.case(
    *(
        (Prediction.protocol.contains(f'"compaction": "{way.compaction}"'), way.compaction)
        for way in (LOOSE, RODDED, VIBRATED)
    )
)
"""The compaction of a prediction's beds; a geometric reference has none."""
READ = (
    "aggregate", "sieve_analysis", "sieve_result", "packing_test", "mixture", "mixture_component", "calibration",
    "prediction", "prediction_calibration", "correction",
)  # fmt: skip
"""The tables that the view reads."""


@dataclass
class _Written:
    """What a session wrote: the mixtures and aggregates that its rows belong to; ``at_large``: rows not told apart.

    A row of a mixture says nothing of the aggregates that it names, or a mixture more would have all others that hold
    one of its aggregates compared anew.
    """

    mixtures: set[int] = field(default_factory=set)
    aggregates: set[int] = field(default_factory=set)
    at_large: bool = False

    def note_rows(self, session: Session, _: Any) -> None:
        for row in (*session.new, *session.dirty, *session.deleted):
            mixture = row.id if isinstance(row, Mixture) else getattr(row, "mixture_id", None)
            aggregate = row.id if isinstance(row, Aggregate) else getattr(row, "aggregate_id", None)
            if mixture is not None:
                self.mixtures.add(mixture)
            elif aggregate is not None:
                self.aggregates.add(aggregate)

    def note_statement(self, state: ORMExecuteState) -> None:
        changes = state.is_insert or state.is_update or state.is_delete
        if changes and state.execution_options.get("compared", True):
            self.at_large |= state.statement.table.name in READ  # type: ignore[attr-defined]


@contextmanager
def kept_for_lists(session: Session) -> Iterator[None]:
    """Keep the sizes of what is sieved in the block; compare anew, at its end, what rests on what it wrote."""
    written = _Written()
    sa.event.listen(session, "before_flush", _set_sizes)
    sa.event.listen(session, "after_flush", written.note_rows)
    sa.event.listen(session, "do_orm_execute", written.note_statement)
    yield
    if not session.in_transaction():  # the block undid what it wrote
        return
    session.flush()
    if written.at_large:
        compare(session)
        _set_mark(session)
        return
    blends = sa.select(MixtureComponent.mixture_id)
    for some in parts(list(written.aggregates)):
        written.mixtures.update(session.scalars(blends.where(MixtureComponent.aggregate_id.in_(some))))
    for some in parts(list(written.mixtures)):
        compare(session, some)
    if written.mixtures:
        _set_mark(session)  # last: who waits for another's row of it holds nothing that the other waits for


def _set_mark(session: Session) -> None:
    """Note that the comparisons are others than before."""
    set_ = (
        "INSERT INTO mark (name, value) VALUES (:name, :value) ON CONFLICT (name) DO UPDATE SET value = excluded.value"
    )
    session.execute(sa.text(set_), {"name": Comparison.__tablename__, "value": uuid4().hex})


def comparison_mark(session: Session) -> str:
    """Return a text that is another one after every change of the comparisons; empty before the first."""
    return session.scalar(sa.select(Mark.value).where(Mark.name == Comparison.__tablename__)) or ""


def compare(session: Session, mixture_ids: Sequence[int] | None = None) -> None:
    """Write the comparisons of these mixtures anew, or all."""
    said = [sa.func.coalesce(VIEW.c.method, "") if name == "method" else VIEW.c[name] for name in COLUMNS]
    come = sa.select(*said, SIMULATED).outerjoin_from(VIEW, Prediction, Prediction.id == VIEW.c.prediction_id)
    gone = sa.delete(Comparison)
    if mixture_ids is not None:
        gone, come = gone.where(Comparison.mixture_id.in_(mixture_ids)), come.where(VIEW.c.mixture_id.in_(mixture_ids))
    session.execute(gone)
    session.execute(sa.insert(Comparison).from_select([*COLUMNS, "simulated"], come))


def sieve_table(analysis: SieveAnalysis) -> SieveTable:
    """Return a stored sieve analysis as the table it was entered as."""
    rows = tuple(SieveRow(result.aperture_mm, getattr(result, analysis.kind)) for result in analysis.results)
    return SieveTable(rows, analysis.kind, analysis.sample_mass_g, analysis.pan_lower_mm)


def sizes(table: SieveTable) -> dict[str, float | None]:
    """Return what is kept with a sieve analysis: the ends of its grading and its log-mean diameter [mm].

    None where it gives no grading.
    """
    try:
        found = make_grading(table)
    except GradingError:
        return {"finest_mm": None, "coarsest_mm": None, "log_mean_mm": None}
    mean = equivalent_diameter(found, "log_mean")
    return {"finest_mm": found.apertures[-1], "coarsest_mm": found.apertures[0], "log_mean_mm": mean}


def _set_sizes(session: Session, *_: Any) -> None:
    """Set the sizes of the sieve analyses that are about to be written, or whose results are."""
    rows = [*session.new, *session.dirty]
    keys = {row.sieve_analysis_id for row in rows if isinstance(row, SieveResult)} - {None}
    analyses = {row for row in rows if isinstance(row, SieveAnalysis)}
    for one in analyses | {found for key in keys if (found := session.get(SieveAnalysis, key)) is not None}:
        for column, value in sizes(sieve_table(one)).items():
            setattr(one, column, value)
