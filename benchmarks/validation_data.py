"""Measured single wheels (data/validation) as series: one wheel on one soil over slip."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from granite_lab.parameters import Soil, Wheels

DATA = Path(__file__).parent.parent / "data" / "validation"

SPEED = 0.01
"""Velocity of the tests [m/s]: stated for K10-mini and KLS-1, taken for the others, which do not state it."""

NO_LIMIT = 1000.0
"""μ_s where the authors give none: (10) is then c + σ tan φ."""


@dataclass(frozen=True)
class Row:
    """One measured point.

    Attributes:
        slip: λ of (1).
        load: [N].
        pull, pull_std: drawbar pull and its std within the run [N]; NaN where none is published.
        torque: [N m]; NaN where it was not measured.
        sinkage: [mm].
    """

    slip: float
    load: float
    pull: float
    pull_std: float
    torque: float
    sinkage: float


@dataclass(frozen=True)
class Series:
    """One wheel on one soil.

    Attributes:
        id, title: for files and people.
        wheels, soil: of the model.
        lug: height of the lugs [m]; 0 for a smooth wheel.
        rows: the points, by rising slip.
    """

    id: str
    title: str
    wheels: Wheels
    soil: Soil
    lug: float
    rows: tuple[Row, ...]

    @property
    def groups(self) -> tuple[Row, ...]:
        """The means of repeated runs; the std is that of a single run."""
        nearest: dict[float, list[Row]] = {}
        for row in self.rows:
            nearest.setdefault(round(20 * row.slip) / 20, []).append(row)
        means = []
        for rows in nearest.values():
            frame = pd.DataFrame([dataclasses.asdict(row) for row in rows])
            means.append(Row(**{str(k): float(x) for k, x in frame.mean().items()}))
        return tuple(means)

    @property
    def driven(self) -> tuple[Row, ...]:
        """Those of the groups in which the wheel does not brake."""
        return tuple(row for row in self.groups if row.slip > -0.1)


def _soil(name: str, n: float, k: float, c: float, phi: float, shear: float) -> Soil:
    return Soil(
        name=name, title=name, exponent=n, cohesive_modulus=0.0, frictional_modulus=k, cohesion=c,
        friction_angle=phi, shear_modulus=shear, tyre_friction=NO_LIMIT,
    )  # fmt: skip


K10 = {
    "grouser": _soil("K10-mini sand, lugged wheel", 1.46, 8e6, 1000.0, 29.0, 0.021),
    "smooth": _soil("K10-mini sand, smooth wheel", 1.40, 8e6, 1000.0, 29.0, 0.010),
}
"""set_soil_params.m of robomechanics/3d-terramechanics, which tunes n and K by hand for each wheel."""

TITLES = {
    ("ding2011", 0.0): ("ding_smooth", "Ding 2011, smooth"),
    ("ding2011", 0.01): ("ding_lugs", "Ding 2011, 30 lugs of 10 mm"),
    ("wang_han_2016_kls1", 0.0): ("kls1_smooth", "KLS-1, smooth"),
    ("wang_han_2016_kls1", 0.01): ("kls1_lugs", "KLS-1, 16 lugs of 10 mm"),
    ("hurrell2025_rashid1", 0.02): ("rashid_lugs", "Rashid-1, 14 lugs of 20 mm"),
}


def all_series() -> list[Series]:
    """Return every series of data/validation."""
    return [*_k10(), *_published()]


def _k10() -> Iterator[Series]:
    table = pd.read_csv(DATA / "k10mini_straight.csv")
    for kind, title in (("smooth", "K10-mini, smooth"), ("grouser", "K10-mini, lugs of 5 mm")):
        rows = [
            Row(
                max(-1.0, r["slip"]),
                r["load_N"],
                r["drawbar_N"],
                r["std_drawbar_N"],
                math.nan,
                r["sinkage_mm"],
            )
            for r in table[table["wheel"] == kind].sort_values("slip").to_dict("records")
        ]
        lug = 0.005 if kind == "grouser" else 0.0
        yield Series(
            f"k10_{kind}", title, Wheels(radius=0.058, width=0.05, lugs=0.0), K10[kind], lug, tuple(rows)
        )


def _published() -> Iterator[Series]:
    table = pd.read_csv(DATA / "published_single_wheel.csv")
    soils = pd.read_csv(DATA / "soil_simulants.csv").set_index("simulant").to_dict("index")
    for key, (name, title) in TITLES.items():
        part = table[(table["source"] == key[0]) & (table["grouser_height_m"] == key[1])].sort_values("slip")
        first = part.iloc[0]
        width, about = float(first["wheel_width_m"]), soils[first["soil_simulant"]]
        # (8) needs k_c / b + k_φ only; the k_c of KLS-1 is negative, which a soil file does not take
        k = about["k_c_kN_per_m_n_plus_1"] / width + about["k_phi_kN_per_m_n_plus_2"]
        soil = _soil(
            str(first["soil_simulant"]), about["n"], 1000 * k, 1000 * about["cohesion_kPa"],
            about["friction_angle_deg"], float(first["soil_shear_modulus_k_m"]),
        )  # fmt: skip
        rows = [
            Row(r["slip"], r["vertical_load_n"], r["meas_drawbar_pull_n"], math.nan, r["meas_torque_nm"],
                1000 * r["meas_sinkage_m"])
            for r in part.to_dict("records")
        ]  # fmt: skip
        lugs = float(first["grouser_count"])
        wheels = Wheels(radius=float(first["wheel_radius_m"]), width=width, lugs=lugs)
        yield Series(name, title, wheels, soil, key[1], tuple(rows))
