"""Parsed rows → records: what belongs together, and what one table alone shows to be wrong."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from pdlab.errors import Problem
from pdlab.grading import KINDS, SieveRow, SieveTable, check, check_rows
from pdlab.specimen import SHARE_TOLERANCE
from pdlab.tables.layout import DENSITY_KINDS, SHARE_KINDS, MixtureRecord, Row, SieveRecord, Tables


@dataclass
class Rows:
    """Parsed rows by table."""

    by_kind: dict[str, list[Row]] = field(default_factory=dict)

    def of(self, kind: str) -> list[Row]:
        """Return the rows of a table, to be read or added to."""
        return self.by_kind.setdefault(kind, [])


def gather(rows: Rows, out: Tables) -> Tables:
    """Make records of rows that belong together, with their problems."""
    for row in rows.of("aggregates"):
        if (row.cells["particle_density_kg_m3"] is None) != (row.cells["density_basis"] is None) and row.sound:
            out.problems.append(
                row.problem("a particle density and its basis go together; fill both or neither", "density_basis")
            )
        elif row.sound:
            out.aggregates.append(row)
            continue
        out.named_aggregates.add((row.cells["name"] or "", row.cells["delivery"] or ""))
    for test in rows.of("packing_tests"):
        if test.sound and _one_kind(test, DENSITY_KINDS, out.problems) is not None:
            out.packing_tests.append(test)
    for group in _groups(rows.of("sieves"), "aggregate", "delivery"):
        for analysis in _analyses(group, out.problems):
            _gather_sieves(analysis, out)
    for group in _groups(rows.of("mixtures"), "mixture"):
        gather_mixture(group, out)
    return out


def _groups(rows: Iterable[Row], *keys: str) -> list[list[Row]]:
    groups: dict[tuple[Any, ...], list[Row]] = {}
    for row in rows:
        groups.setdefault(tuple(row.cells[key] for key in keys), []).append(row)
    return list(groups.values())


def _one_kind(row: Row, kinds: tuple[str, ...], problems: list[Problem]) -> str | None:
    given = [kind for kind in kinds if row.cells[kind] is not None]
    if len(given) == 1:
        return given[0]
    what = f"{' and '.join(given)} are" if given else "none is"
    problems.append(row.problem(f"{what} filled; fill exactly one of {', '.join(kinds)}"))
    return None


def _kind_of_group(group: list[Row], kinds: tuple[str, ...], problems: list[Problem]) -> str | None:
    """Return the one kind of value that the sound rows of a group give; None, and problems, if none."""
    rows = [row for row in group if row.sound]
    given = [_one_kind(row, kinds, problems) for row in rows]
    if None in given or not given:
        return None
    for row, kind in zip(rows, given, strict=True):
        if kind != given[0]:
            message = f"this row gives {kind}, those before it {given[0]}; use one for rows that belong together"
            problems.append(row.problem(message, kind))
            return None
    return given[0]


def _analyses(group: list[Row], problems: list[Problem]) -> list[list[Row]]:
    """Part an aggregate's sieve rows into analyses: by their names, else by standard and date, where several."""
    named = any(row.cells["analysis"] is not None for row in group)
    keys = ("analysis",) if named else ("standard", "date")
    for key in keys:
        given = {row.cells[key] for row in group} - {None}
        empty = [row for row in group if row.cells[key] is None]
        if (named or len(given) > 1) and empty:
            message = f"the cell is empty, and other rows of this aggregate fill it; fill {key} in every row"
            problems += [row.problem(message, key) for row in empty]
            return []
    return _groups(group, *(key for key in keys if len({row.cells[key] for row in group} - {None}) > 1))


def _common(group: list[Row], key: str, problems: list[Problem]) -> Any:
    """Return the one value that a group's rows give in a column, None when none does."""
    filled = [row for row in group if row.cells[key] is not None]
    for row in filled[1:]:
        if row.cells[key] != filled[0].cells[key]:
            message = (
                f"{row.cells[key]} here, {filled[0].cells[key]} in row {filled[0].line}; one analysis has one {key}"
            )
            problems.append(row.problem(message, key))
    return filled[0].cells[key] if filled else None


def _gather_sieves(group: list[Row], out: Tables) -> None:
    before = len(out.problems)
    kind = _kind_of_group(group, KINDS, out.problems)
    mass, pan, standard, date = (
        _common(group, key, out.problems) for key in ("sample_mass_g", "pan_lower_mm", "standard", "date")
    )
    if kind is None:
        return
    rows = [row for row in group if row.sound]
    table = SieveTable(tuple(SieveRow(row.cells["aperture_mm"], row.cells[kind]) for row in rows), kind, mass, pan)
    # of a table with rows that could not be read only the others can be judged, one by one
    for error in check(table) if len(rows) == len(group) else check_rows(table):
        out.problems.append(rows[error.row or 0].problem(str(error), None if error.row is None else "aperture_mm"))
    if len(out.problems) == before and len(rows) == len(group):
        cells = group[0].cells
        raw = tuple(f"{row.raw['aperture_mm'].strip()}\t{row.raw[kind].strip()}" for row in group)
        out.sieves.append(
            SieveRecord(cells["aggregate"], cells["delivery"] or "", table, raw, standard, date, group[0])
        )


def gather_mixture(group: list[Row], out: Tables) -> None:
    """Make a record of the rows of one mixture, or say what speaks against it."""
    before, first, name = len(out.problems), group[0], group[0].cells["mixture"]
    kind = _kind_of_group(group, SHARE_KINDS, out.problems)
    rows = [row for row in group if row.sound]
    names = [(row.cells["aggregate"], row.cells["delivery"] or "") for row in rows]
    shares = [row.cells[kind] for row in rows] if kind else []
    for row, share in zip(rows, shares, strict=False):
        if not 0.0 < share <= 1.0:
            out.problems.append(
                row.problem(f"share {share:g} lies outside (0, 1]; correct it or leave the row out", kind)
            )
    for row, part in zip(rows, names, strict=True):
        if names.count(part) > 1:
            out.problems.append(
                row.problem(f"'{part[0]}' stands more than once in mixture '{name}'; keep one row", "aggregate")
            )
    total = math.fsum(shares)
    if kind and len(rows) == len(group) and abs(total - 1.0) > SHARE_TOLERANCE:
        message = (
            f"the shares of mixture '{name}' sum to {total:.6g}, more than {SHARE_TOLERANCE:g} off 1; correct them"
        )
        out.problems.append(first.problem(message, kind))
    if kind and len(out.problems) == before and len(rows) == len(group):
        out.mixtures.append(MixtureRecord(name, tuple(names), tuple(shares), kind == "mass_share", first))
    else:
        out.named_mixtures.add(name or "")
