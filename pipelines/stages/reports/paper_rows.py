"""Rows of the comparison with the paper, and the verdict on each."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

MET, NEARLY, NOT_MET, NOT_COMPARED = "met", "nearly met", "not met", "not compared"
VERDICTS = (MET, NEARLY, NOT_MET, NOT_COMPARED)
CLOSE, NEAR = 0.03, 0.06  # differences up to which a number is met, or nearly
IN_THE_PAPER = {
    "low threshold": "Sec. 4, Fig. 4, upper charts: 'parametric excitation is of low frequency, e.g. 0.2'",
    "anti-resonance": "Sec. 4: 'found to be 0.63, 0.70, 0.72, 0.74 respectively'",
    "threshold": "Sec. 4: 'a Neimark-Sacker bifurcation at the ending speed of c.a. 1.2'",
    "gain": "Sec. 4: 'increase of the threshold speed of instability up to 30%'",
    "period doubling": "Sec. 4, Fig. 4a: 'in much lower rotating speed, c.a. 0.4'",
    "period doublings": "Sec. 4, Fig. 3: 'for the lowest value no period doubling bifurcation occurs'; "
    "'as the stiffness coefficient increases, only Neimark-Sacker bifurcations appear'",
    "smallest displacement": "Sec. 4: 'selected so as not to affect the threshold speed of instability'",
    "only Neimark-Sacker": "Sec. 4, Fig. 4: 'however, at the case of Fig. 4a, the system experiences period "
    "doubling bifurcation'",
    "displacement": "Sec. 4: 'the strength of such phenomena is enhanced as the dimensionless parameter "
    "delta is increased'",
    "stiffness": "Sec. 4: 'this strength is enhanced as the dimensionless stiffness coefficient is "
    "increased'",
    "zones": "Sec. 4: 'in all examined cases there are zones of excitation frequencies at which the "
    "stability threshold of the rotor-bearing system is enhanced, and no other type of bifurcation occurs'",
    "resonances": "Sec. 4, Eq. 22: 'can be approximately predicted by' 2 Omega_j/n, |Omega_j +- Omega_k|/n",
    "speed": "Sec. 2.2: 'designed to operate above 20 kRPM'",
    "doubled cycles": "Sec. 4, Fig. 4a: 'stable limit cycles are generated'; Fig. 5: 'distributed in a wide "
    "range of rotating speeds'",
    "unbalance": "Sec. 4, Fig. 6: 'the phenomenon of parametric antiresonance is not affected by any level "
    "of unbalance'",
}
"""Where each printed number or statement stands."""


@dataclass(frozen=True)
class Row:
    """One number of the paper, or one of its statements, beside what the stores hold.

    ``printed``: None where the paper gives no number; ``ours``: None where no store has one; both
    dimensionless.  ``source``: a key of ``IN_THE_PAPER``; ``rounding``: half a unit of the last printed
    digit; ``judged``: the verdict where it does not follow from the two numbers; ``told``: what the stores
    say of a statement.
    """

    quantity: str
    source: str
    foil_stiffness: float | None
    displacement: float | None
    printed: float | None
    ours: float | None
    remark: str = ""
    rounding: float = 0.0
    judged: str = ""
    told: str = ""

    @property
    def difference(self) -> float | None:
        """Ours less printed."""
        return None if self.ours is None or self.printed is None else self.ours - self.printed

    @property
    def relative(self) -> float | None:
        """The difference over the printed number."""
        return None if self.difference is None or not self.printed else self.difference / self.printed

    @property
    def verdict(self) -> str:
        """One of `VERDICTS`; empty for a number that the paper does not print."""
        if self.judged or self.printed is None:
            return self.judged
        return NOT_MET if self.difference is None else verdict_of(self.difference, self.rounding)

    @property
    def is_statement(self) -> bool:
        """Whether the paper says it in words."""
        return bool(self.told)

    @property
    def sentence(self) -> str:
        """The comparison in words; empty for a number that the paper does not print."""
        if self.is_statement or self.printed is None:
            return self.told
        if self.ours is None or self.difference is None:
            return f"{self.printed:g} in print, no number here: {self.remark}."
        if abs(self.difference) <= max(1e-9, 1e-6 * abs(self.printed)):
            return f"{self.ours:.3f} here, as in print."
        side = "more" if self.difference > 0.0 else "less"
        within = ", which is within its rounding" if abs(self.difference) <= self.rounding else ""
        return (
            f"{self.ours:.3f} here, {abs(self.difference):.3f} {side} than {self.printed:g} in print{within}."
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain data, fit for JSON."""
        derived = ("difference", "relative", "verdict", "sentence")
        return {**asdict(self), **{name: getattr(self, name) for name in derived}}


def verdict_of(difference: float, rounding: float = 0.0) -> str:
    """Met within `CLOSE` or the rounding of the print, nearly met within `NEAR`."""
    missed = abs(difference) - 1e-9
    return MET if missed <= max(CLOSE, rounding) else NEARLY if missed <= NEAR else NOT_MET


def rounding_of(printed: str) -> float:
    """Half a unit of the last digit of a number as it is printed."""
    return 0.5 * 10.0 ** -len(printed.partition(".")[2])
