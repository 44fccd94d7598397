"""What an import says before and after, and that nothing whatever breaks it or leaves half of it."""

import csv
import io
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
import sqlalchemy as sa
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from openpyxl import Workbook

from pdlab.errors import PdlabError, TableError
from pdlab.experiments import register, register_each
from pdlab.lab import SHIPPED
from pdlab.models import Base, Mixture, MixtureComponent
from pdlab.store import Store
from pdlab.tables import LAYOUT, Tables, read_frames, read_path, slices_of_frame

Folder = Callable[..., Path]
TEST = "material,compaction,voids_percent\n"


def dump(connection: Any) -> list[Any]:
    return [
        list(connection.execute(sa.select(table).order_by(*table.primary_key))) for table in Base.metadata.sorted_tables
    ]


def test_a_dry_run_writes_nothing_and_says_what_would_be_new(pebbles: Store, folder: Folder) -> None:
    before = dump(pebbles.writer)
    path = folder(
        aggregates="name,shape\npebbles L,\nA,round\npebbles M,round pebbles\n", packing_tests=TEST + "A,loose,40\n"
    )
    done = register(pebbles, read_path(path), dry_run=True)
    assert dump(pebbles.writer) == before
    assert done.names == {
        ("aggregates", False): ["pebbles L", "pebbles M"],
        ("aggregates", True): ["A"],
        ("density tests", True): ["A"],
    }
    assert register(pebbles, read_path(path)).names == done.names
    assert dump(pebbles.writer) != before


def test_a_dry_run_finds_every_problem_that_an_import_finds(pebbles: Store, folder: Folder) -> None:
    path = folder(packing_tests=TEST + "B,loose,40\npebbles L,loose,140\n")
    found = []
    for dry_run in (True, False):
        with pytest.raises(TableError) as caught:
            register(pebbles, read_path(path), dry_run)
        found.append(str(caught.value))
    assert found[0] == found[1]
    assert len(caught.value.problems) == 2


def test_a_test_equal_to_one_that_is_no_longer_the_newest_is_noted(pebbles: Store, folder: Folder) -> None:
    first, second = TEST + "pebbles L,unstated,40.0\n", TEST + "pebbles L,unstated,39\n"
    assert register(pebbles, read_path(folder(packing_tests=second))).notes == []
    done = register(pebbles, read_path(folder(packing_tests=first)))
    assert done.equal == 1
    assert done.notes == [
        "packing_tests.csv, row 2: equals one of the density tests of 'pebbles L' that has a newer one after it, "
        "which stays the current one; if it was measured anew, give it its date"
    ]
    assert register(pebbles, read_path(folder(packing_tests=first + "pebbles L,unstated,39\n"))).notes == []


def test_a_history_in_which_a_value_comes_back_is_brought_whole_and_once(pebbles: Store, folder: Folder) -> None:
    path = folder(packing_tests=TEST + "pebbles L,unstated,40\npebbles L,unstated,39\npebbles L,unstated,40\n")
    done = register(pebbles, read_path(path))
    assert (done.new["density tests"], done.equal) == (2, 1)
    done = register(pebbles, read_path(path))
    assert (done.new["density tests"], done.equal, done.notes) == (0, 3, [])


def test_named_analyses_without_dates_are_several_and_every_row_names_its_own(store: Store, folder: Folder) -> None:
    head, aggregates = "aggregate,analysis,aperture_mm,passing_percent\n", "name\nA\n"
    rows = [f"A,{name},{mm},{value}\n" for name, value in (("x", 0), ("y", 1)) for mm, value in ((4, 100), (2, value))]
    done = register(store, read_path(folder(aggregates=aggregates, sieves=head + "".join(rows))))
    assert done.new["sieve analyses"] == 2
    found = read_path(folder(sieves=head + "".join(rows) + "A,,1,0\n")).problems
    assert [str(problem) for problem in found] == [
        "sieves.csv, row 6, column analysis: the cell is empty, and other rows of this aggregate fill it; fill "
        "analysis in every row"
    ]


def test_problems_of_a_workbook_stand_in_the_order_of_its_tables(store: Store, tmp_path: Path) -> None:
    book = Workbook()
    book.worksheets[0].title = "mixtures"
    book.worksheets[0].append(["mixture", "aggregate", "mass_share"])
    book.worksheets[0].append(["M", "Z", 1])
    book.create_sheet("aggregates").append(["name", "density_basis"])
    book["aggregates"].append([None])
    book["aggregates"].append(["A", "wet"])
    book.save(tmp_path / "lab.xlsx")
    with pytest.raises(TableError) as caught:
        register(store, read_path(tmp_path / "lab.xlsx"))
    assert [problem.file for problem in caught.value.problems] == [
        "lab.xlsx, sheet aggregates",
        "lab.xlsx, sheet mixtures",
    ]


def blends(count: int, shares: tuple[str, str] = ("0.4", "0.6")) -> pd.DataFrame:
    """A frame of mixtures of two of the shipped aggregates."""
    lines = [(f"mix {k}", name, share) for k in range(count) for name, share in zip("LM", shares, strict=True)]
    frame = pd.DataFrame(lines, columns=["mixture", "aggregate", "solid_volume_share"])
    return frame.assign(aggregate="pebbles " + frame["aggregate"])


@pytest.mark.parametrize("new", [True, False], ids=["new", "equal"])
def test_an_import_reads_as_often_for_many_mixtures_as_for_few(pebbles: Store, new: bool) -> None:
    taken = []
    for count in (10, 300):
        frame = blends(count)
        brought = read_frames({"mixtures": frame.assign(mixture=frame["mixture"] + f" of {count}")})
        if not new:
            register(pebbles, brought)
        statements: list[str] = []

        def counting(*said: Any, into: list[str] = statements) -> None:
            into += [said[2]] if said[2].startswith("SELECT") else []

        sa.event.listen(pebbles.writer, "before_cursor_execute", counting)
        done = register(pebbles, brought)
        sa.event.remove(pebbles.writer, "before_cursor_execute", counting)
        assert (done.new["mixtures"], done.equal) == ((count, 0) if new else (0, count))
        taken.append(len(statements))
    assert taken[0] == taken[1] > 0


def test_each_mixture_that_can_be_is_registered_and_each_other_says_why(pebbles: Store) -> None:
    first, second = (part for part in slices_of_frame(blends(4), 2))
    keys = register_each(pebbles, first)
    assert register_each(pebbles, first) == keys
    lines = [("mix 0", "pebbles L", 0.4), ("mix 0", "pebbles M", 0.6), ("mix 1", "pebbles L", 0.5),
             ("mix 1", "pebbles M", 0.5), ("unknown", "pebbles X", 1), ("no delivery", "pebbles L", 1),
             ("no density", "light", 1), ("off", "pebbles L", 0.5), ("last", "pebbles L", 1)]  # fmt: skip
    table = pd.DataFrame(lines, columns=["mixture", "aggregate", "solid_volume_share"])
    table["mass_share"] = table["solid_volume_share"].where(table["mixture"] == "no density")
    table["solid_volume_share"] = table["solid_volume_share"].where(table["mixture"] != "no density")
    table["delivery"] = table["mixture"].map({"no delivery": "May"})
    register(pebbles, read_frames({"aggregates": pd.DataFrame({"name": ["light"]})}))
    (part,) = slices_of_frame(table)
    found = dict(zip((brought.name for brought in part.mixtures), register_each(pebbles, part), strict=True))
    said = {name: str(key).removeprefix("mixtures frame, ") for name, key in found.items() if not isinstance(key, int)}
    assert said == {
        "mix 1": "row 4, column mixture: mixture 'mix 1' is there with other shares or aggregates; give this one "
        "another name",
        "unknown": "row 6, column aggregate: no aggregate named 'pebbles X'; add it to aggregates.csv or correct the "
        "name",
        "no delivery": "row 7, column delivery: no delivery 'May' of aggregate 'pebbles L' (it has: ''); name one in "
        "the column delivery",
        "no density": "row 8, column mass_share: mixture 'no density' gives shares by mass, which needs a particle "
        "density of each aggregate; enter it or give solid_volume_share",
        "off": "row 9, column solid_volume_share: the shares of mixture 'off' sum to 0.5, more than 0.0011 off 1; "
        "correct them",
    }
    assert found["mix 0"] == keys[0]
    assert len({*keys, found["last"], *register_each(pebbles, second)}) == 5
    with pebbles.read() as session:
        names = {key: session.get_one(Mixture, key).name for key in found.values() if isinstance(key, int)}
    assert names == {found[name]: name for name in ("mix 0", "last")}


def test_mixtures_of_a_slice_are_those_that_an_import_makes(pebbles: Store) -> None:
    densities = {"name": ["pebbles L", "pebbles M"], "particle_density_kg_m3": [2650.0, 2500.0]}
    register(pebbles, read_frames({"aggregates": pd.DataFrame(densities).assign(density_basis="oven_dry")}))
    brought = blends(3, ("0.3", "0.7")).rename(columns={"solid_volume_share": "mass_share"})
    rows = sa.select(MixtureComponent).order_by(MixtureComponent.mixture_id, MixtureComponent.position)
    with pebbles.read() as session:
        before = len(session.scalars(rows).all())
    (part,) = slices_of_frame(brought)
    register_each(pebbles, part)
    register(pebbles, read_frames({"mixtures": brought.assign(mixture=brought["mixture"] + " too")}))
    with pebbles.read() as session:
        made = [
            (row.position, row.aggregate_id, row.solid_volume_share, row.mass_share) for row in session.scalars(rows)
        ]
    assert made[before : before + 6] == made[before + 6 :]
    assert made[-1][3] == 0.7
    assert made[-1][2] > 0.7


CELLS = st.sampled_from(
    ["A", "B", "M", "", " ", "0", "100", "50", "0,5", "0.5", "1,240", "1.240", "40 %", "No. 4", "3/8 in", "pan", "16",
     "8", "loose", "unstated", "oven_dry", "ssd", "2650", "2026-05-01", "20260501", "1e400", "-1", "nan", "A\x00", "=1"]
) | st.text(max_size=6)  # fmt: skip
ROWS = st.lists(st.lists(CELLS, max_size=6), max_size=6)


@st.composite
def sheets(draw: st.DrawFn) -> dict[str, list[list[str]]]:
    """Tables whose headers are mostly right, of cells that are mostly wrong."""
    out = {}
    for kind in draw(st.lists(st.sampled_from(list(LAYOUT)), min_size=1, max_size=4, unique=True)):
        required = [name for name, column in LAYOUT[kind].items() if column.required]
        more = draw(st.lists(st.sampled_from([*LAYOUT[kind], "", "colour"]), max_size=4))
        header = [*required, *more]
        cells = st.lists(st.lists(CELLS, min_size=len(header), max_size=len(header)), max_size=5)
        out[kind] = [header, *draw(cells | ROWS)]
    return out


def csv_files(tables: dict[str, list[list[str]]], folder: Path) -> Path:
    for kind, lines in tables.items():
        with (folder / f"{kind}.csv").open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows(lines)
    return folder


def workbook(tables: dict[str, list[list[str]]], folder: Path) -> Path:
    book = Workbook()
    for kind, lines in tables.items():
        sheet = book.create_sheet(kind)
        for k, line in enumerate(lines, start=1):
            for j, text in enumerate(line, start=1):
                if text.isprintable():
                    sheet.cell(k, j).value = text
    book.save(folder / "lab.xlsx")
    return folder / "lab.xlsx"


def refused_or_kept(connection: sa.Connection, read: Callable[[], Tables]) -> None:
    """Import: either all of it is kept, or a named error leaves the store as it was."""
    outer = connection.begin()
    try:
        store = Store("sqlite://", connection, connection)
        register(store, read_path(SHIPPED))
        before = dump(connection)
        try:
            done = register(store, read())
        except PdlabError:
            assert dump(connection) == before
        else:
            assert any(done.new.values()) == (dump(connection) != before)
    finally:
        outer.rollback()


def any_tables(database: sa.Connection, tables: dict[str, list[list[str]]], write: Callable[..., Path]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = write(tables, Path(folder))
        refused_or_kept(database, lambda: read_path(path))


def any_bytes(database: sa.Connection, content: bytes, name: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(content)
        refused_or_kept(database, lambda: read_path(path))


def damaged(place: int, damage: bytes, cut: int) -> bytes:
    """A sound workbook with some of its bytes overwritten and some of its end lost."""
    book, out = Workbook(write_only=True), io.BytesIO()
    for kind in LAYOUT:
        sheet = book.create_sheet(kind)
        for line in (SHIPPED / f"{kind}.csv").read_text(encoding="utf-8").splitlines():
            sheet.append(line.split(","))
    book.save(out)
    content = bytearray(out.getvalue())
    place %= len(content)
    content[place : place + len(damage)] = damage
    return bytes(content[: len(content) - cut])


quick = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
many = settings(max_examples=1500, deadline=None, suppress_health_check=[HealthCheck.too_slow])
WRITERS = st.sampled_from([csv_files, workbook])
NAMES = st.sampled_from(["sieves.csv", "packing_tests.csv", "lab.xlsx", "notes"])
DAMAGE = (st.integers(0, 100_000), st.binary(max_size=30), st.integers(0, 50) | st.integers(0, 5_000))


@quick
@given(tables=sheets(), write=WRITERS)
def test_no_table_breaks_an_import_or_leaves_half_of_one(database: sa.Connection, tables: Any, write: Any) -> None:
    any_tables(database, tables, write)


@quick
@given(content=st.binary(max_size=300), name=NAMES)
def test_no_bytes_break_an_import(database: sa.Connection, content: bytes, name: str) -> None:
    any_bytes(database, content, name)


@quick
@given(*DAMAGE)
def test_no_damaged_workbook_breaks_an_import(database: sa.Connection, place: int, damage: bytes, cut: int) -> None:
    any_bytes(database, damaged(place, damage, cut), "lab.xlsx")


@quick
@given(tables=sheets())
def test_no_frame_breaks_an_import(database: sa.Connection, tables: dict[str, list[list[str]]]) -> None:
    frames = {}
    for kind, lines in tables.items():
        width = max(map(len, lines))
        header = [*lines[0], *[""] * (width - len(lines[0]))]
        frames[kind] = pd.DataFrame([[*line, *[""] * (width - len(line))] for line in lines[1:]], columns=header)
    refused_or_kept(database, lambda: read_frames(frames))


@pytest.mark.slow
@many
@given(tables=sheets(), write=WRITERS)
def test_no_table_of_many_breaks_an_import(database: sa.Connection, tables: Any, write: Any) -> None:
    any_tables(database, tables, write)


@pytest.mark.slow
@many
@given(*DAMAGE)
def test_none_of_many_damaged_workbooks_breaks_an_import(
    database: sa.Connection, place: int, damage: bytes, cut: int
) -> None:
    any_bytes(database, damaged(place, damage, cut), "lab.xlsx")
