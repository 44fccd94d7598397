"""What a method, a diameter rule and a test protocol do, in a sentence each."""

from pdlab.experiments.references import MEANINGS, NOTE

METHODS = {
    "monosized": "Each aggregate becomes spheres of one diameter; their friction coefficient μ is the one at which a "
    "simulated bed of them has the measured packing density; a mixture is a bed of such spheres in its proportions.",
    "monosized_rolling": "Each aggregate becomes spheres of one diameter with friction held at μ = 1; their "
    "coefficient of rolling friction μr is the one at which a simulated bed of them has the measured packing density.",
    "graded": "Each aggregate becomes spheres of all its sieve classes; their friction coefficient μ is the one at "
    "which a simulated bed of them has the measured packing density; a mixture is a bed of such spheres.",
    "repose": "Each aggregate becomes spheres of one diameter; their friction coefficient μ is the one at which a "
    "simulated heap of them has the measured angle of repose; beds of them are vibrated.",
    "auto": "For each aggregate the first of monosized, monosized_rolling and graded is taken whose spheres reach its "
    "measured packing density.",
    **{name: f"A {NOTE}: {text}." for name, text in MEANINGS.items()},
}
"""By the method's name."""
RULES = {
    "log_mean": "exp(Σ w ln d), d the geometric mean of a sieve class's apertures, w its share of the solid volume",
    "harmonic": "1 / Σ (w / d), d the geometric mean of a sieve class's apertures, w its share of the solid volume",
    "arithmetic": "Σ w d, d the geometric mean of a sieve class's apertures, w its share of the solid volume",
    "number_volume": "(Σ w / d³)^(−1/3), d the geometric mean of a sieve class's apertures, w its share of the solid "
    "volume",
    "d50": "the size that half of the solids pass, interpolated over the logarithm of the aperture",
    "rrsb_d63": "the size that 63.2 % pass on the fitted line of Rosin, Rammler, Sperling and Bennett",
}
"""Equivalent diameter by the rule's name."""
COMPACTIONS = {
    "loose": "a cloud of spheres falls onto a floor and settles",
    "rodded": "spheres are poured in layers, after each of which the container is lifted and dropped",
    "vibrated": "spheres are poured loose and then shaken by a vertical sine",
    "repose": "spheres settle in a cylinder, which is lifted from a round base with a lip",
    "static": "spheres are placed at random, none of which touches another",
    "drop_and_roll": "spheres fall and roll to rest one by one",
    "ordered": "a formula, no bed",
}
"""How a bed is made, by its compaction."""
ERRORS = {
    "standard_error": "of the simulation alone: seeds, specimen size, the curve that friction is read from",
    "input_error": "the errors of the measured packing densities, carried through to the mixture",
    "expected_error": "both of these and, from two other comparisons on, the root mean square difference of the "
    "method's other comparisons in this store",
    "measured_error": "the standard error of the measured packing density: that of single tests over the root of their "
    "number, 0.005 where none is stated",
}
"""What an error holds, by its quantity."""


def protocol_setting(name: str, value: object) -> str:
    """Return a setting of a protocol as it is read: ``local damping 0.7``."""
    if name == "wall_friction" and value is None:
        return "wall friction: the smallest present"
    if isinstance(value, bool):
        return f"{name.replace('_', ' ')} {'on' if value else 'off'}"
    text = f"{value:g}" if isinstance(value, float) else f"{value}"
    return f"{name.replace('_', ' ')} {text}"
