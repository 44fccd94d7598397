"""Drafts: what somebody is entering and has not saved yet, kept as the texts that stand in the form."""

import datetime as dt
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pdlab import store
from pdlab.errors import UnknownName
from pdlab.experiments.readings import an_object, kept
from pdlab.models import Draft, now
from pdlab.store import Store

LISTED = 10
"""Drafts that are listed, the last saved first."""


@dataclass(frozen=True)
class Drafted:
    """A draft: its ``kind`` (aggregate or mixture), the form's texts by field, and when it was last saved (UTC)."""

    id: int
    kind: str
    content: Mapping[str, Any]
    saved_at: dt.datetime


def save_draft(
    target: Store, kind: str, content: Mapping[str, Any], draft_id: int | None = None,
    before: Mapping[str, Any] | None = None,
) -> int:  # fmt: skip
    """Write a form's texts, over those of the draft if it is still there, else as a new one; return its id.

    ``before``: what the draft held when the form was filled by it or last written. Where it holds something else by
    now, another form has written it: that stays, and these texts are a new draft.
    """
    text = json.dumps(content, ensure_ascii=False)
    with target.write() as session:
        row = None if draft_id is None else store.find_row(session, Draft, draft_id)
        if row is None or (before is not None and fields_of(row) not in (before, content)):
            row = Draft(kind=kind, content=text)
            store.add_all(session, [row])
        row.content, row.saved_at = text, now()
        return row.id


def load_draft(target: Store, draft_id: int) -> Drafted:
    """Return a draft. Raises UnknownName where it was saved as a record, or deleted."""
    with target.read() as session:
        row = store.find_row(session, Draft, draft_id)
        if row is None:
            raise UnknownName(f"draft {draft_id} is not there; it was saved or discarded: begin a new one")
        return _drafted(row)


def list_drafts(target: Store, kind: str, most: int = LISTED) -> list[Drafted]:
    """Return the drafts of a kind that were saved last, the newest first."""
    with target.read() as session:
        return [_drafted(row) for row in store.drafts(session, kind, most)]


def delete_draft(target: Store, draft_id: int, before: Mapping[str, Any] | None = None) -> None:
    """Delete a draft; one that is gone already is no error.

    ``before``: what it held when its form was last written; where another form has written it since, it stays.
    """
    with target.write() as session:
        row = store.find_row(session, Draft, draft_id)
        if before is None or (row is not None and fields_of(row) == before):
            store.delete_draft(session, draft_id)


def fields_of(row: Draft) -> dict[str, Any]:
    """Return the texts that stood in the form. Raises DamagedRow for what is no draft."""
    return kept(row, "content", an_object)


def _drafted(row: Draft) -> Drafted:
    return Drafted(row.id, row.kind, fields_of(row), row.saved_at)
