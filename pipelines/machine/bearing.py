"""One gas foil bearing in dimensionless form: its unknowns u = {p q}, their rates and its linearisation.

    du/dtau = g(u, X, dX/dtau),     F = F(u)

with the journal position X in units of the bearing's clearance.  Linearised,

    d(du)/dtau = A du + B dX + D d(dX/dtau),     dF = C du
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from . import film
from .axial import chebyshev_operator, uniform_operator

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
        return self.arrays[-self.settings.axial :]


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


def film_state(bearing: Bearing, unknowns: Array, journal: Array, phase: float, parameters: Array) -> FilmState:
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
        padded, parameters, local.integers, local.scalars, local.arrays, thickness, thickness_rate, rates
    )
    force = np.array(film.film_force(padded, local.integers, local.scalars, local.arrays))
    return FilmState(thickness, thickness_rate, padded.reshape(stations, nodes + 2), rates, force)


def _at_origin(bearing: Bearing) -> Bearing:
    """The same bearing with its unknowns at the start of the state vector."""
    integers = bearing.integers.copy()
    integers[film.FOIL] -= integers[film.PRESSURE]
    integers[film.PRESSURE] = 0
    return replace(bearing, integers=integers)


@dataclass(frozen=True)
class BearingLinearisation:
    """A, B, D and C of the module's docstring: (u, u) sparse, (u, 2), (u, 2) and (2, u)."""

    unknowns: sparse.csr_array
    position: Array
    velocity: Array
    force: Array


def linearise_bearing(
    bearing: Bearing, unknowns: Array, journal: Array, phase: float, parameters: Array
) -> BearingLinearisation:
    """Analytic linearisation of a bearing about a state (see ``film.film_derivatives``)."""
    local = _at_origin(bearing)
    settings = local.settings
    nodes, stations = settings.nodes, settings.axial
    state = film_state(bearing, unknowns, journal, phase, parameters)
    terms, gradient = np.empty((nodes * stations, film.HERE + stations)), np.empty((nodes * stations, 2))
    film.film_derivatives(
        state.padded_pressure.ravel(), parameters, local.integers, local.scalars, local.arrays,
        state.thickness, state.thickness_rate, state.rates, terms,
    )  # fmt: skip
    film.film_force_derivatives(
        state.padded_pressure.ravel(), local.integers, local.scalars, local.arrays, gradient
    )
    flexibility, relaxation = film.foil_coefficients(parameters, local.integers, local.scalars)

    # dh and d(dh/dtau) at the nodes as linear maps of du, dX, d(dX/dtau)
    mean = sparse.kron(local.mean_weights[None, :], sparse.eye_array(nodes))
    foil_rate = sparse.hstack([flexibility * mean, -relaxation * sparse.eye_array(nodes)])
    thickness = sparse.hstack([sparse.csr_array((nodes, nodes * stations)), sparse.eye_array(nodes)])
    trig = -np.stack([np.cos(local.angles), np.sin(local.angles)], axis=1)

    pressure, by_thickness, by_rate = _film_matrices(terms, settings)
    film_rows = pressure + by_thickness @ thickness + by_rate @ foil_rate
    edge = _edge_columns(terms, settings, trig)
    return BearingLinearisation(
        unknowns=sparse.vstack([film_rows, foil_rate]).tocsr(),
        position=np.vstack([by_thickness @ trig + edge, np.zeros((nodes, 2))]),
        velocity=np.vstack([by_rate @ trig, np.zeros((nodes, 2))]),
        force=np.hstack([gradient.T, np.zeros((2, nodes))]),
    )


def _film_matrices(
    terms: Array, settings: FilmSettings
) -> tuple[sparse.csr_array, sparse.csr_array, sparse.csr_array]:
    """The rows of ``terms`` as sparse matrices acting on du, on dh and on d(dh/dtau) at the nodes."""
    nodes, stations = settings.nodes, settings.axial
    rows = np.arange(nodes * stations)
    i, first = rows % nodes, rows - rows % nodes
    before, after = (i - 1) % nodes, (i + 1) % nodes
    inner = np.ones(rows.size, dtype=bool)
    has_before, has_after = (inner, inner) if settings.periodic else (i > 0, i < nodes - 1)

    def matrix(entries: list[tuple[NDArray[np.bool_], Array, Array]], columns: int) -> sparse.csr_array:
        row = np.concatenate([rows[mask] for mask, _, _ in entries])
        column = np.concatenate([target[mask] for mask, target, _ in entries])
        value = np.concatenate([value[mask] for mask, _, value in entries])
        return sparse.coo_array((value, (row, column)), shape=(rows.size, columns)).tocsr()

    pressure = [(has_before, first + before, terms[:, film.BEFORE]), (has_after, first + after, terms[:, film.AFTER])]
    pressure += [(inner, l * nodes + i, terms[:, film.HERE + l]) for l in range(stations)]
    by_thickness = [
        (has_before, before, terms[:, film.THICKNESS_BEFORE]),
        (inner, i, terms[:, film.THICKNESS_HERE]),
        (has_after, after, terms[:, film.THICKNESS_AFTER]),
    ]
    by_rate = [(inner, i, terms[:, film.THICKNESS_RATE])]
    return matrix(pressure, settings.unknowns), matrix(by_thickness, nodes), matrix(by_rate, nodes)


def _edge_columns(terms: Array, settings: FilmSettings, trig: Array) -> Array:
    """What the film thickness on the foil edge, which moves with the journal only, adds to dX: (rows, 2)."""
    columns = np.zeros((terms.shape[0], 2))
    if not settings.periodic:
        edge = -np.array([np.cos(settings.edge_angle), np.sin(settings.edge_angle)])
        first = np.arange(settings.axial) * settings.nodes
        last = first + settings.nodes - 1
        columns[first] += terms[first, film.THICKNESS_BEFORE, None] * edge
        columns[last] += terms[last, film.THICKNESS_AFTER, None] * edge
    return columns
