"""One gas foil bearing in dimensionless form: its unknowns u = {p q}, their rates and its linearisation.

    du/dtau = g(u, X, dX/dtau),     F = F(u)

with the journal position X in units of the bearing's clearance.  Linearised,

    d(du)/dtau = A du + B dX + D d(dX/dtau),     dF = C du
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from . import film
from .axial import chebyshev_operator, uniform_operator
from .film_force import FORCE_SCRATCH, film_force
from .sparse_pattern import SparsePattern

Array = NDArray[np.float64]

CLIPPING = {"full": film.FULL, "gumbel": film.GUMBEL, "smooth": film.SMOOTH}
AXIAL_OPERATORS = {"chebyshev": chebyshev_operator, "uniform": uniform_operator}
CONVECTION_WEIGHTS = {"central": 0.5, "backward": 1.0}


@dataclass(frozen=True)
class FilmSettings:
    """Dimensionless description of a bearing; lengths across the film in units of its clearance."""

    circumferential: int = 40
    axial: int = 3
    scheme: str = "central"
    axial_scheme: str = "chebyshev"
    periodic: bool = False
    edge_angle: float = 0.0
    clipping: str = "gumbel"
    smoothing: float = 0.01
    kappa: float = 1.0  # R / L_b
    time_ratio: float = 1.0  # own time unit / time unit of the machine
    loss_factor: float = 1.0
    loss_factor_damping: bool = False  # c_f = eta k_f / Omega instead of eta k_f
    stiffness_ratio: float = 1.0  # k_f / the parameter foil_stiffness; 0 makes the bearing rigid
    absolute_pressure: bool = False
    ring_radius: float = 700.0  # R / c_r
    ring_ratio: float = 0.918
    ring_amplitude: float = 1.0
    ring_phase: float = 0.0

    @property
    def nodes(self) -> int:
        """Circumferential stations with unknowns: the foil edge carries none."""
        return self.circumferential if self.periodic else self.circumferential - 1

    @property
    def unknowns(self) -> int:
        """Pressures and foil displacements of the bearing."""
        return self.nodes * (self.axial + 1)


@dataclass(frozen=True)
class Bearing:
    """A bearing packed for the compiled kernels: u = {p q} starts at ``offset`` of the state."""

    settings: FilmSettings
    integers: NDArray[np.int64]
    scalars: Array
    arrays: Array

    @property
    def angles(self) -> Array:
        """Circumferential coordinate theta of the nodes [rad]."""
        spacing = self.scalars[film.SPACING]
        return self.settings.edge_angle + spacing * np.arange(1, self.settings.nodes + 1)

    @property
    def mean_weights(self) -> Array:
        """Weights of the axial mean over the stations with unknowns."""
        return self.arrays[film.film_layout(self.integers).weights :]

    @property
    def directions(self) -> Array:
        """Cosine and sine of theta at the padded nodes, shape (nodes + 2, 2)."""
        return self.arrays[: film.film_layout(self.integers).second_derivative].reshape(2, -1).T


def pack_bearing(settings: FilmSettings, offset: int = 0) -> Bearing:
    """Pack a bearing's settings; ``offset`` is where its pressures start in the state vector."""
    nodes, stations = settings.nodes, settings.axial
    spacing = 2.0 * np.pi / settings.circumferential
    angles = settings.edge_angle + spacing * np.arange(nodes + 2)
    axial = AXIAL_OPERATORS[settings.axial_scheme](stations)
    integers = np.array(
        [nodes, stations, settings.periodic, CLIPPING[settings.clipping], settings.loss_factor_damping,
         offset, offset + nodes * stations], dtype=np.int64,
    )  # fmt: skip
    mobility = 1.0 / settings.time_ratio
    scalars = np.array(
        [spacing, mobility, mobility * settings.kappa**2, CONVECTION_WEIGHTS[settings.scheme],
         settings.loss_factor, settings.time_ratio, settings.stiffness_ratio, settings.absolute_pressure,
         settings.smoothing, settings.ring_radius, settings.ring_ratio, settings.ring_amplitude,
         settings.ring_phase], dtype=np.float64,
    )  # fmt: skip
    arrays = np.concatenate(
        [np.cos(angles), np.sin(angles), axial.second_derivative.ravel(), axial.side, axial.weights]
    )
    return Bearing(settings, integers, scalars, arrays)


@dataclass(frozen=True)
class FilmState:
    """The film at one instant: what the kernels need and what a reader plots."""

    thickness: Array  # (nodes + 2), padded with the film's ends
    thickness_rate: Array  # (nodes)
    padded_pressure: Array  # (stations, nodes + 2)
    rates: Array  # (unknowns) du/dtau
    force: Array  # (2) F / (p0 R L_b) on the journal


def film_state(
    bearing: Bearing, unknowns: Array, journal: Array, phase: float, parameters: Array
) -> FilmState:
    """Film thickness, rates and force of a bearing; ``journal`` = X, Y, dX/dtau, dY/dtau (Eq. 2, 3, 8, 9)."""
    local = _at_origin(bearing)
    nodes, stations = local.settings.nodes, local.settings.axial
    thickness, thickness_rate = np.empty(nodes + 2), np.empty(nodes)
    padded, rates = np.empty(stations * (nodes + 2)), np.empty(local.settings.unknowns)
    journal = np.ascontiguousarray(journal, dtype=np.float64)
    film.film_geometry(
        phase, unknowns, parameters, local.integers, local.scalars, local.arrays, journal,
        thickness, thickness_rate, rates[nodes * stations :],
    )  # fmt: skip
    film.pad_pressure(unknowns, local.integers, padded)
    film.film_rates(
        padded, parameters, local.integers, local.scalars, local.arrays, thickness, thickness_rate, rates,
        np.empty((film.FILM_SCRATCH, nodes + 2)),
    )  # fmt: skip
    scratch = np.empty((FORCE_SCRATCH, nodes + 2))
    force = film_force(padded, local.integers, local.scalars, local.arrays, np.empty((2, 0)), scratch)
    return FilmState(thickness, thickness_rate, padded.reshape(stations, nodes + 2), rates, np.array(force))


def _at_origin(bearing: Bearing) -> Bearing:
    """The same bearing with its unknowns at the start of the state vector."""
    integers = bearing.integers.copy()
    integers[film.FOIL] -= integers[film.PRESSURE]
    integers[film.PRESSURE] = 0
    return replace(bearing, integers=integers)


@dataclass(frozen=True)
class BearingLinearisation:
    """A, B, D and C of the module's docstring.

    ``entries``: those of A (u, u) at the places of ``film_pattern``.
    ``position``, ``velocity`` (u, 2) and ``force`` (2, u): B, D and C, zero where they belong to the foil.
    """

    pattern: SparsePattern
    entries: list[Array]
    position: Array
    velocity: Array
    force: Array

    @property
    def unknowns(self) -> sparse.csc_array:
        """A (u, u)."""
        return self.pattern.matrix(self.entries)


def linearise_bearing(
    bearing: Bearing, unknowns: Array, journal: Array, phase: float, parameters: Array
) -> BearingLinearisation:
    """Analytic linearisation of a bearing about a state (see ``film.film_derivatives``)."""
    local = _at_origin(bearing)
    settings = local.settings
    nodes, stations = settings.nodes, settings.axial
    state = film_state(bearing, unknowns, journal, phase, parameters)
    terms, gradient = np.empty((film.HERE + stations, nodes * stations)), np.empty((2, nodes * stations))
    film.film_derivatives(
        state.padded_pressure.ravel(), parameters, local.integers, local.scalars, local.arrays,
        state.thickness, state.thickness_rate, state.rates, terms, np.empty((film.FILM_SCRATCH, nodes + 2)),
    )  # fmt: skip
    film_force(
        state.padded_pressure.ravel(), local.integers, local.scalars, local.arrays, gradient,
        np.empty((FORCE_SCRATCH, nodes + 2)),
    )  # fmt: skip
    # h and dh/dtau at a padded station follow the journal with -(cos, sin)
    trig = -local.directions
    i = np.arange(nodes * stations) % nodes
    position = terms[film.THICKNESS_BEFORE][:, None] * trig[i]
    position += terms[film.THICKNESS_HERE][:, None] * trig[i + 1]
    position += terms[film.THICKNESS_AFTER][:, None] * trig[i + 2]
    foil = np.zeros((nodes, 2))  # its rate depends on the journal through the pressure only
    coefficients = film.foil_coefficients(parameters, local.integers, local.scalars)
    return BearingLinearisation(
        pattern=film_pattern(nodes, stations, settings.periodic),
        entries=_film_entries(terms, settings, local.mean_weights, *coefficients),
        position=np.vstack([position, foil]),
        velocity=np.vstack([terms[film.THICKNESS_RATE][:, None] * trig[i + 1], foil]),
        force=np.hstack([gradient, foil.T]),
    )


@cache
def film_pattern(nodes: int, stations: int, periodic: bool) -> SparsePattern:
    """Where A has entries: the film's rows, then the foil's, in the order of ``_film_entries``."""
    rows = np.arange(nodes * stations)
    i, first, foil, own = rows % nodes, rows - rows % nodes, nodes * stations, np.arange(nodes)
    before, after = (i - 1) % nodes, (i + 1) % nodes
    left, right = _with_neighbours(nodes, stations, periodic)
    film_rows = [
        (left, (first + before)[left]),
        (right, (first + after)[right]),
        (left, (foil + before)[left]),
        (rows, foil + i),
        (right, (foil + after)[right]),
        *((rows, station * nodes + i) for station in range(stations)),
    ]
    foil_rows = [(foil + own, block * nodes + own) for block in range(stations + 1)]
    return SparsePattern.of(nodes * (stations + 1), [*film_rows, *foil_rows])


def _with_neighbours(nodes: int, stations: int, periodic: bool) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The film's rows with a node before and those with a node after; the foil's edge has no unknowns."""
    rows = np.arange(nodes * stations)
    i = rows % nodes
    return (rows, rows) if periodic else (rows[i > 0], rows[i < nodes - 1])


def _film_entries(
    terms: Array, settings: FilmSettings, mean_weights: Array, flexibility: float, relaxation: float
) -> list[Array]:
    """The entries of A: film rows from ``terms`` with dh/dtau = dq/dtau of the foil put in, and foil rows.

    d(dq/dtau)_i = flexibility sum_l weights_l dp_{i,l} - relaxation dq_i (Eq. 8)
    """
    nodes, stations = settings.nodes, settings.axial
    left, right = _with_neighbours(nodes, stations, settings.periodic)
    by_rate, weights = terms[film.THICKNESS_RATE], flexibility * mean_weights
    return [
        terms[film.BEFORE][left],
        terms[film.AFTER][right],
        terms[film.THICKNESS_BEFORE][left],
        terms[film.THICKNESS_HERE] - relaxation * by_rate,
        terms[film.THICKNESS_AFTER][right],
        *(terms[film.HERE + station] + weight * by_rate for station, weight in enumerate(weights)),
        np.repeat([*weights, -relaxation], nodes),
    ]
