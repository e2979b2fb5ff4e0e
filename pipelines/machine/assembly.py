"""The whole machine of a case in dimensionless form: rotor, two bearings, their active rings (Eq. 16).

``build_machine`` goes from SI tables to flat arrays; ``Machine`` offers the right-hand side, its sparse
Jacobian and the Jacobian's action on a block of vectors, all on the state s = {p_1 q_1 p_2 q_2 y}.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from pipelines.case.models import Bearing as BearingTable
from pipelines.case.models import Case
from pipelines.case.ring_statics import THIN_RING, ring_coefficients
from pipelines.case.scales import Scales

from . import film, rates, shifted
from .bearing import (
    Array,
    Bearing,
    FilmSettings,
    FilmState,
    film_pattern,
    film_state,
    linearise_bearing,
    pack_bearing,
)
from .condensation import CondensedRotor, StateSpace, condense, state_space
from .shaft import RotorMatrices, assemble_rotor
from .sparse_pattern import Places, SparsePattern, grid


@dataclass(frozen=True)
class Machine:
    """A rotor on two gas foil bearings; ``parameters`` everywhere follow `pipelines.case.scales.PARAMETERS`.

    ``condensed`` is in SI units, ``scaled`` in those of the state.
    """

    scales: Scales
    bearings: tuple[Bearing, Bearing]
    rotor: RotorMatrices
    condensed: CondensedRotor
    scaled: CondensedRotor
    space: StateSpace
    journal_freedoms: tuple[int, int]
    constants: Array
    layout: NDArray[np.int64]
    work_size: int

    @property
    def size(self) -> int:
        """N, the number of states."""
        return self.rotor_start + self.space.constant.shape[0]

    @property
    def rotor_start(self) -> int:
        """Where the rotor's displacements start in the state."""
        return int(self.layout[rates.ROTOR_STATE])

    @property
    def rotor_freedoms(self) -> int:
        """Number of freedoms of the master nodes: x and y of each, and its slopes where they are kept."""
        return int(self.layout[rates.ROTOR_SIZE])

    def film_unknowns(self, bearing: int) -> slice:
        """Where a bearing's pressures and foil displacements lie in the state."""
        start = int(self.bearings[bearing].integers[film.PRESSURE])
        return slice(start, start + self.bearings[bearing].settings.unknowns)

    def pressures(self, state: Array, bearing: int) -> Array:
        """The pressures of a bearing's film, from states along the last dimension of ``state``."""
        start, settings = self.film_unknowns(bearing).start, self.bearings[bearing].settings
        return state[..., start : start + settings.nodes * settings.axial]

    def journal(self, state: Array, bearing: int) -> Array:
        """Position and velocity X, Y, dX/dtau, dY/dtau of a journal in units of its own clearance."""
        first = self.rotor_start + self.journal_freedoms[bearing]
        second = first + self.rotor_freedoms
        own = state[..., [first, first + 1, second, second + 1]]
        return np.asarray(own / self.scales.bearings[bearing].clearance_ratio)

    def masters(self, state: Array) -> Array:
        """Displacements x, y of the master nodes, and their slopes where they are kept.

        Displacements are in units of the machine's displacement scale c, slopes in units of c/L, with the
        length L of the first bearing.
        """
        return state[..., self.rotor_start : self.rotor_start + self.rotor_freedoms]

    def rates(self, phase: float, state: Array, parameters: Array) -> Array:
        """ds/dtau, shape (N,)."""
        out = np.empty(self.size)
        rates.machine_rates(
            phase, state, parameters, self.constants, self.layout, np.empty(self.work_size), out
        )
        return out

    def film(self, bearing: int, phase: float, state: Array, parameters: Array) -> FilmState:
        """The film of a bearing at a state."""
        return film_state(
            self.bearings[bearing],
            state[self.film_unknowns(bearing)],
            self.journal(state, bearing),
            phase,
            parameters,
        )

    def minimum_film(self, phase: float, state: Array, parameters: Array) -> Array:
        """Smallest film thickness of either bearing, in units of its clearance."""
        return np.array(
            [self.film(b, phase, state, parameters).thickness.min() for b in range(rates.BEARINGS)]
        )

    def jacobian(self, phase: float, state: Array, parameters: Array) -> sparse.csc_array:
        """Analytic sparse Jacobian ds'/ds, shape (N, N).

        [ A_1   0    B_1 X_1 + D_1 V_1 ]
        [  0   A_2   B_2 X_2 + D_2 V_2 ]        X_b, V_b pick the journal's displacement and velocity from y,
        [ E_1 C_1  E_2 C_2   rotor     ]        E_b spreads its force over the rotor's accelerations
        """
        entries: list[Array] = []
        for b, bearing in enumerate(self.bearings):
            own = self.scales.bearings[b]
            linear = linearise_bearing(
                bearing, state[self.film_unknowns(b)], self.journal(state, b), phase, parameters
            )
            pressures, influence = _pressures(bearing.settings), self._influence(b)
            coupling = np.hstack([linear.position, linear.velocity])[pressures] / own.clearance_ratio
            force = influence[influence.any(axis=1)] @ linear.force[:, pressures]
            entries += [*linear.entries, coupling.ravel(), force.ravel()]
        rotor = self.space.constant + parameters[film.SPEED] * self.space.per_speed
        return self.pattern.matrix([*entries, rotor[self._rotor_places]])

    @cached_property
    def pattern(self) -> SparsePattern:
        """Where the Jacobian has entries, in the order in which `jacobian` computes them."""
        places = []
        for b, bearing in enumerate(self.bearings):
            settings, first = bearing.settings, self.film_unknowns(b).start
            films = film_pattern(settings.nodes, settings.axial, bearing.reach, settings.periodic)
            pressures = first + np.arange(_pressures(settings).stop)
            dof = self.rotor_start + self.journal_freedoms[b]
            journal = dof + np.array([0, 1, self.rotor_freedoms, self.rotor_freedoms + 1])
            driven = self.rotor_start + np.flatnonzero(self._influence(b).any(axis=1))
            rows, columns = films.places
            places += [(first + rows, first + columns), grid(pressures, journal), grid(driven, pressures)]
        rows, columns = self._rotor_places
        return SparsePattern.of(self.size, [*places, (self.rotor_start + rows, self.rotor_start + columns)])

    def _influence(self, bearing: int) -> Array:
        """E of a bearing: the rotor's rates per unit of the bearing's force, (2 freedoms, 2)."""
        dof = self.journal_freedoms[bearing]
        return np.asarray(
            self.scales.bearings[bearing].force_ratio * self.space.force_input[:, dof : dof + 2]
        )

    @cached_property
    def _rotor_places(self) -> Places:
        """Where the rotor's own matrix has entries at some speed."""
        rows, columns = np.nonzero((self.space.constant != 0.0) | (self.space.per_speed != 0.0))
        return rows, columns


def _pressures(settings: FilmSettings) -> slice:
    """The pressures among a bearing's unknowns."""
    return slice(0, settings.nodes * settings.axial)


def film_settings(case: Case, index: int) -> FilmSettings:
    """Dimensionless settings of one of the case's bearings."""
    table: BearingTable = case.bearings[index]
    scales = case.scales
    own, numerics, excitation = scales.bearings[index], case.numerics, case.excitation
    reference = scales.bearings[0].foil_stiffness
    if np.isinf(own.foil_stiffness):
        stiffness_ratio = 0.0
    else:
        stiffness_ratio = 1.0 if np.isinf(reference) else own.foil_stiffness / reference
    return FilmSettings(
        circumferential=numerics.circumferential,
        axial=numerics.axial,
        scheme=numerics.scheme,
        axial_scheme=numerics.axial_scheme,
        periodic=table.film == "periodic",
        edge_angle=table.edge_angle,
        clipping=table.clipping,
        smoothing=table.smoothing,
        kappa=own.kappa,
        time_ratio=own.time_ratio,
        loss_factor=1.0 if table.foil.loss_factor is None else table.foil.loss_factor,
        loss_factor_damping=table.foil.damping == "loss_factor",
        stiffness_ratio=stiffness_ratio,
        absolute_pressure=table.foil.pressure == "absolute",
        ring_radius=table.radius / table.clearance,
        ring_ratio=ring_ratio(case),
        ring_amplitude=scales.ring_factors(excitation)[index],
        ring_phase=excitation.phases[index],
    )


def ring_ratio(case: Case) -> float:
    """rho = |d_h / d_v| of the case's rings: given, from the ring's geometry, or that of a thin ring."""
    if case.excitation.ratio is not None:
        return case.excitation.ratio
    ring = case.excitation.ring
    return THIN_RING.ratio if ring is None else ring_coefficients(ring).ratio


def parameter_vector(case: Case) -> Array:
    """Speed, excitation frequency, ring displacement and foil stiffness of a case, dimensionless."""
    return with_stand_ins(case.parameters)


def with_stand_ins(parameters: Sequence[float | None]) -> Array:
    """Parameters with 1 in the place of those that the machine does not have (NaN or None).

    The equations do not depend on the value that replaces a missing parameter.
    """
    values = np.array(parameters, dtype=float)
    return np.where(np.isnan(values), 1.0, values)


def build_machine(case: Case) -> Machine:
    """Assemble the dimensionless machine of a case.

    Raises ValueError if the masters do not determine the rotor (see ``condensation.static_transformation``).
    """
    scales = case.scales
    rotor = assemble_rotor(case.rotor)
    condensed = condense(rotor, case.rotor.master_nodes, case.rotor.slope_nodes)
    length = scales.bearings[0].length
    scaled = condensed.scaled(scales.time, scales.displacement, scales.force, length)
    settings = [film_settings(case, index) for index in range(rates.BEARINGS)]
    freedoms = (condensed.position(case.bearings[0].node), condensed.position(case.bearings[1].node))
    return _assembled(scales, settings, rotor, condensed, scaled, freedoms)


def with_grid(machine: Machine, circumferential: int, axial: int) -> Machine:
    """The same machine with its films on another grid."""
    settings = [
        replace(bearing.settings, circumferential=circumferential, axial=axial)
        for bearing in machine.bearings
    ]
    return _assembled(
        machine.scales, settings, machine.rotor, machine.condensed, machine.scaled, machine.journal_freedoms
    )


def _assembled(
    scales: Scales,
    settings: Sequence[FilmSettings],
    rotor: RotorMatrices,
    condensed: CondensedRotor,
    scaled: CondensedRotor,
    freedoms: tuple[int, int],
) -> Machine:
    space = state_space(scaled)
    bearings = (pack_bearing(settings[0]), pack_bearing(settings[1], offset=settings[0].unknowns))
    constants, layout = _pack(scales, bearings, space, freedoms)
    state_size = sum(s.unknowns for s in settings) + space.constant.shape[0]
    work_size = max(
        max(
            rates.workspace_size(state_size, bearing.integers),
            shifted.workspace_size(state_size, space.constant.shape[0] // 2, bearing.integers),
        )
        for bearing in bearings
    )
    return Machine(scales, bearings, rotor, condensed, scaled, space, freedoms, constants, layout, work_size)


def _pack(
    scales: Scales, bearings: tuple[Bearing, Bearing], space: StateSpace, freedoms: tuple[int, int]
) -> tuple[Array, NDArray[np.int64]]:
    """Flat constants and integer layout that ``rates`` reads (see its head for the order)."""
    size = space.constant.shape[0] // 2
    velocity = slice(size, 2 * size)
    films = [
        np.concatenate([[own.clearance_ratio], bearing.scalars, bearing.arrays])
        for own, bearing in zip(scales.bearings, bearings, strict=True)
    ]
    influence = [
        own.force_ratio * space.force_input[velocity, dof : dof + 2]
        for own, dof in zip(scales.bearings, freedoms, strict=True)
    ]
    rotor = [
        -space.constant[velocity, :size],
        -space.constant[velocity, velocity],
        -space.per_speed[velocity, velocity],
        np.hstack(influence),
        space.gravity[velocity],
    ]
    constants = np.concatenate([*films, *(part.ravel() for part in rotor)])
    header = np.zeros(rates.MACHINE_INTEGERS, dtype=np.int64)
    header[rates.ROTOR_STATE] = sum(bearing.settings.unknowns for bearing in bearings)
    header[rates.ROTOR_SIZE] = size
    header[rates.ROTOR_CONSTANTS] = films[0].size + films[1].size
    header[rates.JOURNAL : rates.JOURNAL + 2] = freedoms
    header[rates.FILM_CONSTANTS : rates.FILM_CONSTANTS + 2] = [0, films[0].size]
    return constants, np.concatenate([header, *(bearing.integers for bearing in bearings)])
