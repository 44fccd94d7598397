"""Words of the page: texts that Markdown shows as they stand, and how they begin."""

import re

from pdlab.grading import KINDS
from pdlab.quantities import QUANTITIES
from pdlab.tables import DENSITY_KINDS

MISSING = "–"  # stands in a table where a value is missing

LABELS = {name: QUANTITIES[name].short for name in (*DENSITY_KINDS, *KINDS)} | {
    "particle_density_kg_m3": "particle density", "density_basis": "its basis", "repose_angle_deg": "repose angle",
    "wall_angle_deg": "slip angle", "water_absorption_percent": "absorption", "moisture_percent": "moisture",
    "standard_deviation": "deviation", "container_diameter_mm": "container Ø", "container_height_mm": "its height",
    "solid_volume_share": "shares by solid volume",
}  # fmt: skip
"""What forms call the columns of tables."""


def plain(text: str) -> str:
    """Return text that Markdown shows as it stands."""
    return re.sub(r"([!-/:-@\[-`{-~])", r"\\\1", text)


def pressed(text: str, button: str = "Predict") -> str:
    """Return a sentence with the page's button and labels in place of a command and a table's columns."""
    labelled = re.sub(rf"\b({'|'.join(LABELS)})\b", lambda found: LABELS[found[0]], text)
    return re.sub(r"run 'pdlab (predict|refresh)'", f"press '{button}'", labelled)


def digits(value: float) -> str:
    """Return a number with three significant digits, zeros at its end too: 1.20, 14.4, 126."""
    return f"{value:#.3g}".rstrip(".")


def begun(text: str) -> str:
    """Return a text with a capital at its beginning, all else as it is: units and symbols too."""
    return text[:1].upper() + text[1:]
