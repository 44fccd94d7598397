"""A descent, as nested plain data, drawn as a tree in the terminal."""

import json
from collections.abc import Iterable
from typing import Any

from rich.text import Text
from rich.tree import Tree

from pdlab.experiments.references import ORDERED
from pdlab.specimen import PLACED

Facts = dict[str, Any]
LEFT_OUT = ("address", "id", "name", "delivery", "position", "raw_text", "created_at", "message", "warnings")
"""Columns that a line of what was entered does without: they stand elsewhere in the tree, or in the data alone."""


def draw(facts: Facts) -> Tree:
    """Return a row and what it rests on as a tree; equal specimens of several seeds become one branch."""
    tree = Tree(Text(_line(facts)))
    _grow(tree, facts)
    return tree


def _grow(tree: Tree, facts: Facts) -> None:
    for one in facts.get("corrections", ()):
        tree.add(Text(_correction(one), style="yellow"))
    for text in (facts.get("warnings") or "").splitlines():
        tree.add(Text(f"note: {text}"))
    if facts.get("message"):
        tree.add(Text(facts["message"]))
    if facts["address"].startswith("packing_test:") and facts["raw_text"]:
        tree.add(Text(f"as entered: {' '.join(facts['raw_text'].split())}"))
    for name in ("last_prediction", "last_calibration", "mixture", "material", "aggregate", "packing_test",
                 "sieve_analysis"):  # fmt: skip
        if isinstance(facts.get(name), dict):
            _grow(tree.add(Text(_line(facts[name]))), facts[name])
    for name in ("components", "results", "packing_tests", "sieve_analyses", "calibrations", "aggregates"):
        for child in facts.get(name, ()):
            _grow(tree.add(Text(_line(child))), child)
    _grow_runs(tree, facts.get("runs", ()))
    for table, names in facts.get("rests_on_it", {}).items():
        tree.add(Text(f"on it rest: {', '.join(f'{table}:{name}' for name in names)}"))


def _line(facts: Facts) -> str:
    """Return a row as one line: its address and what it says."""
    kind = facts["address"].partition(":")[0]
    words = LINES[kind](facts) if kind in LINES else _entered(facts)
    return f"{facts['address']}: {words}" if words else str(facts["address"])


def _entered(facts: Facts) -> str:
    """Return the columns that were filled."""
    return ", ".join(
        f"{name} {f'{value:g}' if isinstance(value, float) else value}"
        for name, value in facts.items()
        if name not in LEFT_OUT and value not in (None, "") and not isinstance(value, dict | list)
    )


def _of_sieve(facts: Facts) -> str:
    aperture = "pan" if facts["aperture_mm"] is None else f"{facts['aperture_mm']:g} mm"
    kinds = ("retained_g", "retained_percent", "passing_percent")
    value = next(f"{kind} {facts[kind]:g}" for kind in kinds if facts[kind] is not None)
    return f"{aperture}, {value} (as entered: {' '.join(facts['raw_text'].split())})"


def _of_prediction(facts: Facts) -> str:
    rule = (facts["protocol"] or {}).get("diameter_rule")  # kept by what rests on no calibration
    method = _method(facts) + (f", diameter rule {rule}" if rule else "")
    return f"{_error_bars(facts, 'standard_error')}, {method}, {_made(facts)}"


def _of_sweep(facts: Facts) -> str:
    made = f"engine version {facts['engine_version'] or 'unknown'}, {facts['state']} {_when(facts)} UTC"
    return f"densest mix {_error_bars(facts, 'standard_error')}, {_method(facts)}, {made}"


def _of_sweep_component(facts: Facts) -> str:
    shares = (facts["densest_share"], facts["next_share"])
    densest, following = ("unknown" if share is None else f"{share:g}" for share in shares)
    return f"{facts['aggregate']['address']}, share of the densest mix {densest}, of the one to test next {following}"


def _of_calibration(facts: Facts) -> str:
    if facts["friction"] is None:
        return f"{_method(facts)}, {_made(facts)}"
    return (
        f"{_coefficient(facts)} at {_error_bars(facts, 'curve_error')}, "
        f"{_measured(facts)}, diameter {facts['diameter_mm']:.4g} mm ({facts['diameter_rule']}), {_method(facts)}, "
        f"{_made(facts)}"
    )


def _coefficient(facts: Facts) -> str:
    """Return friction, or rolling friction where that was calibrated, with its interval."""
    name = "friction" if facts["rolling_friction"] is None else "rolling_friction"
    low, high = (
        "open" if facts[f"{name}_{end}"] is None else f"{facts[f'{name}_{end}']:.4g}" for end in ("low", "high")
    )
    held = "" if name == "friction" else f"friction {facts['friction']:.4g}, "
    return f"{held}{name.replace('_', ' ')} {facts[name]:.4g} ({low} to {high})"


def _measured(facts: Facts) -> str:
    density, angle, wall = (facts[name] for name in ("measured_packing_density", "measured_angle_deg", "wall_friction"))
    said = ([] if density is None else [f"{density:.4f}"]) + ([] if angle is None else [f"angle of repose {angle:g}°"])
    return f"measured {' and '.join(said) or 'nothing'}" + ("" if wall is None else f", wall friction {wall:.4g}")


def _method(facts: Facts) -> str:
    return f"method {facts['method']}" + (f" with {facts['variant']}" if facts["variant"] else "")


def _error_bars(facts: Facts, simulation: str) -> str:
    if facts["packing_density"] is None:
        return "no PD"
    errors = f"± {facts[simulation]:.4f} (simulation) ± {facts['input_error']:.4f} (inputs)"
    return f"PD {facts['packing_density']:.4f} {errors}"


def _made(facts: Facts) -> str:
    ordered = facts["method"] == ORDERED
    by = "by a formula" if ordered else f"engine version {facts['engine_version'] or 'unknown'}"
    compaction = facts["protocol"]["compaction"] if facts["protocol"] else "not simulated"
    return f"{compaction}, {by}, {facts['state']} {_when(facts)} UTC"


def _when(facts: Facts) -> str:
    return str(facts["finished_at"] or facts["requested_at"])[:16].replace("T", " ")


def _of_run(facts: Facts) -> str:
    return f"{_result(facts)}; {_specimen(facts['specimen'])}; {_engine(facts)}"


LINES = {
    "sieve_result": _of_sieve, "prediction": _of_prediction, "calibration": _of_calibration, "run": _of_run,
    "sweep": _of_sweep, "sweep_component": _of_sweep_component,
}  # fmt: skip


def _correction(one: Facts) -> str:
    reason = f" ({one['reason']})" if one["reason"] else ""
    return (
        f"corrected by {one['corrected_by']} on {one['corrected_at'][:16].replace('T', ' ')}: {one['column_name']} "
        f"{one['old_value'] or 'empty'} → {one['new_value'] or 'empty'}{reason}"
    )


def _grow_runs(tree: Tree, runs: Iterable[Facts]) -> None:
    """Add runs: a branch for each engine, in it one for each specimen, in it the seeds."""
    engines: dict[str, Tree] = {}
    specimens: dict[tuple[str, str], Tree] = {}
    for run in sorted(runs, key=lambda run: (_engine(run), _alike(run), run["seed"])):
        engine = _engine(run)
        if engine not in engines:
            engines[engine] = tree.add(Text(f"runs of {engine}"))
        key = (engine, _alike(run))
        if key not in specimens:
            specimens[key] = engines[engine].add(Text(_specimen(run["specimen"])))
        specimens[key].add(Text(f"run:{run['specimen_hash'][:12]}: {_result(run)}"))


def _alike(run: Facts) -> str:
    """Return what runs of one specimen have in common: all of it but the seed."""
    return json.dumps({**run["specimen"], "seed": None}, sort_keys=True)


def _engine(run: Facts) -> str:
    return (
        f"engine version {run['engine_version']}, numba {run['numba_version'] or 'unknown'}, "
        f"processor {run['processor'] or 'unknown'}"
    )


def _result(run: Facts) -> str:
    result = run["error"] or run["state"]
    if run["packing_density"] is not None:
        result = f"PD {run['packing_density']:.5f}"
    elif run["repose_angle_deg"] is not None:
        result = f"angle of repose {run['repose_angle_deg']:.2f}°"
    contacts = f", {run['coordination_number']:.3f} contacts" if run["coordination_number"] is not None else ""
    steps = f", {run['steps']} steps" if run["steps"] is not None else ""
    return f"seed {run['seed']}, {result}{contacts}{steps}"


def _specimen(specimen: Facts) -> str:
    protocol = specimen.get("protocol", {})
    placed = protocol.get("compaction") in PLACED  # where friction has no meaning
    kinds = [
        f"{kind['count']} spheres of d {kind['diameter']:g}" + ("" if placed else f" with μ {kind['friction']:g}")
        for kind in specimen.get("species", ())
    ]
    inside = f"{protocol.get('container', '')}, {specimen.get('width', 0):g} wide"
    return f"{' + '.join(kinds)}; {protocol.get('compaction', '')}, {inside}"
