"""Running branches of tori in tests."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipelines.bifurcations.tori.continuation import continue_torus
from pipelines.bifurcations.tori.events import TorusEvent
from pipelines.bifurcations.tori.torus import TorusPoint, TorusResult, TorusState
from pipelines.orbits.system import Matrix, Vector


@dataclass
class TorusRun:
    """All that a traced branch recorded."""

    result: TorusResult
    points: list[TorusPoint] = field(default_factory=list)
    states: list[TorusState] = field(default_factory=list)
    events: list[TorusEvent] = field(default_factory=list)

    @property
    def parameters(self) -> Vector:
        return np.array([point.torus.unknowns.parameter for point in self.points])

    @property
    def rotations(self) -> Vector:
        return np.array([point.torus.unknowns.rotation for point in self.points])


def trace_torus(problem, start, options, **callbacks) -> TorusRun:  # type: ignore[no-untyped-def]
    run = TorusRun(TorusResult(None, None))  # type: ignore[arg-type]

    def record(point: TorusPoint, state: TorusState, events: tuple[TorusEvent, ...]) -> None:
        run.points.append(point)
        run.events.extend(events)
        run.states.append(state)

    run.result = continue_torus(problem, start, options, record, **callbacks)
    return run


def fitted_curve(orbit: Matrix, rotation: float, count: int, waves: int) -> Matrix:
    """Values (count, N) at equally spaced angles of the trigonometric polynomial nearest to an orbit of an
    invariant curve, whose point n lies at the angle n rotation.
    """

    def rows(at: Vector) -> Matrix:
        numbers = np.arange(1, waves + 1)
        turns = np.outer(at, numbers)
        return np.hstack([np.ones((len(at), 1)), np.cos(turns), np.sin(turns)])

    found = np.linalg.lstsq(rows(rotation * np.arange(len(orbit))), orbit, rcond=None)[0]
    return np.ascontiguousarray(rows(2.0 * np.pi * np.arange(count) / count) @ found)


def rotation_number(orbit: Matrix) -> float:
    """Mean turn per step [rad] of an orbit (n, 2) around its centre, averaged with the bump
    exp(-1/(t (1 - t))), with which the mean of a smooth quasi-periodic sequence converges fast.
    """
    deviation = orbit - orbit.mean(axis=0)
    turns = np.diff(np.unwrap(np.angle(deviation[:, 0] + 1j * deviation[:, 1])))
    time = np.arange(1, len(turns) + 1) / (len(turns) + 1.0)
    weights = np.exp(-1.0 / (time * (1.0 - time)))
    return float(weights @ turns / weights.sum())
