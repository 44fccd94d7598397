"""Sets of sieves that a laboratory has, coarse to fine, by their designations.

EN 933-2 with the sets of EN 12620, table 1, in nominal apertures, as others print them: set 1 in Betontechnische Daten
(Heidelberg Materials), section 2.2.3, set 2 in Northstone, European aggregate sizes (to BS EN 13043); the ends, 0.063
and 125 mm, in the scope of EN 933-2:2020. ASTM E11, the sieves of ASTM C136 for concrete aggregates, is from memory of
the standard: check it against your copy.
"""

_BASIC = ("125", "63", "31.5", "16", "8", "4", "2", "1", "0.5", "0.25", "0.125", "0.063")
_SET_1 = ("45", "22.4", "11.2", "5.6")
_SET_2 = ("40", "20", "14", "12.5", "10", "6.3")
_ASTM = (
    "3 in", "2 in", "1 1/2 in", "1 in", "3/4 in", "1/2 in", "3/8 in", "No. 4", "No. 8", "No. 16", "No. 30", "No. 50",
    "No. 100", "No. 200",
)  # fmt: skip


def _falling(*names: str) -> tuple[str, ...]:
    return tuple(sorted(names, key=float, reverse=True))


SIEVE_SETS = {
    "EN 933-2 basic": _BASIC,
    "EN 933-2 basic + set 1": _falling(*_BASIC, *_SET_1),
    "EN 933-2 basic + set 2": _falling(*_BASIC, *_SET_2),
    "ASTM E11, concrete": _ASTM,
}
"""Designations of each set's sieves; those without a name are apertures in mm."""
