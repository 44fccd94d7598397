"""Sieves → size distribution → one equivalent diameter; what gradings are called by and compared with."""

from pdlab.grading.combining import combined
from pdlab.grading.diameters import (
    DEFAULT_RULE,
    RULES,
    check_rule,
    equivalent_diameter,
    equivalent_diameters,
)
from pdlab.grading.indices import (
    FINENESS,
    fineness_modulus,
    indices,
    interpolated_sieves,
    retained_percents,
    size_at,
    uniformity,
)
from pdlab.grading.sets import SIEVE_SETS
from pdlab.grading.sieving import (
    KINDS,
    LARGEST,
    SMALLEST,
    Grading,
    SieveRow,
    SieveTable,
    assumes_pan,
    check,
    check_rows,
    make_grading,
    passing_at,
    sieve_classes,
)
from pdlab.grading.targets import ASTM_C33_FINE, FULLER, POWER_045, power_curve, targets

__all__ = [
    "ASTM_C33_FINE",
    "DEFAULT_RULE",
    "FINENESS",
    "FULLER",
    "KINDS",
    "LARGEST",
    "POWER_045",
    "RULES",
    "SIEVE_SETS",
    "SMALLEST",
    "Grading",
    "SieveRow",
    "SieveTable",
    "assumes_pan",
    "check",
    "check_rows",
    "check_rule",
    "combined",
    "equivalent_diameter",
    "equivalent_diameters",
    "fineness_modulus",
    "indices",
    "interpolated_sieves",
    "make_grading",
    "passing_at",
    "power_curve",
    "retained_percents",
    "sieve_classes",
    "size_at",
    "targets",
    "uniformity",
]
