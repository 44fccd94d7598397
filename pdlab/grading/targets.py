"""Gradings to compare with: curves of densest packing by a power of the size, and the limits of a standard."""

from collections.abc import Sequence

import numpy as np

from pdlab.errors import GradingError

FULLER, POWER_045 = 0.5, 0.45
"""Exponents of Fuller & Thompson (1907), and of the maximum density line (Goode & Lufsey 1962), FHWA's 0.45-power."""
LEAST_EXPONENT, MOST_EXPONENT = 0.1, 1.0
"""Exponents outside which an entry is a typing error; Andreassen's packings are densest at 0.33 to 0.5."""
POINTS = 60
"""Sizes at which a target is drawn."""
ASTM_C33_FINE = (
    (9.5, 100.0, 100.0), (4.75, 95.0, 100.0), (2.36, 80.0, 100.0), (1.18, 50.0, 85.0), (0.6, 25.0, 60.0),
    (0.3, 5.0, 30.0), (0.15, 0.0, 10.0),
)  # fmt: skip
"""Fine aggregate for concrete, ASTM C33/C33M, table 1: aperture [mm], least and largest percent passing.

As civilengineer.co.in quotes the table ("Grading requirements of fine aggregates"): check it against your copy.
"""


def power_curve(apertures: Sequence[float], largest: float, exponent: float) -> np.ndarray:
    """Return the share [-] passing each aperture [mm] of the grading (d/D)^q, shape (K,), 1 above D.

    ``largest`` D [mm]; ``exponent`` q: ``FULLER``, ``POWER_045``, or one's own (Andreassen & Andersen 1930,
    Kolloid-Zeitschrift 50, 217). Raises GradingError.
    """
    if not LEAST_EXPONENT <= exponent <= MOST_EXPONENT:
        raise GradingError(
            f"exponent {exponent:g} lies outside {LEAST_EXPONENT:g} to {MOST_EXPONENT:g}; "
            "densest packings have 0.33 to 0.5"
        )
    if not largest > 0.0:
        raise GradingError(f"largest size {largest:g} mm must be above 0; enter that of the aggregate")
    share = (np.asarray(apertures, dtype=np.float64) / largest) ** exponent
    return np.minimum(share, 1.0)


def targets(finest: float, largest: float, exponent: float) -> dict[str, tuple[list[float], list[float]]]:
    """Return each target between two sizes [mm] by its name: sizes [mm] and shares passing [-], shape (60,) each.

    ``exponent``: Andreassen's. Raises GradingError.
    """
    if not 0.0 < finest < largest:
        raise GradingError(f"largest size {largest:g} mm must be above the finest one, {finest:g} mm; correct it")
    sizes = [float(size) for size in np.geomspace(finest, largest, POINTS)]
    exponents = {"Fuller": FULLER, "Andreassen": exponent, "0.45-power": POWER_045}
    return {name: (sizes, power_curve(sizes, largest, power).tolist()) for name, power in exponents.items()}
