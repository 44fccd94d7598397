"""Results into a CSV file as they come: soon on the disk, nothing of others overwritten, an earlier output kept."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from pdlab.errors import InputError
from pdlab.tables import Output, appending

COLUMNS = ["mixture", "packing_density", "message"]


def rows(count: int, beginning: str = "M") -> list[dict[str, str]]:
    return [{"mixture": f"{beginning}{k}", "packing_density": "0.61"} for k in range(count)]


def text(count: int, beginning: str = "M") -> str:
    return "mixture,packing_density,message\n" + "".join(f"{beginning}{k},0.61,\n" for k in range(count))


def test_rows_stand_in_the_file_as_soon_as_they_are_written(tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    with Output(path, COLUMNS) as out:
        assert path.read_text() == text(0)
        out.write(rows(2))
        assert path.read_text() == text(2)
        out.write([{"mixture": 'M "wet", 2', "message": "no\nsieve"}])
        assert path.read_text() == text(2) + '"M ""wet"", 2",,"no\nsieve"\n'
    assert out.rows == 3
    assert os.listdir(tmp_path) == ["out.csv"]


def test_every_row_is_on_the_disk_within_the_time_even_when_no_other_follows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced, done, fsync = list[int](), threading.Event(), os.fsync

    def noting(number: int) -> None:
        fsync(number)
        synced.append(os.fstat(number).st_size)
        done.set()

    monkeypatch.setattr(os, "fsync", noting)
    monkeypatch.setattr(appending, "SYNC_EVERY", 0.5)
    with Output(tmp_path / "out.csv", COLUMNS) as out:
        done.clear()
        for row in rows(3):
            out.write([row])
        assert done.wait(20.0)
        assert synced[-1] == len(text(3))
        before = len(synced)
        for row in rows(40, "N"):
            out.write([row])
        assert len(synced) - before < 20  # and not once for each row
        time.sleep(1.5)
        assert synced[-1] == (tmp_path / "out.csv").stat().st_size


@pytest.mark.parametrize(
    "content",
    [
        b"mixture,aggregate,mass_share\nM,A,1\n",
        b"mixture,packing_density,message\nM,0.6\nN,0.6,\n",
        b"mixture,packing_density,message\nM,0.6\nN,0.6,",
        b"mixture,packing_density,message\nM,0.6\n",
        b"mixture,packing_density,message,note\nM,0.6,,x\n",
        b"dear diary\n",
        b"dear diary",
        b"\n",
        b"\xff\xfe\x00\x01",
        b'mixture,packing_density,message\n"M"x,0.6,\n',
    ],
)
def test_a_file_that_is_no_earlier_output_is_refused_and_left_alone(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_bytes(content)
    with pytest.raises(InputError, match="name another file"):
        Output(path, COLUMNS)
    assert path.read_bytes() == content
    assert os.listdir(tmp_path) == ["out.csv"]


def test_a_place_where_no_file_can_be_is_refused(tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    for name, said in (
        ("folder.csv", "is no file"), ("none/out.csv", "cannot be written"), ("out.xlsx", "ends in .csv")
    ):  # fmt: skip
        with pytest.raises(InputError, match=said):
            Output(tmp_path / name, COLUMNS)


@pytest.mark.parametrize("cut", ["", "M9,0.6", 'M9,0.6,"a bed did'], ids=["whole", "cut off", "cut off in quotes"])
def test_an_earlier_output_stays_until_the_new_one_holds_as_many_rows(cut: str, tmp_path: Path) -> None:
    path = tmp_path / "out.csv"
    path.write_text(text(3) + cut)
    with Output(path, COLUMNS) as out:
        out.write(rows(2, "N"))
        assert path.read_text() == text(3) + cut
        out.write([{"mixture": "N2", "packing_density": "0.61"}])
        assert path.read_text() == text(3, "N")
        out.write([{"mixture": "N3", "packing_density": "0.61"}])
        assert path.read_text() == text(4, "N")
    assert os.listdir(tmp_path) == ["out.csv"]


@pytest.mark.parametrize("count", [0, 1, 3])
def test_what_broke_off_keeps_the_output_with_more_rows_and_what_is_complete_replaces_it(
    count: int, tmp_path: Path
) -> None:
    path = tmp_path / "out.csv"
    path.write_text(text(2))

    def broken_off() -> None:
        with Output(path, COLUMNS) as out:
            out.write(rows(count, "N"))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken_off()
    assert path.read_text() == (text(2) if count < 2 else text(count, "N"))
    with Output(path, COLUMNS) as out:
        out.write(rows(1, "O"))
    assert path.read_text() == text(1, "O")
    assert os.listdir(tmp_path) == ["out.csv"]


def test_a_process_that_is_killed_leaves_its_rows_or_the_earlier_output(tmp_path: Path) -> None:
    code = (
        "import os, sys; from pathlib import Path; from pdlab.tables import Output\n"
        f"out = Output(Path(sys.argv[1]), {COLUMNS})\n"
        "out.write([{'mixture': f'M{k}', 'packing_density': '0.61'} for k in range(3)]); os.kill(os.getpid(), 9)"
    )
    path = tmp_path / "out.csv"
    for earlier in (None, 2, 5):
        if earlier is not None:
            path.write_text(text(earlier, "E"))
        assert subprocess.run([sys.executable, "-c", code, str(path)], check=False).returncode == -9
        assert path.read_text() == (text(5, "E") if earlier == 5 else text(3))
    with Output(path, COLUMNS) as out:  # beside a left-over of the killed one
        out.write(rows(6))
    assert path.read_text() == text(6)
    assert os.listdir(tmp_path) == ["out.csv"]
