"""Geometric references: what the sizes and proportions of a mixture's spheres give alone, without calibration."""

import json
from collections.abc import Mapping, Sequence

from pdlab import geometry, grading, mixture
from pdlab.errors import InputError, PdlabError
from pdlab.experiments.readings import an_object, current_grading, kept
from pdlab.models import Aggregate, Mixture, Prediction
from pdlab.specimen import PLACED, Packing, Protocol, on_grid

ORDERED = "ordered"
REFERENCES = (*PLACED, ORDERED)
NOTE = "reference, no prediction of this material"
MEANINGS = {
    "static": "spheres put at random, of which none touches another, looser than any bed without rolling resistance",
    "drop_and_roll": "spheres fall and roll to rest one by one, without friction, inertia or compaction",
    ORDERED: "sizes of infinite ratio, each in order in the voids of the coarser ones, denser than any poured bed",
}


def notes_of(method: str, aggregates: Sequence[Aggregate], pan_factor: float = 1.0) -> list[str]:
    """Return what is said with a reference: what it is, and what was assumed of the aggregates' gradings."""
    sieved = {row.name: current_grading(row, pan_factor) for row in aggregates}
    assumed = [f"{name}: {text}" for name, one in sieved.items() if one is not None for text in one.warnings]
    return [f"{NOTE}: {MEANINGS[method]}", *assumed]


def parts_of(
    row: Mixture, aggregates: Mapping[int, Aggregate], method: str, rule: str, pan_factor: float = 1.0
) -> list[mixture.Part]:
    """Return a mixture's aggregates as equal spheres of the diameters that their current gradings give by a rule.

    ``aggregates``: by id, with their sieve analyses. Raises InputError where one has none, GradingError.
    """
    total = sum(part.solid_volume_share for part in row.components)  # 1 but for rounding
    out = []
    for part in row.components:
        aggregate = aggregates[part.aggregate_id]
        sieved = current_grading(aggregate, pan_factor)
        if sieved is None:
            raise InputError(f"aggregate '{aggregate.name}' of mixture '{row.name}' has no sieve analysis; enter one")
        sizes = ((grading.equivalent_diameter(sieved, rule), 1.0),)
        protocol = Protocol(method) if method in PLACED else Protocol()
        out.append(mixture.Part(aggregate.name, part.solid_volume_share / total, sizes, protocol=protocol))
    return out


def result_of(method: str, parts: Sequence[mixture.Part], done: Sequence[Packing]) -> mixture.Predicted:
    """Return a reference from the runs that are ``done``; the ordered one from the sizes alone, equal ones as one.

    Raises ShareError.
    """
    if method != ORDERED:
        return mixture.uncalibrated(done)
    largest = max(part.sizes[0][0] for part in parts)
    shares = dict[float, float]()
    for part in parts:
        size = on_grid(part.sizes[0][0] / largest)
        shares[size] = shares.get(size, 0.0) + part.share
    coarse_to_fine = [shares[size] for size in sorted(shares, reverse=True)]
    return mixture.Predicted(geometry.nested(coarse_to_fine), 0.0, 0.0, 0, ())


def made_by(method: str, rule: str, parts: Sequence[mixture.Part]) -> str:
    """Return how a reference was made, as it is kept with it; of the ordered one, which has no beds, the sizes too."""
    if method in PLACED:
        settings = Protocol(method).settings()
    else:
        settings = {"compaction": method, "diameters_mm": [on_grid(part.sizes[0][0]) for part in parts]}
    return json.dumps(settings | {"diameter_rule": rule}, sort_keys=True)


def rule_of(row: Prediction) -> str:
    """Return the diameter rule that is kept with a reference; empty where none is, which nothing is current by."""
    return str(kept(row, "protocol", an_object).get("diameter_rule", "")) if row.protocol else ""


def is_current(row: Prediction, aggregates: Mapping[int, Aggregate]) -> bool:
    """Return whether the present gradings and proportions ask for the bed that a reference rests on, or its sizes."""
    try:
        parts = parts_of(row.mixture, aggregates, row.method, rule_of(row))
        if row.method == ORDERED:
            same = result_of(row.method, parts, ()).packing_density == row.packing_density
            return same and made_by(row.method, rule_of(row), parts) == row.protocol
        bed = mixture.next_specimens(parts, [])[0]
    except PdlabError:  # what the rows say now cannot be placed at all
        return False
    return bed.digest(row.engine_version or 0) in {run.specimen_hash for run in row.runs}
