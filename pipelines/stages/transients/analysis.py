"""Analysis of the samples of a transient, written beside it when it has ended."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array
from pipelines.datasets.branch import write_group
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.schema import TRANSIENT_ANALYSIS
from pipelines.datasets.store import Store, local_name
from pipelines.machine import film
from pipelines.machine.assembly import Machine, with_stand_ins
from pipelines.orbits.time_runs.classification import RETURNS, Classification, classify
from pipelines.orbits.time_runs.envelope import windowed_envelope, windowed_mean
from pipelines.orbits.time_runs.modal_energy import modal_energy, rotor_modes, sampled_velocity
from pipelines.orbits.time_runs.poincare import Section, level_section, phase_section
from pipelines.orbits.time_runs.spectrum import amplitude_spectrum, waterfall

Arrays = dict[str, NDArray[Any]]

KIND = TRANSIENT_ANALYSIS.kind

# Sizes stay bounded however long a run is.
MOST_WINDOWS = 1000
WINDOW_PERIODS = 4  # or fewer in a short run: several, so that beats of rings and rotation lie within
WINDOWS_WANTED = 20
MOST_SECTIONS = 8192  # the last ones
MOST_SPECTRUM_SAMPLES = 2**15
MOST_PIECES = 200
MOST_POINTS = 2000  # that the motion is judged by

FEWEST_SAMPLES_PER_TURN = 8  # for the polynomials of a section, and for velocities
SPECTRUM_PERIODS = 16
PIECE_PERIODS = 16
FEWEST_PIECES = 4
LARGEST_ORDER = 4.0  # frequencies are stored up to so many times the faster of rotation and rings
_SAME = 1e-12


class TooShortError(Exception):
    """A transient is too short for a part of its analysis; the message says why.

    ``arrays``: what it does give.
    """

    def __init__(self, reason: str, arrays: Arrays | None = None) -> None:
        super().__init__(reason)
        self.arrays = arrays or {}


@dataclass(frozen=True)
class Samples:
    """Samples of a transient, ``interval`` apart; ``period`` is the reference period.

    ``journal`` (samples, bearings, 2); ``ring_phase`` (samples,) grows without end.  From the sample
    ``steady`` on speed and displacement of the rings do not change (their number, where that is not so).
    """

    time: Array
    speed: Array
    angle: Array
    ring_phase: Array
    rings_move: NDArray[np.bool_]
    displacement: Array
    journal: Array
    interval: float
    period: float
    steady: int
    unbalanced: bool

    @property
    def largest_frequency(self) -> float:
        """Largest stored frequency of the spectra."""
        ring = self.ring_phase[1] - self.ring_phase[0] if self.rings_move.any() else 0.0
        return LARGEST_ORDER * max(float(self.speed.max()), float(ring) / self.interval)

    @property
    def samples_per_period(self) -> int:
        """Samples in a reference period, at least one."""
        return max(1, round(self.period / self.interval))


def write_transient_analysis(store: Store, machine: Machine, run: str) -> str:
    """Analyse an ended transient into its group of ``transient_analysis``, whose name is returned.

    ``cases/CASE/transient/t000`` gives the group of equal number; an existing group is left alone.

    The attribute ``skipped`` says what the run did not give and why, ``energy_joules`` is the unit of energy.
    The samples are read at once: the million that a group may hold take about 1 GB.  Raises StoreError.
    """
    target = run.replace("/transient/", f"/{KIND}/")
    if store.has_group(target):
        return target
    found = read_group(store, run, _NEEDED)
    arrays, skipped = analyse(samples_of(found), machine)
    attributes = {
        "source": local_name(run),
        "skipped": skipped,
        "energy_joules": machine.scales.force * machine.scales.displacement,
    }
    write_group(store, target, KIND, arrays, attributes)
    return target


_NEEDED = ("time", "speed", "angle", "ring_displacement", "displacement", "journal", "plane_moment")


def samples_of(run: Group) -> Samples:
    """The samples of a group of kind ``transient``."""
    attributes = run.attributes
    interval = attributes["reference_period"] / attributes["request"]["transient"]["samples_per_period"]
    frequency = with_stand_ins(attributes["parameters"])[film.EXCITATION_FREQUENCY]
    speed, displacement = run["speed"], run["ring_displacement"]
    steady = np.maximum(np.abs(speed - speed[-1]) / speed[-1], np.abs(displacement - displacement[-1]))
    changing = np.flatnonzero(steady > _SAME)
    return Samples(
        run["time"],
        speed,
        run["angle"],
        attributes["ring_phase"] + frequency * run["time"],
        displacement > 0.0,
        run["displacement"],
        run["journal"],
        interval,
        attributes["reference_period"],
        int(changing[-1]) + 1 if len(changing) else 0,
        bool(np.any(run["plane_moment"] > 0.0)),
    )


def analyse(samples: Samples, machine: Machine) -> tuple[Arrays, dict[str, str]]:
    """Arrays of the group, and by part why something is missing."""
    parts: Mapping[str, Callable[[], Arrays]] = {
        "envelope": lambda: _envelope(samples),
        "modal_energy": lambda: _energies(samples, machine),
        "ring_section": lambda: _stored_section(samples, "ring"),
        "rotation_section": lambda: _stored_section(samples, "rotation"),
        "spectrum": lambda: _spectrum(samples),
        "waterfall": lambda: _waterfall(samples),
        "motion": lambda: _motion(samples),
    }
    arrays: Arrays = {}
    skipped: dict[str, str] = {}
    for name, part in parts.items():
        try:
            arrays |= part()
        except TooShortError as error:
            skipped[name] = str(error)
            arrays |= error.arrays
    return arrays, skipped


def _windows(samples: Samples) -> int:
    """Number of samples in a window: a few reference periods, more if there would be too many windows."""
    periods = len(samples.time) // samples.samples_per_period
    if periods < 1:
        raise TooShortError("the run is shorter than one reference period")
    window = samples.samples_per_period * min(WINDOW_PERIODS, max(1, periods // WINDOWS_WANTED))
    return max(window, -(-len(samples.time) // MOST_WINDOWS))


def _need_resolution(samples: Samples) -> None:
    if samples.samples_per_period < FEWEST_SAMPLES_PER_TURN:
        raise TooShortError(
            f"{FEWEST_SAMPLES_PER_TURN} samples per reference period are needed: raise "
            "transient.samples_per_period"
        )


def _envelope(samples: Samples) -> Arrays:
    window = _windows(samples)
    found = windowed_envelope(samples.journal, window)
    middle = (found.first + np.append(found.first[1:], len(samples.time)) - 1) // 2
    return {
        "window_time": samples.time[middle],
        "window_speed": samples.speed[middle],
        "envelope_low": found.low,
        "envelope_high": found.high,
    }


def _energies(samples: Samples, machine: Machine) -> Arrays:
    """Mean energies of every window.

    The mean of the squared velocity over whole periods is that of the motion.
    """
    window = _windows(samples)
    _need_resolution(samples)
    modes = rotor_modes(machine.scaled.mass, machine.scaled.stiffness)
    velocity = sampled_velocity(samples.displacement, samples.interval)
    energy = modal_energy(modes, samples.displacement, velocity)
    return {
        "mode_frequency": modes.frequency,
        "mode_multiplicity": modes.multiplicity,
        "kinetic_energy": windowed_mean(energy.kinetic, window),
        "strain_energy": windowed_mean(energy.strain, window),
    }


def _section(samples: Samples, by: str, begin: int) -> Section:
    """Points once per turn of the rings or of the rotor from a given sample: time, speed, journals."""
    phase = (samples.ring_phase if by == "ring" else samples.angle)[begin:]
    journal = samples.journal.reshape(len(samples.time), -1)
    values = np.column_stack([samples.time, samples.speed, journal])[begin:]
    if by == "ring" and not samples.rings_move[begin:].any():
        raise TooShortError("the rings rest")
    if len(phase) < FEWEST_SAMPLES_PER_TURN:
        raise TooShortError(f"a section needs {FEWEST_SAMPLES_PER_TURN} samples")
    if np.diff(phase).max() > 2.0 * np.pi / FEWEST_SAMPLES_PER_TURN:
        raise TooShortError(f"a section needs {FEWEST_SAMPLES_PER_TURN} samples per turn")
    found = phase_section(phase, values)
    if len(found.place) == 0:
        raise TooShortError("the run is shorter than a turn")
    return found


def _stored_section(samples: Samples, by: str) -> Arrays:
    values = _section(samples, by, 0).values[-MOST_SECTIONS:]
    return {
        f"{by}_section_time": values[:, 0],
        f"{by}_section_speed": values[:, 1],
        f"{by}_section_journal": values[:, 2:].reshape(-1, *samples.journal.shape[1:]),
    }


def _steady_end(samples: Samples, periods: int) -> int:
    """Where the second half of the steady end of a run begins; the first half is for settling."""
    count = len(samples.time) - samples.steady
    if samples.steady and count < 2 * samples.samples_per_period:
        raise TooShortError("the speed or the rings change until the end of the run")
    if count < 2 * periods * samples.samples_per_period:
        raise TooShortError(
            f"{2 * periods} reference periods of steady drive are needed; the run ends with "
            f"{count / samples.samples_per_period:.3g}"
        )
    return samples.steady + count // 2


def _spectrum(samples: Samples) -> Arrays:
    _need_resolution(samples)
    begin = _steady_end(samples, SPECTRUM_PERIODS)
    motion = samples.journal[max(begin, len(samples.time) - MOST_SPECTRUM_SAMPLES) :]
    found = amplitude_spectrum(motion, samples.interval)
    kept = found.frequency <= samples.largest_frequency
    return {"frequency": found.frequency[kept], "spectrum": found.amplitude[kept]}


def _waterfall(samples: Samples) -> Arrays:
    _need_resolution(samples)
    count, piece = len(samples.time), PIECE_PERIODS * samples.samples_per_period
    if count < FEWEST_PIECES * piece:
        raise TooShortError(
            f"the run has {count / samples.samples_per_period:.3g} reference periods; "
            f"{FEWEST_PIECES * PIECE_PERIODS} are needed"
        )
    hop = max(piece // 4, -(-(count - piece) // (MOST_PIECES - 1)))
    found = waterfall(samples.journal, samples.interval, piece, hop)
    kept = found.frequency <= samples.largest_frequency
    middle = found.place.astype(np.intp)
    return {
        "piece_time": samples.time[middle],
        "piece_speed": samples.speed[middle],
        "piece_frequency": found.frequency[kept],
        "waterfall": found.amplitude[:, kept],
    }


def _motion(samples: Samples) -> Arrays:
    """Kind of motion at the steady end with its evidence; points are taken once per period of the drive."""
    _need_resolution(samples)
    newest = len(samples.time) - MOST_POINTS * samples.samples_per_period
    begin = max(_steady_end(samples, 1), newest)
    journal = samples.journal.reshape(len(samples.time), -1)[begin:]
    if samples.rings_move[-1] or samples.unbalanced:
        by = "ring" if samples.rings_move[-1] else "rotation"
        values = _section(samples, by, begin).values
        times, points = values[:, 0], values[:, 2:]
    else:
        by, height = "rising", journal[:, 1]
        values = np.column_stack([samples.time[begin:], journal])
        rising = level_section(height, values, float(height.mean())).values
        times, points = rising[:, 0], rising[:, 1:]
    found = classify(points, journal)
    evidence = _evidence(found, by, times, float(samples.time[begin]))
    if found.motion is None:
        raise TooShortError(found.reason, evidence)
    return evidence


def _evidence(found: Classification, by: str, times: Array, begin: float) -> Arrays:
    def flag(name: str, meaning: str) -> NDArray[Any]:
        return np.array([TRANSIENT_ANALYSIS.array(name).flag(meaning)])

    unknown = np.array([TRANSIENT_ANALYSIS.array("motion").fill])
    period = float(np.mean(np.diff(times))) if len(times) > 1 else np.nan
    return {
        "motion": unknown if found.motion is None else flag("motion", found.motion.value),
        "section": flag("section", by),
        "stretch_begin": np.array([begin]),
        "section_points": np.array([len(times)]),
        "section_period": np.array([period]),
        "orbit_size": np.array([found.size]),
        "return_period": np.array(RETURNS),
        "return_distance": found.returns[None, :],
        "growth_rate": np.array([found.growth / period]),
        "chaos": np.array([found.chaos]),
    }
