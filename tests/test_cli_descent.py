"""The verbs show, verify, refresh, correct and delete: what they print and their exit codes."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import sqlalchemy as sa
from conftest import FormulaPool, FormulaRunner, ThreadsPool
from shell import pdlab, refused

from pdlab import Lab, cli, experiments, packing
from pdlab.batch.runner import Runner
from pdlab.errors import InputError
from pdlab.lab import SHIPPED
from pdlab.models import Run
from pdlab.specimen import Species, Specimen, with_seeds
from pdlab.store import open_store


@pytest.fixture
def lab_of() -> Callable[[Path, int], Path]:
    """Make a store in a folder, predicted by a formula under an engine version."""

    def make(folder: Path, version: int = packing.VERSION) -> Path:
        with Lab(folder / "pdlab.db") as lab:
            lab.import_tables(SHIPPED)
            experiments.predict(lab.store, FormulaRunner(lab.store, version))
        return folder

    return make


def test_show_draws_a_tree_or_writes_json(tmp_path: Path, lab_of: Callable[..., Path]) -> None:
    lab_of(tmp_path)
    done = pdlab("show", "pebbles L+M 1:1", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("mixture:pebbles L+M 1:1: version 1\n├── prediction:1: PD 0.6")
    assert "│   │       │   ├── run:" in done.stdout
    facts = json.loads(pdlab("show", "prediction:1", "--json", folder=tmp_path).stdout)
    assert facts["calibrations"][0]["sieve_analysis"]["results"][0]["aperture_mm"] == 60.96
    refused(pdlab("show", "gravel", folder=tmp_path), "the store holds nothing named 'gravel'")


def test_a_correction_is_printed_with_what_it_makes_outdated(tmp_path: Path, lab_of: Callable[..., Path]) -> None:
    lab_of(tmp_path)
    change = ("correct", "packing_test:1", "voids_percent=40,3", "--seen", "1")
    done = pdlab(*change, "--by", "Anna", "--reason", "misread", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "packing_test:1   voids_percent     40.0    40.3" in done.stdout
    assert "outdated now: the predictions of pebbles L+M 1:1, pebbles L+F 1:1; run 'pdlab predict'" in done.stdout
    refused(pdlab(*change, folder=tmp_path), "was changed since you saw it, by Anna on", "it is version 2 now")
    assert "nothing to correct" in pdlab(*change[:3], folder=tmp_path).stdout
    assert "voids_percent     40.0    40.3   misread" in pdlab("ls", "corrections", folder=tmp_path).stdout
    refused(
        pdlab("correct", "voids_percent=4", folder=tmp_path), "write KIND:ROW first, as aggregate:A voids_percent=4"
    )
    refused(pdlab("correct", "packing_test:1", folder=tmp_path), "'packing_test:1' has nothing to correct behind it")


def test_words_become_rows_with_their_columns() -> None:
    words = ["mixture_component:1/0", "mass_share=0.4", "mixture_component:1/1", "mass_share=0.6"]
    assert cli.descent._changes(words) == {words[0]: {"mass_share": "0.4"}, words[2]: {"mass_share": "0.6"}}
    assert cli.descent._changes(["aggregate:a=b", "source=c=d: e"]) == {"aggregate:a=b": {"source": "c=d: e"}}
    with pytest.raises(InputError, match="'source=x' corrects nothing named"):
        cli.descent._changes(["source=x"])


def test_delete_says_what_would_go_and_deletes_with_yes(tmp_path: Path, lab_of: Callable[..., Path]) -> None:
    lab_of(tmp_path)
    refused(pdlab("delete", "pebbles L", folder=tmp_path), "on it rest 1 sieve analysis", "delete those first")
    refused(pdlab("delete", "packing_test:4", folder=tmp_path), "packing_test:4 would be deleted; add --yes")
    assert pdlab("delete", "packing_test:4", "--yes", folder=tmp_path).stdout == "deleted packing_test:4\n"
    assert "(deleted)" in pdlab("ls", "corrections", folder=tmp_path).stdout


def test_verify_ends_with_exit_code_1_where_a_run_differs_and_names_it(tmp_path: Path) -> None:
    assert pdlab("verify", folder=tmp_path).stdout.endswith("no runs yet\n")
    target = open_store(str(tmp_path / "pdlab.db"))
    beds = with_seeds(Specimen((Species(1.0, 0.3, 100),), 4.0, 1), [1, 2, 3])
    Runner(target, ThreadsPool(1))(beds)
    done = pdlab("verify", "--sample", "2", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "2 runs: 2 equal\ndrawn by --seed " in done.stdout
    wrong, older = (bed.digest(packing.VERSION) for bed in beds[:2])
    with target.write() as session:
        session.execute(sa.update(Run).where(Run.specimen_hash == wrong).values(packing_density=0.5))
        session.execute(sa.update(Run).where(Run.specimen_hash == older).values(engine_version=1))
    target.close()
    done = pdlab("verify", folder=tmp_path)
    assert done.returncode == 1
    assert done.stderr == f"these runs differ: {wrong[:12]}; keep the store and report it\n"
    assert "3 runs: " in done.stdout
    assert "1 differs" in done.stdout
    assert "1 another engine version" in done.stdout


def test_refresh_prints_the_difference_and_then_finds_nothing_to_do(
    tmp_path: Path, lab_of: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lab_of(tmp_path, packing.VERSION - 1)
    store = str(tmp_path / "pdlab.db")
    done = pdlab("ls", "predictions", folder=tmp_path)
    assert f"M+F 1:1: by an older engine (version {packing.VERSION - 1}); run 'pdlab refresh'" in done.stdout
    monkeypatch.setattr("pdlab.lab.open_pool", lambda *_: FormulaPool())
    cli.descent.refresh(None, store)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith(f"Calibrated and predicted again by engine version {packing.VERSION}")
    rows = [line.split() for line in lines if line.lstrip().startswith(("aggregate", "mixture"))]
    assert len(rows) == 6
    for row in rows:
        before, after, difference = (float(cell) for cell in row[-4:-1])
        assert difference == pytest.approx(after - before, abs=2e-4)
    cli.descent.refresh(None, store)
    assert capsys.readouterr().out == f"nothing rests on an engine older than version {packing.VERSION}\n"
