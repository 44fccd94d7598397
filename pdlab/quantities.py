"""One registry of what is stored, printed or plotted: name, symbol, unit, meaning."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Quantity:
    """A quantity under its field's name; ``unit`` is empty for a plain number."""

    name: str
    symbol: str
    unit: str
    meaning: str

    @property
    def label(self) -> str:
        """The axis or column title: meaning, symbol and unit."""
        symbol = f" {self.symbol}" if self.symbol else ""
        return f"{self.meaning}{symbol} [{self.unit}]" if self.unit else f"{self.meaning}{symbol}"


QUANTITIES = {
    quantity.name: quantity
    for quantity in (
        Quantity("aperture", "d", "mm", "aperture"),
        Quantity("passing", "", "%", "percent passing"),
        Quantity("retained", "", "%", "percent retained"),
        Quantity("diameter", "d", "mm", "equivalent diameter"),
        Quantity("packing_density", "PD", "", "packing density"),
        Quantity("predicted", "PD", "", "predicted packing density"),
        Quantity("measured", "PD", "", "measured packing density"),
        Quantity("voids", "", "%", "voids"),
        Quantity("friction", "μ", "", "friction coefficient"),
        Quantity("coordination_number", "Z", "", "contacts per sphere"),
        Quantity("bulk_density", "", "kg/m³", "bulk density"),
        Quantity("particle_density", "ρ", "kg/m³", "particle density"),
        Quantity("standard_error", "", "", "standard error of the simulation"),
        Quantity("input_error", "", "", "error from the measured inputs"),
        Quantity("expected_error", "", "", "expected error"),
        Quantity("difference", "", "", "predicted minus measured"),
        Quantity("solid_volume_share", "y", "", "share of the solid volume"),
    )
}


def label(name: str) -> str:
    """Return the title of the quantity ``name``."""
    return QUANTITIES[name].label
