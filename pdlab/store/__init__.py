"""The store: databases, transactions and the only SELECTs."""

from pdlab.store.copying import TableCopy, backup, copy
from pdlab.store.databases import shown_url, store_url
from pdlab.store.descent import (
    blends_with,
    corrections,
    find_row,
    last_calibration,
    last_prediction,
    resting_on,
    with_descent,
)
from pdlab.store.opening import Store, Upgraded, open_store, upgrade
from pdlab.store.revisions import migrate
from pdlab.store.selects import (
    add_all,
    aggregates,
    aggregates_by_id,
    calibrations,
    deliveries,
    done_runs,
    find_aggregate,
    find_bed,
    find_mixture,
    find_run,
    mixtures,
    newest_engine,
    newest_test,
    predictions,
    runs,
    save_run,
)

__all__ = [
    "Store",
    "TableCopy",
    "Upgraded",
    "add_all",
    "aggregates",
    "aggregates_by_id",
    "backup",
    "blends_with",
    "calibrations",
    "copy",
    "corrections",
    "deliveries",
    "done_runs",
    "find_aggregate",
    "find_bed",
    "find_mixture",
    "find_row",
    "find_run",
    "last_calibration",
    "last_prediction",
    "migrate",
    "mixtures",
    "newest_engine",
    "newest_test",
    "open_store",
    "predictions",
    "resting_on",
    "runs",
    "save_run",
    "shown_url",
    "store_url",
    "upgrade",
    "with_descent",
]
