"""The store: databases, transactions and the only SELECTs."""

from pdlab.store.copying import TableCopy, backup, copy
from pdlab.store.databases import shown_url, store_url
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
    mixtures,
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
    "calibrations",
    "copy",
    "deliveries",
    "done_runs",
    "find_aggregate",
    "find_bed",
    "find_mixture",
    "migrate",
    "mixtures",
    "newest_test",
    "open_store",
    "predictions",
    "runs",
    "save_run",
    "shown_url",
    "store_url",
    "upgrade",
]
