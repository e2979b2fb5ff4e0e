"""Plausible numbers of a rotor on two foil bearings, in the layout of a store: invented, for drawing only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.datasets.branch import open_branch, write_group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, create_store
from tests.figures.synthetic_runs import write_runs
from tests.helpers.curves import Path2, curve_rows, oval, write_curve, write_set
from tests.helpers.surveys import write_certificate, write_survey

Arrays = dict[str, NDArray[Any]]

MASTERS = np.array([0, 2, 4, 7, 10, 12, 14])
PARTS = (
    "machine",
    "linear",
    "operating_point",
    "coefficients",
    "criticals",
    "unbalance_response",
    "cycles",
    "doubled",
    "curves",
    "set",
    "tori",
    "runs",
)
SAMPLES, SNAPSHOTS, THETAS, STATES, MULTIPLIERS = 64, 8, 41, 40, 12
TORUS_ANGLES = 33


def machine(hollow: bool = False) -> Arrays:
    """A shaft of 14 elements with a disc at each end and bearings at nodes 2 and 12."""
    length = np.full(14, 0.360 / 14)
    material = np.zeros(14, dtype=np.int32)
    inner = np.zeros(14)
    if hollow:
        material[5:9], inner[5:9] = 1, 0.008
    return {
        "node_position": np.concatenate([[0.0], np.cumsum(length)]),
        "element_length": length,
        "element_outer": np.full(14, 0.0176),
        "element_inner": inner,
        "element_material": material,
        "disc_node": np.array([0, 14]),
        "disc_mass": np.array([0.079, 0.079]),
        "disc_diameter_equivalent": np.array([0.054, 0.054]),
        "bearing_node": np.array([2, 12]),
        "bearing_length": np.array([0.0161, 0.0161]),
        "bearing_radius": np.array([0.014, 0.014]),
        "bearing_clearance": np.array([20.4e-6, 20.4e-6]),
        "master_node": MASTERS,
        "support_node": np.array([7]) if hollow else np.zeros(0, dtype=int),
    }


def _locus(speed: NDArray[np.float64]) -> NDArray[np.float64]:
    """Static journal centres (speed, 2): from the bottom of the clearance towards its middle."""
    eccentricity = 0.75 / (1.0 + 1.1 * speed)
    attitude = -np.pi / 2 + 0.9 * np.tanh(1.2 * speed)
    return np.column_stack([eccentricity * np.cos(attitude), eccentricity * np.sin(attitude)])


def linear(points: int = 41) -> Arrays:
    """Equilibria over the speed with a Hopf point at 1.078."""
    speed = np.linspace(0.2, 1.4, points)
    journal = np.stack([_locus(speed), 0.97 * _locus(speed)], axis=1)
    pairs = [(0.9 * (speed - 1.078), 0.46 * speed + 0.03), (-0.12 - 0.05 * speed, 0.44 * speed + 0.1),
             (-0.25 + 0.05 * speed, 0.9 + 0.1 * speed), (-0.4 - 0.0 * speed, 1.7 + 0.05 * speed),
             (-0.62 + 0.1 * speed, 2.3 - 0.1 * speed)]  # fmt: skip
    eigenvalues = np.column_stack(
        [v for real, imag in pairs for v in (0.1 * real + 1j * imag, 0.1 * real - 1j * imag)]
    )
    ratios = np.array([0.5, 1.0])
    shape = (points, 2, 2)
    stiffness, damping = np.zeros((*shape, 2, 2)), np.zeros((*shape, 2, 2))
    for number, ratio in enumerate(ratios):
        direct, cross = 1.2 + 0.8 * speed * ratio, 0.9 / (1 + speed) * ratio
        for bearing in range(2):
            stiffness[:, number, bearing] = np.moveaxis(
                np.array([[direct, cross], [-1.1 * cross, 1.3 * direct]]), 2, 0
            )
            damping[:, number, bearing] = np.moveaxis(
                np.array([[1.5 / speed**0.4, 0.2 * cross], [-0.2 * cross, 1.9 / speed**0.4]]), 2, 0
            )
    return {
        "speed": speed,
        "whirl_ratio": ratios,
        "journal": journal,
        "minimum_film": 0.95 - np.hypot(journal[..., 0], journal[..., 1]),
        "eigenvalues": eigenvalues,
        "bearing_stiffness": stiffness,
        "bearing_damping": damping,
    }


def operating_point() -> Arrays:
    """A bent shaft in two bearings with five modes, the first of them unstable."""
    x = np.linspace(-1.0, 1.0, 15)
    forms = [1.0 + 0.1 * x, x, 1.0 - 2.0 * x**2, x - 1.5 * x**3, 1.0 - 3.0 * x**2]
    turns = [-1j, 1j, -1j, 1j, 0.0]
    frequency = np.array([0.4, 0.55, 1.3, 1.5, 2.6])
    damping = np.array([-0.02, 0.1, 0.01, 0.012, 0.02])
    hertz = frequency * SCALES["hertz_per_unit"]
    return {
        "deflection": 1e-6 * np.column_stack([3.0 + x, -6.0 + 2.0 * x**2]),
        "bearing_node": np.array([2, 12], dtype=np.int32),
        "reaction": np.array([[0.0, 4.0], [0.0, 3.5]]),
        "journal": np.array([[0.3, -0.2], [0.28, -0.25]]),
        "eccentricity": np.array([0.36, 0.375]),
        "attitude_angle": np.array([0.98, 0.84]),
        "minimum_film": np.array([14e-6, 13e-6]),
        "stiffness": 1e6 * np.array([[[1.0, 0.2], [-0.3, 1.4]], [[0.9, 0.2], [-0.3, 1.3]]]),
        "damping": 1e2 * np.array([[[1.0, 0.2], [-0.3, 1.4]], [[0.9, 0.2], [-0.3, 1.3]]]),
        "eigenvalue": frequency * (1j - damping),
        "frequency_hertz": hertz,
        "frequency_rpm": 60.0 * hertz,
        "logarithmic_decrement": 2.0 * np.pi * damping,
        "damping_ratio": damping / np.sqrt(1.0 + damping**2),
        "direction": np.array([1, 0, 1, 0, 2], dtype=np.int8),
        "mode_shape": np.stack([np.column_stack([f, t * f]) for f, t in zip(forms, turns, strict=True)]),
    }


def coefficients() -> Arrays:
    """K and C over eight speeds and twelve whirl frequencies; the second speed has no equilibrium."""
    speed, frequency = np.linspace(0.2, 1.6, 8), np.linspace(0.0, 1.6, 12)
    stiff = (1.0 + 0.4 * speed[:, None]) * frequency**2 / (0.3 + frequency**2) + 0.5
    damp = 1.5 / (0.4 + speed[:, None] * frequency)
    entries = np.array([[1.0, 0.4], [-0.5, 1.2]])
    shape = (8, 12, 2, 2, 2)
    stiffness = np.broadcast_to(stiff[:, :, None, None, None] * entries, shape).copy()
    damping = np.broadcast_to(damp[:, :, None, None, None] * entries, shape).copy()
    stiffness[1], damping[1] = np.nan, np.nan
    return {
        "speed": speed,
        "frequency": frequency,
        "stiffness": stiffness,
        "damping": damping,
        "bearing_node": np.array([2, 12], dtype=np.int32),
    }


def unbalance_response() -> Arrays:
    """Two planes and probes; x has a resonance at 0.5 and y another at 0.8."""
    speed = np.linspace(0.1, 1.4, 80)
    single = np.stack([speed**2 / (w**2 - speed**2 + 0.1j * speed) for w in (0.5, 0.8)], axis=-1)
    weights = np.array([[0.02, 0.01], [0.01, 0.015]])
    return {
        "speed": speed,
        "plane_node": np.array([0, 14], dtype=np.int32),
        "plane_moment": np.array([1e-6, 2e-6]),
        "plane_phase": np.array([0.0, 1.0]),
        "probe_node": np.array([2, 12], dtype=np.int32),
        "response": weights[None, :, :, None] * single[:, None, None, :],
        "journal_motion": 0.05 * np.ones((80, 2)),
        "peak_probe": np.array([0, 0, 1, 1], dtype=np.int32),
        "peak_axis": np.array([0, 1, 0, 1], dtype=np.int8),
        "peak_speed": np.array([0.5, 0.8, 0.5, 0.8]),
        "peak_amplitude": np.array([0.15, 0.24, 0.125, 0.2]),
        "peak_phase": np.full(4, -0.5 * np.pi),
        "peak_low": np.array([0.45, 0.75, 0.45, 0.75]),
        "peak_high": np.array([0.55, 0.85, 0.55, np.nan]),
        "peak_amplification": np.array([5.0, 8.0, 5.0, np.nan]),
    }


def criticals() -> Arrays:
    """Six modes, five critical speeds, their shapes, resonances to order three, full and condensed rotor."""
    speed = np.linspace(0.05, 1.4, 40)
    start, slope = (
        np.array([0.31, 0.33, 0.62, 0.68, 1.35, 1.38]),
        np.array([0.02, 0.05, -0.05, 0.08, -0.16, 0.18]),
    )
    frequency = start + slope * speed[:, None]
    direction = np.where(slope > 0, 1, 0) * np.ones((40, 1), dtype=np.int8)
    critical = start[:5] / (1 - slope[:5])
    x = np.linspace(-1, 1, 15)
    forms = [np.cos(1.3 * x) + 0.1, np.cos(1.3 * x), x, 1.1 * x**3 - 0.2 * x, np.cos(2.6 * x) - 0.2]
    shapes = np.stack(
        [
            np.column_stack([0.8j * (1 if j % 2 else -1) * f, f * np.exp(0.1j * x)])
            for j, f in enumerate(forms)
        ]
    )
    j, k, order = (
        grid.ravel() for grid in np.meshgrid(np.arange(4), np.arange(4), np.arange(1, 4), indexing="ij")
    )
    rows = [(2 * critical[a] / n, a, a, n, 0) for a, b, n in zip(j, k, order, strict=True) if a == b]
    rows += [
        ((critical[a] + critical[b]) / n, a, b, n, 1) for a, b, n in zip(j, k, order, strict=True) if a < b
    ]
    rows += [
        (abs(critical[a] - critical[b]) / n, a, b, n, 2) for a, b, n in zip(j, k, order, strict=True) if a < b
    ]
    table = np.array(rows)
    unbalance = np.linspace(0.05, 1.5, 200)
    response = sum(unbalance**2 / np.abs(w**2 - unbalance**2 + 0.06j * w * unbalance) for w in critical[:3])
    modes = 8
    full = np.array([0.31, 0.33, 0.62, 0.68, 1.35, 1.38, 2.4, 2.5])
    stiffness = np.logspace(4.5, 8.5, 21)
    mac = np.eye(modes) * 0.97 + 0.02
    mac[6, 6], mac[7, 7], mac[6, 7] = 0.81, 0.78, 0.2
    return {
        "speed": speed,
        "frequency": frequency,
        "damping_ratio": np.abs(np.linspace(0.05, 0.6, 6) * (1.2 - 0.4 * speed[:, None])),
        "direction": direction,
        "critical_speed": critical,
        "critical_damping_ratio": np.array([0.04, 0.11, 0.21, 0.3, 0.45]),
        "critical_direction": np.array([1, 2, 0, 1, 0], dtype=np.int8),
        "critical_mode_shape": shapes,
        "resonance_frequency": table[:, 0],
        "resonance_j": table[:, 1].astype(int) + 1,
        "resonance_k": table[:, 2].astype(int) + 1,
        "resonance_order": table[:, 3].astype(int),
        "resonance_kind": table[:, 4].astype(np.int8),
        "full_frequency": full,
        "condensed_frequency": full * (1 + 0.0004 * np.arange(modes) ** 2.2),
        "full_decrement": np.linspace(0.2, 1.4, modes),
        "condensed_decrement": np.linspace(0.2, 1.4, modes) * 1.03,
        "mac": mac,
        "support_stiffness": stiffness,
        "map_forward": np.sqrt(stiffness[:, None] / (1e7 + stiffness[:, None])) * [1.0, 1.6],
        "map_backward": np.sqrt(stiffness[:, None] / (1e7 + stiffness[:, None])) * [0.9, 1.3],
        "direct_stiffness": 1e6 * (1.0 + 0.3 * unbalance[:, None, None]) * np.array([[1.0, 1.4], [0.9, 1.3]]),
        "unbalance_speed": unbalance,
        "response_node": np.array([7, 14]),
        "unbalance_full": np.column_stack([response, 0.6 * response]),
        "unbalance_condensed": np.column_stack([1.02 * response, 0.61 * response]),
    }


def cycles(points: int = 40) -> tuple[Arrays, list[dict[str, Any]]]:
    """A branch over the speed with a PD window from 0.5 to 0.62 and an NS at 1.2; and its bifurcations."""
    speed = np.linspace(0.3, 1.3, max(points, 2))[:points]
    phase = 2 * np.pi * np.arange(SAMPLES) / SAMPLES
    centre = _locus(speed)
    orbit = np.zeros((points, SAMPLES, 2 * len(MASTERS)))
    for master in range(len(MASTERS)):
        radius = (0.08 + 0.05 * speed + 0.01 * (master == 5))[:, None]
        orbit[:, :, 2 * master] = centre[:, :1] + radius * (np.cos(phase + 0.3) + 0.2 * np.cos(2 * phase))
        orbit[:, :, 2 * master + 1] = centre[:, 1:] + 1.3 * radius * np.sin(phase)
    journals = orbit[:, :, [2, 3, 10, 11]].reshape(points, SAMPLES, 2, 2)
    theta = np.linspace(0, 2 * np.pi, THETAS)
    instants = journals[:, :: SAMPLES // SNAPSHOTS]
    bump = np.cos(theta) * instants[..., :1] + np.sin(theta) * instants[..., 1:]
    pressure = 1.0 + np.sin(theta / 2) ** 2 * (0.8 * bump + 1.2 * np.maximum(bump, 0) ** 3)
    foil = (pressure - 1.0) / 10.0 - 0.1 * (1 + np.sin(2 * np.pi * np.arange(8) / 8))[
        None, :, None, None
    ] * np.sin(theta) ** 2
    multipliers, unstable = _multipliers(speed)
    events = [
        _event("period_doubling", 0.5, speed, -1.0 + 0j),
        _event("period_doubling", 0.62, speed, -1.0 + 0j),
        _event("neimark_sacker", 1.2, speed, np.exp(2.05j)),
    ]
    arrays = {
        "speed": speed,
        "excitation_frequency": np.full(points, 0.7),
        "displacement": np.full(points, 0.2),
        "foil_stiffness": np.full(points, 10.0),
        "period": np.full(points, 2 * np.pi / 0.7),
        "state": np.outer(speed, np.ones(STATES)),
        "multipliers": multipliers,
        "multiplier_residual": np.full((points, MULTIPLIERS), 1e-9),
        "multiplier_count": np.full(points, 8),
        "step": np.full(points, 0.02),
        "arclength": np.linspace(0.0, 1.0, points),
        "direction": np.ones(points, dtype=np.int8),
        "newton_iterations": np.full(points, 4),
        "steps_per_period": np.full(points, 50),
        "step_error": np.full(points, 5e-7),
        "coarser_error": np.full(points, 1.6e-5),
        "unstable_count": unstable,
        "unexplained": np.zeros(len(unstable), dtype=np.int8),
        "orbit": orbit,
        "orbit_minimum": orbit.min(axis=1),
        "orbit_maximum": orbit.max(axis=1),
        "minimum_pressure": np.full((points, 2), 0.85),
        "minimum_film": 0.9 - np.hypot(journals[..., 0], journals[..., 1]).max(axis=1),
        "minimum_film_trace": 0.9 - np.hypot(journals[..., 0], journals[..., 1]),
        "film_pressure": pressure,
        "foil_displacement": foil,
        "film_thickness": 1 - bump + foil,
        "theta": np.array([theta, theta]),
    }
    return arrays, [event for event in events if event["event_after_point"] < points - 1]


def _multipliers(speed: NDArray[np.float64]) -> tuple[NDArray[np.complex128], NDArray[np.int64]]:
    """A pair leaving the circle at 1.2, a real one through -1 in the PD window, and slow ones inside."""
    modulus = np.exp(0.5 * (speed - 1.2))
    pair = modulus * np.exp(1j * (1.2 + 0.85 * (speed - 0.2)))
    flip = -(0.6 + 0.42 * np.exp(-(((speed - 0.56) / 0.13) ** 2))) - 0.0 * 1j
    flip = np.where((speed > 0.5) & (speed < 0.62), np.minimum(flip, -1.001), np.maximum(flip.real, -0.999))
    second = 0.72 * np.exp(1j * (2.4 - 0.4 * speed))
    third = 0.4 * np.exp(1j * (0.8 + speed))
    real = 0.3 + 0.1 * speed
    values = np.column_stack([pair, pair.conj(), flip, second, second.conj(), third, third.conj(), real])
    padded = np.full((len(speed), MULTIPLIERS), np.nan + 0j)
    padded[:, : values.shape[1]] = values
    return padded, np.asarray((np.abs(values) > 1).sum(axis=1))


def _event(kind: str, value: float, speed: NDArray[np.float64], multiplier: complex) -> dict[str, Any]:
    multipliers = np.full(MULTIPLIERS, np.nan + 0j)
    multipliers[:2] = multiplier, np.conj(multiplier)
    if kind == "period_doubling":
        multipliers[1] = 0.6
    return {
        "event_kind": KINDS["cycles"].array("event_kind").flag(kind),
        "event_after_point": int(np.searchsorted(speed, value)) - 1,
        "event_speed": value,
        "event_excitation_frequency": 0.7,
        "event_displacement": 0.2,
        "event_foil_stiffness": 10.0,
        "event_period": 2 * np.pi / 0.7,
        "event_state": np.full(STATES, value),
        "event_multipliers": multipliers,
        "event_angle": float(np.angle(multiplier)),
        "event_transversality": 0.5,
        "event_resonance": 0,
        "event_residual": 1e-11,
    }


SCALES = {
    "time": 5.16e-4,
    "displacement": 20.4e-6,
    "pressure": 101325.0,
    "speed_rpm_per_unit": 60 / (2 * np.pi * 5.16e-4),
    "hertz_per_unit": 1 / (2 * np.pi * 5.16e-4),
}
ATTRIBUTES: dict[str, dict[str, Any]] = {
    "machine": {
        "material_names": ["steel", "titanium"],
        "rotor": {
            "mass": 0.76,
            "centre_of_gravity": 0.18,
            "diametral_inertia": 9e-3,
            "polar_inertia": 8e-5,
            "bearing_loads": [4.0, 3.5],
        },
    },
    "linear": {"instability_speed": 1.078},
    "operating_point": {"equilibrium": True, "reason": "", "speed": 1.2, "speed_rpm": 22207.0},
    "coefficients": {"request": {"ring": "mean"}},
    "criticals": {"compared_speed": 1.2, "unbalance_eccentricity": 0.01},
    "unbalance_response": {},
}
NOTE = "Invented numbers that only test the drawing."


def make_store(path: Path, points: int = 40, *, parts: tuple[str, ...] = PARTS, note: str = NOTE) -> Store:
    """A store of one case ``kb10`` with the chosen parts and a branch of ``points`` points."""
    case = {"name": "kb10", "parameters": {}, "scales": SCALES, "reconstruction": note}
    store = create_store(
        path, {"kb10": case}, {"configuration": {}, "configuration_hash": "0"}, durable=False
    )
    whole = {
        "machine": machine,
        "linear": linear,
        "operating_point": operating_point,
        "coefficients": coefficients,
        "criticals": criticals,
        "unbalance_response": unbalance_response,
    }
    for kind, invent in whole.items():
        if kind in parts:
            write_group(store, f"cases/kb10/{kind}", kind, invent(), ATTRIBUTES[kind])
    if "cycles" in parts:
        write_branch(store, "cases/kb10/cycles/b000", cycles(points))
    if "cycles" in parts and "doubled" in parts:
        write_doubled(store, points)
    if "curves" in parts:
        write_curves(store)
    if "tori" in parts:
        write_tori(store, min(points, 12))
    if "set" in parts:
        write_set(store, "kb10")
    if "survey" in parts:
        write_survey(store, "kb10")
    if "certificate" in parts:
        write_certificate(store, "kb10")
    if "runs" in parts:
        write_runs(store, "kb10")
    return store


def write_branch(
    store: Store, group: str, content: tuple[Arrays, list[dict[str, Any]]], stop: str = "running", **more: Any
) -> None:
    """A branch of at most 60 points over the speed, left running unless it stops; ``more``: attributes."""
    rows, events = content
    points = len(rows["speed"])
    theta = rows.pop("theta")
    sizes = {
        "point": 60,
        "event": 8,
        "component": STATES,
        "multiplier": MULTIPLIERS,
        "sample": SAMPLES,
        "bearing": 2,
    }
    sizes |= {"coordinate": 2 * len(MASTERS), "snapshot": SNAPSHOTS, "theta": THETAS}
    static = {
        "theta": theta,
        "sample": np.arange(SAMPLES) / SAMPLES,
        "snapshot": np.arange(SNAPSHOTS) / SNAPSHOTS,
        "coordinate_node": np.repeat(MASTERS, 2),
        "coordinate_axis": np.tile([0, 1], len(MASTERS)),
    }
    attributes = {"parameter": "speed", "formulation": "stroboscopic", **more}
    with open_branch(store, group, "cycles", sizes, static, attributes) as writer:
        for point in range(points):
            row = {name: values[point] for name, values in rows.items()}
            writer.commit(
                row, {"basis_columns": 8}, [e for e in events if e["event_after_point"] == point - 1]
            )
        if stop != "running":
            writer.finish(stop)


def tori(points: int = 12) -> Arrays:
    """A branch of tori from the Neimark-Sacker point at 1.2 on, unstable beyond 1.28."""
    speed = 1.2 + 0.12 * np.linspace(0.02, 1.0, max(points, 2))[:points]
    reach = 0.3 * np.sqrt(speed - 1.2)[:, None, None]
    angle = 2.0 * np.pi * np.arange(TORUS_ANGLES)[:, None] / TORUS_ANGLES
    x, y = np.cos(angle + 0.2), 0.7 * np.sin(angle) + 0.1 * np.cos(2 * angle)
    centre = np.tile(_locus(speed), len(MASTERS))
    shape = np.concatenate([x, y] * len(MASTERS), axis=1)
    curve = centre[:, None, :] + reach * shape
    return {
        "speed": speed,
        "rotation": 2.0 * np.pi * (0.38 - 0.3 * (speed - 1.2)),
        "unstable_count": (speed > 1.28).astype(int),
        "section_curve": curve,
        "orbit_minimum": curve.min(axis=1) - 0.1,
        "orbit_maximum": curve.max(axis=1) + 0.1,
    }


def write_tori(store: Store, points: int, name: str = "q000", **more: Any) -> None:
    """A branch of tori, ended; arrays that no figure reads hold zeros."""
    sizes = {"point": 60, "curve": TORUS_ANGLES, "coordinate": 2 * len(MASTERS)}
    static = {
        "curve": 2.0 * np.pi * np.arange(TORUS_ANGLES) / TORUS_ANGLES,
        "coordinate_node": np.repeat(MASTERS, 2),
        "coordinate_axis": np.tile([0, 1], len(MASTERS)),
    }
    attributes = {"parameter": "speed", **(more or {"origin": {"group": "cycles/b000", "event": 2}})}
    rows = tori(points)
    with open_branch(store, f"cases/kb10/tori/{name}", "tori", sizes, static, attributes) as writer:
        unread = {n: 0 for n, a in writer.arrays.items() if a.role == "row" and n not in rows}
        slots = {n: 0 for n, a in writer.arrays.items() if a.role == "slot"}
        for point in range(points):
            writer.commit(unread | {n: values[point] for n, values in rows.items()}, slots)
        writer.finish("maximum_points")


def doubled(turns: int, points: int, windows: tuple[tuple[float, float], ...]) -> Arrays:
    """Rows of a branch of ``turns`` periods over the last of the windows between two period doublings; each
    window splits the cycles once more.
    """
    rows, _ = cycles(points)
    low, high = windows[-1]
    # denser at the ends, as steps along the branch are
    speed = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.pi * np.arange(1, points + 1) / (points + 1))
    samples = np.arange(SAMPLES)
    turn = samples * turns // SAMPLES  # of each sample
    phase = 2 * np.pi * (samples * turns / SAMPLES)
    centre = _locus(speed)
    orbit = np.zeros((points, SAMPLES, 2 * len(MASTERS)))
    shift = np.zeros((points, SAMPLES))
    for level, (start, stop) in enumerate(windows):
        reach = np.sqrt((speed - start) * (stop - speed)) / (0.5 * (stop - start))
        sign = np.where((turn >> level) % 2 == 0, 1.0, -1.0)
        shift += 0.07 * 0.35**level * reach[:, None] * sign
    for master in range(len(MASTERS)):
        radius = (0.08 + 0.05 * speed + 0.01 * (master == 5))[:, None]
        orbit[:, :, 2 * master] = centre[:, :1] + radius * np.cos(phase + 0.3)
        orbit[:, :, 2 * master + 1] = centre[:, 1:] + 1.3 * radius * np.sin(phase) + shift
    changed = {"speed": speed, "orbit": orbit, "orbit_minimum": orbit.min(axis=1),
               "orbit_maximum": orbit.max(axis=1), "period": np.full(points, turns * 2 * np.pi / 0.7),
               "unstable_count": np.zeros(points, dtype=np.int64)}  # fmt: skip
    return rows | changed


def write_doubled(store: Store, points: int) -> None:
    """A branch of two periods between the period doublings of b000, one of four on it, and a search line."""
    origin = {"group": "cycles/b000", "event": 0}
    windows = ((0.5, 0.62), (0.53, 0.6))
    second = doubled(2, points, windows[:1])
    events = [_event("period_doubling", value, second["speed"], -1.0 + 0j) for value in (0.53, 0.6)]
    inside = [event for event in events if 0 <= event["event_after_point"] < points - 1]
    second["unstable_count"] = np.asarray((second["speed"] > 0.53) & (second["speed"] < 0.6), dtype=np.int64)
    write_branch(store, "cases/kb10/cycles/d000", (second, inside), "limit", turns=2, origin=origin)
    origin = {"group": "cycles/d000", "event": 0}
    fourth = doubled(4, points, windows)
    write_branch(store, "cases/kb10/cycles/d001", (fourth, []), "limit", turns=4, origin=origin)
    write_branch(store, "cases/kb10/cycles/s000", cycles(min(points, 3)), fixed={"excitation_frequency": 0.7})


def write_curves(store: Store) -> None:
    """A plane with everything: a threshold in two halves, a tongue, a cusp, doubled cycles, a loose end."""
    turn = 2 * np.pi

    def threshold(f: NDArray[Any]) -> NDArray[Any]:
        rise = 0.17 * np.exp(-(((f - 0.72) / 0.16) ** 2)) - 0.13 * np.exp(-(((f - 0.4) / 0.1) ** 2))
        return np.column_stack([f, 1.03 + rise + 0.03 * np.sin(4 * f)])

    right, left = curve_rows(threshold, (0.7, 2.0), 50), curve_rows(threshold, (0.7, 0.2), 24)
    right["criticality"] = np.where(right["excitation_frequency"] < 1.52, 1, 0).astype(np.int8)
    left["criticality"] = np.where(left["excitation_frequency"] < 0.45, 0, 1).astype(np.int8)
    left["criticality"][3:5] = -1
    left_specials = (
        ("R3", *_on(threshold, 0.63)),
        ("R4", *_on(threshold, 0.55)),
        ("chenciner", *_on(threshold, 0.45)),
    )
    write_curve(store, "cases/kb10/ns/c000", "neimark_sacker", right,
                specials=(("chenciner", *_on(threshold, 1.52)),
                          ("flip_neimark_sacker", *_on(threshold, 1.134))))  # fmt: skip
    write_curve(store, "cases/kb10/ns/c001", "neimark_sacker", left, specials=left_specials, half=1)
    upper = curve_rows(lambda f: np.column_stack([f, 1.24 + 0.05 * np.cos(3 * f)]), (0.2, 0.95), 20)
    upper["unstable_count"][:] = 2
    write_curve(store, "cases/kb10/ns/c002", "neimark_sacker", upper, "minimum_step")
    tongue = curve_rows(oval(1.25, 0.86, 0.13, 0.3), (0.0, turn), 60)
    tongue["unstable_count"] = np.where(tongue["speed"] > 1.0, 2, 0)
    tongue["criticality"] = np.where(tongue["excitation_frequency"] < 1.2, 0, 1).astype(np.int8)
    low = 0.86 - 0.3 * np.sqrt(1 - (0.05 / 0.13) ** 2)
    write_curve(store, "cases/kb10/pd/c000", "period_doubling", tongue, "closed",
                specials=(("generalised_flip", 1.2, low), ("flip_neimark_sacker", 1.13, 1.0)))  # fmt: skip
    inner = curve_rows(oval(1.26, 0.8, 0.06, 0.14), (0.0, turn), 40)
    write_curve(store, "cases/kb10/pd/c001", "period_doubling", inner, "closed", turns=2)
    tip = (1.72, 0.5)
    cusp = curve_rows(
        lambda a: np.column_stack([tip[0] + 0.9 * a**2, tip[1] + 0.3 * a - 1.2 * a**3]), (-0.5, 0.5), 40
    )
    cusp["criticality"][:] = -1
    write_curve(store, "cases/kb10/folds/c000", "fold", cusp, "range",
                specials=(("cusp", *tip), ("fold_flip", 1.78, 0.4447),
                          ("fold_neimark_sacker", 1.765, 0.5537)))  # fmt: skip
    stub = curve_rows(lambda f: np.column_stack([f, 0.55 + 0.3 * (f - 0.3)]), (0.3, 0.42), 8)
    write_curve(store, "cases/kb10/folds/c001", "fold", stub, "minimum_step")


def _on(path: Path2, value: float) -> tuple[float, float]:
    frequency, speed = path(np.array([value]))[0]
    return float(frequency), float(speed)
