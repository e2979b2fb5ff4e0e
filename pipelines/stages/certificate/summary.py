"""A certificate in numbers and words, also a stored one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from pipelines.datasets.records import Group
from pipelines.stages.certificate.agreement import (
    AGREES,
    DISAGREES,
    NOT_DECIDED,
    GridVerdicts,
    Places,
    Verdicts,
)
from pipelines.stages.certificate.comparison import Comparison
from pipelines.stages.certificate.crossings import UNKNOWN
from pipelines.stages.survey.cells import bifurcation_of

SHOWN = 3  # disagreeing places named in a sentence


@dataclass(frozen=True)
class Disagreement:
    """A place at which the curves do not explain the stability.

    ``along`` and ``across``: its parameters; ``found`` unstable multipliers, of which the curves let expect
    another number (None where they let expect none); ``kind``: bifurcation of the multiplier with the modulus
    nearest to 1, of which a curve is likely to be missing; ``random``: a random point, no cell of the survey.
    """

    along: float
    across: float
    found: int
    expected: int | None
    kind: str
    random: bool


@dataclass(frozen=True)
class Tally:
    """How many places or pairs agree, disagree, and are not decided."""

    agreeing: int
    disagreeing: int
    not_decided: int

    @property
    def percent(self) -> float | None:
        """Agreeing ones of those that are decided [%]; None where none is."""
        decided = self.agreeing + self.disagreeing
        return 100.0 * self.agreeing / decided if decided else None

    def as_dict(self) -> dict[str, Any]:
        return asdict(self) | {"percent": self.percent}


@dataclass(frozen=True)
class Summary:
    """A certificate in numbers.

    ``resolution``: size of a cell in both parameters; ``share_at_most`` of the plane disagrees, with a
    confidence of 95 %.
    """

    certified: bool
    parameters: tuple[str, str]
    resolution: tuple[float, float]
    cells: Tally
    pairs: Tally
    points: Tally
    share_at_most: float
    disagreements: tuple[Disagreement, ...]

    @classmethod
    def of(cls, comparison: Comparison) -> Summary:
        """The summary of a comparison."""
        cells, points = comparison.at_cells, comparison.at_points
        return cls(
            comparison.certified,
            comparison.names,
            comparison.resolution,
            _tally(cells.cells.number),
            _tally(cells.pairs),
            _tally(points.number),
            comparison.share_at_most,
            tuple(_disagreements(comparison)),
        )

    @classmethod
    def stored(cls, certificate: Group) -> Summary:
        """The summary of a group of kind ``certificate``."""
        return cls.of(stored_comparison(certificate))

    def as_dict(self) -> dict[str, Any]:
        """The summary as plain data; places have their parameters by name."""
        tallies = {name: getattr(self, name).as_dict() for name in ("cells", "pairs", "points")}
        places = [
            dict(zip(self.parameters, (each.along, each.across), strict=True))
            | {"found": each.found, "expected": each.expected, "kind": each.kind, "random": each.random}
            for each in self.disagreements
        ]
        return asdict(self) | tallies | {"disagreements": places}

    def sentence(self) -> str:
        """The summary in a line."""
        steps = " x ".join(f"{size:.3g}" for size in self.resolution)
        if self.certified:
            return (
                f"certified on cells of {steps}: the curves explain the stability of all "
                f"{self.cells.agreeing} cells and {self.points.agreeing} random points that are decided "
                f"({self.cells.not_decided + self.points.not_decided} are not)"
            )
        if not self.pairs.agreeing and not self.disagreements:
            return "not certified: no two cells side by side have a cycle whose stability is decided"
        places = [f"({each.along:.4g}, {each.across:.4g})" for each in self.disagreements[:SHOWN]]
        more = ", ..." if len(self.disagreements) > SHOWN else ""
        return (
            f"not certified on cells of {steps}: the curves do not explain the stability of "
            f"{self.cells.disagreeing} cells and {self.points.disagreeing} random points, at "
            f"({', '.join(name.replace('_', ' ') for name in self.parameters)}) = {', '.join(places)}{more}"
        )


def stored_comparison(certificate: Group) -> Comparison:
    """The comparison that a group of kind ``certificate`` holds."""
    along, across = certificate.attributes["parameters"]
    cells = _verdicts(certificate, "")
    pairs = (certificate[name].astype(np.int64) for name in ("pair_along", "pair_across"))
    return Comparison(
        (str(along), str(across)),
        stored_places(certificate, ""),
        stored_places(certificate, "point_"),
        GridVerdicts(cells, *pairs),
        _verdicts(certificate, "point_"),
    )


def stored_places(certificate: Group, prefix: str) -> Places:
    """The cells of a certificate, or its random points with the prefix ``point_``."""
    names = ("along", "across", "found", "nearest")
    along, across, found, nearest = (certificate[f"{prefix}{name}"] for name in names)
    return Places(along, across, found.astype(np.int64), nearest)


def _verdicts(certificate: Group, prefix: str) -> Verdicts:
    expected, verdict = (certificate[f"{prefix}{name}"].astype(np.int64) for name in ("expected", "verdict"))
    return Verdicts(expected, verdict)


def _tally(number: Callable[[int], int]) -> Tally:
    return Tally(number(AGREES), number(DISAGREES), number(NOT_DECIDED))


def _disagreements(comparison: Comparison) -> Iterator[Disagreement]:
    """The cells that disagree, line by line, and then the random points."""
    grid, points = comparison.grid, comparison.points
    along, across = np.meshgrid(grid.along, grid.across)
    cells = replace(grid, along=along, across=across)
    for places, verdicts in ((cells, comparison.at_cells.cells), (points, comparison.at_points)):
        for place in zip(*np.nonzero(verdicts.verdict == DISAGREES), strict=True):
            expected = int(verdicts.expected[place])
            yield Disagreement(
                float(places.along[place]),
                float(places.across[place]),
                int(places.found[place]),
                None if expected == UNKNOWN else expected,
                bifurcation_of(complex(places.nearest[place])),
                places is points,
            )
