"""An export, imported into an empty store, gives the same store: every value, to the last bit."""

import datetime as dt
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pdlab import density
from pdlab import store as store_module
from pdlab.density import BASES, COMPACTIONS
from pdlab.errors import InputError
from pdlab.experiments import export_tables, register
from pdlab.experiments.readings import particle_density
from pdlab.grading import KINDS, SieveRow, SieveTable, check
from pdlab.lab import SHIPPED
from pdlab.models import Aggregate, Base, Mixture, MixtureComponent, PackingTest, SieveAnalysis, SieveResult
from pdlab.store import Store, open_store
from pdlab.tables import read_path

OWN = {"id", "created_at", "version"}  # what a store gives its rows by itself
Folder = Callable[..., Path]


@pytest.fixture(scope="module")
def other() -> Iterator[sa.Connection]:
    opened = open_store("sqlite://")
    assert isinstance(opened.writer, sa.Engine)
    with opened.writer.connect() as connection:
        yield connection
    opened.close()


def values(row: Base, leave_out: set[str]) -> dict[str, Any]:
    columns = {column.key for column in row.__table__.columns if not column.foreign_keys} - OWN - leave_out
    return {name: getattr(row, name) for name in sorted(columns)}


def contents(target: Store, *leave_out: str) -> list[Any]:
    """All that travels, in order: aggregates with their tests, mixtures with their components and tests."""
    left = set(leave_out)
    with target.read() as session:
        aggregates, mixtures = store_module.all_deliveries(session), store_module.mixtures(session)
        return [
            [
                values(row, left),
                [[values(one, left), [values(line, left) for line in one.results]] for one in row.sieve_analyses],
                [values(test, left) for test in row.packing_tests],
            ]
            for row in aggregates
        ] + [
            [
                values(row, left),
                [[part.aggregate.name, part.aggregate.delivery, values(part, left)] for part in row.components],
                [values(test, left) for test in row.packing_tests],
            ]
            for row in mixtures
        ]


def brought(source: Store, connection: sa.Connection, path: Path, *leave_out: str) -> list[Any]:
    """What an empty store holds after it imported an export of another; an import again changes nothing."""
    export_tables(source, path)
    outer = connection.begin()
    try:
        target = Store("sqlite://", connection, connection)
        register(target, read_path(path))
        again = register(target, read_path(path))
        assert not any(again.new.values())
        assert again.notes == []
        return contents(target, *leave_out)
    finally:
        outer.rollback()


@pytest.mark.parametrize("name", ["out", "out.xlsx"])
def test_the_shipped_tables_travel(pebbles: Store, other: sa.Connection, tmp_path: Path, name: str) -> None:
    left = ["raw_text"] if name.endswith("xlsx") else []
    assert brought(pebbles, other, tmp_path / name, *left) == contents(pebbles, *left)


def test_the_shipped_tables_come_out_as_they_went_in(pebbles: Store, tmp_path: Path) -> None:
    files = export_tables(pebbles, tmp_path / "out").files
    assert [file.name for file in files] == ["aggregates.csv", "sieves.csv", "packing_tests.csv", "mixtures.csv"]
    assert all(file.read_bytes() == (SHIPPED / file.name).read_bytes() for file in files)


TABLES = {
    "aggregates": """\
name;delivery;particle_density_kg_m3;density_basis
A;May;2600,5;oven_dry
A;June;2700 kg/m³;oven_dry
""",
    "sieves": """\
aggregate;delivery;analysis;aperture_mm;passing_percent;date
A;May;x;3/8 in;100;2026-05-01
A;May;x;No. 4;0 %;
A;May;y;9,5;100;
A;May;y;4.7500;0;
""",
    "packing_tests": """\
material;delivery;compaction;voids_percent
aggregate:A;May;loose;38,5
aggregate:A;May;loose;39.0
aggregate:A;May;loose;38,5
mixture:A;;loose;33 %
""",
    "mixtures": """\
mixture;aggregate;delivery;mass_share
A;A;May;0,3
A;A;June;0,7
""",
}


@pytest.mark.parametrize("name", ["out", "out.xlsx"])
def test_deliveries_repeats_names_of_sieves_and_equal_names_travel(
    store: Store, other: sa.Connection, folder: Folder, name: str
) -> None:
    path = folder(**TABLES)
    done = register(store, read_path(path))
    assert (done.new["sieve analyses"], done.new["density tests"]) == (2, 4)
    there = contents(store, "raw_text")
    assert brought(store, other, path / name, "raw_text") == there
    first = there[0][2]
    assert [test["voids_percent"] for test in first] == [38.5, 39.0, 38.5]


def test_the_text_that_was_entered_travels_but_for_decimal_commas(
    store: Store, other: sa.Connection, folder: Folder
) -> None:
    path = folder(**TABLES)
    register(store, read_path(path))
    there = brought(store, other, path / "out")
    texts = [line["raw_text"] for _, lines in there[0][1] for line in lines]
    assert texts == ["3/8 in\t100", "No. 4\t0 %", "9.5\t100", "4.7500\t0"]
    assert there[2][2][0]["raw_text"] == "material=mixture:A\tcompaction=loose\tvoids_percent=33 %"


def test_a_corrected_value_goes_out_instead_of_what_was_entered(
    store: Store, other: sa.Connection, folder: Folder
) -> None:
    path = folder(**TABLES)
    register(store, read_path(path))
    with store.write() as session:
        row = store_module.find_aggregate(session, "A", "May")
        assert row is not None
        row.sieve_analyses[0].results[0].aperture_mm = 19.0
        row.packing_tests[0].voids_percent = 37.0
        row.particle_density_kg_m3 = 2500.0
    done = export_tables(store, path / "first")
    assert done.notes == [
        "mixture 'A': its shares by mass no longer give its shares by solid volume, as a particle density has "
        "changed; the shares by solid volume are exported"
    ]
    left = ("raw_text", "mass_share")
    assert brought(store, other, path / "out", *left) == contents(store, *left)


def test_nothing_is_overwritten_and_an_empty_store_gives_no_tables(pebbles: Store, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="is not empty and would be overwritten"):
        export_tables(pebbles, tmp_path)
    book = tmp_path / "lab.xlsx"
    export_tables(pebbles, book)
    before = book.read_bytes()
    with pytest.raises(InputError, match="is there and would be overwritten"):
        export_tables(pebbles, book)
    assert book.read_bytes() == before
    with pytest.raises(InputError, match=r"name a folder, or a file that ends in \.xlsx"):
        export_tables(pebbles, tmp_path / "lab.csv")
    with pytest.raises(InputError, match="cannot be written"):
        export_tables(pebbles, tmp_path / "notes.txt" / "out")
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_store_without_aggregates_has_nothing_to_export(store: Store, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no aggregate yet"):
        export_tables(store, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_text_too_long_for_excel_is_refused_and_not_cut(store: Store, folder: Folder) -> None:
    path = folder(aggregates="name,source\nA," + "x" * 32_768 + "\n")
    register(store, read_path(path))
    with pytest.raises(InputError, match="a text of 32768 characters is longer than"):
        export_tables(store, path / "lab.xlsx")
    export_tables(store, path / "out")


AWKWARD = (
    "=1+1",
    "123",
    "1,5",
    "a;b",
    'say "x"',
    "mixture:M",
    "aggregate:A",
    "#N/A",
    "TRUE",
    "2026-05-01",
    "'x",
    "_x0041_",
)
STORED = st.characters(exclude_categories=["Cs"], exclude_characters="\x00")  # what both databases keep
SHOWN = st.characters(exclude_categories=["C", "Z"]) | st.just(" ")
NAMES = st.sampled_from(AWKWARD) | st.text(SHOWN, min_size=1, max_size=9).map(str.strip).filter(bool)
OPTIONAL = st.none() | NAMES
DATES = st.none() | st.dates(dt.date(1900, 3, 1))


def between(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


@st.composite
def aggregates(draw: st.DrawFn, name: str, delivery: str) -> Aggregate:
    basis = draw(st.none() | st.sampled_from(BASES))
    return Aggregate(
        name=name,
        delivery=delivery,
        particle_density_kg_m3=None if basis is None else draw(between(1500.0, 4000.0)),
        density_basis=basis,
        water_absorption_percent=draw(between(0.0, 20.0)),
        shape=draw(OPTIONAL),
        source=draw(OPTIONAL),
        repose_angle_deg=draw(st.none() | between(-1e9, 1e300)),
        sieve_analyses=draw(st.lists(analyses(), max_size=3)),
        packing_tests=draw(st.lists(density_tests(), max_size=4)),
    )


@st.composite
def analyses(draw: st.DrawFn) -> SieveAnalysis:
    kind = draw(st.sampled_from(KINDS))
    apertures = sorted(draw(st.sets(between(1e-3, 1e3), min_size=2, max_size=5)), reverse=True)
    inner = sorted(draw(st.lists(between(0.0, 100.0), min_size=len(apertures) - 2, max_size=len(apertures) - 2)))[::-1]
    if kind == "passing_percent":
        column = [100.0, *inner, 0.0]
    elif kind == "retained_percent":
        column = [0.0] * (len(apertures) - 1) + [draw(between(99.5, 100.0))]
    else:
        column = [0.0, *inner, draw(between(1.0, 1e4))]
    rows = [*zip(apertures, column, strict=True)]
    if draw(st.booleans()):
        rows.append((None, 0.0))
    elif draw(st.booleans()):
        rows.reverse()
    table = SieveTable(tuple(SieveRow(*row) for row in rows), kind)
    if check(table):
        rows = [(2.0, 100.0), (1.0, 0.0)] if kind == "passing_percent" else [(2.0, 0.0), (1.0, 100.0)]
    return SieveAnalysis(
        kind=kind,
        sample_mass_g=None if kind == "retained_g" else draw(st.none() | between(1.0, 1e5)),
        pan_lower_mm=draw(st.none() | between(1e-5, 9e-4)),
        standard=draw(OPTIONAL),
        date=draw(DATES),
        results=[
            SieveResult(position=k, aperture_mm=aperture, raw_text=draw(st.text(STORED, max_size=5)), **{kind: value})
            for k, (aperture, value) in enumerate(rows)
        ],
    )


@st.composite
def density_tests(draw: st.DrawFn) -> PackingTest:
    value = {"voids_percent": draw(between(1.0, 99.0))} if draw(st.booleans()) else {"packing_density": 0.1 + 0.2}
    return PackingTest(
        **value,
        compaction=draw(st.sampled_from(COMPACTIONS)),
        repeats=draw(st.none() | st.integers(1, 9)),
        standard_deviation=draw(st.none() | between(0.0, 0.05)),
        container_diameter_mm=draw(st.none() | between(1.0, 1e3)),
        moisture_percent=draw(st.none() | between(0.0, 50.0)),
        standard=draw(OPTIONAL),
        date=draw(DATES),
        raw_text=draw(st.text(STORED, max_size=9)),
    )


@st.composite
def mixtures(draw: st.DrawFn, parts: list[Aggregate]) -> Mixture:
    parts = draw(st.permutations(parts))[: draw(st.integers(1, len(parts)))]
    raw = draw(st.lists(between(0.1, 1.0), min_size=len(parts), max_size=len(parts)))
    shares = [share / sum(raw) for share in raw]
    densities = [particle_density(part) for part in parts]
    by_mass = None not in densities and draw(st.booleans())
    solid = density.solid_volume_shares(shares, densities) if by_mass else shares  # type: ignore[arg-type]
    return Mixture(
        components=[
            MixtureComponent(
                position=k, aggregate=part, solid_volume_share=min(solid[k], 1.0),
                mass_share=min(shares[k], 1.0) if by_mass else None,
            )
            for k, part in enumerate(parts)
        ],
        packing_tests=draw(st.lists(density_tests(), max_size=2)),
    )  # fmt: skip


@st.composite
def stores(draw: st.DrawFn) -> list[Base]:
    keys = draw(st.lists(st.tuples(NAMES, st.just("") | NAMES), min_size=1, max_size=4, unique=True))
    rows = [draw(aggregates(*key)) for key in keys]
    named = st.sampled_from([name for name, _ in keys]) | NAMES
    blends = [draw(mixtures(rows)) for _ in range(draw(st.integers(0, 2)))]
    names = draw(st.lists(named, min_size=len(blends), max_size=len(blends), unique=True))
    for blend, name in zip(blends, names, strict=True):
        blend.name = name
    return [*rows, *blends]


def travels(rows: list[Base], database: sa.Connection, other: sa.Connection, suffix: str) -> None:
    outer = database.begin()
    try:
        source = Store("sqlite://", database, database)
        with source.write() as session:
            store_module.add_all(session, rows)
        with tempfile.TemporaryDirectory() as folder:
            assert brought(source, other, Path(folder) / f"out{suffix}", "raw_text") == contents(source, "raw_text")
    finally:
        outer.rollback()


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(rows=stores(), suffix=st.sampled_from(["", ".xlsx"]))
def test_any_store_travels(database: sa.Connection, other: sa.Connection, rows: list[Base], suffix: str) -> None:
    travels(rows, database, other, suffix)


@pytest.mark.slow
@settings(max_examples=500, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(rows=stores(), suffix=st.sampled_from(["", ".xlsx"]))
def test_any_of_many_stores_travels(
    database: sa.Connection, other: sa.Connection, rows: list[Base], suffix: str
) -> None:
    travels(rows, database, other, suffix)
