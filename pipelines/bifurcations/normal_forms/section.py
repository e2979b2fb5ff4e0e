"""The return map to a section across a cycle of unknown period, used instead of the map over its period.

The map over a fixed time has the multiplier 1 along the cycle, so that the normal forms of cycles of unknown
period are those of the return map P to the section <n, s - s_0> = 0: with the return time tau(s)

    P(s) = phi(s, tau(s)),      <n, P(s) - s_0> = 0,      DP = Pi M,      Pi x = x - phi_T <n, x>/<n, phi_T>

where M and phi_T are taken at tau(s).  On the cycle Pi projects along the flow: it carries right critical
vectors of M to those of DP, and left ones stay what they are, because p'phi_T = 0.  The section of a forced
system is a phase of its forcing, where P is the stroboscopic map; that of any other is normal to the flow.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import null_space

from pipelines.bifurcations.critical.critical_cycles import Critical
from pipelines.bifurcations.critical.cycle_manifold import ManifoldLinearisation
from pipelines.bifurcations.plane import MapAt, Position
from pipelines.orbits.period_map import PeriodImage
from pipelines.orbits.system import Matrix, Vector

_SETTLED = 1e-14  # last change of a return time, relative to it
_ITERATIONS = 8  # of Newton for a return time: from beside the cycle three are enough


@dataclass(frozen=True)
class ReturnMapAt(MapAt):
    """P at one position of the section.

    All passes give DP columns, and ``position.period`` is the return time.
    ``normal`` (N,): n; ``level``: <n, s_0>; ``flow`` (N,): phi_T.
    """

    normal: Vector
    level: float
    flow: Vector

    def tangent(self, columns: Matrix, period_column: bool = False) -> PeriodImage:
        """DP columns = Pi M columns."""
        image = super().tangent(columns, period_column)
        return replace(image, columns=self.projected(image.columns))

    def with_columns(self, image: PeriodImage, columns: Matrix) -> PeriodImage:
        """The image with DP columns."""
        image = super().with_columns(image, columns)
        return replace(image, columns=self.projected(image.columns))

    def beside(self, direction: Position, distance: float, image: PeriodImage) -> ReturnMapAt:
        """P at position + distance direction, where the return time differs."""
        at = replace(self, position=self.position.plus(direction, distance), near=image.without_factors())
        for _ in range(_ITERATIONS):
            image = MapAt.tangent(at, np.zeros((len(self.normal), 0)), period_column=True)
            at = replace(at, flow=image.inhomogeneous[:, -1].copy())
            # <n, phi(s, tau)> + <n, phi_T> dtau = <n, s_0>
            change = (self.level - float(self.normal @ image.state)) / float(self.normal @ at.flow)
            if not abs(change) > _SETTLED * at.position.period:
                break
            at = replace(at, position=replace(at.position, period=at.position.period + change))
        return at

    def length(self, columns: Matrix) -> float:
        """The norm of vectors of the section.

        Those of a forced system are carried to phase zero of its forcing: the position of a cycle of
        unknown period is set by the phase condition.
        """
        angle = self._angle_to_zero()
        if angle == 0.0:
            return super().length(columns)
        period_map, at = self.problem.period_map, self.position
        time = at.period * angle / (2.0 * math.pi * period_map.period_multiple)
        parameters = self.problem.parameters_at(at)
        return super().length(period_map.evaluate(at.state, parameters, time, self.steps, columns).columns)

    def _angle_to_zero(self) -> float:
        """How far the forcing turns until its phase is zero: forward, because a film cannot go back."""
        period_map = self.problem.period_map
        if not period_map.extended:
            return 0.0
        s1, s2 = self.position.state[-2:]
        phase = math.atan2(s1, s2)
        return -phase if phase <= 0.0 else 2.0 * math.pi * period_map.period_multiple - phase

    def projected(self, columns: Matrix) -> Matrix:
        """Pi columns."""
        return columns - np.outer(self.flow, self.normal @ columns) / float(self.normal @ self.flow)


def on_section(linear: ManifoldLinearisation, critical: Critical) -> tuple[ManifoldLinearisation, Critical]:
    """The return map linearised at a critical cycle of unknown period, with its critical vectors.

    The slow subspace V of M contains the flow; that of DP is what of V lies in the section, V Z with
    n'V Z = 0.
    """
    flow = linear.image.inhomogeneous[:, -1]
    normal = _section_normal(linear, flow)
    inside = null_space((normal @ linear.basis)[None, :])
    basis = np.ascontiguousarray(linear.basis @ inside)
    position = linear.at.position
    at = ReturnMapAt(
        linear.at.problem, position, linear.at.steps, None, normal, float(normal @ position.state), flow
    )
    image = replace(linear.image, columns=at.projected(linear.image.columns @ inside))
    seen = replace(
        critical,
        right=at.projected(critical.right),
        left=inside.T @ critical.left,
        right_period=None,
        left_phase=0.0,
    )
    return replace(linear, at=at, basis=basis, image=image), seen


def _section_normal(linear: ManifoldLinearisation, flow: Vector) -> Vector:
    """A unit vector: along the flow, or the gradient (s_2, -s_1) of the phase of Eq. 17."""
    if not linear.at.problem.period_map.extended:
        return np.asarray(flow / np.linalg.norm(flow))
    normal = np.zeros_like(flow)
    s1, s2 = linear.at.position.state[-2:]
    normal[-2:] = np.array([s2, -s1]) / np.hypot(s1, s2)
    return normal
