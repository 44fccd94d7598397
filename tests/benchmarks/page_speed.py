"""How long the server takes to draw each view again, of a large store.

``python tests/benchmarks/page_speed.py [FILE]``: builds a store of 100 000 runs, 10 000 mixtures and two sweeps in FILE
(in a temporary folder by default), or takes the one that is there. Each time is the least of five, in ms of the
processor: of views that are drawn again as they were, and again after a density test has changed.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

import sqlalchemy as sa
from store_speed import build
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash

sys.path.insert(0, str(Path(__file__).parents[1]))

from conftest import FormulaRunner

from pdlab import experiments, store
from pdlab.models import PackingTest
from pdlab.page import app
from pdlab.store import Store

SCALE = 0.5
"""Of the store of ``store_speed.py``."""
SWEPT = ("gravel 0001", "gravel 0002", "gravel 0003")
VIEWS: dict[str, tuple[dict[str, str], ...]] = {
    "predicted-vs-measured": ({}, {"find": "mix 01"}, {"method": "monosized"}, {"holds": "gravel 0001"}),
    "aggregates": ({},),
    "calibration": ({}, {"aggregate": "7"}),
    "mixtures": ({}, {"mixture": "9990"}),
    "proportions": ({}, {"sweep": "1"}, {"sweep": "2"}),
    "new-aggregate": ({},),
    "corrections": ({"aggregate": "7"}, {"mixture": "9990"}),
}
"""What stands behind each view's address."""


def filled(path: Path) -> Store:
    """Open the store in a file; a new one is filled, the beds of its sweeps worked out by the tests' formula."""
    target = store.open_store(path)
    if target.created:
        build(target, SCALE)
        for count in (2, 3):
            experiments.sweep_aggregates(target, FormulaRunner(target), SWEPT[:count])
    return target


def spent(address: str, query: dict[str, str], target: Store) -> tuple[float, float]:
    """Return the least times [ms] that a view takes to be drawn again: as it was, and after a write."""
    view = AppTest.from_file(app.__file__, default_timeout=60)
    view._page_hash = calc_hash(address)
    for name, text in query.items():
        view.query_params[name] = text
    view.run()
    assert not view.exception
    times = list[list[float]]()
    for writes in (False, True):
        times.append([])
        for _ in range(5):
            if writes:
                _retest(target)
            begin = time.process_time()
            view.run()
            times[-1].append(1e3 * (time.process_time() - begin))
            assert not view.exception
    return min(times[0]), min(times[1])


def _retest(target: Store) -> None:
    """Change the measured packing density of a mixture a little."""
    with target.write() as session:
        found = session.scalars(sa.select(PackingTest).where(PackingTest.mixture_id.is_not(None)).limit(1)).one()
        found.repeats = 3 + (found.repeats or 0) % 3


def main(path: Path) -> None:
    """Build the store where there is none, and print the table."""
    target = filled(path)
    os.environ["PDLAB_STORE"] = target.url
    assert VIEWS.keys() == app.VIEWS.keys()
    for address, queries in VIEWS.items():
        for query in queries:
            text = "&".join(f"{name}={value}" for name, value in query.items())
            still, anew = spent(address, query, target)
            print(f"{still:8.1f} {anew:8.1f}  /{address}{'?' * bool(text)}{text}", flush=True)
    target.close()


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder) / "lab.db")
