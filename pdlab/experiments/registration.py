"""What users bring → rows: everything of an import, or nothing."""

from dataclasses import dataclass, field
from typing import Any

from sqlalchemy.orm import Session

from pdlab import density, store
from pdlab.errors import DensityError, Problem, TableError
from pdlab.experiments.readings import mean_density, measured_test, particle_density, sieve_table
from pdlab.grading import SieveTable
from pdlab.models import Aggregate, Mixture, MixtureComponent, PackingTest, SieveAnalysis, SieveResult
from pdlab.store import Store
from pdlab.tables import DENSITY_KINDS, MixtureRecord, Row, SieveRecord, Tables


@dataclass
class Registered:
    """How many rows an import made, by table, and how many equal ones were there before."""

    new: dict[str, int] = field(
        default_factory=lambda: dict.fromkeys(("aggregates", "sieve analyses", "density tests", "mixtures"), 0)
    )
    equal: int = 0

    def count(self, table: str, is_new: bool) -> None:
        """Count one record."""
        self.new[table] += is_new
        self.equal += not is_new


def register(target: Store, tables: Tables) -> Registered:
    """Write all records of ``tables``, or none. Raises TableError with every problem at once."""
    problems, done = list(tables.problems), Registered()
    with target.write() as session:
        for row in tables.aggregates:
            _register_aggregate(session, row, problems, done)
        for record in tables.sieves:
            _register_sieves(session, record, tables, problems, done)
        for blend in tables.mixtures:
            _register_mixture(session, blend, tables, problems, done)
        for row in tables.packing_tests:
            _register_test(session, row, tables, problems, done)
        if problems:
            order = {
                name: k for k, name in enumerate(("aggregates.csv", "sieves.csv", "packing_tests.csv", "mixtures.csv"))
            }
            problems.sort(key=lambda problem: (order.get(problem.file, 9), problem.file, problem.row or 0))
            raise TableError(problems)
    return done


def _register_aggregate(session: Session, row: Row, problems: list[Problem], done: Registered) -> None:
    cells = {**row.cells, "delivery": row.cells["delivery"] or ""}
    there = store.find_aggregate(session, cells["name"], cells["delivery"])
    if there is None:
        try:
            if cells["particle_density_kg_m3"] is not None and cells["density_basis"] is not None:
                density.oven_dry_density(
                    cells["particle_density_kg_m3"], cells["density_basis"], cells["water_absorption_percent"]
                )
        except DensityError as error:
            problems.append(row.problem(str(error), "particle_density_kg_m3"))
            return
        if (cells["particle_density_kg_m3"] is None) == (cells["density_basis"] is None):
            store.add_all(session, [Aggregate(**cells)])
    else:
        for column, value in cells.items():
            if getattr(there, column) != value:
                message = (
                    f"aggregate '{there.name}' is there with {column} {getattr(there, column)}, not {value}; "
                    "give a new delivery its own name in the column delivery"
                )
                problems.append(row.problem(message, column))
    done.count("aggregates", there is None)


def _unknown(row: Row, name: str, known: set[str], column: str, problems: list[Problem]) -> None:
    if name not in known:
        problems.append(
            row.problem(f"no aggregate named '{name}'; add it to aggregates.csv or correct the name", column)
        )


def _register_sieves(
    session: Session, record: SieveRecord, tables: Tables, problems: list[Problem], done: Registered
) -> None:
    aggregate = store.find_aggregate(session, record.aggregate, record.delivery)
    if aggregate is None:
        _unknown(record.first, record.aggregate, tables.named_aggregates, "aggregate", problems)
        return
    wanted = _sieve_facts(record.table, record.standard, record.date)
    is_new = all(_sieve_facts(sieve_table(old), old.standard, old.date) != wanted for old in aggregate.sieve_analyses)
    if is_new:
        aggregate.sieve_analyses.append(
            SieveAnalysis(
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
        )
        session.flush()
    done.count("sieve analyses", is_new)


def _sieve_facts(table: SieveTable, *rest: Any) -> tuple[Any, ...]:
    return (table, *rest)


def _register_mixture(
    session: Session, record: MixtureRecord, tables: Tables, problems: list[Problem], done: Registered
) -> None:
    parts = [store.find_aggregate(session, name) for name in record.aggregates]
    for name, part in zip(record.aggregates, parts, strict=True):
        if part is None:
            _unknown(record.first, name, tables.named_aggregates, "aggregate", problems)
    known = [part for part in parts if part is not None]
    if len(known) < len(parts):
        return
    shares = list(record.shares)
    if record.by_mass:
        densities = [particle_density(part) for part in known]
        if None in densities:
            message = (
                f"mixture '{record.name}' gives shares by mass, which needs a particle density of each aggregate; "
                "enter it or give solid_volume_share"
            )
            problems.append(record.first.problem(message, "mass_share"))
            return
        shares = density.solid_volume_shares(shares, [float(value or 0.0) for value in densities])
    there = store.find_mixture(session, record.name)
    if there is None:
        components = [
            MixtureComponent(
                position=k, aggregate_id=part.id, solid_volume_share=share,
                mass_share=record.shares[k] if record.by_mass else None,
            )
            for k, (part, share) in enumerate(zip(known, shares, strict=True))
        ]  # fmt: skip
        if not any(problem.file == record.first.file for problem in problems):
            store.add_all(session, [Mixture(name=record.name, components=components)])
    else:
        before = {part.aggregate_id: part.solid_volume_share for part in there.components}
        after = {part.id: share for part, share in zip(known, shares, strict=True)}
        if before.keys() != after.keys() or any(abs(before[key] - after[key]) > 1e-9 for key in before):
            message = f"mixture '{record.name}' is there with other shares or aggregates; give this one another name"
            problems.append(record.first.problem(message, "mixture"))
    done.count("mixtures", there is None)


def _register_test(session: Session, row: Row, tables: Tables, problems: list[Problem], done: Registered) -> None:
    named, cells = row.cells["material"], dict(row.cells)
    kind, name = named.split(":", 1) if named.startswith(("aggregate:", "mixture:")) else ("", named)
    aggregate = store.find_aggregate(session, name) if kind != "mixture" else None
    blend = store.find_mixture(session, name) if kind != "aggregate" else None
    if aggregate is not None and blend is not None:
        message = f"'{name}' names an aggregate and a mixture; write aggregate:{name} or mixture:{name}"
        problems.append(row.problem(message, "material"))
        return
    material = aggregate or blend
    if material is None:
        if name not in tables.named_aggregates | tables.named_mixtures:
            message = f"no aggregate or mixture named '{name}'; add it or correct the name"
            problems.append(row.problem(message, "material"))
        return
    del cells["material"]
    test = PackingTest(**cells, raw_text="\t".join(f"{key}={text}" for key, text in row.raw.items() if text.strip()))
    try:
        measured_test(test, particle_density(material) if isinstance(material, Aggregate) else mean_density(material))
    except DensityError as error:
        column = next((kind for kind in DENSITY_KINDS if cells[kind] is not None), None)
        problems.append(row.problem(str(error), column))
        return
    is_new = all(any(getattr(old, key) != value for key, value in cells.items()) for old in material.packing_tests)
    if is_new:
        material.packing_tests.append(test)
        session.flush()
    done.count("density tests", is_new)
