"""What every setting of a test does to PD, and the container's size, beside each other.

``python tests/validation/protocols.py`` writes ``docs/protocols.md``. Its runs are kept in a store,
``protocols.db`` in the current folder by default, and are not repeated. Some half an hour on two cores.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from pdlab.batch.runner import Runner
from pdlab.errors import EngineError
from pdlab.packing import VERSION
from pdlab.specimen import (
    LOOSE,
    RODDED,
    VIBRATED,
    Component,
    Packing,
    Species,
    Specimen,
    equal_spheres,
    in_cylinder,
    mixed_spheres,
    with_seeds,
)
from pdlab.store import open_store

OUT = Path(__file__).parents[2] / "docs" / "protocols.md"
FRICTION = 0.3
DEFAULTS = {"loose": LOOSE, "rodded": RODDED, "vibrated": VIBRATED}
VARIED: dict[str, list[tuple[str, str, tuple[float, ...]]]] = {
    "Pouring and contact": [
        ("loose", "local_damping", (0.0, 0.3, 0.7)),
        ("loose", "restitution", (0.4, 0.5, 0.8)),
        ("loose", "cloud_fraction", (0.15, 0.25, 0.3)),
        ("loose", "nominal_overlap", (0.0005, 0.001, 0.002, 0.004)),
        ("loose", "steps_per_collision", (8.0, 10.0, 20.0, 40.0)),
        ("loose", "wall_friction", (0.1, 0.3, 1.0)),
        ("loose", "moment_damping", (False, True)),
    ],
    "Rodded": [
        ("rodded", "drops", (0, 5, 10, 25)),
        ("rodded", "drop_height", (0.25, 0.5)),
        ("rodded", "drop_pause", (2.5, 5.0)),
        ("rodded", "layers", (1, 3)),
    ],
    "Vibrated": [
        ("vibrated", "shake_periods", (0, 25, 50, 100, 200)),
        ("vibrated", "shake_acceleration", (1.5, 3.0)),
        ("vibrated", "shake_amplitude", (0.05, 0.1)),
    ],
}
COMPACTED = (0.05, 0.1, 0.3, 1.0)
CYLINDERS = (5.0, 7.5, 10.0, 15.0, 20.0)
RATIOS, SHARES = (2.0, 3.5, 5.0), (0.5, 0.7, 0.8)


def shown(outcomes: Sequence[Packing | EngineError]) -> str:
    """Return mean PD, its standard error and the contacts per sphere as three cells; why there is none, as one."""
    packings = [outcome for outcome in outcomes if isinstance(outcome, Packing)]
    if len(packings) < len(outcomes):
        error = next(outcome for outcome in outcomes if isinstance(outcome, EngineError))
        return f"none: {str(error).split(';')[0]} | | "
    density = np.array([packing.packing_density for packing in packings])
    error = float(density.std(ddof=1)) / math.sqrt(density.size) if density.size > 1 else math.nan
    contacts = np.mean([packing.coordination_number for packing in packings])
    return f"{density.mean():.4f} | {error:.4f} | {contacts:.2f}"


def settings(runner: Runner, seeds: Sequence[int]) -> list[str]:
    """Return the tables in which one setting at a time is varied."""
    lines = []
    for title, variations in VARIED.items():
        lines += ["", f"## {title}", "", "| compaction | setting | value | PD | standard error | contacts per sphere |"]
        lines += ["|---|---|---|---|---|---|"]
        for compaction, name, values in variations:
            for value in values:
                protocol = replace(DEFAULTS[compaction], **{name: value})  # type: ignore[arg-type]
                beds = runner([equal_spheres(FRICTION, seed, protocol) for seed in seeds])
                default = getattr(DEFAULTS[compaction], name)
                mark = " (default)" if value == (FRICTION if default is None else default) else ""
                lines.append(f"| {compaction} | {name} | {value:g}{mark} | {shown(beds)} |")
                print(lines[-1])
    return lines


def compacted(runner: Runner, seeds: Sequence[int]) -> list[str]:
    """Return PD against friction in the three protocols."""
    lines = ["", "## The three protocols over friction", ""]
    lines += ["| μ | compaction | PD | standard error | contacts per sphere |", "|---|---|---|---|---|"]
    for friction in COMPACTED:
        for name, protocol in DEFAULTS.items():
            beds = runner([equal_spheres(friction, seed, protocol) for seed in seeds])
            lines.append(f"| {friction:g} | {name} | {shown(beds)} |")
            print(lines[-1])
    return lines


def containers(runner: Runner, seeds: Sequence[int]) -> list[str]:
    """Return PD against the size of the container, periodic and cylindrical."""
    lines = [
        "",
        "## Size of the container",
        "",
        f"μ = {FRICTION:g}, loose. A cylinder is as high as wide.",
        "",
    ]
    lines += ["| container | width or diameter / d | wall μ | spheres | PD | standard error | contacts per sphere |"]
    lines += ["|---|---|---|---|---|---|---|"]
    for count, width in ((1250, 10.0), (2500, 10.0), (5000, 10.0), (10_000, 20.0)):
        one = Species(1.0, FRICTION, count)
        beds = runner([Specimen((one,), width, seed) for seed in seeds])
        lines.append(f"| periodic | {width:g} | {FRICTION:g} | {count} | {shown(beds)} |")
        print(lines[-1])
    for wall in (0.05, FRICTION, 1.0):
        for width in CYLINDERS if wall == FRICTION else (10.0,):
            protocol = replace(LOOSE, container="cylinder", wall_friction=wall)
            specimen = in_cylinder([Component(1.0, FRICTION, 1.0)], width, width, 1, protocol)
            beds = runner(with_seeds(specimen, seeds))
            lines.append(f"| cylinder | {width:g} | {wall:g} | {specimen.spheres} | {shown(beds)} |")
            print(lines[-1])
    return lines


def binaries(runner: Runner, seeds: Sequence[int]) -> list[str]:
    """Return PD of binary mixtures over size ratio and share, beside Furnas's limit."""
    beds = runner([equal_spheres(FRICTION, seed) for seed in seeds])
    alone = float(np.mean([bed.packing_density for bed in beds if isinstance(bed, Packing)]))
    lines = [
        "",
        "## Two sizes",
        "",
        f"μ = {FRICTION:g} for both, loose; alone both pack to {alone:.4f}.",
    ]
    lines += ["The limit is that of an infinite size ratio (Furnas): min(φ/(1 − y_f), 1/(y_c + y_f/φ)).", ""]
    lines += [
        "| size ratio | coarse share | spheres | PD | standard error | contacts per sphere | largest overlap | limit |"
    ]
    lines += ["|---|---|---|---|---|---|---|---|"]
    for ratio in RATIOS:
        for share in SHARES:
            specimen = mixed_spheres([Component(ratio, FRICTION, share), Component(1.0, FRICTION, 1.0 - share)], 1)
            beds = runner(with_seeds(specimen, seeds[:2]))
            limit = min(alone / share, 1.0 / (share + (1.0 - share) / alone))
            overlap = max((bed.largest_overlap for bed in beds if isinstance(bed, Packing)), default=math.nan)
            cells = f"{ratio:g} | {share:g} | {specimen.spheres} | {shown(beds)} | {overlap:.2%} | {limit:.3f}"
            lines.append(f"| {cells} |")
            print(lines[-1])
    return lines


def main(
    store: str = "protocols.db",
    seeds: Annotated[int, typer.Option(min=2, help="Beds of a row; two of a mixture.")] = 4,
    out: Path = OUT,
) -> None:
    """Run every setting and write the tables."""
    runner = Runner(open_store(store))
    numbers = range(1, seeds + 1)
    lines = [
        "# What a test's settings do to PD",
        "",
        f"Made by `python tests/validation/protocols.py`. Engine version {VERSION}, {seeds} seeds a row (two of a",
        f"mixture); 2500 equal spheres of μ = {FRICTION:g} in a periodic box 10 d wide where nothing else is said.",
    ]
    for part in (compacted, settings, containers, binaries):
        lines += part(runner, numbers)
    out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"written to {out}")


if __name__ == "__main__":
    typer.run(main)
