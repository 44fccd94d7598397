"""The store: databases, transactions and the only SELECTs."""

from pdlab.store.opening import Store, is_made, migrate, open_store, store_url, upgrade
from pdlab.store.selects import (
    add_all,
    aggregates,
    aggregates_by_id,
    all_deliveries,
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
    "add_all",
    "aggregates",
    "aggregates_by_id",
    "all_deliveries",
    "calibrations",
    "deliveries",
    "done_runs",
    "find_aggregate",
    "find_bed",
    "find_mixture",
    "is_made",
    "migrate",
    "mixtures",
    "newest_test",
    "open_store",
    "predictions",
    "runs",
    "save_run",
    "store_url",
    "upgrade",
]
