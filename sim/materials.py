"""The materials that a voxel can be of, and their properties in SI units."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

EMPTY, PASSIVE, EXPANDING, JAMMED, UNJAMMED = range(5)

# From softer than any gel that holds its own shape to stiffer than any jamming fiber, in Pa.
MODULUS_BOUNDS_PA = (1e3, 1e9)
# Lowest and highest value of every property. A foam weighs above 100 kg/m^3, tungsten 19 300.
BOUNDS = {
    "passive_pa": MODULUS_BOUNDS_PA,
    "expanding_pa": MODULUS_BOUNDS_PA,
    "jammed_pa": MODULUS_BOUNDS_PA,
    "jammed_bending_pa": MODULUS_BOUNDS_PA,
    "unjammed_pa": MODULUS_BOUNDS_PA,
    "density_kg_m3": (100.0, 20_000.0),
    "expansion_per_degree": (1e-6, 1.0),
}


@dataclass(frozen=True)
class Materials:
    """Moduli in Pa, density in kg/m^3, linear expansion of the expanding layer per degree of "temperature".

    `jammed_bending_pa` is a jammed fiber's modulus in bending, shear and twist where it is not that in tension.
    The defaults are those of the published runs (docs/reference/voxel-physics.md).
    """

    passive_pa: float = 82_700.0
    expanding_pa: float = 160_000.0
    jammed_pa: float = 1_330_688.0
    unjammed_pa: float = 68_900.0
    density_kg_m3: float = 938.33
    expansion_per_degree: float = 0.01
    jammed_bending_pa: float | None = None

    def axial_moduli_pa(self) -> NDArray[np.float64]:
        """Modulus of each material code in tension, float64 (5,); EMPTY has none (0)."""
        return np.array([0.0, self.passive_pa, self.expanding_pa, self.jammed_pa, self.unjammed_pa])

    def bending_moduli_pa(self) -> NDArray[np.float64]:
        """Modulus of each material code in bending, shear and twist, float64 (5,); EMPTY has none (0)."""
        jammed_pa = self.jammed_pa if self.jammed_bending_pa is None else self.jammed_bending_pa
        return np.array([0.0, self.passive_pa, self.expanding_pa, jammed_pa, self.unjammed_pa])


# Jamming multiplies a fiber's stiffness in tension by more than 20 but in bending by only about 2
# (docs/reference/published-experiment.md); a voxel of one modulus raises both together.
MEASURED_JAMMING = Materials(jammed_pa=20 * 68_900.0, jammed_bending_pa=2 * 68_900.0)
