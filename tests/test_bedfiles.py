"""A stored bed's numbers and files: the same spheres in every format, lengths in the unit asked for."""

import base64
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from pdlab import bedfiles, packing
from pdlab.bedfiles import Bed, standing
from pdlab.errors import InputError, ProtocolError
from pdlab.specimen import Component, Protocol, Species, Specimen, equal_spheres, from_canonical, in_cylinder

MIXED = Specimen((Species(1.0, 0.3, 40), Species(0.5, 0.3, 320)), 4.0, 2)
CYLINDER = in_cylinder([Component(1.0, 0.3, 1.0)], 5.0, 5.0, 1, Protocol("loose", "cylinder"))
RODDED = replace(MIXED, protocol=Protocol("rodded", drops=3, wall_friction=0.2))


def settled(specimen: Specimen) -> tuple[Bed, packing.State]:
    state = packing.advance(specimen, None, 10**9)
    return Bed(specimen, standing(specimen, state.place), state.species.astype(np.uint8), "0" * 64, "done"), state


@pytest.fixture(scope="module")
def mixed() -> Bed:
    return settled(MIXED)[0]


@pytest.fixture(scope="module")
def cylinder() -> Bed:
    return settled(CYLINDER)[0]


@pytest.fixture
def trio() -> Bed:
    """Three spheres on the floor of a periodic box 4 wide: 0 touches 1, and 2 across the boundary."""
    place = np.array([[-0.25, 1.0, 0.5, 0.5], [-0.93, 1.0, 0.25, 0.25], [0.74, 1.0, 0.5, 0.5]])
    specimen = Specimen((Species(1.0, 0.3, 2), Species(0.5, 0.3, 1)), 4.0, 1)
    return Bed(specimen, standing(specimen, place), np.array([0, 1, 0]), "0" * 64, "done")


def arrays(path: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    """Read a .vtp file by the format's description: the piece's attributes, and every array by its name."""
    root = ElementTree.parse(path).getroot()
    assert root.attrib == {
        "type": "PolyData", "version": "1.0", "byte_order": "LittleEndian", "header_type": "UInt64",
    }  # fmt: skip
    piece = root.find("PolyData/Piece")
    assert piece is not None
    out = {}
    for array in piece.iter("DataArray"):
        assert array.get("format") == "binary"
        content = base64.b64decode(array.text or "")
        size = int.from_bytes(content[:8], "little")
        assert size == len(content) - 8
        kind = {"Float64": "<f8", "Int64": "<i8"}[array.attrib["type"]]
        out[array.attrib["Name"]] = np.frombuffer(content[8:], kind).reshape(
            -1, int(array.get("NumberOfComponents", 1))
        )
    return dict(piece.attrib), out


@pytest.mark.parametrize("specimen", [MIXED, CYLINDER], ids=["periodic", "cylinder"])
def test_a_bed_shows_what_its_run_reports(specimen: Specimen) -> None:
    bed, state = settled(specimen)
    report = packing.measure(specimen, state, 1.0)
    assert bed.packing_density == pytest.approx(report.packing_density, rel=1e-12)
    assert bed.height == pytest.approx(report.height, rel=1e-12)
    matrix, (low, high) = bed.contacts_by_species, bed.slab
    count = np.bincount(bed.species[(bed.place[:, 2] >= low) & (bed.place[:, 2] <= high)])
    assert (matrix.sum(axis=1) * count).sum() / count.sum() == pytest.approx(report.coordination_number)


def test_a_periodic_bed_stands_in_its_box_and_a_cylinder_about_its_axis(mixed: Bed, cylinder: Bed) -> None:
    assert ((mixed.place[:, :2] >= 0.0) & (mixed.place[:, :2] < 4.0)).all()
    off = np.hypot(cylinder.place[:, 0], cylinder.place[:, 1]) + cylinder.place[:, 3]
    assert 2.5 < off.max() < 2.52
    assert np.abs(cylinder.place[:, :2].mean(axis=0)).max() < 0.3


def test_a_vtp_file_holds_spheres_as_points_and_contacts_as_lines(trio: Bed, tmp_path: Path) -> None:
    assert bedfiles.write(trio, tmp_path / "bed.vtp") == [tmp_path / "bed.vtp"]
    piece, found = arrays(tmp_path / "bed.vtp")
    assert (piece["NumberOfPoints"], piece["NumberOfLines"]) == ("3", "2")
    assert np.array_equal(found["Points"], trio.place[:, :3])
    assert found["Points"][0, 0] == 3.75
    assert found["radius"].ravel().tolist() == [0.5, 0.25, 0.5]
    assert found["diameter"].ravel().tolist() == [1.0, 0.5, 1.0]
    assert found["species"].ravel().tolist() == [0, 1, 0]
    assert found["contacts"].ravel().tolist() == [2, 1, 1]
    assert found["connectivity"].ravel().tolist() == [0, 1, 0, 2]
    assert found["offsets"].ravel().tolist() == [2, 4]
    assert found["across"].ravel().tolist() == [0, 1]
    assert found["overlap"].ravel() == pytest.approx([0.75 - np.hypot(0.68, 0.25), 0.01])


def test_csv_files_hold_the_same_to_the_last_bit(mixed: Bed, tmp_path: Path) -> None:
    spheres, contacts = bedfiles.write(mixed, tmp_path / "bed.csv")
    bedfiles.write(mixed, tmp_path / "bed.vtp")
    assert (spheres.name, contacts.name) == ("bed.csv", "bed-contacts.csv")
    assert spheres.read_text(encoding="utf-8").startswith("x,y,z,radius,species\n")
    assert contacts.read_text(encoding="utf-8").startswith("i,j,overlap\n")
    table, pairs = (np.loadtxt(file, delimiter=",", skiprows=1) for file in (spheres, contacts))
    ends, overlap = pairs[:, :2].astype(int), pairs[:, 2]
    assert np.array_equal(table, np.column_stack([mixed.place, mixed.species]))
    _, found = arrays(tmp_path / "bed.vtp")
    assert np.array_equal(found["Points"], table[:, :3])
    assert np.array_equal(found["connectivity"].ravel(), ends.ravel())
    assert np.array_equal(found["overlap"].ravel(), overlap)
    assert found["contacts"].sum() == 2 * len(pairs) > 1000
    length = np.sqrt(((table[ends[:, 0], :3] - table[ends[:, 1], :3]) ** 2).sum(axis=1))
    inside = found["across"].ravel() == 0
    assert np.allclose(length[inside], (table[ends, 3].sum(axis=1) - overlap)[inside])
    assert (length[~inside] > 2.0).all()


def test_a_diameter_turns_every_length_into_millimetres_and_says_so(trio: Bed, tmp_path: Path) -> None:
    bedfiles.write(trio, tmp_path / "bed.vtp", 16.0)
    bedfiles.write(trio, tmp_path / "bed.csv", 16.0)
    _, found = arrays(tmp_path / "bed.vtp")
    assert np.array_equal(found["Points"], 16.0 * trio.place[:, :3])
    assert found["radius_mm"].ravel().tolist() == [8.0, 4.0, 8.0]
    assert found["diameter_mm"].ravel().tolist() == [16.0, 8.0, 16.0]
    assert found["across"].ravel().tolist() == [0, 1]
    table, pairs = pd.read_csv(tmp_path / "bed.csv"), pd.read_csv(tmp_path / "bed-contacts.csv")
    assert list(table) == ["x_mm", "y_mm", "z_mm", "radius_mm", "species"]
    assert table["x_mm"].tolist() == pytest.approx([60.0, 49.12, 11.84])
    assert table["radius_mm"].tolist() == [8.0, 4.0, 8.0]
    assert pairs["overlap_mm"].to_numpy() == pytest.approx(found["overlap_mm"].ravel())
    assert pairs["overlap_mm"].to_numpy()[1] == pytest.approx(0.16)


def test_a_bed_without_contacts_is_a_file_too(trio: Bed, tmp_path: Path) -> None:
    apart = replace(trio, place=trio.place * np.array([1.0, 1.0, 1.0, 0.1]))
    bedfiles.write(apart, tmp_path / "bed.vtp")
    bedfiles.write(apart, tmp_path / "bed.csv")
    piece, found = arrays(tmp_path / "bed.vtp")
    assert piece["NumberOfLines"] == "0"
    assert found["contacts"].ravel().tolist() == [0, 0, 0]
    assert (tmp_path / "bed-contacts.csv").read_text(encoding="utf-8") == "i,j,overlap\n"


def test_the_profiles_of_a_periodic_bed_are_its_height_and_its_pairs(mixed: Bed, tmp_path: Path) -> None:
    bedfiles.write_profiles(mixed, tmp_path / "profiles.csv")
    table = pd.read_csv(tmp_path / "profiles.csv")
    assert list(table) == ["profile", "from", "to", "value"]
    assert list(table["profile"].unique()) == ["packing_density_along_height", "pair_distribution"]
    height = table[table["profile"] == "packing_density_along_height"]
    solids = (height["value"] * (height["to"] - height["from"])).sum() * 16.0
    assert solids == pytest.approx(np.pi / 6.0 * (40 + 320 / 8), rel=0.002)  # but for what presses into the floor
    assert height["to"].iloc[-1] == pytest.approx((mixed.place[:, 2] + mixed.place[:, 3]).max())
    pairs = table[table["profile"] == "pair_distribution"]
    assert pairs["to"].max() == 1.975  # half the width
    assert not pairs[pairs["to"] < 0.49]["value"].any()
    assert pairs.loc[pairs["value"].idxmax(), "from"] in (0.475, 0.725)


def test_the_profiles_of_a_cylinder_are_its_height_and_its_wall(cylinder: Bed, tmp_path: Path) -> None:
    bedfiles.write_profiles(cylinder, tmp_path / "profiles.csv", 20.0)
    table = pd.read_csv(tmp_path / "profiles.csv")
    assert list(table) == ["profile", "from_mm", "to_mm", "value"]
    wall = table[table["profile"] == "packing_density_from_wall"]
    assert wall["to_mm"].max() == 50.0  # the axis of a cylinder 5 diameters of 20 mm wide
    ring = (50.0 - wall["from_mm"]) ** 2 - (50.0 - wall["to_mm"]) ** 2
    mean = (wall["value"] * ring).sum() / ring.sum()
    assert mean == pytest.approx(cylinder.along_height(np.array(cylinder.slab))[0], rel=0.002)
    assert wall["value"].iloc[0] < 0.2  # spheres touch a wall in points


def test_what_is_no_format_or_no_diameter_is_refused(trio: Bed, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"bed.stl ends in neither .vtp, for ParaView, nor .csv; rename it"):
        bedfiles.write(trio, tmp_path / "bed.stl")
    with pytest.raises(InputError, match=r"profiles.vtp does not end in .csv"):
        bedfiles.write_profiles(trio, tmp_path / "profiles.vtp")
    for diameter in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="give a positive one"):
            bedfiles.write(trio, tmp_path / "bed.vtp", diameter)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("specimen", [MIXED, CYLINDER, RODDED, equal_spheres(0.3, 7)])
def test_a_canonical_form_is_read_back_as_its_specimen(specimen: Specimen) -> None:
    read = from_canonical(specimen.canonical(2))
    assert read.canonical(2) == specimen.canonical(2)
    assert (read.species, read.width, read.height, read.seed) == (
        specimen.species, specimen.width, specimen.height, specimen.seed,
    )  # fmt: skip
    assert read.protocol.wall_friction == specimen.wall_friction


def test_the_first_engines_form_is_read_and_a_text_that_is_no_specimen_refused() -> None:
    old = (
        '{"engine_version":1,"protocol":{"cloud_fraction":0.25,"compaction":"loose","container":"periodic",'
        '"local_damping":0.7,"nominal_overlap":0.002,"restitution":0.5,"steps_per_collision":10.0,'
        '"wall_friction":0.3},"seed":7,"species":[{"count":2500,"density":1.0,"diameter":1.0,"friction":0.3}],'
        '"width":10.0}'
    )
    assert from_canonical(old).canonical(1) == equal_spheres(0.3, 7).canonical(1)
    for text in ("", "{}", "[]", old.replace('"loose"', '"stamped"'), old.replace('"seed"', '"sed"')):
        with pytest.raises(ProtocolError):
            from_canonical(text)


def test_spheres_that_fell_and_rolled_show_the_contacts_that_their_run_reports(tmp_path: Path) -> None:
    specimen = Specimen((Species(1.0, 0.0, 200),), 5.0, 1, Protocol("drop_and_roll"))
    bed, state = settled(specimen)
    report = packing.measure(specimen, state, 1.0)
    low, high = bed.slab
    counted = (bed.place[:, 2] >= low) & (bed.place[:, 2] <= high)
    assert bed.contacts_by_species[0, 0] == pytest.approx(report.coordination_number)
    assert counted.sum() > 50
    assert 5.0 < report.coordination_number < 6.5
    bedfiles.write(bed, tmp_path / "bed.vtp")
    assert len(arrays(tmp_path / "bed.vtp")[1]["overlap"]) == len(bed.contacts[0]) > 400
