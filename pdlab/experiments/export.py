"""Rows → the tables that users bring: what an import into an empty store makes anew, value by value."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pdlab import density, store
from pdlab.errors import InputError
from pdlab.experiments.readings import particle_density
from pdlab.models import Aggregate, Mixture, PackingTest, SieveAnalysis
from pdlab.store import Store
from pdlab.tables import LAYOUT, ParseError, check_target, write_tables

Cells = dict[str, str]


@dataclass
class Exported:
    """What an export wrote: its ``files``, how many ``rows`` of each table, and what did not travel."""

    files: list[Path] = field(default_factory=list)
    rows: dict[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def export_tables(target: Store, path: Path) -> Exported:
    """Write all aggregates, sieve analyses, density tests and mixtures to a new folder, or to an .xlsx file.

    Raises InputError where something would be overwritten, and for a store that holds nothing.
    """
    check_target(path)
    with target.read() as session:
        aggregates, mixtures = store.all_deliveries(session), store.mixtures(session)
    if not aggregates:
        raise InputError(f"the store {target.url} holds no aggregate yet, so there is nothing to export; import some")
    done = Exported()
    materials: list[Aggregate | Mixture] = [*aggregates, *mixtures]
    tests = sorted(((test, row) for row in materials for test in row.packing_tests), key=lambda pair: pair[0].id)
    both = {row.name for row in aggregates} & {row.name for row in mixtures}
    tables = {
        "aggregates": [_given(row, LAYOUT["aggregates"]) for row in aggregates],
        "sieves": [cells for row in aggregates for cells in _sieves(row)],
        "packing_tests": [_test(test, row, both) for test, row in tests],
        "mixtures": [cells for row in mixtures for cells in _mixture(row, done.notes)],
    }
    done.rows = {kind: len(rows) for kind, rows in tables.items() if rows}
    done.files = write_tables(tables, path)
    return done


def _text(value: Any) -> str:
    """Return a value as text that reads as the same value, to the last bit of a number."""
    return "" if value is None else repr(value) if isinstance(value, float) else str(value)


def _given(row: object, columns: Any) -> Cells:
    """Return the cells of those ``columns`` that a row has and fills."""
    values = {name: getattr(row, name, None) for name in columns}
    return {name: _text(value) for name, value in values.items() if value is not None}


def _entered(raw: str | None, value: Any, parse: Callable[[str], Any]) -> str:
    """Return the text that was entered where it still reads as the value, without a decimal comma; else the value's."""
    try:
        if raw and "," not in raw and parse(raw) == value:
            return raw
    except ParseError:
        pass  # entered as an earlier version read it, or corrected since
    return "pan" if value is None else _text(value)


def _sieves(row: Aggregate) -> Iterator[Cells]:
    """Give the lines of an aggregate's analyses; where there are several, they are told apart by number."""
    several = len(row.sieve_analyses) > 1
    for number, analysis in enumerate(row.sieve_analyses, start=1):
        named = {"aggregate": row.name, "delivery": row.delivery, "analysis": str(number) if several else ""}
        facts = _given(analysis, ("sample_mass_g", "pan_lower_mm", "standard", "date"))
        for values in _results(analysis):
            yield {**named, **values, **facts}


def _results(analysis: SieveAnalysis) -> Iterator[Cells]:
    parse = LAYOUT["sieves"]
    for result in analysis.results:
        aperture, _, value = result.raw_text.partition("\t")
        yield {
            "aperture_mm": _entered(aperture, result.aperture_mm, parse["aperture_mm"].parse),
            analysis.kind: _entered(value, getattr(result, analysis.kind), parse[analysis.kind].parse),
        }


def _test(test: PackingTest, material: Aggregate | Mixture, both: set[str]) -> Cells:
    """Return a density test's line; ``both``: the names that an aggregate and a mixture have."""
    raw = dict(part.partition("=")[::2] for part in test.raw_text.split("\t"))
    out = _given(test, LAYOUT["packing_tests"])
    for name, column in LAYOUT["packing_tests"].items():
        if name in out and column.number:
            out[name] = _entered(raw.get(name, "").strip(), getattr(test, name), column.parse)
    whole = f"{'aggregate' if isinstance(material, Aggregate) else 'mixture'}:{material.name}"
    is_plain = material.name not in both and not material.name.startswith(("aggregate:", "mixture:"))
    out["material"] = material.name if is_plain and raw.get("material") != whole else whole
    out["delivery"] = material.delivery if isinstance(material, Aggregate) else ""
    return out


def _mixture(row: Mixture, notes: list[str]) -> Iterator[Cells]:
    """Give a mixture's lines: shares by mass where they still give its stored ones by solid volume."""
    masses, solid = zip(*((part.mass_share, part.solid_volume_share) for part in row.components), strict=True)
    by_mass = masses[0] is not None
    if by_mass:
        densities = [particle_density(part.aggregate) or math.nan for part in row.components]
        if density.solid_volume_shares(list(masses), densities) != list(solid):
            by_mass = False
            notes.append(
                f"mixture '{row.name}': its shares by mass no longer give its shares by solid volume, as a particle "
                "density has changed; the shares by solid volume are exported"
            )
    column = "mass_share" if by_mass else "solid_volume_share"
    for part in row.components:
        yield {
            "mixture": row.name,
            "aggregate": part.aggregate.name,
            "delivery": part.aggregate.delivery,
            column: _text(getattr(part, column)),
        }
