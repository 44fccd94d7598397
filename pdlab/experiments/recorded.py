"""What was entered of an aggregate or a mixture, as its corrector sees it: record by record, in texts."""

import datetime as dt
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy.orm import Session

from pdlab import store, tables
from pdlab.errors import InputError, ShareError
from pdlab.experiments.addresses import address, row_key
from pdlab.experiments.corrections import COLUMNS, Corrected, Edited, correct
from pdlab.experiments.evidence import ShownCorrection, corrections_of
from pdlab.experiments.mixing import aggregates_of, full_name, stored_mixture
from pdlab.experiments.readings import is_stale, mean_density, particle_density
from pdlab.models import Aggregate, Base, Mixture, PackingTest, SieveAnalysis
from pdlab.specimen import SHARE_TOLERANCE
from pdlab.store import Store
from pdlab.tables import DENSITY_KINDS, Typed

MATERIALS = ("aggregate", "mixture")
SHARE = "share"
"""The text of a component's share, in percent: by mass where it was entered so, else by solid volume."""


@dataclass(frozen=True)
class RecordedPart:
    """A row of a record: ``key`` as ``correct`` takes it, the text that was entered, and texts of what stands now.

    Of a sieve ``aperture_mm`` (or pan) and the value of its analysis's kind; of a component ``share`` and as
    ``entered`` its aggregate. ``column``: in which the value or share stands.
    """

    key: str
    entered: str
    column: str
    texts: Mapping[str, str]

    def columns(self, texts: Mapping[str, str]) -> Mapping[str, str]:
        """Return texts by the columns that they stand for. Raises InputError for a share that is no number."""
        if SHARE not in texts:
            return texts
        try:
            return {self.column: f"{tables.above_zero('%')(texts[SHARE]) / 100.0:.10g}"}
        except InputError as error:
            raise type(error)(f"{self.entered}: {error}") from error


@dataclass(frozen=True)
class Recorded:
    """A record as it stands: its ``version``, and texts of its own columns and of its parts, empty for none.

    ``kind``: its table; ``key``: kind and id; ``address``: as ``correct`` takes it. Of a density test the texts are
    those of a form, ``TEST_TEXTS``. ``entered``: the raw text. ``current``: whether it is the newest test of its kind.
    """

    kind: str
    key: str
    address: str
    version: int
    current: bool
    entered: str
    created_at: dt.datetime
    texts: Mapping[str, str]
    parts: tuple[RecordedPart, ...] = ()

    def changes(self, texts: Mapping[str, str], parts: Sequence[Mapping[str, str]] = ()) -> list[Corrected]:
        """Return what differs in ``texts`` and in those of its ``parts``.

        Raises InputError for a share that is no number, and for shares that do not sum to 100 %.
        """
        out = _differences(self.address, self._columns(self.texts), self._columns(texts))
        shares = list[float]()
        for part, typed in zip(self.parts, parts, strict=True):
            columns = part.columns(typed)
            out += _differences(part.key, part.columns(part.texts), columns)
            shares += [float(columns[part.column])] if SHARE in typed else []
        if shares and abs(math.fsum(shares) - 1.0) > SHARE_TOLERANCE:
            raise ShareError(
                f"the shares sum to {100.0 * math.fsum(shares):.6g} %, more than {100.0 * SHARE_TOLERANCE:g} off 100; "
                "correct them"
            )
        return out

    def _columns(self, texts: Mapping[str, str]) -> Mapping[str, str]:
        """Return texts by the columns that they stand for."""
        if self.kind != PackingTest.__tablename__:
            return texts
        others = {name: text for name, text in texts.items() if name not in ("kind", "value")}
        return others | {kind: texts["value"] if kind == texts["kind"] else "" for kind in DENSITY_KINDS}


@dataclass(frozen=True)
class RecordedMaterial:
    """What was entered of an aggregate or a mixture, the newest record of a kind first, and what was corrected in it.

    ``name`` with delivery; ``particle``: oven-dry density of its grains [kg/m³], None where it is unknown.
    """

    name: str
    records: tuple[Recorded, ...]
    corrections: tuple[ShownCorrection, ...]
    particle: float | None


@dataclass(frozen=True)
class Outdated:
    """What is outdated of an aggregate, or of a mixture: its calibration, and mixtures' predictions by id and name.

    ``more``: whether there are more mixtures than are named.
    """

    calibration: bool
    mixtures: Mapping[int, str]
    more: bool


def recorded(target: Store, material: str, key: int) -> RecordedMaterial:
    """Return what was entered of the aggregate or mixture (``material``) with this id. Raises UnknownName."""
    with target.read() as session:
        row = _material(session, material, key)
        parts = row.components if isinstance(row, Mixture) else ()
        sieved = row.sieve_analyses[::-1] if isinstance(row, Aggregate) else []
        tested = row.packing_tests[::-1]
        rows: list[tuple[Base, dt.datetime]] = [(one, one.created_at) for one in (row, *sieved, *tested)]
        rows += [(part, row.created_at) for part in parts]
        rows += [(line, one.created_at) for one in sieved for line in one.results]
        corrections = corrections_of(session, rows)
        records = [_sieves(one, one is sieved[0]) for one in sieved] + [_test(one, one is tested[0]) for one in tested]
        return RecordedMaterial(
            full_name(row) if isinstance(row, Aggregate) else row.name,
            (*records, _itself(row)), corrections[::-1], _particle(row),
        )  # fmt: skip


def correct_recorded(
    target: Store, seen: Recorded, changes: Sequence[Corrected], by: str, reason: str
) -> list[Corrected]:
    """Correct a record as ``correct`` does; ``seen``: as its corrector saw it, with its version."""
    by_row = dict[str, dict[str, str]]()
    for one in changes:
        by_row.setdefault(one.address, {})[one.column] = one.new or ""
    return correct(target, by_row, by, reason.strip() or None, seen.version)


def outdated_of(target: Store, material: str, key: int, most: int) -> Outdated:
    """Return what is outdated of an aggregate or a mixture, ``most`` mixtures of it at most. Raises UnknownName."""
    with target.read() as session:
        row = _material(session, material, key)
        its = ("mixture_id", "holds", [row.name]) if isinstance(row, Aggregate) else ("mixture_id", "=", row.id)
        found = store.list_rows(
            session, "predictions", ["mixture_id", "mixture"], [its, ("state", "=", "outdated")], limit=most + 1,
            engine_version=store.newest_engine(session) or 0,
        )  # fmt: skip
        fits = store.calibrations(session, [row.id]) if isinstance(row, Aggregate) else []
        last = next((fit for fit in fits if not fit.variant), None)
        return Outdated(last is not None and is_stale(last), dict(found[:most]), len(found) > most)


def _material(session: Session, material: str, key: int) -> Aggregate | Mixture:
    if material not in MATERIALS:
        raise InputError(f"'{material}' is no material; name one of {', '.join(MATERIALS)}")
    return stored_mixture(session, key) if material == "mixture" else aggregates_of(session, [key])[0]


def _particle(row: Aggregate | Mixture) -> float | None:
    try:
        return particle_density(row) if isinstance(row, Aggregate) else mean_density(row)
    except InputError:  # an import would refuse it; a correction mends it
        return None


def _record(
    row: Edited, current: bool, entered: str | None, texts: Mapping[str, str], *parts: RecordedPart
) -> Recorded:
    kind = row.__tablename__
    return Recorded(
        kind, f"{kind}:{row_key(row)}", address(row), row.version, current, entered or "", row.created_at, texts, parts
    )


def _itself(row: Aggregate | Mixture) -> Recorded:
    parts = [
        RecordedPart(
            f"mixture_component:{row_key(part)}", full_name(part.aggregate),
            "solid_volume_share" if part.mass_share is None else "mass_share",
            {SHARE: f"{100.0 * (part.solid_volume_share if part.mass_share is None else part.mass_share):.10g}"},
        )
        for part in (row.components if isinstance(row, Mixture) else ())
    ]  # fmt: skip
    return _record(row, False, None, _texts(row), *parts)


def _sieves(row: SieveAnalysis, current: bool) -> Recorded:
    parts = [
        RecordedPart(
            f"sieve_result:{row_key(one)}", " ".join(one.raw_text.split()), row.kind,
            {"aperture_mm": _text(one.aperture_mm) or "pan", row.kind: _text(getattr(one, row.kind))},
        )
        for one in row.results
    ]  # fmt: skip
    return _record(row, current, row.raw_text, _texts(row), *parts)


def _test(row: PackingTest, current: bool) -> Recorded:
    texts = _texts(row)
    kind = next(one for one in DENSITY_KINDS if texts[one])
    others = {name: text for name, text in texts.items() if name not in DENSITY_KINDS}
    return _record(row, current, row.raw_text, others | {"kind": kind, "value": texts[kind]})


def _texts(row: Edited) -> dict[str, str]:
    return {name: _text(getattr(row, name)) for name in COLUMNS[type(row)][1]}


def _text(value: Any) -> str:
    """Return a value as it would be typed; a number's point is no guess (``tables.Typed``)."""
    if isinstance(value, float):
        return Typed(f"{value:.15g}")
    return "" if value is None else str(value)


def _differences(row: str, before: Mapping[str, str], after: Mapping[str, str]) -> list[Corrected]:
    return [
        Corrected(row, name, before[name] or None, text.strip() or None)
        for name, text in after.items()
        if text.strip() != before[name]
    ]
