"""A stored bed: what it shows, and its files, ``.vtp`` for ParaView and CSV.

Lengths in files are reduced, in largest diameters, or in millimetres, once the largest diameter is given in
millimetres: names of columns and arrays that are lengths then end in ``_mm``. Spheres are numbered from 0 in
the order of their rows, species from 0 in the order of the specimen, coarse to fine. The floor is z = 0; a
periodic bed lies in x, y from 0 to its width, a cylinder or a heap stands about the axis x = y = 0.
"""

import base64
import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import pandas as pd

from pdlab.dem import heap, measures, profiles
from pdlab.dem.bed import MARGIN, SURROUNDINGS
from pdlab.errors import InputError
from pdlab.specimen import PLACED, Specimen

BINS, PAIR_BINS, PAIR_REACH = 10, 20, 3.0
"""Bins to a largest diameter, of the profiles and of g(r), and how many of these diameters g(r) reaches."""
TYPES = {"<f8": "Float64", "<i8": "Int64"}


@dataclass(frozen=True)
class Bed:
    """Where the spheres of a run lie, at rest or, where it failed, at last.

    ``place`` (N, 4): x, y, z, radius in largest diameters, as ``standing`` returns it; ``species`` (N,).
    ``digest``: the run's specimen hash; ``state``: done or failed, with the ``error`` of the latter.
    """

    specimen: Specimen
    place: np.ndarray
    species: np.ndarray
    digest: str
    state: str
    error: str | None = None

    @property
    def width(self) -> float | None:
        """Width of the periodic box, in largest diameters; None in a cylinder and of a heap."""
        return self.specimen.width if self.specimen.height is None else None

    @cached_property
    def flank(self) -> heap.Flank | None:
        """A heap's flank with its angle of repose, None of what is no heap."""
        if self.specimen.protocol.compaction != "repose":
            return None
        return heap.flank(self.place, 0.5 * self.specimen.protocol.base_diameter)

    @property
    def area(self) -> float:
        """Area of the floor, in squares of the largest diameter."""
        return self.specimen.width**2 * (math.pi / 4.0 if self.width is None else 1.0)

    @property
    def height(self) -> float:
        """The rim's height, twice that of a periodic bed's centre of mass, or a heap's, in largest diameters."""
        if self.flank is not None:
            return self.flank.top
        return self.specimen.height or self.slab[1] / 0.75

    @property
    def slab(self) -> tuple[float, float]:
        """The middle half of the height, in which contacts and pairs are counted, in largest diameters."""
        rim = self.specimen.height if self.flank is None else None
        return measures.slab(self.place) if rim is None else (0.25 * rim, 0.75 * rim)

    @property
    def packing_density(self) -> float:
        """PD of the middle half, or of a cylinder up to its rim; NaN of a heap."""
        if self.flank is not None:
            return math.nan
        low, high = (0.0, self.height) if self.width is None else self.slab
        return measures.solid_fraction(self.place, self.area, low, high)

    @cached_property
    def contacts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Spheres i < j of every contact and its overlap, in largest diameters, each of shape (C,)."""
        gap = profiles.GAP if self.specimen.protocol.compaction in PLACED else 0.0
        return profiles.touching(self.place, self.width, gap)

    @property
    def contacts_by_species(self) -> np.ndarray:
        """Mean contacts of the slab's spheres of species a with species b, shape (S, S)."""
        low, high = self.slab
        inside = (self.place[:, 2] >= low) & (self.place[:, 2] <= high)
        i, j, _ = self.contacts
        return profiles.contacts_by_species(i, j, self.species, inside, len(self.specimen.species))

    def surface(self, edges: np.ndarray) -> np.ndarray:
        """Return the mean height of a heap's surface in rings about its axis, shape (K,), in largest diameters.

        ``edges`` (K + 1,): distances from the axis, rising; a ring without a point of the surface's grid has NaN.
        """
        points, height = heap.surface(self.place, 0.5 * self.specimen.protocol.base_diameter)
        off = np.hypot(*points.T)
        sums, number = np.histogram(off, edges, weights=height)[0], np.histogram(off, edges)[0]
        return np.asarray(np.divide(sums, number, out=np.full(sums.shape, math.nan), where=number > 0))

    def along_height(self, edges: np.ndarray) -> np.ndarray:
        """Return PD between consecutive heights ``edges`` (K + 1,), in largest diameters, shape (K,)."""
        return profiles.height_profile(self.place, self.area, edges)


def standing(specimen: Specimen, place: np.ndarray) -> np.ndarray:
    """Return the engine's places (N, 4) with a periodic bed within its box, a cylinder or heap about x = y = 0."""
    if specimen.height is None:
        return profiles.into_box(place, specimen.width)
    heaped = specimen.protocol.compaction == "repose"
    box = specimen.protocol.base_diameter + SURROUNDINGS if heaped else specimen.width + MARGIN
    return np.asarray(place - 0.5 * box * np.array([1.0, 1.0, 0.0, 0.0]))


def unit(diameter: float | None) -> tuple[float, str]:
    """Return the factor from largest diameters to a file's lengths, and what their names end in.

    ``diameter``: the largest [mm], None for reduced lengths. Raises InputError.
    """
    if diameter is None:
        return 1.0, ""
    if not 0.0 < diameter < math.inf:
        raise InputError(f"a largest diameter of {diameter:g} mm is none; give a positive one, or leave it out")
    return diameter, "_mm"


def write(bed: Bed, path: Path, diameter: float | None = None) -> list[Path]:
    """Write a bed in the format of the file's suffix, .vtp or .csv, and return the files written.

    ``diameter``: the largest [mm], for lengths in millimetres. Raises InputError.
    """
    files = files_of(path)
    (write_vtp if path.suffix == ".vtp" else write_csv)(bed, path, diameter)
    return files


def files_of(path: Path) -> list[Path]:
    """Return the files that ``write`` makes. Raises InputError for a suffix that is no format."""
    if path.suffix not in (".vtp", ".csv"):
        raise InputError(f"{path} ends in neither .vtp, for ParaView, nor .csv; rename it")
    return [path] if path.suffix == ".vtp" else [path, path.with_name(f"{path.stem}-contacts.csv")]


def write_csv(bed: Bed, path: Path, diameter: float | None = None) -> None:
    """Write the spheres, ``x,y,z,radius,species``, and beside them the contacts, ``i,j,overlap``.

    The contacts' file has the stem of ``path`` and ``-contacts``. ``diameter``: the largest [mm].
    """
    scale, mm = unit(diameter)
    spheres, contacts = files_of(path)
    table = pd.DataFrame(scale * bed.place, columns=[f"{name}{mm}" for name in ("x", "y", "z", "radius")])
    table.assign(species=bed.species).to_csv(spheres, index=False)
    i, j, overlap = bed.contacts
    pd.DataFrame({"i": i, "j": j, f"overlap{mm}": scale * overlap}).to_csv(contacts, index=False)


def write_profiles(bed: Bed, path: Path, diameter: float | None = None) -> None:
    """Write the profiles of a bed, ``profile,from,to,value``, a row for each bin.

    ``packing_density_along_height`` from the floor to the topmost sphere; of a cylinder's slab
    ``packing_density_from_wall``, by the distance from it; of a periodic bed's slab ``pair_distribution``, by
    the distance of centres. Of a heap ``surface_height`` alone, over the distance from its axis. ``diameter``: the
    largest [mm], for bins and heights in millimetres. Raises InputError for a file that is not .csv.
    """
    scale, mm = unit(diameter)
    check_csv(path)
    rows = _profiles_of_bed(bed) if bed.flank is None else [_surface_profile(bed, scale, mm)]
    table = pd.concat(rows)
    table[["from", "to"]] *= scale
    table.rename(columns={"from": f"from{mm}", "to": f"to{mm}"}).to_csv(path, index=False)


def _surface_profile(bed: Bed, scale: float, mm: str) -> pd.DataFrame:
    edges = _bins(0.5 * bed.specimen.protocol.base_diameter)
    return _rows(f"surface_height{mm}", edges, scale * bed.surface(edges))


def _profiles_of_bed(bed: Bed) -> list[pd.DataFrame]:
    top = float((bed.place[:, 2] + bed.place[:, 3]).max())
    edges = _bins(top)
    rows = [_rows("packing_density_along_height", edges, bed.along_height(edges))]
    if bed.width is None:
        edges = _bins(0.5 * bed.specimen.width)
        values = profiles.wall_profile(bed.place, 0.5 * bed.specimen.width, *bed.slab, edges)
        rows.append(_rows("packing_density_from_wall", edges, values))
    else:
        reach = min(PAIR_REACH, 0.5 * bed.width)
        edges = (np.arange(math.floor(reach * PAIR_BINS + 0.5)) + 0.5) / PAIR_BINS  # contacts lie within a bin
        values = profiles.pair_distribution(bed.place, bed.width, *bed.slab, edges)
        rows.append(_rows("pair_distribution", edges, values))
    return rows


def check_csv(path: Path) -> None:
    """Raise InputError unless a file of profiles is .csv."""
    if path.suffix != ".csv":
        raise InputError(f"{path} does not end in .csv, the one format of profiles; rename it")


def _bins(end: float) -> np.ndarray:
    """Return the edges of equal bins from 0 on, the last of which stops at ``end``."""
    return np.append(np.arange(math.ceil(end * BINS - 1e-9)) / BINS, end)


def _rows(name: str, edges: np.ndarray, values: np.ndarray) -> pd.DataFrame:
    return pd.DataFrame({"profile": name, "from": edges[:-1], "to": edges[1:], "value": values})


def write_vtp(bed: Bed, path: Path, diameter: float | None = None) -> None:
    """Write a bed as VTK XML PolyData, little-endian, its arrays in base64.

    Points are the spheres' centres, with radius, diameter, species, and number of contacts with spheres.
    Lines are the contacts, with the overlap, and ``across``: 1 where the two touch across the periodic
    boundary, so that the line runs through the box. ``diameter``: the largest [mm].
    """
    scale, mm = unit(diameter)
    i, j, overlap = bed.contacts
    centre, radius = scale * bed.place[:, :3], scale * bed.place[:, 3]
    half = math.inf if bed.width is None else 0.5 * bed.width
    across = (np.abs(bed.place[i, :2] - bed.place[j, :2]) > half).any(axis=1)
    number = np.bincount(np.concatenate([i, j]), minlength=len(centre))
    root = Xml.Element(
        "VTKFile", type="PolyData", version="1.0", byte_order="LittleEndian", header_type="UInt64"
    )  # fmt: skip
    counts = {"Points": len(centre), "Verts": 0, "Lines": len(i), "Strips": 0, "Polys": 0}
    piece = Xml.SubElement(
        Xml.SubElement(root, "PolyData"), "Piece", {f"NumberOf{name}": str(count) for name, count in counts.items()}
    )
    spheres = {f"radius{mm}": radius, f"diameter{mm}": 2.0 * radius, "species": bed.species, "contacts": number}
    _add(piece, "PointData", spheres.items())
    _add(piece, "CellData", {f"overlap{mm}": scale * overlap, "across": across}.items())
    _add(piece, "Points", [("Points", centre)])
    ends = np.stack([i, j], axis=1)
    _add(piece, "Lines", {"connectivity": ends.ravel(), "offsets": 2 * np.arange(1, len(i) + 1)}.items())
    Xml.indent(root)
    Xml.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _add(piece: Xml.Element, section: str, arrays: Iterable[tuple[str, np.ndarray]]) -> None:
    """Add arrays under a heading: the number of bytes as a 64-bit integer, then the bytes, in one base64 text."""
    under = Xml.SubElement(piece, section)
    for name, values in arrays:
        form = "<f8" if values.dtype.kind == "f" else "<i8"
        row = {"NumberOfComponents": str(values.shape[1])} if values.ndim > 1 else {}
        array = Xml.SubElement(under, "DataArray", {"type": TYPES[form], "Name": name, "format": "binary", **row})
        content = values.astype(form).tobytes()
        array.text = base64.b64encode(np.array(len(content), "<u8").tobytes() + content).decode("ascii")
