"""Critical coefficients of maps whose normal forms are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipelines.bifurcations.curve import CurveOptions, CurveStart
from pipelines.bifurcations.normal_forms.coefficients import NormalForm, NormalFormOptions
from pipelines.bifurcations.plane import CurveProblem
from tests.bifurcations.curve_runs import FLIP, FOLD, NS, map_problem, start, trace
from tests.bifurcations.explicit_maps import cusp_map, delayed_logistic, flip_map, henon, rotation_map

PLANE = ((-5.0, 5.0), (-5.0, 5.0))


def form_of(problem: CurveProblem, begin: CurveStart, options: NormalFormOptions | None = None) -> NormalForm:
    options = NormalFormOptions() if options is None else options
    run = trace(problem, begin, CurveOptions(PLANE, max_points=1, normal_form=options))
    form = run.points[0].normal_form
    assert form is not None
    return form


@pytest.mark.parametrize(("q", "c"), [(0.6, -0.8), (0.0, 0.3), (-1.1, 0.2)])
def test_flip(q: float, c: float) -> None:
    form = form_of(map_problem(flip_map(), FLIP, (0, q, c, 0.5), ("c", "m")), start(np.zeros(2), (c, 0.0)))
    assert form.coefficient == pytest.approx(c + q * q, abs=1e-7)
    assert form.error < 1e-6
    assert form.supercritical == (c + q * q > 0.0)


def test_flip_of_the_henon_map() -> None:
    """With the other multiplier -b, b_flip = a^2/(1 - b)^2-like terms follow from the centre manifold."""
    b = 0.3
    a, x = 0.75 * (1 - b) ** 2, 2.0 / (3.0 * (1.0 - b))
    form = form_of(map_problem(henon(), FLIP, (0, 0), ("a", "b")), start([x, b * x], (a, b)))
    # q = (1, -b)/n, p = n (1, -1)/(1 + b), B(u, v) = (-2 a u_1 v_1, 0), C = 0
    n = math.hypot(1.0, b)
    matrix = np.array([[-2.0 * a * x, 1.0], [b, 0.0]])
    h = np.linalg.solve(np.eye(2) - matrix, [-2.0 * a / n**2, 0.0])
    left = np.linalg.solve(np.column_stack([[1.0, -b], [1.0, 1.0]]).T, [n, 0.0])
    assert np.allclose(left @ matrix, -left)
    assert form.coefficient == pytest.approx(0.5 * left[0] * (-2.0 * a) * h[0] / n, abs=1e-9)


@pytest.mark.parametrize("theta", [0.7, 1.9, 2.9])
@pytest.mark.parametrize("real", [-0.6, 0.4])
def test_neimark_sacker(theta: float, real: float) -> None:
    """q = (1, -+i)/sqrt 2 means abs(w)^2 = 2 abs(z)^2; the driven direction u has no effect."""
    problem = map_problem(rotation_map(), NS, (0, theta, real, 0, 0.8), ("theta", "m"))
    form = form_of(problem, start(np.zeros(3), (theta, 0.0), theta))
    assert form.coefficient == pytest.approx(2.0 * (real + 0.7j), abs=1e-7)
    assert form.supercritical == (real < 0.0)


def test_neimark_sacker_of_the_delayed_logistic_map() -> None:
    """Quadratic terms only: d = p.[2 B(q, h11) + B(q*, h20)]/(2 mu) with r = 2, theta = pi/3."""
    form = form_of(
        map_problem(delayed_logistic(), NS, (0, 0), ("r", "e")), start([0.5, 0.5], (2.0, 0.0), math.pi / 3)
    )
    mu = np.exp(1j * math.pi / 3)
    matrix = np.array([[1.0, -1.0], [1.0, 0.0]])
    q = np.array([mu, 1.0]) / math.sqrt(2.0)
    left = np.array([1.0, -1.0 / mu])
    left = left / (left @ q)
    assert np.allclose(left @ matrix, mu * left)

    def quadratic(u, v):  # type: ignore[no-untyped-def]
        return np.array([-2.0 * (u[0] * v[1] + u[1] * v[0]), 0.0])

    h11 = np.linalg.solve(np.eye(2) - matrix, quadratic(q, np.conj(q)))
    h20 = np.linalg.solve(mu**2 * np.eye(2) - matrix, quadratic(q, q))
    expected = left @ (2.0 * quadratic(q, h11) + quadratic(np.conj(q), h20)) / (2.0 * mu)
    assert form.coefficient == pytest.approx(expected, abs=1e-9)


def test_fold() -> None:
    half = math.sqrt(0.1)
    form = form_of(
        map_problem(cusp_map(), FOLD, (0, 0), ("m", "n")), start([half, 1.25 * half], (-2.0 * half**3, 0.3))
    )
    # q = (1, 1.25)/n, p.q = 1
    assert abs(form.coefficient) == pytest.approx(3.0 * half / math.hypot(1.0, 1.25), abs=1e-9)
    assert not form.supercritical


def test_error_estimate_bounds_the_error() -> None:
    """Coarse differences: the true error stays below the estimate."""
    problem = map_problem(delayed_logistic(), NS, (0, 0), ("r", "e"))
    begin = start([0.5, 0.5], (2.0, 0.0), math.pi / 3)
    exact = form_of(problem, begin).coefficient
    for difference in (0.3, 0.1, 0.03):
        form = form_of(problem, begin, NormalFormOptions(difference))
        assert abs(form.coefficient - exact) <= form.error + 1e-10


def test_options_are_checked() -> None:
    with pytest.raises(ValueError, match="difference"):
        NormalFormOptions(0.0)
