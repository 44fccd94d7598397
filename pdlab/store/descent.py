"""SELECTs that follow a result down to its measurements and runs, and a row up to what rests on it."""

from collections.abc import Sequence
from typing import Any, TypeVar

import sqlalchemy as sa
from sqlalchemy.orm import Session, raiseload, selectinload
from sqlalchemy.orm.interfaces import ORMOption

from pdlab.models import (
    Aggregate,
    Base,
    Calibration,
    CalibrationRun,
    Correction,
    Mixture,
    MixtureComponent,
    PackingTest,
    Prediction,
    PredictionCalibration,
    PredictionRun,
    Run,
    SieveAnalysis,
    Sweep,
    SweepCalibration,
    SweepComponent,
    SweepRun,
)

Row = TypeVar("Row", bound=Base)

_CALIBRATION = (
    selectinload(Calibration.aggregate),
    selectinload(Calibration.packing_test),
    selectinload(Calibration.sieve_analysis).selectinload(SieveAnalysis.results),
    selectinload(Calibration.runs).selectinload(CalibrationRun.run),
)
_MIXTURE = (
    selectinload(Mixture.packing_tests),
    selectinload(Mixture.components).selectinload(MixtureComponent.aggregate),
)
_DESCENT: dict[type[Base], tuple[ORMOption, ...]] = {
    Aggregate: (
        selectinload(Aggregate.packing_tests),
        selectinload(Aggregate.sieve_analyses).selectinload(SieveAnalysis.results),
    ),
    SieveAnalysis: (selectinload(SieveAnalysis.results), selectinload(SieveAnalysis.aggregate)),
    PackingTest: (selectinload(PackingTest.aggregate), selectinload(PackingTest.mixture)),
    Mixture: _MIXTURE,
    Calibration: _CALIBRATION,
    Prediction: (
        selectinload(Prediction.mixture).options(*_MIXTURE),
        selectinload(Prediction.runs).selectinload(PredictionRun.run),
        selectinload(Prediction.calibrations)
        .selectinload(PredictionCalibration.calibration)
        .options(*_CALIBRATION),
    ),
    Sweep: (
        selectinload(Sweep.components).selectinload(SweepComponent.aggregate),
        selectinload(Sweep.runs).selectinload(SweepRun.run),
        selectinload(Sweep.calibrations).selectinload(SweepCalibration.calibration).options(*_CALIBRATION),
    ),
}  # fmt: skip


def find_row(session: Session, table: type[Row], key: int | str | tuple[int, int]) -> Row | None:
    """Return a row by its primary key; None where the store holds none."""
    return session.get(table, key)


def with_descent(session: Session, row: Row) -> Row:
    """Return a row with all that it rests on, in a number of queries that does not grow with it."""
    keys = sa.inspect(type(row)).primary_key
    here = [key == value for key, value in zip(keys, sa.inspect(row).identity or (), strict=True)]
    options = _DESCENT.get(type(row), ())
    query = (
        sa.select(type(row)).where(*here).options(*options, raiseload("*")).execution_options(populate_existing=True)
    )
    return session.scalars(query).one()


def last_calibration(session: Session, aggregate_id: int) -> Calibration | None:
    """Return the calibration of an aggregate that was asked for last, whatever its state; no variant."""
    query = sa.select(Calibration).where(Calibration.aggregate_id == aggregate_id, Calibration.variant == "")
    return session.scalars(query.order_by(Calibration.requested_at.desc(), Calibration.id.desc())).first()


def last_prediction(session: Session, mixture_id: int) -> Prediction | None:
    """Return the prediction of a mixture that was asked for last, whatever its method and state; no variant."""
    query = sa.select(Prediction).where(Prediction.mixture_id == mixture_id, Prediction.variant == "")
    return session.scalars(query.order_by(Prediction.requested_at.desc(), Prediction.id.desc())).first()


def corrections(session: Session, keys: Sequence[tuple[str, str]] | None = None) -> list[Correction]:
    """Return corrections, of all rows or of those given by table name and key, the oldest first."""
    query = sa.select(Correction).order_by(Correction.id)
    if keys is not None:
        query = query.where(sa.tuple_(Correction.table_name, Correction.row_key).in_(keys))
    return list(session.scalars(query))


def blends_with(session: Session, aggregate_id: int) -> list[Mixture]:
    """Return the mixtures that an aggregate is part of, with their components and density tests."""
    its = sa.select(MixtureComponent.mixture_id).where(MixtureComponent.aggregate_id == aggregate_id)
    return list(session.scalars(sa.select(Mixture).where(Mixture.id.in_(its)).options(*_MIXTURE)))


_RESTING: dict[type[Base], dict[str, tuple[sa.Select[Any], Any]]] = {
    Aggregate: {
        "sieve_analysis": (sa.select(SieveAnalysis.id), SieveAnalysis.aggregate_id),
        "packing_test": (sa.select(PackingTest.id), PackingTest.aggregate_id),
        "mixture": (sa.select(Mixture.name).join(MixtureComponent), MixtureComponent.aggregate_id),
        "calibration": (sa.select(Calibration.id), Calibration.aggregate_id),
        "sweep": (sa.select(SweepComponent.sweep_id), SweepComponent.aggregate_id),
    },
    Mixture: {
        "packing_test": (sa.select(PackingTest.id), PackingTest.mixture_id),
        "prediction": (sa.select(Prediction.id), Prediction.mixture_id),
    },
    SieveAnalysis: {"calibration": (sa.select(Calibration.id), Calibration.sieve_analysis_id)},
    PackingTest: {"calibration": (sa.select(Calibration.id), Calibration.packing_test_id)},
    Calibration: {
        "prediction": (sa.select(PredictionCalibration.prediction_id), PredictionCalibration.calibration_id),
        "sweep": (sa.select(SweepCalibration.sweep_id), SweepCalibration.calibration_id),
    },
    Run: {
        "calibration": (sa.select(CalibrationRun.calibration_id), CalibrationRun.specimen_hash),
        "prediction": (sa.select(PredictionRun.prediction_id), PredictionRun.specimen_hash),
        "sweep": (sa.select(SweepRun.sweep_id), SweepRun.specimen_hash),
    },
}
"""For each table, those whose rows may rest on its rows: how these are named, and the column that points there."""


def resting_on(session: Session, row: Base) -> dict[str, list[str]]:
    """Return what rests on a row, by table, as it is addressed: mixtures by name, the others by id."""
    (key, *_) = type(row).__mapper__.primary_key_from_instance(row)
    out = dict[str, list[str]]()
    for table, (names, pointing) in _RESTING.get(type(row), {}).items():
        found = [
            str(name) for name in session.scalars(names.where(pointing == key).order_by(names.selected_columns[0]))
        ]
        if found:
            out[table] = found
    return {table: found for table, found in out.items() if found}
