"""Timoshenko elements and the assembled rotor against ROSS's matrices and closed forms."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import linalg

from pipelines.case.models import Disc, Element, Material, Rotor
from pipelines.machine.shaft import (
    assemble_rotor,
    cowper_shear_coefficient,
    disc_matrices,
    element_matrices,
    weight_shares,
)

ROSS = json.loads((Path(__file__).parents[1] / "reference" / "ross_elements.json").read_text())
STEEL = Material(young_modulus=206e9, density=7850.0, poisson_ratio=0.3)


def assert_same_matrix(actual, expected, reference_diagonal):
    """Every entry to 1e-12 of the geometric mean of its two diagonal entries, which removes the units."""
    scale = np.sqrt(np.outer(reference_diagonal, reference_diagonal))
    assert np.max(np.abs(actual - expected) / scale) < 1e-12


@pytest.mark.parametrize("record", ROSS["elements"], ids=lambda record: record["name"])
def test_element_matrices_agree_with_ross(record):
    dimensions = {name: record[name] for name in ("length", "outer_diameter", "inner_diameter")}
    part = element_matrices(Element(**dimensions), Material(**record["material"]))
    assert not part.geometric.any()
    for name in ("mass", "stiffness"):
        expected = np.array(record[name])
        assert_same_matrix(getattr(part, name), expected, np.diag(expected))
    expected = np.array(record["gyroscopic"])
    # x couples with y exactly as strongly as deflections gyrate: the largest entry of each row is its scale
    row_scale = np.max(np.abs(expected), axis=1)
    assert_same_matrix(part.gyroscopic, expected, row_scale)


@pytest.mark.parametrize("record", ROSS["cones"], ids=lambda record: record["name"])
def test_cones_and_axial_forces_agree_with_ross(record):
    element = Element(**record["element"])
    part = element_matrices(element, Material(**record["material"]))
    assert_same_matrix(part.mass, np.array(record["mass"]), np.diag(record["mass"]))
    assert_same_matrix(
        part.stiffness + part.geometric, np.array(record["stiffness"]), np.diag(part.stiffness)
    )
    row_scale = np.max(np.abs(record["gyroscopic"]), axis=1)
    assert_same_matrix(part.gyroscopic, np.array(record["gyroscopic"]), row_scale)
    density = record["material"]["density"]
    assert density * element.volume == pytest.approx(record["mass_of_element"], rel=1e-14)
    assert weight_shares(element)[1] == pytest.approx(record["centre_of_gravity"], rel=1e-13)
    assert weight_shares(element).sum() == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize("record", ROSS["discs"], ids=lambda record: record["name"])
def test_disc_matrices_agree_with_ross(record):
    disc = Disc(
        node=0,
        mass=record["mass_value"],
        diametral_inertia=record["diametral_inertia"],
        polar_inertia=record["polar_inertia"],
    )
    part = disc_matrices(disc.inertia({}))
    np.testing.assert_array_equal(part.mass, record["mass"])
    np.testing.assert_array_equal(part.gyroscopic, record["gyroscopic"])
    assert not part.stiffness.any()


def test_poisson_ratio_and_shear_modulus_are_two_names_of_one_material():
    by_shear_modulus = Material(young_modulus=206e9, density=7850.0, shear_modulus=206e9 / 2.6)
    first = element_matrices(Element(length=0.02, outer_diameter=0.05, inner_diameter=0.01), STEEL)
    second = element_matrices(
        Element(length=0.02, outer_diameter=0.05, inner_diameter=0.01), by_shear_modulus
    )
    np.testing.assert_allclose(second.stiffness, first.stiffness, rtol=1e-13)


def test_cowper_coefficient_of_solid_section_and_thin_tube():
    assert cowper_shear_coefficient(0.3, 0.0) == pytest.approx(6 * 1.3 / (7 + 6 * 0.3))
    # Cowper (1966), thin-walled round tube: 2 (1 + nu) / (4 + 3 nu)
    assert cowper_shear_coefficient(0.3, 1.0) == pytest.approx(2 * 1.3 / (4 + 3 * 0.3))


def test_one_element_gives_the_exact_cantilever():
    """Tip load on a short hollow cantilever: F L^3 / 3 E I + F L / kappa G A, slope F L^2 / 2 E I."""
    length, outer, inner = 0.1, 0.06, 0.03
    element = Element(length=length, outer_diameter=outer, inner_diameter=inner)
    stiffness = element_matrices(element, STEEL).stiffness[4:, 4:]
    bending = 206e9 * np.pi / 64 * (outer**4 - inner**4)
    shear = cowper_shear_coefficient(0.3, 0.5) * 206e9 / 2.6 * np.pi / 4 * (outer**2 - inner**2)
    in_x, in_y = np.linalg.solve(stiffness, np.eye(4)[:, :2]).T
    deflection = length**3 / (3 * bending) + length / shear
    slope = length**2 / (2 * bending)
    np.testing.assert_allclose(in_x, [deflection, 0, 0, slope], rtol=1e-12, atol=1e-25)
    np.testing.assert_allclose(in_y, [0, deflection, -slope, 0], rtol=1e-12, atol=1e-25)


def pinned_bar(elements: int, diameter: float, force: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Mass and stiffness in the x-z plane of a pinned steel bar of 0.5 m made of equal elements."""
    element = Element(length=0.5 / elements, outer_diameter=diameter, count=elements, axial_force=force)
    matrices = assemble_rotor(Rotor(elements=(element,), masters=(0, elements)))
    kept = np.sort(np.concatenate((np.arange(4, 4 * elements, 4), np.arange(3, 4 * elements + 4, 4))))
    in_plane = np.ix_(kept, kept)
    return matrices.mass[in_plane], matrices.stiffness[in_plane]


def pinned_frequencies(elements: int, modes: int, diameter: float, force: float = 0.0) -> np.ndarray:
    """Lowest frequencies of the pinned bar [rad/s]."""
    mass, stiffness = pinned_bar(elements, diameter, force)
    return np.sqrt(linalg.eigh(stiffness, mass, eigvals_only=True)[:modes])


def exact_pinned_frequencies(modes: int, diameter: float) -> np.ndarray:
    """E I k^4 - w^2 [rho A + rho I (1 + E / kappa G) k^2] + w^4 rho^2 I / kappa G = 0 with k = n pi / L."""
    area, second_moment = np.pi / 4 * diameter**2, np.pi / 64 * diameter**4
    shear = cowper_shear_coefficient(0.3, 0.0) * 206e9 / 2.6
    k = np.arange(1, modes + 1) * np.pi / 0.5
    a = 7850.0**2 * second_moment / shear
    b = 7850.0 * (area + second_moment * (1 + 206e9 / shear) * k**2)
    c = 206e9 * second_moment * k**4
    return np.sqrt(2 * c / (b + np.sqrt(b**2 - 4 * a * c)))


@pytest.mark.parametrize(
    ("diameter", "order", "largest_error"),
    [
        # a slender bar: cubic deflections
        (0.001, 4.0, 1e-5),
        # a stubby bar, Phi = 6 ... 90: the slope in an element is fixed by statics and follows the inertia
        # forces to second order only; still the exact Timoshenko frequencies in the limit
        (0.1, 2.0, 2e-3),
    ],
)
def test_pinned_bar_converges_to_timoshenko(diameter, order, largest_error):
    exact = exact_pinned_frequencies(3, diameter)
    errors = np.array([pinned_frequencies(elements, 3, diameter) / exact - 1 for elements in (8, 16, 32)])
    assert np.all(errors > 0)  # a conforming element with consistent mass is too stiff
    np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), order, atol=0.2)
    assert errors[-1, 2] < largest_error


def pulled_bar_frequency(diameter: float, force: float) -> float:
    """First frequency of the pinned bar under a tension N, from w = W sin kz and slope B cos kz, k = pi/L.

    (kappa G A k^2 + N k^2 - w^2 rho A) W = kappa G A k B
    (E I k^2 + kappa G A - w^2 rho I) B = kappa G A k W
    """
    area, second_moment = np.pi / 4 * diameter**2, np.pi / 64 * diameter**4
    shear = cowper_shear_coefficient(0.3, 0.0) * 206e9 / 2.6 * area
    k = np.pi / 0.5
    stiffness = [[(shear + force) * k**2, -shear * k], [-shear * k, 206e9 * second_moment * k**2 + shear]]
    return np.sqrt(linalg.eigh(stiffness, np.diag([7850.0 * area, 7850.0 * second_moment]))[0][0])


@pytest.mark.parametrize("part", [-0.9, 3.0])
def test_an_axial_force_changes_the_frequency_as_in_closed_form(part):
    """A slender bar under 0.9 of its buckling load, and under three times as much tension."""
    diameter = 0.002
    force = part * 206e9 * np.pi / 64 * diameter**4 * (np.pi / 0.5) ** 2
    exact = pulled_bar_frequency(diameter, force)
    errors = np.array(
        [pinned_frequencies(elements, 1, diameter, force)[0] / exact - 1 for elements in (2, 4)]
    )
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)
    assert pinned_frequencies(16, 1, diameter, force)[0] == pytest.approx(exact, rel=2e-5)


@pytest.mark.parametrize(("diameter", "order", "largest_error"), [(0.002, 4.0, 5e-5), (0.1, 2.0, 1e-3)])
def test_the_buckling_load_is_that_of_engesser(diameter, order, largest_error):
    """P = P_E / (1 + P_E / kappa G A) with Euler's load P_E = pi^2 E I / L^2; slender and stubby as above."""
    euler = np.pi**2 * 206e9 * np.pi / 64 * diameter**4 / 0.5**2
    shear = cowper_shear_coefficient(0.3, 0.0) * 206e9 / 2.6 * np.pi / 4 * diameter**2
    exact = euler / (1.0 + euler / shear)
    loads = []
    for elements in (2, 4, 8):
        _, elastic = pinned_bar(elements, diameter)
        geometric = (elastic - pinned_bar(elements, diameter, -exact)[1]) / exact
        loads.append(1.0 / linalg.eigh(geometric, elastic, eigvals_only=True)[-1])
    errors = np.array(loads) / exact - 1
    assert np.log2(errors[1] / errors[2]) == pytest.approx(order, abs=0.2)
    assert 0 < errors[-1] < largest_error


def test_axial_forces_are_not_rayleigh_damped():
    plain = Element(length=0.05, outer_diameter=0.02, count=2)
    pulled = plain.model_copy(update={"axial_force": 1e4})
    first, second = (
        assemble_rotor(Rotor(elements=(element,), masters=(0, 2), rayleigh_stiffness=1e-5))
        for element in (plain, pulled)
    )
    assert not np.array_equal(first.stiffness, second.stiffness)
    np.testing.assert_array_equal(first.damping, second.damping)


def clamped_frequencies(elements: tuple[Element, ...], modes: int = 3) -> np.ndarray:
    """Lowest frequencies in the x-z plane of a steel rotor clamped at its left end [rad/s]."""
    nodes = sum(element.count for element in elements)
    matrices = assemble_rotor(Rotor(elements=elements, masters=(0, nodes)))
    in_plane = np.ix_(*[np.sort(np.r_[4 : 4 * nodes + 4 : 4, 7 : 4 * nodes + 4 : 4])] * 2)
    return np.sqrt(
        linalg.eigh(matrices.stiffness[in_plane], matrices.mass[in_plane], eigvals_only=True)[:modes]
    )


CONE = Element(
    length=0.4, outer_diameter=0.05, outer_diameter_right=0.03, inner_diameter=0.01, inner_diameter_right=0.02
)


def divided_cone(count: int) -> Element:
    return CONE.model_copy(update={"length": 0.4 / count, "count": count})


def short_cylinders(count: int) -> tuple[Element, ...]:
    """Cylinders with the diameters in the middle of each part of the cone."""
    return tuple(
        Element(
            length=0.4 / count,
            outer_diameter=0.5 * (part.outer_diameter + part.right_diameters[0]),
            inner_diameter=0.5 * (part.inner_diameter + part.right_diameters[1]),
        )
        for part in divided_cone(count).divided()
    )


def test_cones_converge_to_many_short_cylinders():
    """Both with order 2, towards the same frequencies."""
    cones = [clamped_frequencies((divided_cone(count),)) for count in (16, 32, 64)]
    cylinders = [clamped_frequencies(short_cylinders(count)) for count in (16, 32, 64)]
    limit = (4.0 * cones[2] - cones[1]) / 3.0
    np.testing.assert_allclose((4.0 * cylinders[2] - cylinders[1]) / 3.0, limit, rtol=1e-5)
    for approached in (cones, cylinders):
        errors = np.abs(np.array(approached) / limit - 1)
        np.testing.assert_allclose(np.log2(errors[:-1] / errors[1:]), 2.0, atol=0.15)


def test_a_row_of_elements_is_one_cone():
    parts = divided_cone(4).divided()
    assert [part.count for part in parts] == [1] * 4
    assert parts[0].outer_diameter == 0.05
    assert parts[-1].right_diameters == (0.03, 0.02)
    for left, right in pairwise(parts):
        assert left.right_diameters == (right.outer_diameter, right.inner_diameter)
    assert [part.outer_diameter for part in parts] == pytest.approx([0.05, 0.045, 0.04, 0.035])
    assert sum(part.volume for part in parts) == pytest.approx(CONE.volume, rel=1e-14)
    assert divided_cone(4).volume == pytest.approx(CONE.volume, rel=1e-14)


def test_inertia_and_weight_of_a_cone_are_those_of_the_solid():
    """A full cone, 40 mm wide at z = 0, cut at 4 mm: differences of cones with I_p = 3/10 m r^2."""
    tip = 0.25 / 0.9  # the cut cone is 0.25 m long

    def cone(height: float, radius: float) -> tuple[float, ...]:
        """Mass, static moment, diametral inertia about the base, polar inertia of a full cone."""
        mass = 7850.0 * np.pi / 3 * radius**2 * height
        polar = 0.3 * mass * radius**2
        return mass, mass * height / 4, polar / 2 + mass * height**2 / 10, polar

    whole, cut = cone(tip, 0.02), cone(0.1 * tip, 0.002)
    shift = 0.25
    mass = whole[0] - cut[0]
    moment = whole[1] - (cut[1] + cut[0] * shift)
    polar = whole[3] - cut[3]
    diametral = whole[2] - (cut[2] + 2 * shift * cut[1] + cut[0] * shift**2)
    element = Element(length=0.05, count=5, outer_diameter=0.04, outer_diameter_right=0.004)
    matrices = assemble_rotor(Rotor(elements=(element,), masters=(0, 5)))
    motions = rigid_motions(matrices.node_position, about=0.0)
    seen = motions.T @ matrices.mass @ motions
    np.testing.assert_allclose([seen[0, 0], seen[0, 2], seen[2, 2]], [mass, moment, diametral], rtol=1e-12)
    turned = motions.T @ matrices.gyroscopic @ motions
    assert turned[2, 3] == pytest.approx(-polar, rel=1e-12)
    # the weights of the nodes have the resultant of the body's weight
    weights = -matrices.gravity_load[1::4] / 9.81
    assert weights.sum() == pytest.approx(mass, rel=1e-12)
    assert weights @ matrices.node_position == pytest.approx(moment, rel=1e-12)


def test_a_disc_by_dimensions_is_a_ring_of_its_material():
    """The disc of a shaft of one element: consistent inertia of the same ring."""
    disc = Disc(node=0, outer_diameter=0.08, inner_diameter=0.02, width=0.03, material="steel")
    found = disc.inertia({"steel": STEEL})
    ring = Element(length=0.03, outer_diameter=0.08, inner_diameter=0.02)
    matrices = assemble_rotor(Rotor(elements=(ring,), masters=(0, 1)))
    motions = rigid_motions(matrices.node_position, about=0.015)
    seen = motions.T @ matrices.mass @ motions
    np.testing.assert_allclose([found.mass, found.diametral], [seen[0, 0], seen[2, 2]], rtol=1e-12)
    turned = motions.T @ matrices.gyroscopic @ motions
    assert found.polar == pytest.approx(-turned[2, 3], rel=1e-12)
    rotor = Rotor(elements=(ring,), discs=(disc,), masters=(0, 1))
    assert rotor.mass == pytest.approx(2 * found.mass, rel=1e-14)


def free(rotor: Rotor) -> Rotor:
    return rotor.model_copy(update={"supports": ()})


def rigid_motions(position: np.ndarray, about: float) -> np.ndarray:
    """Columns: x, y translation, tilt beta (x = z - about), tilt alpha (y = -(z - about))."""
    motions = np.zeros((4 * position.size, 4))
    motions[0::4, 0] = 1.0
    motions[1::4, 1] = 1.0
    motions[0::4, 2], motions[3::4, 2] = position - about, 1.0
    motions[1::4, 3], motions[2::4, 3] = -(position - about), 1.0
    return motions


def rigid_body_inertia(rotor: Rotor) -> tuple[float, float, float, float]:
    """Mass, static moment about z = 0, diametral inertia about z = 0, polar inertia, part by part."""
    totals = np.zeros(4)
    left = 0.0
    for element in rotor.single_elements():
        outer, inner, length = element.outer_diameter, element.inner_diameter, element.length
        density = rotor.materials[element.material].density
        line_mass = density * np.pi / 4 * (outer**2 - inner**2)
        line_inertia = density * np.pi / 64 * (outer**4 - inner**4)
        right = left + length
        totals += [
            line_mass * length,
            line_mass * (right**2 - left**2) / 2,
            line_mass * (right**3 - left**3) / 3 + line_inertia * length,
            2 * line_inertia * length,
        ]
        left = right
    for disc in rotor.discs:
        z = rotor.node_positions()[disc.node]
        totals += [disc.mass, disc.mass * z, disc.diametral_inertia + disc.mass * z**2, disc.polar_inertia]
    return tuple(totals)


def test_rigid_motions_see_the_bodys_mass_and_inertia_and_no_stiffness(stepped_rotor):
    rotor = free(stepped_rotor)
    matrices = assemble_rotor(rotor)
    motions = rigid_motions(matrices.node_position, about=0.0)
    mass, moment, diametral, polar = rigid_body_inertia(rotor)
    expected_mass = [
        [mass, 0, moment, 0],
        [0, mass, 0, -moment],
        [moment, 0, diametral, 0],
        [0, -moment, 0, diametral],
    ]
    np.testing.assert_allclose(motions.T @ matrices.mass @ motions, expected_mass, rtol=1e-12, atol=1e-14)
    # H = I_p Omega e: tilting about y turns it about x, G(alpha, beta) = I_p
    expected_gyroscopic = np.zeros((4, 4))
    expected_gyroscopic[3, 2], expected_gyroscopic[2, 3] = polar, -polar
    np.testing.assert_allclose(
        motions.T @ matrices.gyroscopic @ motions, expected_gyroscopic, rtol=1e-12, atol=1e-16
    )
    assert np.max(np.abs(matrices.stiffness @ motions)) < 1e-12 * np.max(matrices.stiffness)


def test_matrices_have_the_symmetries_of_their_energies(stepped_rotor):
    matrices = assemble_rotor(free(stepped_rotor))
    for symmetric in (matrices.mass, matrices.stiffness, matrices.damping):
        np.testing.assert_allclose(symmetric, symmetric.T, rtol=0, atol=1e-14 * np.max(symmetric))
    np.testing.assert_allclose(matrices.gyroscopic, -matrices.gyroscopic.T, atol=1e-18)
    linalg.cholesky(matrices.mass)  # positive definite, or it raises


def test_supports_add_to_x_and_y_of_their_node_and_are_not_rayleigh_damped(stepped_rotor):
    with_supports, without = assemble_rotor(stepped_rotor), assemble_rotor(free(stepped_rotor))
    added_stiffness = with_supports.stiffness - without.stiffness
    added_damping = with_supports.damping - without.damping
    # the differences of entries of 1e8 N/m are exact to 1e-8 N/m
    np.testing.assert_allclose(added_stiffness[4:6, 4:6], [[1e6, 3e5], [-4e5, 2e6]], rtol=1e-12)
    np.testing.assert_allclose(added_stiffness[20:22, 20:22], [[5e6, 0], [0, 6e6]], rtol=1e-12)
    np.testing.assert_allclose(added_damping[4:6, 4:6], [[50, 0], [0, 60]], rtol=1e-12)
    assert np.count_nonzero(np.abs(added_stiffness) > 1e-3) == 6
    assert np.count_nonzero(np.abs(added_damping) > 1e-6) == 2
    np.testing.assert_allclose(without.damping, 2.0 * without.mass + 1e-5 * without.stiffness, rtol=1e-14)


def test_gravity_pulls_half_of_each_elements_weight_at_its_nodes(stepped_rotor):
    load = assemble_rotor(stepped_rotor).gravity_load
    assert not load[0::4].any()
    assert not load[2::4].any()
    assert not load[3::4].any()
    assert load.sum() == pytest.approx(-9.81 * stepped_rotor.mass, rel=1e-14)
    first_element = 7850.0 * np.pi / 4 * 0.02**2 * 0.03
    assert load[1] == pytest.approx(-9.81 * (0.4 + first_element / 2), rel=1e-14)
    assert load[5] == pytest.approx(-9.81 * first_element, rel=1e-14)
