"""Predicted against measured: what the home page shows of the store, read as columns of a list, not as rows.

Filters choose mixtures; of these, the methods' errors; and of the predictions by some methods or in some states the
points, or how many lie in each cell of the parity plane.
"""

import datetime as dt
import hashlib
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy.orm import Session

from pdlab import comparison, store, tables
from pdlab.calibration import REPOSE
from pdlab.comparison import Errors
from pdlab.experiments.references import REFERENCES
from pdlab.store import Store

Numbers = NDArray[np.float64]
Cell = tuple[int, int, int]
"""A cell of the parity plane: column, row and width in units of CELL."""

MOST_POINTS = 2000
"""Predictions that are drawn one by one; more are counted by cells."""
CELL = 0.005
"""Width of a cell of the parity plane [-], half of the narrow band, or ..."""
WIDER, MOST_CELLS = (1, 2, 4, 8), 500
"""... so many times as wide, the first that makes no more cells than a browser draws at once."""
NAMED = 20
"""Mixtures without a prediction that are told by name."""
STATES = ("done", "outdated", "failed")
LISTED = (
    "prediction_id", "mixture_id", "mixture", "method", "packing_density", "expected_error", "measured",
    "measured_error", "difference", "compaction", "tested", "state", "message",
)  # fmt: skip
"""Columns of the list beside the chart."""
WRITTEN = (
    "mixture", "method", "packing_density", "standard_error", "input_error", "expected_error", "measured",
    "measured_error", "difference", "compaction", "tested", "requested_at", "state", "message",
)  # fmt: skip
"""Columns of the CSV file: those of ``predict -o`` but the theories, what the measurement was, and when it all was."""
NEWEST = (("prediction_id", True),)
_READ = ("mixture_id", "prediction_id", "method", "state", "packing_density", "measured", "mixture", "compaction")


@dataclass(frozen=True)
class Filters:
    """What is looked at: what meets all of these, where they are not empty.

    Of mixtures: a text in their names, the names of ``aggregates`` of which they hold one or more, the compaction and
    the days ``since`` and ``until`` of their density tests. Of their predictions: ``methods``, ``states``.
    """

    search: str = ""
    aggregates: tuple[str, ...] = ()
    compactions: tuple[str, ...] = ()
    since: dt.date | None = None
    until: dt.date | None = None
    methods: tuple[str, ...] = ()
    states: tuple[str, ...] = ()

    def of_mixtures(self) -> list[store.Condition]:
        """Return the conditions on mixtures."""
        asked: list[tuple[str, str, Any]] = [
            ("mixture", "~", self.search.strip()),
            ("mixture_id", "holds", self.aggregates),
            ("compaction", "in", self.compactions),
            ("tested", ">=", self.since),
            ("tested", "<=", self.until),
        ]
        return [condition for condition in asked if condition[2]]

    def all(self) -> list[store.Condition]:
        """Return the conditions on mixtures and on their predictions."""
        asked = (("method", "in", self.methods), ("state", "in", self.states))
        return [*self.of_mixtures(), *(condition for condition in asked if condition[2])]


@dataclass(frozen=True)
class Points:
    """Predictions beside measurements, one by one; arrays of shape (P,).

    ``current``: whether the prediction is what the store would give now. An error that is unknown is NaN.
    """

    ids: NDArray[np.int64]
    mixture: tuple[str, ...]
    method: tuple[str, ...]
    current: NDArray[np.bool_]
    predicted: Numbers
    expected_error: Numbers
    measured: Numbers
    measured_error: Numbers


@dataclass(frozen=True)
class Density:
    """How many predictions lie in each cell of the parity plane that holds any; arrays of shape (C,).

    ``column``, ``row``: the cell's measured and predicted packing density over its ``width`` [-], rounded down; the
    width is ``times`` CELL.
    """

    column: NDArray[np.int64]
    row: NDArray[np.int64]
    current: NDArray[np.int64]
    outdated: NDArray[np.int64]
    times: int = 1

    @property
    def width(self) -> float:
        """Width of a cell [-]."""
        return CELL * self.times


@dataclass(frozen=True)
class Judged:
    """How far a method is from the measured mixtures, of which ``compared`` have its prediction as it would be now.

    ``otherwise``: those that were tested in another compaction than their aggregates and left out. ``errors``: None
    where there is none. ``volume_mean``, ``best_constant``: the mean absolute errors [-], over the
    same mixtures, of the mean of their aggregates' current tests, None where one mixture has no such mean, and of the
    mean of the other mixtures' measured packing densities.
    """

    method: str
    compared: int
    otherwise: int
    errors: Errors | None
    volume_mean: float | None = None
    best_constant: float | None = None


@dataclass(frozen=True)
class Parity:
    """What is shown: how each method is judged, and the predictions that the filters leave.

    ``measured``: the mixtures with a density test. ``shown``: the predictions that have both values. ``points``: these,
    or where there are too many those of the chosen cells; ``density``: None where all are points. ``states``: how many
    of all predictions that the filters leave are in each. ``with_warnings``: how many say something though done.
    ``listed``: rows of the columns LISTED, the newest first; ``chosen``: how many predictions were chosen, 0 for none.
    ``waiting``: the mixtures, by id, whose prediction waits for a runner ('queued') or is worked on ('running'). Of the
    others ``open``: the names by id of mixtures that are measured and not predicted, so many in ``opened``;
    ``unmeasured``: mixtures that are neither.
    """

    mixtures: int
    measured: int
    judged: tuple[Judged, ...]
    shown: int
    points: Points
    density: Density | None
    states: dict[str, int]
    with_warnings: int
    listed: tuple[tuple[Any, ...], ...]
    chosen: int
    opened: int
    unmeasured: int
    waiting: dict[int, str] = field(default_factory=dict)
    open: dict[int, str] = field(default_factory=dict)


def parity(
    target: Store,
    filters: Filters = Filters(),
    ids: Collection[int] = (),
    cells: Collection[Cell] = (),
    most: int | None = None,
) -> Parity:
    """Return predicted against measured under ``filters``.

    What is listed, ``most`` at most, are the predictions of these ``ids``, or in these ``cells``, or the newest; those
    in the cells are points too where not all are.
    """
    with target.read() as session:
        engine = store.newest_engine(session) or 0
        rows = store.list_rows(session, "predictions", _READ, filters.of_mixtures(), engine_version=engine)
        table = _Table.of(rows)
        shown = table.both & table.chosen(filters)
        density = _density(table, shown) if shown.sum() > MOST_POINTS else None
        inside = shown & _in_cells(table, cells)
        points = _points(session, table, np.flatnonzero(shown if density is None else inside)[-MOST_POINTS:], engine)
        chosen = {*ids, *(table.ids[place] or 0 for place in np.flatnonzero(inside).tolist())}
        where = [("prediction_id", "in", sorted(chosen, reverse=True)[:most])] if chosen else filters.all()
        said = [*filters.all(), ("state", "=", "done"), ("message", "!=", None)]
        return Parity(
            mixtures=len(set(table.mixture_id.tolist())),
            measured=len(set(table.mixture_id[~np.isnan(table.measured)].tolist())),
            judged=_judge(session, table, not filters.of_mixtures()),
            shown=int(shown.sum()),
            points=points,
            density=density,
            states={state: int((table.chosen(filters) & (table.state == state)).sum()) for state in STATES},
            with_warnings=store.count_rows(session, "predictions", said, engine),
            listed=tuple(store.list_rows(session, "predictions", LISTED, where, NEWEST, most, engine)),
            chosen=len(chosen),
            **_open(table, store.waiting_mixtures(session)),
        )


def parity_state(target: Store) -> str:
    """Return a text that is another one wherever ``parity`` may show something else than before."""
    with target.read() as session:
        wishes = repr(sorted(store.waiting_mixtures(session).items())).encode()
        known = (store.comparison_mark(session), store.newest_engine(session) or 0, hashlib.sha256(wishes).hexdigest())
        return " ".join(map(str, known))


def parity_csv(target: Store, filters: Filters = Filters()) -> str:
    """Return the columns WRITTEN of all predictions under ``filters`` as CSV, the newest first."""
    with target.read() as session:
        engine = store.newest_engine(session) or 0
        rows = store.list_rows(session, "predictions", WRITTEN, filters.all(), NEWEST, None, engine)
    return tables.csv_text(WRITTEN, rows)


def aggregates_in_mixtures(target: Store, most: int) -> list[str]:
    """Return the names of aggregates that mixtures hold, so many at most."""
    with target.read() as session:
        return store.names_in_mixtures(session, most)


def methods_used(target: Store) -> list[str]:
    """Return the methods that mixtures were predicted by."""
    with target.read() as session:
        return store.methods(session)


@dataclass(frozen=True)
class _Table:
    """The columns of the list as arrays, shape (R,)."""

    mixture_id: NDArray[np.int64]
    ids: list[int | None]
    method: NDArray[np.str_]
    state: NDArray[np.str_]
    predicted: Numbers
    measured: Numbers
    mixture: list[str]
    compaction: NDArray[np.str_]

    @classmethod
    def of(cls, rows: Sequence[tuple[Any, ...]]) -> "_Table":
        columns = zip(*rows, strict=True) if rows else ((),) * len(_READ)
        mixtures, ids, methods, states, predicted, measured, names, compactions = columns
        return cls(
            np.array(mixtures, dtype=np.int64), list(ids), _texts(methods), _texts(states),
            np.array(predicted, dtype=float), np.array(measured, dtype=float), list(names), _texts(compactions),
        )  # fmt: skip

    @property
    def both(self) -> NDArray[np.bool_]:
        """Whether there is a predicted and a measured packing density."""
        return np.asarray(np.isfinite(self.predicted) & np.isfinite(self.measured), dtype=np.bool_)

    @property
    def current(self) -> NDArray[np.bool_]:
        """Whether a prediction can be held against the measurement now."""
        return np.asarray(self.both & (self.state == "done"), dtype=np.bool_)

    def chosen(self, filters: Filters) -> NDArray[np.bool_]:
        """Whether a row is a prediction by one of the methods and in one of the states that are asked for."""
        out = np.asarray(self.method != "", dtype=np.bool_)
        for values, wanted in ((self.method, filters.methods), (self.state, filters.states)):
            if wanted:
                out = out & np.isin(values, wanted)
        return out


def _texts(values: Sequence[str | None]) -> NDArray[np.str_]:
    """Return texts of which most are equal as an array, empty where one is missing."""
    known = {text: place for place, text in enumerate(dict.fromkeys(values))}
    texts = np.array([text or "" for text in known], dtype=np.str_)
    return texts[np.fromiter(map(known.__getitem__, values), dtype=np.intp, count=len(values))]


def _judge(session: Session, table: _Table, is_whole: bool) -> tuple[Judged, ...]:
    """Return each method's errors, that of the most mixtures first; ``is_whole``: the table holds all mixtures."""
    ids = np.unique(table.mixture_id[table.current])
    alone = store.each_alone(session, None if is_whole else ids.tolist()) if ids.size else {}
    names = sorted(set(table.method[table.method != ""].tolist()))
    found = [_judged(name, table, np.flatnonzero(table.current & (table.method == name)), alone) for name in names]
    return tuple(sorted(found, key=lambda one: -one.compared))


def _judged(method: str, table: _Table, at: NDArray[np.int64], alone: Mapping[int, store.Alone]) -> Judged:
    """Return the errors of a method at places of the table."""
    known = [alone[key] for key in table.mixture_id[at].tolist()]
    way, stated = _texts([one.way for one in known]), table.compaction[at]
    compaction = np.where(stated == "unstated", way, stated)
    alike = _alike(method, compaction, way)
    means = np.array([one.mean for one in known], dtype=float)
    means[compaction != way] = math.nan
    at, means, otherwise = at[alike], means[alike], int(np.count_nonzero(~alike))
    measured = table.measured[at]
    if not at.size:
        return Judged(method, 0, otherwise, None)
    off = float(np.abs(means - measured).mean())
    constant = float(np.abs(comparison.best_constant(measured) - measured).mean()) if at.size > 1 else None
    errors = comparison.errors_of(table.predicted[at] - measured)
    return Judged(method, at.size, otherwise, errors, None if math.isnan(off) else off, constant)


def _alike(method: str, compaction: NDArray[np.str_], way: NDArray[np.str_]) -> NDArray[np.bool_]:
    """Return whether mixtures of a ``compaction`` may be held against a method, as ``compare`` has it.

    ``way``: the compaction of their aggregates' tests, which is that of a calibrated method's beds.
    """
    if method in REFERENCES:
        return np.ones(way.shape, dtype=np.bool_)
    return np.asarray(compaction == ("vibrated" if method == REPOSE else way), dtype=np.bool_)


def _cells(values: Numbers, times: int) -> NDArray[np.int64]:
    return np.floor(values / (CELL * times)).astype(np.int64)


def _density(table: _Table, shown: NDArray[np.bool_]) -> Density:
    """Count the predictions that are shown by cells, the finest of which there are not too many."""
    done = table.state[shown] == "done"
    for times in WIDER:
        column, row = (_cells(values[shown], times) for values in (table.measured, table.predicted))
        rows = int(row.max()) + 1
        cells, which = np.unique(column * rows + row, return_inverse=True)
        if cells.size <= MOST_CELLS:
            break
    current, outdated = (np.bincount(which[of], minlength=cells.size) for of in (done, ~done))
    return Density(cells // rows, cells % rows, current, outdated, times)


def _in_cells(table: _Table, cells: Collection[Cell]) -> NDArray[np.bool_]:
    """Return whether a prediction lies in one of the cells."""
    out, both = np.zeros(table.both.size, dtype=np.bool_), np.flatnonzero(table.both)
    for times in {cell[2] for cell in cells}:
        own = zip(*(_cells(values[both], times).tolist() for values in (table.measured, table.predicted)), strict=True)
        wanted = {cell[:2] for cell in cells if cell[2] == times}
        out[both] |= np.array([cell in wanted for cell in own], dtype=np.bool_)
    return out


def _points(session: Session, table: _Table, at: NDArray[np.int64], engine: int) -> Points:
    """Return the predictions at places of the table with their errors."""
    ids = [key for place in at.tolist() if (key := table.ids[place]) is not None]
    errors = dict[int, tuple[float | None, float | None]]()
    if ids:
        names = ("prediction_id", "expected_error", "measured_error")
        rows = store.list_rows(session, "predictions", names, [("prediction_id", "in", ids)], engine_version=engine)
        errors = {key: (expected, measured) for key, expected, measured in rows}
    expected, measured = (np.array([errors[key][k] for key in ids], dtype=float) for k in (0, 1))
    return Points(
        np.array(ids, dtype=np.int64), _at(table.mixture, at), tuple(table.method[at].tolist()),
        table.state[at] == "done", table.predicted[at], expected, table.measured[at], measured,
    )  # fmt: skip


def _at(values: Sequence[str], places: Iterable[Any]) -> tuple[str, ...]:
    return tuple(values[int(place)] for place in places)


def _open(table: _Table, asked: Mapping[int, str]) -> dict[str, Any]:
    """Return which mixtures' predictions are asked for, and which have none, those that are measured by name."""
    is_asked = np.isin(table.mixture_id, list(asked))
    missing, tested = (table.method == "") & ~is_asked, ~np.isnan(table.measured)
    places = np.flatnonzero(missing & tested)
    named = {int(table.mixture_id[place]): table.mixture[place] for place in places[:NAMED]}
    waiting = {key: asked[key] for key in table.mixture_id[is_asked].tolist()}
    counts = {"opened": int(places.size), "unmeasured": int((missing & ~tested).sum())}
    return {**counts, "open": named, "waiting": waiting}
