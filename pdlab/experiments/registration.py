"""What users bring → rows: everything of an import, or nothing; of a table of mixtures each that can be.

What the store holds of the names that were brought is read first, all at once; what is new is written at the end.
"""

from dataclasses import dataclass, field
from typing import TypeVar

from sqlalchemy.orm import Session

from pdlab import density, store
from pdlab.errors import DensityError, Problem, TableError
from pdlab.experiments.readings import mean_density, measured_test, particle_density, sieve_table
from pdlab.models import Aggregate, Mixture, MixtureComponent, PackingTest, SieveAnalysis, SieveResult
from pdlab.store import Store
from pdlab.tables import DENSITY_KINDS, LAYOUT, Brought, MixtureRecord, Row, SieveRecord, Slice, Tables

_Test = TypeVar("_Test", SieveAnalysis, PackingTest)
TABLES = ("aggregates", "aggregates completed", "sieve analyses", "density tests", "mixtures")


@dataclass
class Registered:
    """What an import made, or a dry run would make: records by table, and what equals what was there.

    ``new``: how many records of each table; ``equal``: how many changed nothing; ``names``: the materials of
    both, by table and whether they are new; ``notes``: what the user should know of an import that went well.
    """

    new: dict[str, int] = field(default_factory=lambda: dict.fromkeys(TABLES, 0))
    equal: int = 0
    names: dict[tuple[str, bool], list[str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def count(self, table: str, is_new: bool, name: str) -> None:
        """Count one record."""
        self.new[table] += is_new
        self.equal += not is_new
        self.names.setdefault((table, is_new), []).append(name)


@dataclass
class _Import:
    """One import on its way: the session, what was brought, what is wrong, what was made.

    ``aggregates``, by name and delivery, and ``mixtures``: those that were named, stored or brought. ``matched``: the
    stored tests that a brought one is or equals; each equals one at most, so that a history with two equal tests in
    it is brought whole. ``last``: by material, where its test that was brought last stands, and whether it is the
    newest.
    """

    session: Session
    tables: Tables
    problems: list[Problem]
    aggregates: dict[str, dict[str, Aggregate]]
    mixtures: dict[str, Mixture]
    done: Registered = field(default_factory=Registered)
    matched: set[object] = field(default_factory=set)
    last: dict[tuple[str, Aggregate | Mixture], tuple[Row, bool]] = field(default_factory=dict)


def register(target: Store, tables: Tables, dry_run: bool = False) -> Registered:
    """Write all records of ``tables``, or none; with ``dry_run`` none, and say what would be written.

    Raises TableError with every problem at once.
    """
    with target.write() as session:
        work = _begin(session, tables)
        for row in tables.aggregates:
            _register_aggregate(work, row)
        session.flush()
        for record in tables.sieves:
            _register_sieves(work, record)
        for blend in tables.mixtures:
            _register_mixture(work, blend)
        for row in tables.packing_tests:
            _register_test(work, row)
        _note_old_ones(work)
        if work.problems:
            raise TableError(sorted(work.problems, key=lambda found: (_order(found.file), found.row or 0)))
        session.flush()
        if dry_run:
            session.rollback()
    return work.done


def register_each(target: Store, part: Slice) -> list[int | TableError]:
    """Write each mixture of a slice that can be, all in one transaction; none stops another.

    Returns, in order, the key of each one's row, new or equal to what was there, or why it has none.
    """
    with target.write() as session:
        work = _begin(session, Tables(mixtures=[one.record for one in part.mixtures if one.record is not None]))
        found = [_register_brought(work, one) for one in part.mixtures]
        session.flush()
        return [row if isinstance(row, TableError) else row.id for row in found]


def _register_brought(work: _Import, brought: Brought) -> Mixture | TableError:
    """Make a mixture, or find the equal one that is there; or say what is wrong with it."""
    if brought.record is None:
        return TableError(list(brought.problems))
    row = _register_mixture(work, brought.record)
    if row is not None:
        return row
    error = TableError(list(work.problems))
    work.problems.clear()
    return error


def _begin(session: Session, tables: Tables) -> _Import:
    """Read what the store holds of all that is named."""
    materials = {_named_material(row)[1] for row in tables.packing_tests}
    aggregates = {row.cells["name"] for row in tables.aggregates} | {record.aggregate for record in tables.sieves}
    aggregates |= {name for record in tables.mixtures for name, _ in record.aggregates} | materials
    mixtures = {record.name for record in tables.mixtures} | materials
    return _Import(
        session,
        tables,
        list(tables.problems),
        store.aggregates_named(session, sorted(aggregates)),
        store.mixtures_named(session, sorted(mixtures), with_tests=bool(materials)),
    )


def _order(file: str) -> int:
    """Return where a table stands among the others, by the name of its file or of its sheet."""
    stem = file.rpartition(", sheet ")[2].removesuffix(".csv")
    return list(LAYOUT).index(stem) if stem in LAYOUT else len(LAYOUT)


def _register_aggregate(work: _Import, row: Row) -> None:
    """Make an aggregate, or fill what was empty in the one that is there; nothing is overwritten."""
    cells = {**row.cells, "delivery": row.cells["delivery"] or ""}
    there = work.aggregates.get(cells["name"], {}).get(cells["delivery"])
    given = {column: value for column, value in cells.items() if value is not None}
    empty = {column for column in given if there is None or getattr(there, column) is None}
    for column in given.keys() - empty:
        if getattr(there, column) != given[column]:
            message = (
                f"aggregate '{cells['name']}' is there with {column} {getattr(there, column)}, not {given[column]}; "
                "give a new delivery its own name in the column delivery"
            )
            work.problems.append(row.problem(message, column))
            return
    target = there or Aggregate(**cells, sieve_analyses=[], packing_tests=[])
    for column in empty:
        setattr(target, column, given[column])
    try:
        particle_density(target)
    except DensityError as error:
        work.problems.append(row.problem(str(error), "particle_density_kg_m3"))
        work.tables.named_aggregates.add((cells["name"], cells["delivery"]))
        for column in empty:
            setattr(target, column, None)
        return
    if there is None:
        work.session.add(target)
        work.aggregates.setdefault(cells["name"], {})[cells["delivery"]] = target
    table = "aggregates completed" if there and empty else "aggregates"
    work.done.count(table, there is None or bool(empty), cells["name"])


def _find(work: _Import, row: Row, name: str, delivery: str) -> Aggregate | None:
    """Return an aggregate; None, and a problem unless its own row is reported already, where there is none."""
    others = work.aggregates.get(name, {})
    found = store.choose_delivery(others, delivery)
    if found is None and not work.tables.excuses_aggregate(name, delivery):
        if others:
            message = (
                f"no delivery '{delivery}' of aggregate '{name}' (it has: {', '.join(map(repr, others))}); "
                "name one in the column delivery"
            )
        else:
            message = f"no aggregate named '{name}'; add it to aggregates.csv or correct the name"
        work.problems.append(row.problem(message, "delivery" if others else "aggregate"))
    return found


def _register_sieves(work: _Import, record: SieveRecord) -> None:
    aggregate = _find(work, record.first, record.aggregate, record.delivery)
    if aggregate is None:
        return
    made = SieveAnalysis(
        kind=record.table.kind,
        sample_mass_g=record.table.sample_mass,
        pan_lower_mm=record.table.pan_lower,
        standard=record.standard,
        date=record.date,
        raw_text="\n".join(record.raw),
        results=[
            SieveResult(position=k, aperture_mm=row.aperture, raw_text=raw, **{record.table.kind: row.value})
            for k, (row, raw) in enumerate(zip(record.table.rows, record.raw, strict=True))
        ],
    )
    wanted = (record.table, record.standard, record.date)
    equal = [old for old in aggregate.sieve_analyses if (sieve_table(old), old.standard, old.date) == wanted]
    _keep_test(work, "sieve analyses", aggregate, aggregate.sieve_analyses, equal, made, record.first)


def _keep_test(
    work: _Import,
    table: str,
    material: Aggregate | Mixture,
    rows: list[_Test],
    equal: list[_Test],
    made: _Test,
    place: Row,
) -> None:
    """Add a test to the ``rows`` of its material, unless it is one of the ``equal`` ones that were there."""
    there = next((old for old in equal if old not in work.matched), None)
    if there is None:
        rows.append(made)
    work.matched.add(there or made)
    work.last[table, material] = (place, (there or made) is rows[-1])
    work.done.count(table, there is None, material.name)


def _note_old_ones(work: _Import) -> None:
    """Note what was brought last of a material's tests and equals one that is not the current one."""
    for (table, material), (place, is_newest) in work.last.items():
        if not is_newest:
            message = (
                f"equals one of the {table} of '{material.name}' that has a newer one after it, which stays the "
                "current one; if it was measured anew, give it its date"
            )
            work.done.notes.append(str(place.problem(message)))


def _register_mixture(work: _Import, record: MixtureRecord) -> Mixture | None:
    """Make a mixture, or find the equal one that is there; None, and a problem, where it cannot be."""
    parts = [found for name, delivery in record.aggregates if (found := _find(work, record.first, name, delivery))]
    shares = _solid_shares(work, record, parts) if len(parts) == len(record.shares) else None
    if shares is None:
        work.tables.named_mixtures.add(record.name)
        return None
    there = work.mixtures.get(record.name)
    work.done.count("mixtures", there is None, record.name)
    if there is None:
        components = [
            MixtureComponent(
                position=k, aggregate=part, aggregate_id=part.id, solid_volume_share=share,
                mass_share=record.shares[k] if record.by_mass else None,
            )
            for k, (part, share) in enumerate(zip(parts, shares, strict=True))
        ]  # fmt: skip
        made = work.mixtures[record.name] = Mixture(name=record.name, components=components, packing_tests=[])
        work.session.add(made)
        return made
    before = {part.aggregate_id: part.solid_volume_share for part in there.components}
    after = {part.id: share for part, share in zip(parts, shares, strict=True)}
    if before.keys() != after.keys() or any(abs(before[key] - after[key]) > 1e-9 for key in before):
        message = f"mixture '{record.name}' is there with other shares or aggregates; give this one another name"
        work.problems.append(record.first.problem(message, "mixture"))
        return None
    return there


def _solid_shares(work: _Import, record: MixtureRecord, parts: list[Aggregate]) -> list[float] | None:
    """Return a mixture's shares by solid volume; None, and a problem, where they cannot be had."""
    if len({part.id for part in parts}) < len(parts):
        message = f"mixture '{record.name}' names one delivery of an aggregate twice; keep one row"
        work.problems.append(record.first.problem(message, "aggregate"))
        return None
    if not record.by_mass:
        return list(record.shares)
    densities = [particle_density(part) for part in parts]
    if None in densities:
        message = (
            f"mixture '{record.name}' gives shares by mass, which needs a particle density of each aggregate; "
            "enter it or give solid_volume_share"
        )
        work.problems.append(record.first.problem(message, "mass_share"))
        return None
    return density.solid_volume_shares(list(record.shares), [float(value or 0.0) for value in densities])


def _named_material(row: Row) -> tuple[str, str]:
    """Return what a density test names: aggregate, mixture or '' where it does not say which, and the name."""
    named = row.cells["material"]
    kind, name = named.split(":", 1) if named.startswith(("aggregate:", "mixture:")) else ("", named)
    return kind, name.strip()


def _material(work: _Import, row: Row) -> Aggregate | Mixture | None:
    """Return the aggregate or mixture that a density test names; None, and a problem, where there is none."""
    (kind, name), delivery = _named_material(row), row.cells["delivery"] or ""
    deliveries = work.aggregates.get(name, {}) if kind != "mixture" else {}
    aggregate = store.choose_delivery(deliveries, delivery)
    blend = work.mixtures.get(name) if kind != "aggregate" else None
    if aggregate is not None and blend is not None:
        message = f"'{name}' names an aggregate and a mixture; write aggregate:{name} or mixture:{name}"
        work.problems.append(row.problem(message, "material"))
        return None
    if aggregate is None and blend is None:
        if deliveries:
            return _find(work, row, name, delivery)
        excused = kind != "mixture" and work.tables.excuses_aggregate(name, delivery)
        if not excused and not (kind != "aggregate" and work.tables.excuses_mixture(name)):
            what = kind or "aggregate or mixture"
            work.problems.append(row.problem(f"no {what} named '{name}'; add it or correct the name", "material"))
    return aggregate or blend


def _register_test(work: _Import, row: Row) -> None:
    material, cells = _material(work, row), dict(row.cells)
    if material is None:
        return
    del cells["material"], cells["delivery"]
    test = PackingTest(**cells, raw_text="\t".join(f"{key}={text}" for key, text in row.raw.items() if text.strip()))
    try:
        measured_test(test, particle_density(material) if isinstance(material, Aggregate) else mean_density(material))
    except DensityError as error:
        column = next((kind for kind in DENSITY_KINDS if cells[kind] is not None), None)
        work.problems.append(row.problem(str(error), column))
        return
    rows = material.packing_tests
    equal = [old for old in rows if all(getattr(old, key) == value for key, value in cells.items())]
    _keep_test(work, "density tests", material, rows, equal, test, row)
