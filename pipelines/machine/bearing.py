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


@dataclass(frozen=True)
class Stencil:
    """Weights of a scheme along theta.

    ``narrow``: of the narrow fluxes at the faces in dtheta S (see ``film``), from the one furthest behind on.
    ``convection``, ``beside_edge``: of p h in dtheta S, and at the first node behind a foil edge; at the last
    node before an edge they are mirrored.
    """

    narrow: tuple[float, ...]
    convection: tuple[float, ...]
    beside_edge: tuple[float, ...]

    @property
    def reach(self) -> int:
        """Number of neighbours on either side."""
        return len(self.narrow) // 2

    @property
    def packed(self) -> Array:
        """The stencil as ``film`` reads it."""
        if self.reach < film.WIDE_REACH:
            last = self.convection
        else:
            last = tuple(-weight for weight in reversed(self.beside_edge))
        return np.array([0.0, *self.narrow, 0.0, *self.beside_edge, *self.convection, *last])


_CENTRAL, _BACKWARD = (-0.5, 0.0, 0.5), (-1.0, 1.0, 0.0)
SCHEMES = {
    "central": Stencil((-1.0, 1.0), _CENTRAL, _CENTRAL),
    "backward": Stencil((-1.0, 1.0), _BACKWARD, _BACKWARD),
    "fourth_order": Stencil(
        (1.0 / 24.0, -3.0 / 24.0, 3.0 / 24.0, -1.0 / 24.0),
        (1.0 / 12.0, -8.0 / 12.0, 0.0, 8.0 / 12.0, -1.0 / 12.0),
        (0.0, -3.0 / 8.0, -3.0 / 8.0, 7.0 / 8.0, -1.0 / 8.0),
    ),
}


@dataclass(frozen=True)
class FilmSettings:
    """Dimensionless description of a bearing; lengths across the film in units of its clearance."""

    circumferential: int = 32
    axial: int = 4
    scheme: str = "fourth_order"
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
    def reach(self) -> int:
        """Neighbours of a node on either side in the scheme along theta."""
        return int(self.integers[film.REACH])

    @property
    def angles(self) -> Array:
        """Circumferential coordinate theta of the nodes [rad]."""
        spacing = self.scalars[film.SPACING]
        return self.settings.edge_angle + spacing * np.arange(1, self.settings.nodes + 1)

    @property
    def mean_weights(self) -> Array:
        """Weights of the axial mean over the stations with unknowns."""
        at = film.film_layout(self.integers)
        return self.arrays[at.weights : at.narrow]

    @property
    def directions(self) -> Array:
        """Cosine and sine of theta at the padded nodes, shape (nodes + 2 reach, 2)."""
        return self.arrays[: film.film_layout(self.integers).second_derivative].reshape(2, -1).T


def pack_bearing(settings: FilmSettings, offset: int = 0) -> Bearing:
    """Pack a bearing's settings; ``offset`` is where its pressures start in the state vector."""
    nodes, stations, stencil = settings.nodes, settings.axial, SCHEMES[settings.scheme]
    spacing = 2.0 * np.pi / settings.circumferential
    places = np.arange(1 - stencil.reach, nodes + stencil.reach + 1)
    if not settings.periodic:  # what lies beyond an edge is the edge
        places = np.clip(places, 0, nodes + 1)
    angles = settings.edge_angle + spacing * places
    axial = AXIAL_OPERATORS[settings.axial_scheme](stations)
    integers = np.array(
        [nodes, stations, stencil.reach, settings.periodic, CLIPPING[settings.clipping],
         settings.loss_factor_damping, offset, offset + nodes * stations], dtype=np.int64,
    )  # fmt: skip
    mobility = 1.0 / settings.time_ratio
    scalars = np.array(
        [spacing, mobility, mobility * settings.kappa**2, settings.loss_factor, settings.time_ratio,
         settings.stiffness_ratio, settings.absolute_pressure, settings.smoothing, settings.ring_radius,
         settings.ring_ratio, settings.ring_amplitude, settings.ring_phase], dtype=np.float64,
    )  # fmt: skip
    arrays = np.concatenate(
        [np.cos(angles), np.sin(angles), axial.second_derivative.ravel(), axial.side, axial.weights,
         stencil.packed]
    )  # fmt: skip
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
    film_now = _evaluate(_at_origin(bearing), unknowns, journal, phase, parameters)
    beyond = bearing.reach - 1
    inside = slice(beyond, len(film_now.thickness) - beyond)
    padded = film_now.padded_pressure[:, inside]
    return replace(film_now, thickness=film_now.thickness[inside], padded_pressure=padded)


def _evaluate(
    local: Bearing,
    unknowns: Array,
    journal: Array,
    phase: float,
    parameters: Array,
    scratch: Array | None = None,
) -> FilmState:
    """``film_state`` with all padded nodes; ``scratch`` receives that of ``film.film_rates``."""
    nodes, stations, length = local.settings.nodes, local.settings.axial, len(local.directions)
    thickness, thickness_rate = np.empty(length), np.empty(nodes)
    padded, rates = np.empty(stations * length), np.empty(local.settings.unknowns)
    journal = np.ascontiguousarray(journal, dtype=np.float64)
    film.film_geometry(
        phase, unknowns, parameters, local.integers, local.scalars, local.arrays, journal,
        thickness, thickness_rate, rates[nodes * stations :],
    )  # fmt: skip
    film.pad_pressure(unknowns, local.integers, padded)
    film.film_rates(
        padded, parameters, local.integers, local.scalars, local.arrays, thickness, thickness_rate, rates,
        _film_scratch(local) if scratch is None else scratch,
    )  # fmt: skip
    force = film_force(
        padded,
        local.integers,
        local.scalars,
        local.arrays,
        np.empty((2, 0)),
        np.empty((FORCE_SCRATCH, nodes + 2)),
    )
    return FilmState(thickness, thickness_rate, padded.reshape(stations, length), rates, np.array(force))


def _film_scratch(bearing: Bearing) -> Array:
    return np.empty((film.FILM_SCRATCH, film.scratch_length(bearing.integers)))


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
    scratch, reach = _film_scratch(local), local.reach
    state = _evaluate(local, unknowns, journal, phase, parameters, scratch)
    at = film.term_rows(reach, stations)
    terms, gradient = np.empty((at.count, nodes * stations)), np.empty((2, nodes * stations))
    film.film_derivatives(
        state.padded_pressure.ravel(), parameters, local.integers, local.scalars, local.arrays,
        state.thickness, state.thickness_rate, state.rates, terms, scratch,
    )  # fmt: skip
    film_force(
        state.padded_pressure.ravel(), local.integers, local.scalars, local.arrays, gradient,
        np.empty((FORCE_SCRATCH, nodes + 2)),
    )  # fmt: skip
    # h and dh/dtau at a padded node follow the journal with -(cos, sin)
    trig = -local.directions
    i = np.arange(nodes * stations) % nodes
    position = sum(
        terms[at.thickness + offset][:, None] * trig[i + reach + offset]
        for offset in range(-reach, reach + 1)
    )
    foil = np.zeros((nodes, 2))  # its rate depends on the journal through the pressure only
    coefficients = film.foil_coefficients(parameters, local.integers, local.scalars)
    return BearingLinearisation(
        pattern=film_pattern(nodes, stations, reach, settings.periodic),
        entries=_film_entries(terms, settings, reach, local.mean_weights, *coefficients),
        position=np.vstack([position, foil]),
        velocity=np.vstack([terms[film.THICKNESS_RATE][:, None] * trig[i + reach], foil]),
        force=np.hstack([gradient, foil.T]),
    )


@cache
def film_pattern(nodes: int, stations: int, reach: int, periodic: bool) -> SparsePattern:
    """Where A has entries: the film's rows, then the foil's, in the order of ``_film_entries``."""
    rows = np.arange(nodes * stations)
    i, first, foil, own = rows % nodes, rows - rows % nodes, nodes * stations, np.arange(nodes)
    film_rows = [(rows, foil + i)]
    for offset, inside in _with_neighbours(nodes, stations, reach, periodic):
        neighbour = (i[inside] + offset) % nodes
        film_rows += [(inside, first[inside] + neighbour), (inside, foil + neighbour)]
    film_rows += [(rows, station * nodes + i) for station in range(stations)]
    foil_rows = [(foil + own, block * nodes + own) for block in range(stations + 1)]
    return SparsePattern.of(nodes * (stations + 1), [*film_rows, *foil_rows])


def _with_neighbours(
    nodes: int, stations: int, reach: int, periodic: bool
) -> list[tuple[int, NDArray[np.intp]]]:
    """Offsets of neighbours, and the film's rows that have one there; the foil's edge has no unknowns."""
    rows = np.arange(nodes * stations)
    offsets = [offset for offset in range(-reach, reach + 1) if offset != 0]
    others = [rows % nodes + offset for offset in offsets]
    return [
        (offset, rows[periodic | ((other >= 0) & (other < nodes))])
        for offset, other in zip(offsets, others, strict=True)
    ]


def _film_entries(
    terms: Array,
    settings: FilmSettings,
    reach: int,
    mean_weights: Array,
    flexibility: float,
    relaxation: float,
) -> list[Array]:
    """The entries of A: film rows from ``terms`` with dh/dtau = dq/dtau of the foil put in, and foil rows.

    d(dq/dtau)_i = flexibility sum_l weights_l dp_{i,l} - relaxation dq_i (Eq. 8)
    """
    nodes, stations = settings.nodes, settings.axial
    at = film.term_rows(reach, stations)
    by_rate, weights = terms[film.THICKNESS_RATE], flexibility * mean_weights
    entries = [terms[at.thickness] - relaxation * by_rate]
    for offset, inside in _with_neighbours(nodes, stations, reach, settings.periodic):
        entries += [terms[at.pressure + offset][inside], terms[at.thickness + offset][inside]]
    entries += [terms[at.here + station] + weight * by_rate for station, weight in enumerate(weights)]
    return [*entries, np.repeat([*weights, -relaxation], nodes)]
