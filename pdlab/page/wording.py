"""Words of the page: texts that Markdown shows as they stand, and how they begin."""

import re

from pdlab.grading import KINDS
from pdlab.quantities import QUANTITIES, heading
from pdlab.tables import DENSITY_KINDS

LABELS = {
    "name": "Name",
    "delivery": "Delivery",
    "particle_density_kg_m3": "Particle density [kg/m³]",
    "density_basis": "Its basis",
    "water_absorption_percent": "Absorption [%]",
    "shape": "Shape",
    "source": "Source",
    "repose_angle_deg": "Repose angle [°]",
    "wall_angle_deg": "Slip angle [°]",
    "aperture_mm": "Sieve [mm]",
    "sample_mass_g": "Sample [g]",
    "pan_lower_mm": "Pan [mm]",
    "standard": "Standard",
    "date": "Date",
    "compaction": "Compaction",
    "repeats": "Repeats",
    "standard_deviation": "Deviation",
    "container_diameter_mm": "Container Ø [mm]",
    "container_height_mm": "Its height [mm]",
    "moisture_percent": "Moisture [%]",
    "solid_volume_share": "Share of the solid volume",
    "mass_share": "Share of the mass",
}
"""The columns of what is entered, as forms and tables name them; others are quantities."""
BASIS_LABELS = {"oven_dry": "oven-dry", "ssd": "saturated surface-dry", "apparent": "apparent"}
AFRESH = "Show what stands now"
"""The button that gives up a correction, where another has corrected the same record meanwhile."""
MISSING = "–"  # stands in a table where a value is missing

WORDS = {name: label[0].lower() + label[1:].partition(" [")[0] for name, label in LABELS.items()}
WORDS |= {name: QUANTITIES[name].short for name in (*DENSITY_KINDS, *KINDS)}
"""The same within a sentence, without units."""


def plain(text: str) -> str:
    """Return text that Markdown shows as it stands."""
    return re.sub(r"([!-/:-@\[-`{-~])", r"\\\1", text)


def pressed(text: str, button: str = "Predict") -> str:
    """Return a sentence with the page's buttons and labels in place of commands and a table's columns."""
    said = re.sub(rf"\b({'|'.join(WORDS)})\b", lambda found: WORDS[found[0]], text)
    said = re.sub(r"run 'pdlab (predict|refresh)'", f"press '{button}'", said)
    return re.sub(r"look at it with 'pdlab show .*' and", f"press '{AFRESH}' and", said)


def named(column: str) -> str:
    """Return what a column of what is entered is called."""
    return LABELS.get(column) or (begun(heading(column)) if column in QUANTITIES else column)


def digits(value: float) -> str:
    """Return a number with three significant digits, zeros at its end too: 1.20, 14.4, 126."""
    return f"{value:#.3g}".rstrip(".")


def begun(text: str) -> str:
    """Return a text with a capital at its beginning, all else as it is: units and symbols too."""
    return text[:1].upper() + text[1:]
