"""The table [sample]: machines drawn from ranges of keys, such as a drawing's tolerances; each is a case."""

from __future__ import annotations

import copy
import warnings
from collections.abc import Collection
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from pipelines.case.arrays import Array
from pipelines.case.fields import (
    Inconsistency,
    InconsistentError,
    Number,
    Table,
    choice,
    quantity,
    rising,
    table,
)
from pipelines.case.sweeps import MOST_CASES, Document, MisplacedError, Sweep, assign, flat, values_at

Tolerance = Annotated[Number, Field(gt=0)]
NAME = "sample"


class Sample(Table):
    """Machines drawn from ranges of keys, beside [sweep]; each is a case, `sample=0000` and so on."""

    count: int = quantity(
        "number of machines; for `sobol` best a power of two, which covers the ranges evenly",
        at_least=1,
        at_most=MOST_CASES,
        because="each is a case",
    )
    method: Literal["sobol", "latin_hypercube"] = choice(
        "`sobol`: scrambled Sobol sequence, a larger `count` keeps the machines of a smaller one; "
        "`latin_hypercube`: of `count` equal parts of every range each holds one machine",
        "sobol",
    )
    seed: int = quantity(
        "seed: the same draws the same machines",
        "",
        0,
        at_least=0,
        at_most=1_000_000,
        because="any number will do",
    )
    ranges: dict[str, tuple[Number, Number]] = table(
        "lowest and highest value by dotted key (as in `--set`), in the unit of the key", {}
    )
    tolerances: dict[str, Tolerance] = table(
        "half width of the range about the value in the file, by dotted key, in the unit of the key", {}
    )

    @field_validator("ranges", "tolerances", mode="before")
    @classmethod
    def _dotted(cls, value: Any) -> Any:
        """Quoted dotted keys and nested tables mean the same."""
        return dict(flat(value)) if isinstance(value, dict) else value

    @field_validator("ranges")
    @classmethod
    def _rising(cls, value: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
        for key, ends in value.items():
            try:
                rising(ends)
            except InconsistentError as error:
                raise InconsistentError(((key,), str(error))) from None
        return value

    @field_validator("tolerances")
    @classmethod
    def _some_key_once(cls, value: dict[str, float], info: ValidationInfo) -> dict[str, float]:
        ranges = info.data.get("ranges")
        if ranges is not None and not ranges and not value:
            raise InconsistentError("give at least one key in [sample.ranges] or [sample.tolerances]")
        if twice := [key for key in value if key in (ranges or {})]:
            raise InconsistentError(*(((key,), "stands in [sample.ranges] too") for key in twice))
        return value


class Sampled(Table):
    """A configuration's table [sample] alone: the paths of its errors are those of the file."""

    sample: Sample


def sample_sweep(
    sample: Sample, document: Document, fixed: Collection[str]
) -> tuple[Sweep | None, list[Inconsistency]]:
    """The machines as a sweep of their keys together, and what is wrong with the keys.

    ``fixed``: keys that the command line sets; every machine has that value. None if no other key is left.
    """
    ranges: dict[str, tuple[float, float]] = {}
    problems: list[Inconsistency] = []
    for name, given in (("ranges", sample.ranges), ("tolerances", sample.tolerances)):
        for key in (key for key in given if key not in fixed):
            try:
                ends = given[key]
                ranges[key] = ends if isinstance(ends, tuple) else _around(document, key, ends)
                assign(copy.deepcopy(document), key, 0.0)
            except MisplacedError as error:
                problems.append(((NAME, name, key), str(error)))
    if problems or not ranges:
        return None, problems
    keys = [*sample.ranges, *sample.tolerances]  # all are drawn: a fixed key changes no other
    columns = dict(zip(keys, _draw(sample, len(keys)).T.tolist(), strict=True))
    drawn = [[low + (high - low) * at for at in columns[key]] for key, (low, high) in ranges.items()]
    labels = tuple(f"{NAME}={number:04d}" for number in range(sample.count))
    return Sweep(tuple(ranges), tuple(zip(*drawn, strict=True)), (NAME,), labels), []


def _around(document: Document, key: str, tolerance: float) -> tuple[float, float]:
    """The range about the value of a key; raises MisplacedError where the file does not tell one number."""
    values = list(values_at(document, key))
    if not values:
        raise MisplacedError("has no value in the file: write it there, or give a range in [sample.ranges]")
    if any(isinstance(value, bool) or not isinstance(value, int | float) for value in values):
        raise MisplacedError("is not a number in the file")
    if len(set(values)) > 1:
        raise MisplacedError("has different values: name each by its index, as in bearings.0.clearance")
    return values[0] - tolerance, values[0] + tolerance


def _draw(sample: Sample, dimensions: int) -> Array:
    """Points (count, dimensions) in the unit cube."""
    from scipy.stats import qmc  # slow to import, and most configurations have no sample

    if sample.method == "latin_hypercube":
        return qmc.LatinHypercube(dimensions, rng=sample.seed).random(sample.count)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The balance properties")  # count says so
        return qmc.Sobol(dimensions, rng=sample.seed).random(sample.count)
