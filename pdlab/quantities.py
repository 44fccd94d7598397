"""One registry of what is printed or plotted: name, short heading, unit, meaning."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """A quantity under its field's name; ``unit`` is empty for a plain number."""

    name: str
    short: str
    unit: str
    meaning: str


QUANTITIES = {
    quantity.name: quantity
    for quantity in (
        Quantity("aperture", "aperture", "mm", "aperture d"),
        Quantity("retained_g", "retained mass", "g", "mass retained on a sieve"),
        Quantity("retained_percent", "retained", "%", "percent retained on a sieve"),
        Quantity("passing_percent", "percent passing", "%", "percent passing"),
        Quantity("diameter", "d", "mm", "equivalent diameter"),
        Quantity("d10", "D10", "mm", "size that 10 % pass"),
        Quantity("d50", "D50", "mm", "size that 50 % pass"),
        Quantity("d60", "D60", "mm", "size that 60 % pass"),
        Quantity("uniformity", "D60/D10", "", "coefficient of uniformity"),
        Quantity("fineness_astm", "FM, ASTM", "", "fineness modulus by ASTM C136"),
        Quantity("fineness_en", "FM, EN", "", "fineness modulus by EN 12620"),
        Quantity("bulk_density_kg_m3", "bulk density", "kg/m³", "oven-dry bulk density"),
        Quantity("voids_percent", "voids", "%", "voids between the grains"),
        Quantity("void_volume", "voids for paste", "L/m³", "voids in a cubic metre, which paste must fill at least"),
        Quantity("packing_density", "packing density", "", "packing density PD"),
        Quantity("repose_angle_deg", "angle of repose", "°", "angle of repose of a heap"),
        Quantity("measured_angle", "angle", "°", "measured angle of repose"),
        Quantity("wall", "wall μ", "", "friction coefficient of the walls"),
        Quantity("vibrated", "vibrated PD", "", "packing density of the calibrated spheres, vibrated"),
        Quantity("measured", "measured PD", "", "measured packing density PD"),
        Quantity("measured_error", "± measured", "", "standard error of the measured packing density"),
        Quantity("simulated", "simulated PD", "", "packing density of the calibrated spheres"),
        Quantity("predicted", "predicted PD", "", "predicted packing density PD"),
        Quantity("standard_error", "± simulation", "", "standard error of the simulation"),
        Quantity("input_error", "± inputs", "", "error from the measured packing densities"),
        Quantity("curve_error", "± curve", "", "standard error of the curve PD(μ)"),
        Quantity("expected_error", "± expected", "", "error of both, and of the method in this store"),
        Quantity("difference", "difference", "", "predicted minus measured packing density"),
        Quantity("volume_mean", "volume mean", "", "mean of the aggregates' packing densities by solid volume"),
        Quantity("furnas", "Furnas", "", "packing density after Furnas, an upper bound"),
        Quantity("toufar", "Toufar", "", "packing density after Toufar"),
        Quantity("cpm", "CPM", "", "packing density by the compressible packing model"),
        Quantity("best_constant", "mean of others", "", "mean of the other mixtures' measured packing densities"),
        Quantity("cpm_fitted", "CPM, own K", "", "compressible packing model, K fitted to the other mixtures"),
        Quantity("bias", "bias", "", "mean difference"),
        Quantity("mean_absolute_error", "mean absolute", "", "mean absolute difference"),
        Quantity("root_mean_square_error", "root mean square", "", "root mean square difference"),
        Quantity("largest_error", "largest", "", "difference that is largest either way"),
        Quantity("against_volume_mean", "beside volume mean", "", "mean absolute error less that of the volume mean"),
        Quantity("friction", "friction μ", "", "friction coefficient μ"),
        Quantity("rolling", "rolling friction μr", "", "coefficient of rolling friction μr"),
        Quantity("friction_low", "μ from", "", "lower end of the friction coefficient's interval"),
        Quantity("friction_high", "μ to", "", "upper end of the friction coefficient's interval"),
    )
}


def _with_unit(text: str, unit: str) -> str:
    return f"{text} [{unit}]" if unit else text


def label(name: str) -> str:
    """Return the axis title of a quantity: its meaning and unit."""
    return _with_unit(QUANTITIES[name].meaning, QUANTITIES[name].unit)


def heading(name: str) -> str:
    """Return the column heading of a quantity: its short name and unit."""
    return _with_unit(QUANTITIES[name].short, QUANTITIES[name].unit)
