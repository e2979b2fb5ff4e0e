"""A state of the machine on another film grid, as a first guess there.

Along theta pressures and foil displacements are interpolated by cubic splines.  At the foil edge line the
pressure is 1 and the foil displacement is extrapolated; a film without an edge has periodic splines.  Along
the axis the pressure is the even Chebyshev polynomial of the collocation itself, or a cubic spline through
the paper's uniform stations.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from .assembly import Machine
from .bearing import AXIAL_OPERATORS, Array, Bearing

_AMBIENT = 1.0  # pressure at the side of the film and on the foil edge line


def regrid(source: Machine, target: Machine, state: Array) -> Array:
    """``state`` (N + m,) of ``source`` on the film grids of ``target``, (N' + m,).

    The rotor's states, and the m entries that follow them, stay as they are.  The error of smooth films is of
    fourth order in the spacing along theta.  Raises ValueError for machines with different rotors or a state
    that is too short.
    """
    rotor = source.size - source.rotor_start
    if rotor != target.size - target.rotor_start:
        raise ValueError(f"the rotors have {rotor} and {target.size - target.rotor_start} states")
    if len(state) < source.size:
        raise ValueError(f"the state has {len(state)} entries; the machine has {source.size}")
    films = [
        _regridded(bearing, finer, state[source.film_unknowns(index)])
        for index, (bearing, finer) in enumerate(zip(source.bearings, target.bearings, strict=True))
    ]
    return np.concatenate([*films, state[source.rotor_start :]])


def _regridded(source: Bearing, target: Bearing, unknowns: Array) -> Array:
    """The unknowns {p q} of one bearing on another grid."""
    settings = source.settings
    films = settings.nodes * settings.axial
    pressure = unknowns[:films].reshape(settings.axial, settings.nodes)
    around = _along_theta(source, target, pressure, edge=_AMBIENT)
    axial = _axial_interpolation(settings.axial_scheme, settings.axial, _stations(target))
    foil = _along_theta(source, target, unknowns[films:][None, :], edge=None)
    return np.concatenate([(_AMBIENT + axial @ (around - _AMBIENT)).ravel(), foil.ravel()])


def _along_theta(source: Bearing, target: Bearing, values: Array, edge: float | None) -> Array:
    """Rows of ``values`` (k, nodes) at the stations of ``target``; ``edge``: their value on the edge line."""
    angles, start = source.angles, source.settings.edge_angle
    if source.settings.periodic:
        whole = np.concatenate([angles[-1:] - 2.0 * np.pi, angles])
        closed = np.concatenate([values[:, -1:], values], axis=1)
        return np.asarray(CubicSpline(whole, closed, axis=1, bc_type="periodic")(target.angles))
    if edge is None:
        return np.asarray(CubicSpline(angles, values, axis=1)(target.angles))
    whole = np.concatenate([[start], angles, [start + 2.0 * np.pi]])
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=edge)
    return np.asarray(CubicSpline(whole, padded, axis=1)(target.angles))


def _stations(bearing: Bearing) -> Array:
    """Axial stations z = Z / L_b of a bearing's unknowns."""
    return AXIAL_OPERATORS[bearing.settings.axial_scheme](bearing.settings.axial).stations


def _axial_interpolation(scheme: str, count: int, stations: Array) -> Array:
    """Matrix (stations, count) from gauge pressures at ``count`` stations, zero at the side, to others."""
    own = np.concatenate([[0.0], AXIAL_OPERATORS[scheme](count).stations])
    if scheme == "chebyshev":
        # T_0, T_2, ... T_2n in x = 1 - 2 z: even about the middle
        values = np.polynomial.chebyshev.chebvander(1.0 - 2.0 * own, 2 * count)[:, ::2]
        wanted = np.polynomial.chebyshev.chebvander(1.0 - 2.0 * stations, 2 * count)[:, ::2]
        return np.asarray(wanted @ np.linalg.inv(values))[:, 1:]
    whole = np.concatenate([own, 1.0 - own[-2::-1]])
    mirrored = np.vstack([np.eye(count + 1), np.eye(count + 1)[-2::-1]])
    return np.asarray(CubicSpline(whole, mirrored)(stations))[:, 1:]
