"""The first steps in an empty store: what comes after what, and an example that is wished for as a whole."""

from pathlib import Path
from typing import NamedTuple

from pdlab import store, tables
from pdlab.calibration import METHOD
from pdlab.experiments.lists import listed
from pdlab.experiments.mixing import ask_prediction
from pdlab.experiments.registration import register
from pdlab.store import Store

SHIPPED = Path(__file__).parents[1] / "data" / "feret_pebbles"
"""Feret's round pebbles in the table format, with their source in the folder above."""


class FirstSteps(NamedTuple):
    """Which of the steps to a first prediction a store has behind it."""

    aggregate: bool
    calibrated: bool
    mixture: bool
    predicted: bool


def first_steps(target: Store) -> FirstSteps:
    """Return which of the first steps are done, whoever did them."""
    asked = (
        ("aggregates", (), "aggregate_id"),
        ("aggregates", ("friction>=0",), "aggregate_id"),
        ("mixtures", (), "mixture"),
        ("predictions", ("state=done",), "mixture"),
    )
    return FirstSteps(*(bool(listed(target, what, where, [column], column, 1)[1]) for what, where, column in asked))


def load_example(target: Store) -> list[int]:
    """Register the measurements that come with pdlab and wish for their mixtures' predictions; return the mixtures.

    Raises TableError where other materials of the same names are there.
    """
    brought = tables.read_path(SHIPPED)
    register(target, brought)
    names = list(dict.fromkeys(record.name for record in brought.mixtures))
    with target.read() as session:
        ids = [row.id for row in store.mixtures(session, names)]
    for mixture_id in ids:
        ask_prediction(target, mixture_id, METHOD)
    return ids
