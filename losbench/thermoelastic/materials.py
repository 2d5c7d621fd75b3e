"""What the parts of a camera are made of, with where each number comes from."""

from __future__ import annotations

from dataclasses import dataclass

from losbench.checks import number, positive

__all__ = ["MATERIALS", "Material"]


@dataclass(frozen=True)
class Material:
    """An isotropic material near room temperature.

    Parameters
    ----------
    young_MPa, poisson : float
        Elastic modulus and Poisson's ratio.
    expansion_per_K : float
        Linear thermal expansion; may be negative.
    conductivity_W_per_mK, density_kg_per_m3, heat_J_per_kgK : float
    source : str
        Where the numbers come from.

    Raises
    ------
    ValueError
        If a value is not positive or Poisson's ratio not from -0.99 to 0.49.

    Examples
    --------
    >>> MATERIALS["Al 6061"].expansion_per_K
    2.36e-05
    """

    young_MPa: float
    poisson: float
    expansion_per_K: float
    conductivity_W_per_mK: float
    density_kg_per_m3: float
    heat_J_per_kgK: float
    source: str = ""

    def __post_init__(self) -> None:
        """Check the values."""
        for name in ("young_MPa", "conductivity_W_per_mK", "density_kg_per_m3", "heat_J_per_kgK"):
            positive(name, number(name, getattr(self, name)))
        number("poisson", self.poisson, low=-0.99, high=0.49)
        number("expansion_per_K", self.expansion_per_K, low=-1e-3, high=1e-3)

    @property
    def lame_MPa(self) -> tuple[float, float]:
        """Lame's constants lambda and mu."""
        shear = self.young_MPa / (2.0 * (1.0 + self.poisson))
        return 2.0 * shear * self.poisson / (1.0 - 2.0 * self.poisson), shear


MATERIALS = {
    "Al 6061": Material(68900, 0.33, 2.36e-5, 167, 2700, 896, "6061-T6, ASM data sheet"),
    "Invar 36": Material(141000, 0.26, 1.3e-6, 10.5, 8050, 515, "Carpenter Invar 36, annealed"),
    "CFRP": Material(
        60000, 0.3, 5e-7, 5.0, 1600, 900, "assumed: quasi-isotropic laminate, in its plane"
    ),
    "Ti-6Al-4V": Material(114000, 0.34, 8.6e-6, 6.7, 4430, 526, "annealed, ASM data sheet"),
    "Zerodur": Material(90300, 0.243, 5e-8, 1.46, 2530, 800, "Schott; expansion 0 +- 0.05e-6"),
    "SiC": Material(420000, 0.16, 2.2e-6, 180, 3210, 680, "sintered, Boostec data sheet"),
    "Si": Material(130000, 0.28, 2.6e-6, 148, 2330, 700, "Hopcroft et al. 2010, along <100>"),
    "flexure": Material(
        500, 0.3, 8.6e-6, 1.5, 2000, 526, "assumed: titanium blades, smeared over their pad"
    ),
}
