"""Packing density and contacts of equal spheres against an independent program's."""

import sys
from pathlib import Path

import pytest

from pdlab.batch import Runner
from pdlab.specimen import LOOSE, Packing, equal_spheres
from pdlab.store import open_store

sys.path.insert(0, str(Path(__file__).parent))
from friction_table import REFERENCE, row, simulate

ROWS = (0.1, 0.3, 1.0)


def test_three_rows_of_the_friction_table_with_two_seeds_each(tmp_path: Path) -> None:
    runner = Runner(open_store(str(tmp_path / "runs.db")))
    beds = [equal_spheres(friction, seed) for friction in ROWS for seed in (1, 2)]
    packings = [outcome for outcome in runner(beds) if isinstance(outcome, Packing)]
    assert len(packings) == len(beds)
    rows = [row(packings[2 * k : 2 * k + 2]) for k in range(len(ROWS))]
    for friction, one in zip(ROWS, rows, strict=True):
        density, contacts = REFERENCE[0.7, friction]
        # 0.010, and 2.5 standard errors of two seeds, 0.003 / √2 each
        assert abs(one.density - density) < 0.010 + 2.5 * 0.003 / 2**0.5, friction
        assert one.contacts == pytest.approx(contacts, abs=0.3)
        assert one.overlap < 0.02
    assert rows[0].density > rows[1].density > rows[2].density


@pytest.mark.slow
@pytest.mark.parametrize("friction", [mu for alpha, mu in REFERENCE if alpha == 0.7])
def test_every_row_is_met_within_0_010_by_the_mean_of_eight_seeds(tmp_path: Path, friction: float) -> None:
    one = simulate(Runner(open_store(str(tmp_path / "runs.db"))), friction, LOOSE, 8)
    assert abs(one.density - REFERENCE[0.7, friction][0]) < 0.010


@pytest.mark.slow
def test_the_demo_meets_its_numbers(tmp_path: Path) -> None:
    from pdlab import Lab
    from pdlab.lab import SHIPPED

    with Lab(str(tmp_path / "demo.db")) as lab:
        lab.import_tables(SHIPPED)
        reports = lab.predict_reports()
    error = sum(abs(report.difference or 1.0) for report in reports) / len(reports)
    plain = sum(abs((report.volume_mean or 0.0) - (report.measured or 0.0)) for report in reports) / len(reports)
    assert error <= 0.02
    assert error < plain / 2.0
    assert plain == pytest.approx(0.037, abs=0.001)
    assert max(report.standard_error or 1.0 for report in reports) <= 0.004
