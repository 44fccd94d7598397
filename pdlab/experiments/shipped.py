"""Runs of equal spheres that are shipped with pdlab, so that a first calibration waits for none.

``tests/validation/equal_spheres.py`` makes the table. A run is found by the digest of its specimen, which holds the
engine's version: what another engine ran, or what a specimen of another form would be, is never taken.
"""

import csv
import datetime as dt
import hashlib
import io
import json
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from typing import Any

from pdlab import equal_spheres
from pdlab.equal_spheres import Surface
from pdlab.errors import InputError, Problem, TableError
from pdlab.models import Run
from pdlab.specimen import Specimen

TABLE = Path(__file__).parents[1] / "data" / "equal_spheres" / "runs.csv"
COLUMNS: dict[str, Callable[[str], Any]] = {
    "seed": int, "specimen_hash": str, "engine_version": int, "numba_version": str, "processor": str,
    "packing_density": float, "coordination_number": float, "height": float, "largest_overlap": float, "rest": str,
    "steps": int, "seconds": float, "warnings": str, "finished_at": dt.datetime.fromisoformat,
}  # fmt: skip
"""What the table holds of a run, after the compaction, friction and rolling friction of its bed."""


def runs(beds: dict[str, Specimen]) -> list[Run]:
    """Return the rows of those beds, given by their digests, whose runs are shipped. Raises TableError."""
    known = _rows(TABLE)
    return [_run(bed, known[digest]) for digest, bed in beds.items() if digest in known]


def _run(bed: Specimen, row: dict[str, Any]) -> Run:
    told = {name: row[name] for name in COLUMNS}
    specimen, shares = bed.canonical(row["engine_version"]), json.dumps(bed.shares)
    return Run(**told, state="done", specimen=specimen, spheres=bed.spheres, slab_shares=shares)


def shipped_surface(compaction: str, engine_version: int) -> Surface:
    """Return the packing density of equal spheres over both coefficients, in a protocol's default settings.

    Raises TableError, and InputError where no run of the compaction and engine version is shipped.
    """
    densities = dict[tuple[float, float], list[float]]()
    for row in _rows(TABLE).values():
        if (row["compaction"], row["engine_version"]) == (compaction, engine_version):
            densities.setdefault((row["friction"], row["rolling"]), []).append(row["packing_density"])
    if not densities:
        raise InputError(
            f"no runs of equal spheres are shipped for compaction '{compaction}' and engine version {engine_version}; "
            "calibrate in a store, which runs them"
        )
    return equal_spheres.through(densities)


@cache
def _rows(table: Path) -> dict[str, dict[str, Any]]:
    """Return the rows of a table by digest. Raises TableError unless it is, byte for byte, what was written."""
    try:
        text = table.read_text(encoding="utf-8")
        noted = _checksum_file(table).read_text(encoding="utf-8").split()[0]
    except (OSError, UnicodeDecodeError, IndexError) as error:
        raise _damaged(table, f"cannot be read ({error})") from error
    if (found := _checksum(text)) != noted:
        raise _damaged(table, f"is not as it was shipped: its SHA-256 is {found[:12]}..., not {noted[:12]}...")
    kinds = {"compaction": str, "friction": float, "rolling": float} | COLUMNS
    rows = csv.DictReader(io.StringIO(text))
    return {
        row["specimen_hash"]: {name: kind(row[name]) if row[name] else None for name, kind in kinds.items()}
        for row in rows
    }


def _damaged(table: Path, what: str) -> TableError:
    return TableError([Problem(str(table), None, None, f"the table of shipped runs {what}; install pdlab again")])


def write_table(table: Path, beds: Iterable[tuple[Specimen, Run]]) -> None:
    """Write runs of equal spheres as the table that is shipped, and its checksum beside it."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow(["compaction", "friction", "rolling", *COLUMNS])
    for bed, run in beds:
        (kind,) = bed.species
        told = [getattr(run, name) for name in COLUMNS]
        out.writerow([bed.protocol.compaction, kind.friction, kind.rolling, *told])
    table.parent.mkdir(parents=True, exist_ok=True)
    table.write_text(text.getvalue(), encoding="utf-8", newline="\n")
    _checksum_file(table).write_text(f"{_checksum(text.getvalue())}  {table.name}\n", encoding="utf-8", newline="\n")
    _rows.cache_clear()


def _checksum_file(table: Path) -> Path:
    """Return where a table's checksum stands, in the form that ``sha256sum -c`` reads."""
    return table.with_suffix(".sha256")


def _checksum(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
