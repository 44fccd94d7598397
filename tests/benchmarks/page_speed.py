"""How long the server takes to draw each view again, of a large store.

``python tests/benchmarks/page_speed.py [FILE]``: builds a store of 100 000 runs and 10 000 mixtures in FILE (in a
temporary folder by default), or takes the one that is there. Each time is the least of five, in ms of the processor.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

from store_speed import build
from streamlit.testing.v1 import AppTest
from streamlit.util import calc_hash

from pdlab import store
from pdlab.page import app

SCALE = 0.5
"""Of the store of ``store_speed.py``."""


def spent(address: str) -> float:
    """Return the least time [ms] that a view takes to be drawn again."""
    view = AppTest.from_file(app.__file__, default_timeout=60)
    view._page_hash = calc_hash(address)
    view.run()
    assert not view.exception
    times = []
    for _ in range(5):
        begin = time.process_time()
        view.run()
        times.append(time.process_time() - begin)
    return 1e3 * min(times)


def main(path: Path) -> None:
    """Build the store where there is none, and print the table."""
    target = store.open_store(path)
    if target.created:
        build(target, SCALE)
    target.close()
    os.environ["PDLAB_STORE"] = target.url
    for address in app.VIEWS:
        print(f"{spent(address):8.1f}  /{address}", flush=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder) / "lab.db")
