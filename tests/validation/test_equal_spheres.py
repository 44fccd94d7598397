"""The shipped packing density of equal spheres against runs that nobody has seen."""

import math
from pathlib import Path

import numpy as np
import pytest

from pdlab.batch.runner import Runner
from pdlab.calibration import MONOSIZED, NODES, ROLLING, Ladder
from pdlab.experiments.curves import Curves
from pdlab.experiments.shipped import shipped_surface
from pdlab.packing import VERSION
from pdlab.specimen import Packing, equal_spheres, on_grid, protocol_of, with_seeds
from pdlab.store import Store, open_store

SEED, FRESH = 20261124, (101, 102)
POINTS = ("loose",) * 7 + ("rodded",) * 2 + ("vibrated",)
MEDIAN, ERRORS = 0.003, 4.0
"""The largest median of the absolute differences, and the joint standard errors that each may be off."""
ONE_BED = 0.0028
"""Standard deviation of one bed: no two seeds tell their own."""


def drawn() -> list[tuple[str, float, float]]:
    """Draw compaction, friction and rolling friction: on one of the two edges or between them, never at a node."""
    rng = np.random.default_rng(SEED)
    out = []
    for compaction in POINTS:
        inside = shipped_surface(compaction, VERSION)
        frictions, rollings = [(0.0, 1.0), (inside.frictions[0], 1.0)], [(0.0, 1.0), (0.0, inside.rollings[-1])]
        where = rng.integers(3)  # edge of friction, edge of rolling friction, between
        friction = on_grid(rng.uniform(*np.sqrt(frictions[where // 2])) ** 2) if where != 1 else 1.0
        rolling = on_grid(rng.uniform(*np.sqrt(rollings[where // 2])) ** 2) if where != 0 else 0.0
        assert friction not in NODES or rolling not in NODES
        out.append((compaction, friction, rolling))
    return out


def told(target: Store, compaction: str, friction: float, rolling: float) -> tuple[float, float]:
    """Return what is shipped: on an edge the curve of a calibration, else the surface."""
    if rolling > 0.0 and friction < 1.0:
        return shipped_surface(compaction, VERSION).at(friction, rolling)
    ladder = Ladder(ROLLING if rolling else MONOSIZED, ((1.0, 1.0),), protocol_of(compaction))
    curves = Curves(target, VERSION)
    curves.load([ladder])
    known, value = curves.known(ladder), rolling or friction
    assert known is not None
    return known.at(value), known.error_at(value)


@pytest.mark.slow
@pytest.mark.shipped
def test_fresh_runs_at_ten_points_drawn_beforehand_are_told_by_the_shipped_ones(tmp_path: Path) -> None:
    target = open_store(str(tmp_path / "runs.db"))
    points = drawn()
    beds = [with_seeds(equal_spheres(mu, 1, protocol_of(name), mu_r), FRESH) for name, mu, mu_r in points]
    outcomes = iter(Runner(target)([bed for some in beds for bed in some]))
    differences, lines = [], []
    for point in points:
        two = [next(outcomes) for _ in FRESH]
        fresh = float(np.mean([one.packing_density for one in two if isinstance(one, Packing)]))
        value, error = told(target, *point)
        allowed = ERRORS * math.hypot(error, ONE_BED / math.sqrt(len(FRESH)))
        differences.append(abs(fresh - value))
        lines.append(
            f"{point}: shipped {value:.4f} ± {error:.4f}, fresh {fresh:.4f}, {fresh - value:+.4f}, {allowed=:.4f}"
        )
        assert differences[-1] <= allowed, lines[-1]
    print("\n".join([*lines, f"median {np.median(differences):.4f}"]))
    assert np.median(differences) <= MEDIAN
