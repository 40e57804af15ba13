"""What `flexor plan` read and wrote: the arm's file and the plan's CSV.

Angles run from a1 (horizontal) to a2 (down), as everywhere in Flexor; a force is that of the tip on
the surface. Every fault of a file is a `FileError`, which names the key or column.
"""

import csv
import json
import math
import struct
import tomllib
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh

# A plan's tip may miss its own kinematics, or the straight path, by this much, m: what rounding to ten
# digits leaves, and a ten-thousandth of what another arm's lengths miss it by.
TIP_TOLERANCE_M = 1e-7


class FileError(Exception):
    """A file that cannot be used; the message is for the user."""


@dataclass(frozen=True)
class Arm:
    """The arm of `arm.toml`, SI units.

    Attributes are named as in the file; `gravity` is (along a1, along a2), m/s^2.
    """

    link1_length: float
    link1_mass: float
    link2_length: float
    link2_mass: float
    bending_stiffness: float
    damping_ratio: float
    elements: int
    root_inertia: float
    tip_mass: float
    tip_inertia: float
    gravity: tuple
    bending_damping_s: float | None

    @property
    def line_density(self):
        """Mass of link 2 per length, kg/m."""
        return self.link2_mass / self.link2_length

    def fingerprint(self):
        """The number by which Flexor tells arms apart, as in a plan's summary.json."""
        values = [
            *(self.link1_length, self.link1_mass, self.link2_length, self.link2_mass),
            *(self.bending_stiffness, self.damping_ratio),
            *(self.root_inertia, self.tip_mass, self.tip_inertia, *self.gravity),
        ]
        packed = struct.pack(f"<{len(values)}d", *(value + 0.0 for value in values))
        return f"{zlib.crc32(b'flexor arm 1' + packed):#010x}"

    def matched_bending_damping_s(self):
        """Retardation time 2 zeta / omega_1, s, which damps the first mode of the pinned link as the
        arm's damping ratio says: what `damping = "bending"` means without a time of its own.

        omega_1 is that of the arm's own number of finite elements, with the inertias of root and tip.
        """
        n, h = self.elements, self.link2_length / self.elements
        mass, stiffness = np.zeros((2, 2 * n + 2, 2 * n + 2))
        m = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]) / 420
        k = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
        units = np.array([1, h, 1, h])
        for e in range(n):
            at = slice(2 * e, 2 * e + 4)
            mass[at, at] += self.line_density * h * m * np.outer(units, units)
            stiffness[at, at] += self.bending_stiffness / h**3 * k * np.outer(units, units)
        mass[1, 1] += self.root_inertia
        mass[-1, -1] += self.tip_inertia
        free = [i for i in range(2 * n + 2) if i not in (0, 2 * n)]  # pinned at both ends
        at = np.ix_(free, free)
        squared = eigh(stiffness[at], mass[at], eigvals_only=True)
        return 2 * self.damping_ratio / math.sqrt(squared[0])


# Keys of arm.toml that say how to plan or what the drives give, and nothing about the arm in Exudyn.
_NOT_THE_ARM = {"link2.model", "link2.damping", "base.elbow"}
_KEYS = {
    "link1.length_m": "link1_length",
    "link1.mass_kg": "link1_mass",
    "link2.length_m": "link2_length",
    "link2.mass_kg": "link2_mass",
    "link2.bending_stiffness_Nm2": "bending_stiffness",
    "link2.damping_ratio": "damping_ratio",
    "link2.elements": "elements",
    "base.gravity_m_s2": "gravity",
}
_OPTIONAL_KEYS = {
    "link2.root_inertia_kgm2": ("root_inertia", 0.0),
    "link2.tip_mass_kg": ("tip_mass", 0.0),
    "link2.tip_inertia_kgm2": ("tip_inertia", 0.0),
    "link2.bending_damping_s": ("bending_damping_s", None),
}


def read_arm(path):
    """The `Arm` of an `arm.toml`.

    A key of [link1], [link2] or [base] that this comparison does not know is refused: what it adds
    to the arm would be missing in Exudyn. [limits] and [monitors] are not looked at.
    """
    try:
        tables = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise FileError(f"{path}: {error}") from error
    for name in ("link1", "link2", "base"):
        if not isinstance(tables.get(name, {}), dict):
            raise FileError(f"{path}: {name} = {tables[name]!r}: a table [{name}] is accepted")
    given = {
        f"{name}.{key}": value
        for name in ("link1", "link2", "base")
        for key, value in tables.get(name, {}).items()
    }
    for key in given:
        if key not in _NOT_THE_ARM and key not in _KEYS and key not in _OPTIONAL_KEYS:
            raise FileError(f"{path}: {key}: this comparison does not model it in Exudyn")
    values = {}
    for key, attribute in _KEYS.items():
        if key not in given:
            raise FileError(f"{path}: {key} is missing")
        values[attribute] = given[key]
    for key, (attribute, default) in _OPTIONAL_KEYS.items():
        values[attribute] = given.get(key, default)
    names = _KEYS | {key: attribute for key, (attribute, _) in _OPTIONAL_KEYS.items()}
    for key, attribute in names.items():
        _check(path, key, values[attribute])
    return Arm(**values)


# Values of these may be 0.
_MAY_BE_ZERO = {"link2.damping_ratio", *_OPTIONAL_KEYS}


def _check(path, key, value):
    """Raises `FileError` for a value of arm.toml that no arm has."""

    def number(value):
        return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)

    if key == "base.gravity_m_s2":
        if not (isinstance(value, list) and len(value) == 2 and all(map(number, value))):
            raise FileError(f"{path}: {key} = {value!r}: two accelerations in m/s^2 are accepted")
    elif key == "link2.elements":
        if not (isinstance(value, int) and 1 <= value <= 100):
            raise FileError(f"{path}: {key} = {value!r}: a whole number from 1 to 100 is accepted")
    elif value is not None and not (number(value) and (value > 0 or value == 0 and key in _MAY_BE_ZERO)):
        least = "0 or more" if key in _MAY_BE_ZERO else "above 0"
        raise FileError(f"{path}: {key} = {value!r}: a number {least} is accepted")


@dataclass(frozen=True)
class Plan:
    """A plan, one row a tick.

    t: s, rising; torque: (ticks, 2), N m; angle: theta10 and theta20 (chord), (ticks, 2), rad;
    root_slope: of link 2 against the chord, rad, 0 where the file has none; tip: (ticks, 2), m;
    normal_force and friction: of the tip on the surface, along the normal and along the way travelled, N;
    direction: unit vector of the travel; interpolation: "linear" or "cubic", of the torques between ticks.
    """

    t: np.ndarray
    torque: np.ndarray
    angle: np.ndarray
    root_slope: np.ndarray
    tip: np.ndarray
    normal_force: np.ndarray
    friction: np.ndarray
    direction: np.ndarray
    interpolation: str

    def smooth(self, values, t):
        """`values` (ticks, ...) at the times `t`, s, by a cubic spline, held before the first and after
        the last tick."""
        return CubicSpline(self.t, values)(np.clip(t, self.t[0], self.t[-1]))

    def torque_at(self, t):
        """Both torques at the times `t`, s: (times, 2), N m, held as in `smooth`."""
        if self.interpolation == "cubic":
            return self.smooth(self.torque, t)
        return np.stack([np.interp(t, self.t, torque) for torque in self.torque.T], axis=-1)


def check_arm(folder, arm, arm_path):
    """Refuses an `Arm` that is not the one that the plan in `folder` was made for, as far as a
    summary.json there says which that is."""
    path = Path(folder) / "summary.json"
    try:
        planned = json.loads(path.read_text(encoding="utf-8")).get("arm_fingerprint")
    except FileNotFoundError:
        return
    except (OSError, ValueError, AttributeError) as error:
        raise FileError(f"{path}: {error}") from error
    if planned is not None and planned != arm.fingerprint():
        raise FileError(
            f"{arm_path}: fingerprint {arm.fingerprint()}, but {path} is for an arm with {planned}: that "
            "arm's file is accepted (--arm), and with --any-arm another one"
        )


def _columns(path):
    """Columns of a CSV of numbers by their names."""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            header = next(csv.reader(file), [])
            rows = np.array([[float(value) for value in row] for row in csv.reader(file)], ndmin=2)
    except (OSError, ValueError) as error:
        raise FileError(f"{path}: {error}") from error
    if len(rows) < 4 or rows.shape[1] != len(header):
        raise FileError(
            f"{path}: {len(rows)} rows of {rows.shape[1]} numbers below {len(header)} names: at least 4 "
            "rows, with a number for every name, are accepted"
        )
    return dict(zip(header, rows.T, strict=True))


def _column(path, columns, *names):
    """The columns of those names side by side, (ticks, names)."""
    for name in names:
        if name not in columns:
            raise FileError(f"{path}: no column {name}")
        if not np.isfinite(columns[name]).all():
            raise FileError(
                f"{path}: {name} has values that are no numbers; a plan of a tip that slides on a "
                "straight surface is accepted"
            )
    return np.stack([columns[name] for name in names], axis=-1)


def _tip(path, columns, arm, angle):
    """Where the plan has the tip, (ticks, 2), m, as the columns say and the arm's lengths confirm."""
    if "chord_m" in columns:
        chord = _column(path, columns, "chord_m")[:, 0]
    else:
        chord = arm.link2_length
    joints = arm.link1_length * np.exp(1j * angle[:, 0]) + chord * np.exp(1j * angle[:, 1])
    kinematic = np.stack([joints.real, joints.imag], axis=-1)
    if "x1_m" not in columns:
        return kinematic
    tip = _column(path, columns, "x1_m", "x2_m")
    miss = np.abs(tip - kinematic).max()
    if miss > TIP_TOLERANCE_M:
        raise FileError(
            f"{path}: the arm's lengths put the plan's tip {1e3 * miss:.4g} mm from where the plan has it: "
            "the arm file of the plan is accepted (--arm)"
        )
    return tip


def _direction(path, tip):
    """Unit vector of the straight way that the tip takes."""
    way = tip[-1] - tip[0]
    if np.hypot(*way) < 1e3 * TIP_TOLERANCE_M:
        raise FileError(f"{path}: the tip ends where it began; a path along a straight surface is accepted")
    direction = way / np.hypot(*way)
    off = np.abs((tip - tip[0]) @ [-direction[1], direction[0]]).max()
    if off > TIP_TOLERANCE_M:
        raise FileError(
            f"{path}: the tip leaves the line between its ends by {1e3 * off:.4g} mm; a path along a "
            "straight surface is accepted"
        )
    return direction


def read_plan(path, arm, normal_force=None, interpolation="linear"):
    """The `Plan` in the CSV at `path`, for the `Arm` that it was made for.

    Without the columns x1_m, x2_m the tip is where the angles and the chord put it; without chord_m
    the chord is as long as link 2. `normal_force`, N, is for files without the column
    normal_force_N.
    """
    columns = _columns(path)

    def optional(name, otherwise):
        if name in columns:
            return _column(path, columns, name)[:, 0]
        return np.full(len(columns["t_s"]), otherwise)

    t = _column(path, columns, "t_s")[:, 0]
    if not (np.diff(t) > 0).all():
        raise FileError(f"{path}: t_s does not rise from row to row")
    if normal_force is None and "normal_force_N" not in columns:
        raise FileError(f"{path}: no column normal_force_N; --normal-force-N says what the plan presses with")
    force = optional("normal_force_N", normal_force)
    if not force.any():
        raise FileError(
            f"{path}: normal_force_N is 0 throughout; a plan that presses on a surface is accepted"
        )
    angle = _column(path, columns, "theta10_rad", "theta20_rad")
    tip = _tip(path, columns, arm, angle)
    return Plan(
        t=t,
        torque=_column(path, columns, "tau1_Nm", "tau2_Nm"),
        angle=angle,
        root_slope=optional("root_slope_rad", 0.0),
        tip=tip,
        normal_force=force,
        friction=optional("friction_N", 0.0),
        direction=_direction(path, tip),
        interpolation=interpolation,
    )
