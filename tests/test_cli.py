"""The verbs in the shell: what they print, where, and their exit codes."""

import socket
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from conftest import FormulaPool, ThreadsPool
from shell import pdlab, process, refused

from pdlab import Lab
from pdlab.batch.runner import Runner
from pdlab.lab import SHIPPED

Folder = Callable[..., Path]


def test_version_and_help(tmp_path: Path) -> None:
    assert process("--version", folder=tmp_path).stdout.startswith("pdlab 0.")
    text = pdlab("--help", folder=tmp_path).stdout
    for verb in ("demo", "import", "export", "calibrate", "predict", "compare", "ls", "serve", "db"):
        assert verb in text
    assert not list(tmp_path.iterdir())


def test_import_makes_the_store_says_so_and_lists(tmp_path: Path) -> None:
    done = pdlab("import", str(SHIPPED), folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "made a new store: sqlite:///pdlab.db" in done.stdout
    assert "imported 3 aggregates, 3 sieve analyses, 6 density tests, 3 mixtures" in done.stdout
    assert "nothing new; 15 equal" in pdlab("import", str(SHIPPED), folder=tmp_path).stdout
    assert "pebbles L" in pdlab("ls", folder=tmp_path).stdout
    assert "pebbles L+F 1:1" in pdlab("ls", "mixtures", folder=tmp_path).stdout
    assert "no runs yet" in pdlab("ls", "runs", folder=tmp_path).stdout
    assert "already at revision" in pdlab("db", "upgrade", folder=tmp_path).stdout


def test_a_dry_run_of_an_import_makes_no_store_and_changes_none(tmp_path: Path, folder: Folder) -> None:
    done = pdlab("import", str(SHIPPED), "--dry-run", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "new: aggregates: pebbles L, pebbles M, pebbles F" in done.stdout
    assert "there is no store yet; sqlite:///pdlab.db would be made" in done.stdout
    assert "would import 3 aggregates, 3 sieve analyses, 6 density tests, 3 mixtures; 0 equal" in done.stdout
    assert not list(tmp_path.iterdir())
    pdlab("import", str(SHIPPED), folder=tmp_path)
    path = folder(packing_tests="material,compaction,voids_percent\npebbles L,loose,39\n")
    for _ in range(2):
        done = pdlab("import", str(path / "packing_tests.csv"), "--dry-run", folder=tmp_path)
        assert done.stdout == "new: density tests: pebbles L\nwould import 1 density tests; 0 equal to what was there\n"


@pytest.mark.parametrize("name", ["out", "out.xlsx"])
def test_export_writes_what_import_reads_and_overwrites_nothing(tmp_path: Path, name: str) -> None:
    pdlab("import", str(SHIPPED), folder=tmp_path)
    done = pdlab("export", name, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"written to {name}: 3 rows of aggregates, 6 rows of sieves" in done.stdout
    refused(pdlab("export", name, folder=tmp_path), "would be overwritten")
    assert "nothing new; 15 equal" in pdlab("import", name, folder=tmp_path).stdout
    refused(pdlab("export", "new", "--store", "empty.db", folder=tmp_path), "holds no aggregate yet")


def test_the_store_comes_from_the_option_else_the_environment(tmp_path: Path) -> None:
    pdlab("db", "upgrade", folder=tmp_path, PDLAB_STORE="sqlite:///one.db")
    pdlab("db", "upgrade", "--store", "two.db", folder=tmp_path, PDLAB_STORE="sqlite:///one.db")
    assert sorted(path.name for path in tmp_path.glob("*.db")) == ["one.db", "two.db"]


def test_bad_tables_are_refused_with_every_problem_and_nothing_is_kept(tmp_path: Path, folder: Folder) -> None:
    path = folder(aggregates="name\nA\n", sieves="aggregate,aperture_mm,retained_g\nA,16,abc\nB,8,0\nB,8,5\n")
    done = pdlab("import", str(path), folder=tmp_path)
    refused(done, "sieves.csv, row 2, column retained_g: 'abc' is no number", "sieves.csv, row 4", "stands twice")
    assert "no aggregates yet" in pdlab("ls", folder=tmp_path).stdout


def test_what_the_user_can_mend_ends_with_exit_code_2_and_one_sentence(tmp_path: Path) -> None:
    refused(process("calibrate", folder=tmp_path), "the store holds no aggregate yet")
    pdlab("import", str(SHIPPED), folder=tmp_path)
    refused(pdlab("calibrate", "gravel", folder=tmp_path), "the store holds no aggregate named 'gravel'")
    refused(pdlab("predict", "gravel", folder=tmp_path), "the store holds no mixture named 'gravel'")
    refused(pdlab("calibrate", "--rule", "mean", folder=tmp_path), "'mean' is no diameter rule")
    refused(pdlab("predict", "--method", "magic", folder=tmp_path), "'magic' is no method")
    refused(pdlab("predict", "--threads", "999", folder=tmp_path), "999 threads lie outside [1, ")
    refused(pdlab("predict", "-o", "gone/out.csv", folder=tmp_path), "cannot be written")
    refused(pdlab("ls", "stones", folder=tmp_path), "'stones' cannot be listed")
    refused(pdlab("import", "gone", folder=tmp_path), "no such file or folder")
    refused(pdlab("ls", "--store", str(SHIPPED / "sieves.csv"), folder=tmp_path), "is no pdlab store")
    refused(pdlab("ls", "--store", "gone/lab.db", folder=tmp_path), "does not exist")


@pytest.fixture(scope="module")
def small_lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which every run that the pebbles need is there, by a formula."""
    from conftest import FormulaRunner

    from pdlab import experiments

    folder = tmp_path_factory.mktemp("lab")
    with Lab(str(folder / "pdlab.db")) as lab:
        lab.import_tables(SHIPPED)
        experiments.predict(lab.store, FormulaRunner(lab.store))
    return folder


def test_calibrate_and_predict_print_tables_and_write_csv(small_lab: Path) -> None:
    done = pdlab("calibrate", folder=small_lab)
    assert done.returncode == 0, done.stderr
    assert "friction μ" in done.stdout
    assert "note: pebbles L, pebbles M, pebbles F: the density test's compaction is not stated" in done.stdout
    done = pdlab("predict", "-o", "out.csv", folder=small_lab)
    assert done.returncode == 0, done.stderr
    assert "mean absolute error over 3 mixtures" in done.stdout
    assert "(volume mean of the aggregates: 0.0373; Toufar: 0.0106; CPM: 0.0115)" in done.stdout
    table = [line for line in done.stdout.splitlines() if line.startswith("  pebbles L+M 1:1")][-1].split()
    assert table[-4:] == ["0.6060", "0.6378", "0.6419", "done"]
    frame = pd.read_csv(small_lab / "out.csv")
    assert list(frame["mixture"]) == ["pebbles L+M 1:1", "pebbles L+F 1:1", "pebbles M+F 1:1"]
    assert (frame["difference"] - (frame["packing_density"] - frame["measured"])).abs().max() < 1e-12
    assert "pebbles L+F 1:1" in pdlab("ls", "predictions", folder=small_lab).stdout


def test_compare_prints_every_mixture_and_every_method_and_writes_both_as_csv(small_lab: Path) -> None:
    done = pdlab("compare", "--confidence", "0.9", "--seed", "4", "-o", "figures.csv", folder=small_lab)
    assert done.returncode == 0, done.stderr
    assert max(map(len, done.stdout.splitlines())) <= 140
    mixture = next(line for line in done.stdout.splitlines() if line.startswith("  pebbles L+F 1:1")).split()
    assert mixture[3:4] + mixture[-3:-1] == ["0.6440", "+0.0140", "+0.0161"]
    assert "Errors over the 3 mixtures that all methods have (90 % intervals by bootstrap, seed 4)" in done.stdout
    assert "over all that it has" not in done.stdout
    rows = {line[:18].strip(): line for line in done.stdout.splitlines() if " (" in line}
    assert "0.0106 (0.007, 0.014)" in rows["Toufar"]
    assert "-0.0373" in rows["volume mean"]
    assert "measured PDs have a standard error of 0.0050, which is in every difference" in done.stdout
    assert "note: intervals over fewer than 10 mixtures are too narrow" in done.stdout
    assert done.stdout.endswith("written to figures.csv\nwritten to figures-mixtures.csv\n")
    figures = pd.read_csv(small_lab / "figures.csv").query("over == 'common'").set_index("method")
    off = pd.read_csv(small_lab / "figures-mixtures.csv")
    assert list(off["mixture"]) == ["pebbles L+M 1:1", "pebbles L+F 1:1", "pebbles M+F 1:1"]
    for method, row in figures.iterrows():
        assert abs(off[str(method)].abs().mean() - row["mean_absolute_error"]) < 1e-12
    two = pdlab("compare", "pebbles L+M 1:1", "pebbles M+F 1:1", folder=small_lab).stdout
    assert "note: no interval where 2 mixtures say nothing of an interval, it takes 3" in two
    assert "note: CPM, own K lacks pebbles L+M 1:1, pebbles M+F 1:1: 1 other mixtures depend on the" in two


def test_compare_refuses_what_it_cannot_compare_or_write(small_lab: Path, tmp_path: Path) -> None:
    refused(pdlab("compare", "--confidence", "95", folder=small_lab), "confidence 95 must lie between 0 and 1")
    refused(pdlab("compare", "-o", "figures.txt", folder=small_lab), "figures.txt does not end in .csv")
    refused(pdlab("compare", "--rule", "mean", folder=small_lab), "'mean' is no diameter rule")
    refused(pdlab("compare", folder=tmp_path), "none of these mixtures has a density test")


def test_lab_predicts_a_frame_of_mixtures(small_lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = pd.DataFrame(
        {"mixture": ["new"] * 2, "aggregate": ["pebbles L", "pebbles F"], "solid_volume_share": ["0,7", "0,3"]}
    )
    with Lab(str(small_lab / "pdlab.db")) as lab:
        assert isinstance(lab.runner, Runner)
        monkeypatch.setattr(lab, "runner", Runner(lab.store, FormulaPool()))
        out = lab.predict(frame)
        assert list(out["mixture"]) == ["new"]
        assert 0.5 < out["packing_density"][0] < 0.75
        assert set(lab.aggregates()["friction"].notna()) == {True}


def test_what_cannot_be_written_or_served_is_said_before_anything_runs(small_lab: Path, tmp_path: Path) -> None:
    refused(pdlab("predict", "-o", str(tmp_path), folder=small_lab), "cannot be written")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        done = pdlab("serve", "--port", str(taken.getsockname()[1]), folder=small_lab)
    refused(done, "is not free", "choose another with --port")
    assert "the page" not in done.stdout


def test_names_are_listed_as_they_were_entered(tmp_path: Path, folder: Folder) -> None:
    name = "L:M:F :fire: [bold]x[/bold] " + "y" * 40
    folder(aggregates=f"name\n{name}\n")
    pdlab("import", str(tmp_path), folder=tmp_path)
    text = pdlab("ls", folder=tmp_path, COLUMNS="200").stdout
    assert name[:28] in text
    assert "y" * 40 in text


@pytest.mark.parametrize("address", ["nonsense://x", "sqlite+foo:///x", "http://x:abc/y"])
def test_a_store_address_that_cannot_be_used_is_a_sentence(tmp_path: Path, address: str) -> None:
    refused(pdlab("ls", folder=tmp_path, PDLAB_STORE=address), "write sqlite:///FILE, a path, or postgresql://")


def test_db_upgrade_keeps_a_backup_and_db_backup_and_copy_say_what_they_wrote(
    tmp_path: Path, old_store: Callable[[str], Path]
) -> None:
    old_store("0001").rename(tmp_path / "pdlab.db")
    refused(pdlab("ls", folder=tmp_path), "older than", "run 'pdlab db upgrade'")
    done = pdlab("db", "upgrade", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    (kept,) = tmp_path.glob("pdlab.revision-0001.*.db")
    assert f"backup of revision 0001: {kept.name}\n" in done.stdout
    assert "sqlite:///pdlab.db: upgraded at revision" in done.stdout
    assert "kept.db (0." in pdlab("db", "backup", "kept.db", folder=tmp_path).stdout
    refused(pdlab("db", "backup", "kept.db", folder=tmp_path), "kept.db is there already and is not overwritten")
    done = pdlab("db", "copy", "kept.db", "copy.db", folder=tmp_path)
    assert "137 rows from sqlite:///kept.db to sqlite:///copy.db" in done.stdout, done
    assert "pebbles L" in pdlab("ls", "--store", "copy.db", folder=tmp_path).stdout


def test_lab_takes_a_path_one_name_and_refuses_an_empty_frame(small_lab: Path, monkeypatch: pytest.MonkeyPatch) -> None:

    from pdlab.errors import InputError, TableError

    with Lab(small_lab / "pdlab.db") as lab:
        monkeypatch.setattr(lab, "runner", Runner(lab.store, FormulaPool()))
        assert list(lab.predict("pebbles L+F 1:1")["mixture"]) == ["pebbles L+F 1:1"]
        with pytest.raises(TableError, match="the table is empty"):
            lab.predict(pd.DataFrame(columns=["mixture", "aggregate", "solid_volume_share"]))
        with pytest.raises(InputError, match="1 seeds give no standard error"):
            lab.calibrate(seeds=1)


@pytest.fixture(scope="module")
def bed_lab(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    """A store with a bed at rest, one that does not come to rest, and two runs without a bed; the beds' hashes."""

    from pdlab import packing
    from pdlab.models import Run
    from pdlab.specimen import Species, Specimen
    from pdlab.store import open_store, save_run

    mixed = Specimen((Species(1.0, 0.3, 40), Species(0.5, 0.3, 320)), 4.0, 2)
    restless = Specimen((Species(1.0, 0.3, 100),), 4.0, 5)
    folder = tmp_path_factory.mktemp("beds")
    target = open_store(str(folder / "pdlab.db"))
    runner = Runner(target, ThreadsPool(1))
    runner([mixed])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(packing.simulation, "PATIENCE", 0.5)
        runner([restless])
    with target.write() as session:
        for end in "01":
            digest = end.rjust(64, "0")
            save_run(session, Run(specimen_hash=digest, specimen="{}", engine_version=1, seed=1, spheres=1,
                                  state="failed"), None)  # fmt: skip
    target.close()
    return folder, mixed.digest(packing.VERSION), restless.digest(packing.VERSION)


def test_bed_shows_density_contacts_and_height_of_a_run(bed_lab: tuple[Path, str, str]) -> None:
    folder, digest, _ = bed_lab
    done = pdlab("bed", digest[:4], folder=folder)
    assert done.returncode == 0, done.stderr
    assert f"run {digest[:12]}: done\n" in done.stdout
    with Lab(folder / "pdlab.db") as lab:
        density = lab.runs().set_index("specimen_hash")["packing_density"][digest]
        matrix = lab.bed(digest).contacts_by_species
    assert f"360 spheres in a periodic box 4 d_max wide, packing density {density:.4f}\n" in done.stdout
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith("  ")]
    fine = next(row for row in rows if row[:3] == ["1", "0.5", "320"])
    assert fine[3:] == [f"{value:.3f}" for value in (*matrix[1], matrix[1].sum())]
    assert sum(row[0][0].isdigit() for row in rows if row) == 2 + 10
    in_mm = pdlab("bed", digest, "--diameter-mm", "16", folder=folder).stdout
    assert "a periodic box 64 mm wide" in in_mm
    assert "d_max" not in in_mm


def test_bed_shows_a_failed_run_as_it_was_left(bed_lab: tuple[Path, str, str]) -> None:
    folder, _, digest = bed_lab
    done = pdlab("bed", digest[:12], folder=folder)
    assert done.returncode == 0, done.stderr
    assert f"run {digest[:12]}: failed (the bed still moves after" in done.stdout
    assert "100 spheres" in done.stdout
    assert pdlab("bed", digest[:12], "-o", "failed.vtp", folder=folder).returncode == 0


def test_bed_writes_every_file_asked_for_and_names_it(bed_lab: tuple[Path, str, str], tmp_path: Path) -> None:
    folder, digest, _ = bed_lab
    vtp, csv, profiles = (tmp_path / name for name in ("bed.vtp", "bed.csv", "profiles.csv"))
    done = pdlab(
        "bed", digest[:8], "-o", str(vtp), "-o", str(csv), "--profiles", str(profiles), "--diameter-mm", "16",
        folder=folder,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    written = [vtp, csv, tmp_path / "bed-contacts.csv", profiles]
    assert done.stdout == "".join(f"written to {file}\n" for file in written)
    assert sorted(tmp_path.iterdir()) == sorted(written)
    assert 'NumberOfPoints="360"' in vtp.read_text(encoding="utf-8")
    assert pd.read_csv(csv)["radius_mm"].max() == 8.0
    assert pd.read_csv(profiles)["to_mm"].max() > 16.0


def test_a_run_is_found_by_the_beginning_of_its_hash_or_not_at_all(bed_lab: tuple[Path, str, str]) -> None:
    from pdlab.errors import UnknownName

    folder, digest, _ = bed_lab
    with Lab(folder / "pdlab.db") as lab:
        assert lab.bed(digest[:4]).digest == lab.bed(digest).digest == digest
        for beginning, message in (
            (digest[:3], f"'{digest[:3]}' cannot begin a run's hash, which takes 4 to 64"),
            (digest.upper(), "cannot begin a run's hash"),
            ("%%%%", "cannot begin a run's hash"),
            (f"{digest}0", "cannot begin a run's hash"),
            (digest[4:20], f"holds no run whose hash begins with {digest[4:20]}"),
            ("0000", r"several runs begin with 0000, .* 00000000 and 00000000; give more characters"),
            ("0" * 63 + "1", r"run 000000000000 \(failed\) keeps no bed; choose another"),
        ):
            with pytest.raises(UnknownName, match=message):
                lab.bed(beginning)


def test_bed_refuses_what_it_cannot_find_or_write_and_leaves_nothing(
    bed_lab: tuple[Path, str, str], tmp_path: Path
) -> None:
    folder, digest, _ = bed_lab
    out = str(tmp_path / "bed.csv")
    refused(pdlab("bed", "f" * 5, "-o", out, folder=folder), "holds no run whose hash begins with fffff; see 'pdlab ls")
    refused(pdlab("bed", digest, "-o", str(tmp_path), folder=folder), "ends in neither .vtp, for ParaView, nor .csv")
    refused(pdlab("bed", digest, "-o", out, "--profiles", out, folder=folder), "bed.csv would be written twice")
    refused(pdlab("bed", digest, "-o", out, "--profiles", "p.vtp", folder=folder), "p.vtp does not end in .csv")
    refused(pdlab("bed", digest, "-o", out, "--diameter-mm", "0", folder=folder), "a largest diameter of 0 mm is none")
    refused(pdlab("bed", digest, "-o", "gone/bed.vtp", folder=folder), "gone/bed.vtp cannot be written")
    assert not list(tmp_path.iterdir())
    Path(out).mkdir()
    refused(pdlab("bed", digest, "-o", out, folder=folder), "bed.csv cannot be written (Is a directory)")
