"""A stored certificate in numbers and words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipelines.datasets.records import Group
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
    def of(cls, certificate: Group) -> Summary:
        """The summary of a group of kind ``certificate``."""
        attributes = certificate.attributes
        names, sizes = attributes["parameters"], attributes["resolution"]
        cells, pairs, points = (_tally(attributes, what) for what in ("cells", "pairs", "points"))
        return cls(
            bool(attributes["certified"]),
            (str(names[0]), str(names[1])),
            (float(sizes[0]), float(sizes[1])),
            cells,
            pairs,
            points,
            float(attributes["share_at_most"]),
            tuple(_disagreements(certificate)),
        )

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


def _tally(attributes: Mapping[str, Any], what: str) -> Tally:
    agreeing, disagreeing, not_decided = (
        int(attributes[f"{what}_{verdict}"]) for verdict in ("agreeing", "disagreeing", "not_decided")
    )
    return Tally(agreeing, disagreeing, not_decided)


def _disagreements(certificate: Group) -> Iterator[Disagreement]:
    """The cells that disagree, line by line, and then the random points."""
    grid = np.meshgrid(certificate["along"], certificate["across"])
    points = certificate["point_along"], certificate["point_across"]
    for prefix, (along, across) in (("", grid), ("point_", points)):
        found, expected, nearest = (
            certificate[f"{prefix}{name}"] for name in ("found", "expected", "nearest")
        )
        for place in zip(*np.nonzero(certificate.labels(f"{prefix}verdict") == "disagrees"), strict=True):
            yield Disagreement(
                float(along[place]),
                float(across[place]),
                int(found[place]),
                None if expected[place] == UNKNOWN else int(expected[place]),
                bifurcation_of(complex(nearest[place])),
                bool(prefix),
            )
