"""Correct typing errors in place, with a history, and delete what nothing rests on."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session, attributes
from sqlalchemy.orm.exc import StaleDataError

from pdlab import density, grading, store
from pdlab.errors import DensityError, EditedMeanwhile, InputError, StillNeeded
from pdlab.experiments.addresses import address, find, row_key
from pdlab.experiments.descent import history, plain
from pdlab.experiments.readings import mean_density, measured_test, particle_density, sieve_table
from pdlab.grading import KINDS
from pdlab.models import (
    CORRECTABLE,
    Aggregate,
    Base,
    Calibration,
    Correction,
    Mixture,
    MixtureComponent,
    PackingTest,
    Prediction,
    Run,
    RunState,
    SieveAnalysis,
    SieveResult,
    Sweep,
)
from pdlab.specimen import check_shares
from pdlab.store import Store
from pdlab.tables import DENSITY_KINDS, LAYOUT, SHARE_KINDS

Edited = Aggregate | SieveAnalysis | PackingTest | Mixture
"""A record: a row that carries a version, with its parts."""
COLUMNS: dict[type[Base], tuple[str, tuple[str, ...]]] = {
    Aggregate: ("aggregates", tuple(LAYOUT["aggregates"])),
    SieveAnalysis: ("sieves", ("sample_mass_g", "pan_lower_mm", "standard", "date")),
    SieveResult: ("sieves", ("aperture_mm", *KINDS)),
    PackingTest: ("packing_tests", tuple(name for name in LAYOUT["packing_tests"] if hasattr(PackingTest, name))),
    Mixture: ("mixtures", ("name",)),
    MixtureComponent: ("mixtures", SHARE_KINDS),
}
"""The columns that may be corrected, and the imported table whose parser reads them."""
DENSITY_COLUMNS = {"particle_density_kg_m3", "density_basis", "water_absorption_percent"}
DELETABLE = ("aggregate", "mixture", "sieve_analysis", "packing_test", "calibration", "prediction", "sweep", "run")
PLURALS = {
    "sieve_analysis": "sieve analyses", "packing_test": "packing tests", "mixture": "mixtures",
    "calibration": "calibrations", "prediction": "predictions", "sweep": "sweeps",
}  # fmt: skip
DELETED = "(deleted)"
"""The column name under which a deletion is written down, with the whole row as its old value."""


@dataclass(frozen=True)
class Corrected:
    """One value corrected: the row's address, its column, and what stood there before and after, None for empty."""

    address: str
    column: str
    old: str | None
    new: str | None


@dataclass
class _Work:
    """One correction on its way: who makes it and why, what it has changed."""

    session: Session
    by: str
    reason: str | None
    made: list[Correction] = field(default_factory=list)
    out: list[Corrected] = field(default_factory=list)

    def set(self, row: Base, column: str, value: Any) -> None:
        """Change a value and write down what it was; an equal one changes nothing."""
        old = getattr(row, column)
        if old == value:
            return
        before, after = _text(old), _text(value)
        self.out.append(Corrected(address(row), column, before, after))
        setattr(row, column, value)
        self.made.append(_correction(self, row, column, before, after))


def _correction(work: _Work, row: Base, column: str, old: str | None, new: str | None) -> Correction:
    return Correction(
        table_name=row.__tablename__, row_key=row_key(row), column_name=column, old_value=old, new_value=new,
        corrected_by=work.by, reason=work.reason,
    )  # fmt: skip


def _text(value: Any) -> str | None:
    return None if value is None else str(value)


def correct(
    target: Store,
    changes: Mapping[str, Mapping[str, str]],
    by: str,
    reason: str | None = None,
    version: int | None = None,
) -> list[Corrected]:
    """Correct typing errors of one record in place: what was entered stays in its history.

    ``changes``: by row, as ``addresses.find`` reads it, the text of each column, read and checked as in an import;
    an empty text empties the cell. A sieve analysis is one record with its results, a mixture with its components.
    ``version``: the record's as its corrector saw it. All of it or nothing; what rests on it is not worked out
    again but is outdated from then on. Solid-volume shares that came from shares by mass follow.

    Raises UnknownName, InputError for what an import would refuse, and EditedMeanwhile where the record is no longer
    of that ``version``.
    """
    if not by.strip():
        raise InputError("a correction names who makes it; give --by")
    with target.write() as session, session.no_autoflush:
        work = _Work(session, by.strip(), reason)
        rows = {what: find(session, what, CORRECTABLE) for what in changes}
        record = _one_record(session, rows)
        _check_version(session, record, version)
        for what, columns in changes.items():
            _set_columns(work, rows[what], columns)
        _follow(work, record)
        _check(session, record)
        if work.made:
            _write(work, record)
    return work.out


def _one_record(session: Session, rows: Mapping[str, Base]) -> Edited:
    """Return the record that all rows belong to. Raises InputError."""
    records = {id(record): record for record in (_record(session, row) for row in rows.values())}
    if len(records) != 1:
        named = ", ".join(address(record) for record in records.values()) or "none"
        raise InputError(f"one correction changes one record, not {len(records)} ({named}); correct them one by one")
    return next(iter(records.values()))


def _record(session: Session, row: Base) -> Edited:
    parent: Base | None = row
    if isinstance(row, SieveResult):
        parent = store.find_row(session, SieveAnalysis, row.sieve_analysis_id)
    elif isinstance(row, MixtureComponent):
        parent = store.find_row(session, Mixture, row.mixture_id)
    assert isinstance(parent, Edited)
    return parent


def _check_version(session: Session, record: Edited, seen: int | None) -> None:
    if seen is not None and seen != record.version:
        raise EditedMeanwhile(_edited_text(session, record, f"it is version {record.version} now, you saw {seen}"))


def _edited_text(session: Session, record: Edited, what: str) -> str:
    """Say who changed a record last and when, as far as that was written down."""
    rows = [record, *_parts(record)]
    last = history(session, {(row.__tablename__, row_key(row)): record.created_at for row in rows})[-1:]
    who = "".join(f", by {one.corrected_by} on {one.corrected_at:%Y-%m-%d %H:%M} UTC" for one in last)
    return (
        f"{address(record)} was changed since you saw it{who}: {what}; look at it with "
        f"'pdlab show {address(record)}' and correct what is still wrong"
    )


def _parts(record: Base) -> Sequence[Base]:
    if isinstance(record, SieveAnalysis):
        return record.results
    return record.components if isinstance(record, Mixture) else ()


def _set_columns(work: _Work, row: Base, columns: Mapping[str, str]) -> None:
    table, known = COLUMNS[type(row)]
    values = {}
    for column, text in columns.items():
        if column not in known:
            raise InputError(f"{address(row)} has no column '{column}' to correct; it has {', '.join(known)}")
        layout = LAYOUT[table]["mixture" if column == "name" and table == "mixtures" else column]
        if not text.strip():
            if layout.required:
                raise InputError(f"{column} of {address(row)} cannot be emptied; give a value")
            values[column] = "" if column == "delivery" else None
            continue
        try:
            values[column] = layout.parse(text)
        except InputError as error:
            raise type(error)(f"{column}: {error}") from error
    _check_name(work.session, row, values)
    _check_kind(row, values)
    for column, value in values.items():
        work.set(row, column, value)


def _check_name(session: Session, row: Base, values: Mapping[str, Any]) -> None:
    """Raise InputError where another row has the name already."""
    if isinstance(row, Mixture):
        taken = values.get("name", row.name) != row.name and store.find_mixture(session, values["name"]) is not None
    elif isinstance(row, Aggregate):
        name, delivery = values.get("name", row.name), values.get("delivery", row.delivery)
        taken = (name, delivery) != (row.name, row.delivery) and delivery in store.deliveries(session, name)
    else:
        return
    if taken:
        raise InputError(f"{address(row)} cannot take the name of a row that is there already; choose another")


def _check_kind(row: Base, values: Mapping[str, Any]) -> None:
    """Raise InputError where a part would change from one kind of value to another."""
    kinds = KINDS if isinstance(row, SieveResult) else SHARE_KINDS if isinstance(row, MixtureComponent) else ()
    entered = next((kind for kind in reversed(kinds) if getattr(row, kind) is not None), None)
    for column in values.keys() & set(kinds):
        if column != entered or values[column] is None:
            raise InputError(f"{address(row)} was entered as {entered}; correct that number")


def _follow(work: _Work, record: Edited) -> None:
    """Work out again the shares by solid volume that rest on shares by mass."""
    changed = {one.column for one in work.out}
    blends: Sequence[Mixture] = [record] if isinstance(record, Mixture) and "mass_share" in changed else ()
    if isinstance(record, Aggregate) and changed & DENSITY_COLUMNS:
        blends = store.blends_with(work.session, record.id)
    for blend in blends:
        masses = [part.mass_share for part in blend.components if part.mass_share is not None]
        if len(masses) < len(blend.components):
            continue
        check_shares(masses)
        densities = [particle_density(part.aggregate) for part in blend.components]
        if None in densities:
            raise DensityError(
                f"the shares of mixture '{blend.name}' were entered by mass, which needs a particle density of each "
                "aggregate; give one"
            )
        shares = density.solid_volume_shares(masses, [value or 0.0 for value in densities])
        for part, share in zip(blend.components, shares, strict=True):
            work.set(part, "solid_volume_share", share)
        attributes.flag_modified(blend, "name")  # its version rises with its parts


def _check(session: Session, record: Edited) -> None:
    """Raise the InputError that an import would raise of a record and of the tests that it is the measure of."""
    if isinstance(record, SieveAnalysis):
        grading.make_grading(sieve_table(record))
    elif isinstance(record, PackingTest):
        _check_test(record)
    elif isinstance(record, Mixture):
        check_shares([part.solid_volume_share for part in record.components])
        for test in record.packing_tests:
            _check_test(test)
    else:
        if (record.particle_density_kg_m3 is None) != (record.density_basis is None):
            raise DensityError("a particle density and its basis go together; fill both or neither")
        blends = store.blends_with(session, record.id)
        for test in (*record.packing_tests, *(test for blend in blends for test in blend.packing_tests)):
            _check_test(test)
        particle_density(record)


def _check_test(test: PackingTest) -> None:
    given = [kind for kind in DENSITY_KINDS if getattr(test, kind) is not None]
    if len(given) != 1:
        raise DensityError(
            f"{address(test)} would hold {' and '.join(given) or 'no density'}; fill exactly one of "
            f"{', '.join(DENSITY_KINDS)}"
        )
    if test.aggregate is not None:
        measured_test(test, particle_density(test.aggregate))
    elif test.mixture is not None:
        measured_test(test, mean_density(test.mixture))


def _write(work: _Work, record: Edited) -> None:
    """Write a correction. Raises EditedMeanwhile where another wrote the record at the same time."""
    attributes.flag_modified(record, "created_at")  # its version rises with its parts
    named = address(record)  # a session that failed says nothing more
    try:
        store.add_all(work.session, work.made)
    except StaleDataError as error:
        raise EditedMeanwhile(
            f"{named} was changed by another at the same time; look at it with 'pdlab show {named}' and correct what "
            "is still wrong"
        ) from error
    except IntegrityError as error:
        reason = str(error.orig).partition("\n")[0]  # PostgreSQL adds the row on further lines
        raise InputError(
            f"the store cannot hold {named} so ({reason}); correct values that change places one after the other"
        ) from error


def delete(target: Store, what: str, by: str, reason: str | None = None, confirmed: bool = True) -> str:
    """Delete a row with its own parts (a sieve analysis's results, a run's bed); return its address.

    Of what people entered the whole row is kept in the history. Raises UnknownName, StillNeeded where anything
    rests on the row, and, unless ``confirmed``, InputError that says what would go.
    """
    if not by.strip():
        raise InputError("a deletion names who makes it; give --by")
    with target.write() as session:
        row = find(session, what, DELETABLE)
        named, needed, parts = address(row), store.resting_on(session, row), _own_parts(session, row)
        if needed:
            raise StillNeeded(f"{named} cannot be deleted: on it rest {_listed(needed)}; delete those first")
        if not confirmed:
            its = f" with {len(parts)} rows of its own" if parts else ""
            raise InputError(f"{named}{its} would be deleted; add --yes")
        if row.__tablename__ in CORRECTABLE:
            whole = json.dumps(_filled(row) | {"parts": [_filled(part) for part in parts]}, ensure_ascii=False)
            store.add_all(session, [_correction(_Work(session, by.strip(), reason), row, DELETED, whole, None)])
        for one in (*parts, row):
            session.delete(one)
        try:
            session.flush()
        except IntegrityError as error:
            raise StillNeeded(
                f"{named} cannot be deleted: another has used it a moment ago; see 'pdlab show {named}'"
            ) from error
    return named


def _filled(row: Base) -> dict[str, Any]:
    return {name: value for name, value in plain(row, with_parents=True).items() if value is not None}


def _listed(needed: Mapping[str, Sequence[str]]) -> str:
    """Name what rests on a row with its counts, five of each table and the number of the others."""
    words = []
    for table, names in needed.items():
        kind = PLURALS[table] if len(names) > 1 else table.replace("_", " ")
        more = f" and {len(names) - 5} more" if len(names) > 5 else ""
        words.append(f"{len(names)} {kind} ({', '.join(f'{table}:{name}' for name in names[:5])}{more})")
    return ", ".join(words)


def _own_parts(session: Session, row: Base) -> list[Base]:
    if isinstance(row, Run):
        bed = store.find_row(session, RunState, row.specimen_hash)
        return [] if bed is None else [bed]
    if isinstance(row, Prediction):
        return [*row.runs, *row.calibrations]
    if isinstance(row, Sweep):
        return [*row.components, *row.runs, *row.calibrations]
    return [*row.runs] if isinstance(row, Calibration) else list(_parts(row))
