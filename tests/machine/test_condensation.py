"""Guyan condensation: exact in statics, rigid motions preserved, frequencies from above, state-space form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg

from pipelines.case.models import Element, Rotor, Support
from pipelines.machine.condensation import condense, master_freedoms, state_space
from pipelines.machine.rotor_modes import oscillating_modes
from pipelines.machine.shaft import assemble_rotor


def held(rotor: Rotor) -> Rotor:
    """The rotor on symmetric supports at two masters."""
    supports = (
        Support(node=rotor.masters[1], stiffness_xx=2e6, stiffness_yy=3e6, damping_xx=80.0, damping_yy=70.0),
        Support(node=rotor.masters[-2], stiffness_xx=1e6, stiffness_yy=4e6),
    )
    return rotor.model_copy(update={"supports": supports})


def test_statics_is_exact_at_the_masters_for_forces_there_and_for_gravity(slender_rotor):
    rotor = assemble_rotor(held(slender_rotor))
    condensed = condense(rotor, slender_rotor.masters)
    master = master_freedoms(slender_rotor.masters)
    force = np.random.default_rng(1).normal(size=master.size)
    load = rotor.gravity_load.copy()
    load[master] += force
    full = np.linalg.solve(rotor.stiffness, load)
    reduced = np.linalg.solve(condensed.stiffness, force + condensed.gravity_load)
    # rounding: the shaft is 1e4 times stiffer in its shortest element than its supports
    np.testing.assert_allclose(reduced, full[master], rtol=0, atol=1e-9 * np.max(np.abs(full[master])))

    full_without_weight = np.linalg.solve(rotor.stiffness, load - rotor.gravity_load)
    expanded = condensed.transformation @ np.linalg.solve(condensed.stiffness, force)
    np.testing.assert_allclose(expanded, full_without_weight, atol=1e-9 * np.max(np.abs(expanded)))


def test_rigid_motions_keep_their_mass_gyroscopic_moment_and_weight(slender_rotor):
    rotor = assemble_rotor(slender_rotor)
    condensed = condense(rotor, slender_rotor.masters)
    z = rotor.node_position
    full = np.zeros((4 * z.size, 4))
    full[0::4, 0] = full[1::4, 1] = 1.0
    full[0::4, 2], full[3::4, 2] = z, 1.0
    full[1::4, 3], full[2::4, 3] = z, -1.0
    at_masters = full[master_freedoms(slender_rotor.masters)]
    np.testing.assert_allclose(condensed.transformation @ at_masters, full, atol=1e-10)
    for name in ("mass", "gyroscopic"):
        expected = full.T @ getattr(rotor, name) @ full
        actual = at_masters.T @ getattr(condensed, name) @ at_masters
        np.testing.assert_allclose(actual, expected, rtol=1e-10, atol=1e-10 * np.max(np.abs(expected)))
    mass = slender_rotor.mass
    assert at_masters[:, 0] @ condensed.mass @ at_masters[:, 0] == pytest.approx(mass, rel=1e-11)
    np.testing.assert_allclose(
        at_masters.T @ condensed.gravity_load,
        [0, -9.81 * mass, 0, -9.81 * mass * z[-1] / 2],
        rtol=1e-10,
        atol=1e-10,
    )
    largest = np.max(condensed.stiffness)
    assert np.max(np.abs(condensed.stiffness @ at_masters)) < 1e-9 * largest


def test_rayleigh_damping_is_condensed_with_its_matrices(slender_rotor):
    condensed = condense(assemble_rotor(slender_rotor), slender_rotor.masters)
    scale = np.max(condensed.damping)
    np.testing.assert_allclose(condensed.damping, 2.43e-5 * condensed.stiffness, atol=1e-9 * scale)


def test_frequencies_come_down_to_the_full_ones_with_order_four():
    """Slaves between masters at distance h resonate at frequencies that grow as 1/h^2: error h^4.

    The bar is slender: rotary inertia and shear, small here, add errors of order h^2.
    """
    support = Support(node=0, stiffness_xx=1e9, stiffness_yy=1e9)
    rotor = Rotor(
        elements=(Element(length=0.005, outer_diameter=0.002, count=64),),
        supports=(support, support.model_copy(update={"node": 64})),
        masters=(0, 64),
    )
    matrices = assemble_rotor(rotor)
    exact = oscillating_modes(matrices, 0.0).damped_frequencies[:6]
    errors = np.array(
        [
            oscillating_modes(condense(matrices, range(0, 65, spacing)), 0.0).damped_frequencies[:6] / exact
            - 1
            for spacing in (8, 4)
        ]
    )
    assert np.all(errors > 0)  # a constrained motion is stiffer
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 4.0, atol=0.3)
    assert np.all(errors[1] < 2e-4)


def test_a_shaft_that_buckles_between_its_masters_is_refused():
    """Masters hold translations alone: Euler's load of the pinned bar between them, shear negligible."""
    euler = np.pi**2 * 206e9 * np.pi / 64 * 0.002**4 / 0.32**2

    def condensed_under(part: float, masters: tuple[int, ...]) -> None:
        element = Element(length=0.01, outer_diameter=0.002, count=32, axial_force=-part * euler)
        condense(assemble_rotor(Rotor(elements=(element,), masters=masters)), masters)

    condensed_under(0.999, (0, 32))
    condensed_under(1.001, (0, 16, 32))
    for part in (1.001, 1000.0):
        with pytest.raises(ValueError, match="buckle the shaft between its masters"):
            condensed_under(part, (0, 32))


def test_state_space_is_equation_twelve(slender_rotor):
    condensed = condense(assemble_rotor(held(slender_rotor)), slender_rotor.masters)
    form = state_space(condensed)
    rng = np.random.default_rng(2)
    position, velocity, force = rng.normal(size=(3, 14))
    speed = 1234.5
    rate = (form.constant + speed * form.per_speed) @ np.concatenate((position, velocity))
    rate += form.force_input @ force + form.gravity
    np.testing.assert_array_equal(rate[:14], velocity)
    elastic = condensed.stiffness @ position
    residual = condensed.mass @ rate[14:] + elastic + condensed.damping @ velocity
    residual += speed * condensed.gyroscopic @ velocity - force - condensed.gravity_load
    assert np.max(np.abs(residual)) < 1e-10 * np.max(np.abs(elastic))


def test_scaled_rotor_has_scaled_eigenvalues_and_the_same_sag(slender_rotor):
    condensed = condense(assemble_rotor(held(slender_rotor)), slender_rotor.masters)
    time, displacement, force = 5.2e-4, 20.4e-6, 22.8
    scaled = condensed.scaled(time, displacement, force)
    speed = 2000.0
    physical, dimensionless = (
        linalg.eigvals(form.constant + value * form.per_speed)
        for form, value in ((state_space(condensed), speed), (state_space(scaled), speed * time))
    )
    physical, dimensionless = (
        np.sort_complex(values[values.imag > 0])[:8] for values in (physical, dimensionless)
    )
    np.testing.assert_allclose(dimensionless, physical * time, rtol=1e-9)
    np.testing.assert_allclose(
        np.linalg.solve(scaled.stiffness, scaled.gravity_load) * displacement,
        np.linalg.solve(condensed.stiffness, condensed.gravity_load),
        rtol=1e-9,
        atol=1e-16,
    )


def test_free_cross_coupled_supports_are_allowed_at_slaves(stepped_rotor):
    rotor = assemble_rotor(stepped_rotor)
    condensed = condense(rotor, stepped_rotor.masters)
    master = master_freedoms(stepped_rotor.masters)
    load = np.zeros(rotor.stiffness.shape[0])
    load[master] = np.arange(1.0, 7.0)
    full = np.linalg.solve(rotor.stiffness, load)[master]
    np.testing.assert_allclose(np.linalg.solve(condensed.stiffness, load[master]), full, rtol=1e-9)


@pytest.mark.parametrize(
    ("masters", "message"),
    [
        ((7,), "do not determine the rest"),
        ((), "different nodes"),
        ((3, 3), "different nodes"),
        ((0, 15), "from 0 to 14"),
        ((-1, 7), "different nodes"),
    ],
)
def test_masters_that_cannot_be_kept_are_refused(slender_rotor, masters, message):
    with pytest.raises(ValueError, match=message):
        condense(assemble_rotor(slender_rotor), masters)


def test_two_masters_at_the_ends_of_a_finely_divided_rotor_are_enough():
    rotor = Rotor(elements=(Element(length=0.001, outer_diameter=0.02, count=200),), masters=(0, 200))
    condensed = condense(assemble_rotor(rotor), rotor.masters)
    assert condensed.mass[::2, ::2].sum() == pytest.approx(rotor.mass, rel=1e-6)


def test_only_masters_have_a_position(slender_rotor):
    condensed = condense(assemble_rotor(slender_rotor), slender_rotor.masters)
    assert condensed.position(4) == 4
    with pytest.raises(ValueError, match="node 5 is not a master node"):
        condensed.position(5)


def test_slopes_stand_behind_the_translations_of_their_node(slender_rotor):
    condensed = condense(assemble_rotor(slender_rotor), slender_rotor.masters, slopes=(0, 4))
    np.testing.assert_array_equal(condensed.freedoms[:10], [0, 1, 2, 3, 8, 9, 16, 17, 18, 19])
    assert condensed.masters == slender_rotor.masters
    assert condensed.slopes == (0, 4)
    assert [condensed.position(node) for node in (0, 2, 4, 7)] == [0, 4, 6, 10]
    # a master keeps its own displacement and slope
    np.testing.assert_array_equal(condensed.transformation[condensed.freedoms], np.eye(18))


def test_all_nodes_with_their_slopes_are_the_full_rotor(slender_rotor):
    full = assemble_rotor(held(slender_rotor))
    condensed = condense(full, range(15), slopes=range(15))
    np.testing.assert_array_equal(condensed.transformation, np.eye(60))
    for speed in (0.0, 3000.0):
        exact, found = (oscillating_modes(rotor, speed).damped_frequencies for rotor in (full, condensed))
        np.testing.assert_allclose(found, exact, rtol=1e-10)


def test_slopes_are_scaled_like_a_displacement_over_a_length(slender_rotor):
    """The same eigenvalues and sag in other units; moments and slopes do the work of forces and lengths."""
    condensed = condense(assemble_rotor(held(slender_rotor)), slender_rotor.masters, slopes=(0, 14))
    time, displacement, force, length = 5.2e-4, 20.4e-6, 22.8, 0.016
    scaled = condensed.scaled(time, displacement, force, length)
    speed = 2000.0
    physical, dimensionless = (
        linalg.eigvals(form.constant + value * form.per_speed)
        for form, value in ((state_space(condensed), speed), (state_space(scaled), speed * time))
    )
    physical, dimensionless = (
        np.sort_complex(values[values.imag > 0])[:8] for values in (physical, dimensionless)
    )
    np.testing.assert_allclose(dimensionless, physical * time, rtol=1e-9)
    sag, scaled_sag = (np.linalg.solve(one.stiffness, one.gravity_load) for one in (condensed, scaled))
    unit = np.where(condensed.freedoms % 4 < 2, displacement, displacement / length)
    np.testing.assert_allclose(scaled_sag * unit, sag, rtol=1e-9, atol=1e-14)
    translations = np.arange(60) % 4 < 2
    np.testing.assert_allclose(
        (scaled.transformation @ scaled_sag * displacement)[translations],
        (condensed.transformation @ sag)[translations],
        rtol=1e-9,
        atol=1e-14,
    )
