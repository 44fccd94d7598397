"""``pdlab sweep``: what it prints and writes, and its exit codes."""

from pathlib import Path

import pandas as pd
import pytest
from shell import pdlab, refused

from pdlab import Lab
from pdlab.lab import SHIPPED

ASKED = ("pebbles L", "pebbles F", "--standard-error", "0.003", "--most", "6")


@pytest.fixture(scope="module")
def swept_lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store in which every run that a sweep of the pebbles needs is there, by a formula."""
    from conftest import FormulaRunner

    from pdlab import experiments

    folder = tmp_path_factory.mktemp("lab")
    with Lab(str(folder / "pdlab.db")) as lab:
        lab.import_tables(SHIPPED)
        runner = FormulaRunner(lab.store)
        experiments.sweep_aggregates(lab.store, runner, ASKED[:2], None, 0.003, 6)
    return folder


def test_sweep_prints_the_beds_the_densest_mix_and_the_next_test_and_writes_the_curve(swept_lab: Path) -> None:
    done = pdlab("sweep", *ASKED, "-o", "curve.csv", folder=swept_lab)
    assert done.returncode == 0, done.stderr
    tables = done.stdout[: done.stdout.index("its packing density")]
    assert max(map(len, tables.splitlines())) <= 140
    assert "Beds along pebbles L + pebbles F (method monosized, diameter rule log_mean)" in done.stdout
    for words in ("Densest mix", "its packing density: 0.6", "(inputs); no other proportions", "to test next: 0."):
        assert words in done.stdout
    assert "see 'pdlab show sweep:1'" in done.stdout
    frame = pd.read_csv(swept_lab / "curve.csv")
    assert list(frame.columns) == ["pebbles L", "pebbles F", "packing_density", "standard_error"]
    assert len(frame) == 101
    assert (frame["pebbles L"] + frame["pebbles F"] - 1.0).abs().max() < 1e-9
    best = frame["packing_density"].max()
    assert f"its packing density: {best:.4f}" in done.stdout
    assert "densest mix PD" in pdlab("show", "sweep:1", folder=swept_lab).stdout


def test_what_cannot_be_swept_ends_with_exit_code_2(swept_lab: Path) -> None:
    refused(pdlab("sweep", "pebbles L", folder=swept_lab), "a sweep goes over 2 to 5 aggregates, not 1")
    refused(pdlab("sweep", "pebbles L", "sand", folder=swept_lab), "no aggregate named 'sand'")
    refused(pdlab("sweep", *ASKED, "-o", "gone/out.csv", folder=swept_lab), "cannot be written")
    refused(pdlab("sweep", *ASKED[:2], "--standard-error", "0", folder=swept_lab), "take both above 0")


def test_lab_sweeps_and_gives_the_curve_as_a_frame(swept_lab: Path) -> None:
    from pdlab.frames import sweep_frame

    with Lab(str(swept_lab / "pdlab.db")) as lab:
        report = lab.sweep(ASKED[:2], standard_error=0.003, most=6)
    assert report.result is not None
    frame = sweep_frame(report)
    at = frame["packing_density"].idxmax()
    assert frame["pebbles L"][at] == report.result.densest.shares[0]
