"""The lab report: one mixture or one aggregate as one HTML file that asks nothing of any other, fit to sign."""

import datetime as dt
import re
from pathlib import Path

from pdlab import experiments
from pdlab.errors import InputError
from pdlab.experiments import REFERENCES, AggregateDocument, MixtureDocument
from pdlab.experiments.references import NOTE
from pdlab.report import figures
from pdlab.report.pages import LONGEST, moment, page
from pdlab.store import Store

__all__ = ["aggregate", "file_name", "mixture", "named", "refused"]

STATES = {"outdated": "OUTDATED: not to be signed", "failed": "FAILED: no result", "open": "NO RESULT YET"}
"""What stands on top of every page, by a result's state."""
REFERENCE = f"REFERENCE: {NOTE.partition(', ')[2]}"
"""What stands there of a geometric reference that is current."""


def aggregate(target: Store, aggregate_id: int, at: dt.datetime | None = None) -> str:
    """Return an aggregate's report as HTML, dated ``at``, with its zone, by default now.

    Raises UnknownName, and InputError for a date without a zone.
    """
    with experiments.damage_named(target):
        return _aggregate(experiments.aggregate_document(target, aggregate_id), at)


def _aggregate(known: AggregateDocument, at: dt.datetime | None) -> str:
    return page(
        "aggregate.html", title=f"Aggregate {known.inputs.name}", known=known, at=_dated(at),
        mark=STATES.get(_state(known), ""), state=_state(known), grading=_grading(known), curve=_curve(known),
    )  # fmt: skip


def mixture(target: Store, mixture_id: int, method: str | None = None, at: dt.datetime | None = None) -> str:
    """Return a mixture's report as HTML, by a ``method`` or by the one it was last predicted by, dated ``at``.

    Raises UnknownName, and InputError for what is no method and for a date without a zone.
    """
    with experiments.damage_named(target):
        return _mixture(experiments.mixture_document(target, mixture_id, method), at)


def _mixture(known: MixtureDocument, at: dt.datetime | None) -> str:
    state, composed = known.prediction.state, known.composed
    used = [fit.key for fit in known.calibrations]
    shown = [part for part in known.parts if part.explained.calibration_id in used or not used]
    mark = STATES.get(state, "")
    if known.prediction.method in REFERENCES:
        shown, mark = [], mark or REFERENCE
    return page(
        "mixture.html", title=f"Mixture {known.name}", known=known, at=_dated(at), mark=mark,
        parity=_parity(known), references=REFERENCES,
        grading=figures.grading_curves(composed.gradings, composed.combined) if composed.gradings else None,
        curves={part.inputs.key: _curve(part) for part in shown},
    )  # fmt: skip


def named(target: Store, what: str, method: str | None = None, at: dt.datetime | None = None) -> str:
    """Return the report of what a text names, as ``pdlab show`` reads it: a mixture or an aggregate.

    Raises UnknownName, and InputError where it names several things, for an aggregate by a method, for what is no
    method.
    """
    kind, key = experiments.reported(target, what)
    if kind == "mixture":
        return mixture(target, key, method, at)
    if method is not None:
        raise InputError(f"'{what}' is an aggregate, whose report holds its last calibration; leave the method out")
    return aggregate(target, key, at)


def refused(sentence: str) -> str:
    """Return an HTML file that says why there is no report."""
    return page("refused.html", sentence=sentence)


def file_name(name: str) -> str:
    """Return a file's name for the report of what has a name, of which a file system takes only so much."""
    short = re.sub(r"[^0-9A-Za-z_.+-]+", "-", name).strip("-.")[:LONGEST]
    return f"report-{short or 'unnamed'}.html"


def check_new(path: Path) -> None:
    """Raise InputError where a report would be written over a file, or into one that no browser opens as a page."""
    if path.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"{path} does not end in .html, as which a browser opens a report; name the file so")
    if path.exists():
        raise InputError(f"{path} is there and would be overwritten; name another file")


def write(text: str, path: Path) -> None:
    """Write a report into a new file. Raises InputError."""
    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise InputError(f"{path} cannot be written ({error.strerror}); choose another file") from error


def _dated(at: dt.datetime | None) -> str:
    if at is None:
        at = dt.datetime.now().astimezone()
    if at.tzinfo is None:
        raise InputError(f"the date {at} of a report has no zone; give it one")
    return moment(at)


def _state(known: AggregateDocument) -> str:
    if known.calibration is None:
        return "open"
    if known.calibration.state != "done":
        return known.calibration.state
    return "outdated" if known.outdated else "done"


def _grading(known: AggregateDocument) -> figures.Figure | None:
    found = known.inputs.grading
    return None if found is None else figures.grading_curves({known.inputs.name: found})


def _curve(known: AggregateDocument) -> figures.Figure | None:
    curve = known.explained.curve
    return None if curve is None else figures.calibration_curve(known.explained, curve)


def _parity(known: MixtureDocument) -> figures.Figure | None:
    one = known.prediction
    values = (one.measured, one.measured_error, one.packing_density, one.expected_error)
    own = None if None in values else tuple(value or 0.0 for value in values)
    if own is None and not known.others:
        return None
    return figures.parity(None if own is None else (own[0], own[1], own[2], own[3]), known.others)
