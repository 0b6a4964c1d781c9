"""Energy domains: names and SI units of the power variables and of the energy variables.

Effort times flow is a power in every domain but the pseudo ones (thermal: temperature and heat flow), which say so.
Source of names and variables: Karnopp, Margolis, Rosenberg, *System Dynamics*, 5th ed. (2012), table 2.1.
"""

from __future__ import annotations

from dataclasses import dataclass

from bondgraph.coherent import coherent
from bondgraph.errors import DeclarationError, suggest
from bondgraph.units import DIMENSIONLESS, dimension


@dataclass(frozen=True)
class Domain:
    """Names and SI units of one energy domain.

    ``effort_prefix`` and ``flow_prefix`` begin the names that derivation gives to efforts and flows (``tau_brake``,
    ``omega_rotor``). ``pseudo`` marks a pseudo-bond domain, whose effort times flow is not a power.

    Raises
    ------
    DeclarationError
        If effort times flow is not a power and the domain does not declare itself pseudo.

    Examples
    --------
    >>> ROTATION.effort_unit, ROTATION.flow_unit
    ('N m', 'rad/s')
    """

    name: str
    effort_unit: str
    flow_unit: str
    displacement_unit: str
    momentum_unit: str
    effort_prefix: str
    flow_prefix: str
    pseudo: bool = False

    def __post_init__(self) -> None:
        for unit in (self.effort_unit, self.flow_unit, self.displacement_unit, self.momentum_unit):
            if unit and coherent(unit)[1] != 1.0:
                raise DeclarationError(
                    f"domain {self.name}: unit {unit!r} is not coherent SI, in which laws are computed - write "
                    f"{coherent(unit)[0]!r}",
                    where=(self.name,),
                )
        power = tuple(a + b for a, b in zip(dimension(self.effort_unit), dimension(self.flow_unit), strict=True))
        if power != dimension("W") and not self.pseudo:
            raise DeclarationError(
                f"domain {self.name}: effort [{self.effort_unit}] times flow [{self.flow_unit}] is not a power [W] - "
                "correct the units or declare the domain with pseudo=True",
                where=(self.name,),
            )


ELECTRICAL = Domain("electrical", "V", "A", "C", "V s", "u", "i")
TRANSLATION = Domain("translation", "N", "m/s", "m", "N s", "F", "v")
ROTATION = Domain("rotation", "N m", "rad/s", "rad", "N m s", "tau", "omega")
HYDRAULIC = Domain("hydraulic", "Pa", "m^3/s", "m^3", "Pa s", "pressure", "Q")
THERMAL = Domain("thermal", "K", "W", "J", "K s", "T", "H", pseudo=True)
CHEMICAL = Domain("chemical", "J/mol", "mol/s", "mol", "J s/mol", "mu", "n")

#: Domains by the names that graph files use.
DOMAINS: dict[str, Domain] = {
    domain.name: domain for domain in (ELECTRICAL, TRANSLATION, ROTATION, HYDRAULIC, THERMAL, CHEMICAL)
}

#: Prefixes for bonds whose domain is not declared.
UNDECLARED_PREFIXES = ("e", "f")


def domain_named(name: str) -> Domain:
    """The domain with the name used in graph files.

    Raises
    ------
    DeclarationError
        If there is no such domain.
    """
    if name not in DOMAINS:
        raise DeclarationError(
            f"domain {name!r} is not known{suggest(name, DOMAINS)} - use one of {', '.join(DOMAINS)} or leave it out",
            where=(name,),
        )
    return DOMAINS[name]


def is_dimensionless(unit: str) -> bool:
    """Whether a unit string means a pure number (or an angle)."""
    return dimension(unit) == DIMENSIONLESS
