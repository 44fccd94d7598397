"""A table of mixtures in slices: the same records and problems as an import's, in memory that does not grow."""

import tempfile
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from openpyxl import Workbook

from pdlab.errors import TableError
from pdlab.tables import MixtureRecord, Slices, read_frame, read_path, slices, slices_of_frame

HEAD = "mixture,aggregate,solid_volume_share\n"


def file_of(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    path = folder / "many.csv"
    path.write_bytes(text.encode(encoding))
    return path


def records(table: Slices) -> list[MixtureRecord]:
    return [brought.record for part in table for brought in part.mixtures if brought.record is not None]


def problems(table: Slices) -> list[str]:
    return sorted(str(found) for part in table for brought in part.mixtures for found in brought.problems)


def mixtures(count: int) -> Iterator[str]:
    for k in range(count):
        yield f"mix {k},gravel,0.{k % 9 + 1}\nmix {k},sand,0.{9 - k % 9}\n"


DIALECTS = {
    "commas": (HEAD + "M,A,0.5\nM,B,0.5\nN,A,1\n", "utf-8"),
    "semicolons and decimal commas": ("mixture;aggregate;mass_share\nM;A;0,25\nM;B;0,75\n\n ; ;\nN;A;1\n", "utf-8"),
    "tabs": ("mixture\taggregate\tdelivery\tmass_share\nM\tA\tMay\t1\n", "utf-8"),
    "a BOM": (HEAD + "M,Körnung,1\n", "utf-8-sig"),
    "a code page": (HEAD + "M,Sand 0–4 «Körnung»,1\n", "cp1252"),
    "a code page below the first block": (HEAD + "".join(mixtures(5000)) + "M,Körnung,1\n", "cp1252"),
    "old line ends": ((HEAD + "M,A,0.5\nM,B,0.5\n").replace("\n", "\r\n"), "utf-8"),
    "quotes": (HEAD + '"M, wet","the\nwhole, thing",1\n', "utf-8"),
    "a point that may part thousands": ("mixture;aggregate;mass_share\nM;A;1.000\nN;A;0,5\nN;B;0,5\n", "utf-8"),
    "lines too long and too short": (HEAD + "M,A,0.5,x\nM,B,0.5\nN,A\nO,A,1\n", "utf-8"),
}


@pytest.mark.parametrize("text", DIALECTS.values(), ids=list(DIALECTS))
@pytest.mark.parametrize("size", [1, 3, 10_000])
def test_slices_hold_what_an_import_holds_in_every_dialect(text: tuple[str, str], size: int, tmp_path: Path) -> None:
    path = file_of(tmp_path, *text)
    whole = read_path(path)
    table = slices(path, size)
    assert records(table) == whole.mixtures
    assert problems(table) == sorted(map(str, whole.problems))
    assert sum(len(part.mixtures) for part in table) == table.count
    assert all(len(part.mixtures) == size for part in list(table)[:-1])


CELLS = st.sampled_from(["A", "B", "", " ", "0.5", "0,5", "1", "1.000", "nan", "-1", "2", "A\x01", "May"])


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.lists(st.lists(st.lists(CELLS, min_size=3, max_size=5), min_size=1, max_size=3), min_size=1, max_size=5))
def test_whatever_stands_in_the_cells_slices_find_what_an_import_finds(groups: list[list[list[str]]]) -> None:
    lines = [";".join([f"M{k}", *cells]) for k, group in enumerate(groups) for cells in group]
    with tempfile.TemporaryDirectory() as folder:
        text = "\n".join(["mixture;aggregate;solid_volume_share;mass_share", *lines])
        path = file_of(Path(folder), text)
        whole, table = read_path(path), slices(path, 2)
        assert records(table) == whole.mixtures
        assert problems(table) == sorted(map(str, whole.problems))


def test_what_is_wrong_with_a_mixture_stands_with_it_and_with_no_other(tmp_path: Path) -> None:
    bad = "short,A,0.5\nbad,A,x\nbad,B,0.5\ntwice,A,0.5\ntwice,A,0.5\n,A,1\n"
    path = file_of(tmp_path, HEAD + "first,A,1\n" + bad + "last,A,0.5\nlast,B,0.5\n")
    (found,) = slices(path)
    said = {brought.name: [str(problem) for problem in brought.problems] for brought in found.mixtures}
    assert list(said) == ["first", "short", "bad", "twice", "", "last"]
    assert [brought.record is None for brought in found.mixtures] == [False, True, True, True, True, False]
    assert said["first"] == said["last"] == []
    assert [text.split(":")[0] for text in said["short"]] == ["many.csv, row 3, column solid_volume_share"]
    assert "sum to 0.5" in said["short"][0]
    assert said["bad"] == [
        "many.csv, row 4, column solid_volume_share: 'x' is no number; write it like 12.5 or 12,5, without thousands "
        "separators"
    ]
    assert len(said["twice"]) == 2
    assert [row.raw["solid_volume_share"] for row in found.mixtures[2].rows] == ["x", "0.5"]


def test_a_name_that_comes_back_is_the_problem_of_the_later_rows_across_slices(tmp_path: Path) -> None:
    path = file_of(tmp_path, HEAD + "M,A,1\nN,A,1\nO,A,1\nM,B,1\nN,B,0.5\nN,A,0.5\n")
    table = slices(path, 2)
    for _ in range(2):  # a second reading remembers nothing of the first
        assert [brought.name for part in table for brought in part.mixtures] == ["M", "N", "O", "M", "N"]
        assert [record.aggregates for record in records(table)] == [(("A", ""),)] * 3
        assert problems(table) == [
            f"many.csv, row {row}, column mixture: mixture '{name}' stands in row {before} already; put the rows of a "
            "mixture together, or give this one another name"
            for name, row, before in (("M", 5, 2), ("N", 6, 3))
        ]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "this is no table (it is empty)"),
        (HEAD, "the table is empty"),
        ("mixture,solid_volume_share\nM,1\n", "the column 'aggregate' is missing; add it"),
        (HEAD.replace("share", "part") + "M,A,1\n", "'solid_volume_part' is no column of mixtures.csv"),
        (HEAD.strip() + ",mixture\nM,A,1,M\n", "the column 'mixture' stands 2 times"),
        ("name,shape\nA,round\n", "'shape' is no column of mixtures.csv"),
        (HEAD + 'M,A,1\nN,"A" B,1\n', "this is no table"),
        (HEAD + "M,A,1\n\x81\x8d\xff", "this is no table"),
    ],
)
def test_a_table_that_is_wrong_as_a_whole_is_refused_before_its_first_slice(
    text: str, said: str, tmp_path: Path
) -> None:
    path = file_of(tmp_path, text, "latin-1")
    with pytest.raises(TableError) as caught:
        slices(path)
    assert said in str(caught.value)


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    for path, said in ((tmp_path, "this is a folder"), (tmp_path / "none.csv", "no such file"), ("x.ods", "no such")):
        with pytest.raises(TableError, match=said):
            slices(Path(path))


def test_a_frame_is_read_like_a_file_of_the_same_text(tmp_path: Path) -> None:
    path = file_of(tmp_path, HEAD + "".join(mixtures(2500)) + "bad,A,0.4\n")
    frame = pd.read_csv(path)
    table, of_file = slices_of_frame(frame, 300), slices(path, 300)
    plain = [(one.name, one.aggregates, one.shares, one.first.line) for one in records(of_file)]
    assert [(one.name, one.aggregates, one.shares, one.first.line) for one in records(table)] == plain
    assert records(table) == read_frame(frame, "mixtures").mixtures
    assert problems(table) == [text.replace("many.csv", "mixtures frame") for text in problems(of_file)] != []
    with pytest.raises(TableError, match="the table is empty"):
        slices_of_frame(frame.iloc[:0])


def test_a_workbook_is_read_like_a_file_of_the_same_cells(tmp_path: Path) -> None:
    book = Workbook()
    sheet = book.worksheets[0]
    for line in (["mixture", "aggregate", "mass_share"], ["M", "A", 0.25], ["M", "B", 0.75], ["N", "A", 0.5]):
        sheet.append(line)
    book.save(tmp_path / "many.xlsx")
    (found,) = slices(tmp_path / "many.xlsx")
    assert [brought.name for brought in found.mixtures] == ["M", "N"]
    assert found.mixtures[0].record is not None
    assert found.mixtures[0].record.shares == (0.25, 0.75)
    assert "many.xlsx, sheet Sheet, row 4" in str(found.mixtures[1].problems[0])
    sheet.title = "mixtures"
    book.create_sheet("aggregates").append(["name"])
    book["aggregates"].append(["A"])
    book.save(tmp_path / "two.xlsx")
    with pytest.raises(TableError, match="it holds aggregates, mixtures; keep the mixtures in a workbook of their own"):
        slices(tmp_path / "two.xlsx")
    (tmp_path / "broken.xlsx").write_bytes(b"PK")
    with pytest.raises(TableError, match="no Excel workbook"):
        slices(tmp_path / "broken.xlsx")


def peak(run: Callable[[], int]) -> tuple[float, int]:
    """The most memory [KiB] that a call holds at once, and what it returns."""
    tracemalloc.start()
    done = run()
    most = tracemalloc.get_traced_memory()[1] / 1024.0
    tracemalloc.stop()
    return most, done


def test_memory_does_not_grow_with_the_table_but_by_eight_bytes_of_each_name(tmp_path: Path) -> None:
    most = {}
    for count in (2_000, 20_000):
        path = tmp_path / f"{count}.csv"
        with path.open("w", encoding="utf-8") as file:
            file.write(HEAD)
            file.writelines(mixtures(count))
        most[count], found = peak(lambda: sum(len(part.mixtures) for part in slices(path)))  # noqa: B023
        assert found == count
    sorting = 8.0 * 4.0  # the digests, their sorted copy, and room to sort them and to grow
    assert most[20_000] - most[2_000] < sorting * 18_000 / 1024.0
