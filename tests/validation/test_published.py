"""Packing density and contacts of equal spheres against an independent program's."""

import math
import sys
from pathlib import Path

import pytest

from pdlab.batch.runner import Runner
from pdlab.specimen import Packing, Protocol, equal_spheres
from pdlab.store import open_store

sys.path.insert(0, str(Path(__file__).parent))
from friction_table import REFERENCE, SETTINGS, agrees, row, simulate

ROWS = (0.1, 0.3, 1.0)


def test_three_rows_of_the_friction_table_with_two_seeds_each(tmp_path: Path) -> None:
    runner = Runner(open_store(str(tmp_path / "runs.db")))
    beds = [equal_spheres(friction, seed) for friction in ROWS for seed in (1, 2)]
    packings = [outcome for outcome in runner(beds) if isinstance(outcome, Packing)]
    assert len(packings) == len(beds)
    rows = [row(packings[2 * k : 2 * k + 2]) for k in range(len(ROWS))]
    for friction, one in zip(ROWS, rows, strict=True):
        density, _, contacts = REFERENCE[0.7, friction, 0.0]
        # 0.010, and 2.5 standard errors of two seeds, 0.003 / √2 each
        assert abs(one.density - density) < 0.010 + 2.5 * 0.003 / 2**0.5, friction
        assert one.contacts == pytest.approx(contacts, abs=0.3)
        assert one.overlap < 0.02
    assert rows[0].density > rows[1].density > rows[2].density


@pytest.mark.slow
@pytest.mark.parametrize("case", REFERENCE)
def test_every_row_agrees_with_another_program_in_the_mean_of_four_seeds(
    tmp_path: Path, case: tuple[float, float, float]
) -> None:
    damping, friction, rolling = case
    runner = Runner(open_store(str(tmp_path / "runs.db")))
    assert agrees(simulate(runner, friction, Protocol(local_damping=damping), 4, rolling), *case)


@pytest.mark.slow
def test_half_the_time_step_and_half_the_overlap_change_pd_by_less_than_0_002(tmp_path: Path) -> None:
    runner = Runner(open_store(str(tmp_path / "runs.db")))
    base, finer = (simulate(runner, 0.3, Protocol(**change), 16) for change in ({}, SETTINGS["both"]))
    assert abs(finer.density - base.density) < 0.002 + 2.0 * math.hypot(base.error, finer.error)
    assert math.hypot(base.error, finer.error) < 0.0013


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
