"""Water of BlueROV2 Heavy from its geometry, beside two published sets.

The geometry is that of the model's visible geoms, foam and housing; of a sketch with the published
outer size, tubes, plates, foam blocks and thrusters as plain shapes, inner sizes estimated; and of
the solid box around all.
"""

from uuv.start import run_scenario  # isort: skip

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np

from uuv import models
from uuv.experiment import Page, column, experiment, stat
from uuv.experiment.statistic import Statistic
from uuv.models import hydrodynamics
from uuv.models.vehicles.bluerov2_heavy import BENZON_2022, HEIGHT, LENGTH, WIDTH, WU_2018
from uuv.models.water_from_geometry.wetting import wet

AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
MODEL = "bluerov2_heavy_benzon2022"
DENSITY = 1000.0  # [kg/m^3]
SKETCH = f"""<mujoco><worldbody><body name="hull"><freejoint/>
  <geom type="cylinder" size=".057 .15" zaxis="1 0 0" pos="0 0 .02"/>
  <geom type="cylinder" size=".0445 .125" zaxis="1 0 0" pos="0 0 -.085"/>
  <geom type="box" size="{LENGTH / 2} .0032 .09" pos="0 .165 -.03"/>
  <geom type="box" size="{LENGTH / 2} .0032 .09" pos="0 -.165 -.03"/>
  <geom type="box" size="{LENGTH / 2} .165 .0032" pos="0 0 -.1"/>
  <geom type="box" size=".105 .05 .0325" pos=".115 .12 .09"/>
  <geom type="box" size=".105 .05 .0325" pos="-.115 .12 .09"/>
  <geom type="box" size=".105 .05 .0325" pos=".115 -.12 .09"/>
  <geom type="box" size=".105 .05 .0325" pos="-.115 -.12 .09"/>
  <geom type="cylinder" size=".03 .05" pos=".156 .111 -.06" zaxis="1 -1 0"/>
  <geom type="cylinder" size=".03 .05" pos=".156 -.111 -.06" zaxis="1 1 0"/>
  <geom type="cylinder" size=".03 .05" pos="-.156 .111 -.06" zaxis="1 1 0"/>
  <geom type="cylinder" size=".03 .05" pos="-.156 -.111 -.06" zaxis="1 -1 0"/>
  <geom type="cylinder" size=".03 .05" pos=".12 .24 0"/>
    <geom type="cylinder" size=".03 .05" pos=".12 -.24 0"/>
  <geom type="cylinder" size=".03 .05" pos="-.12 .24 0"/>
    <geom type="cylinder" size=".03 .05" pos="-.12 -.24 0"/>
</body></worldbody></mujoco>"""

VISIBLE, PARTS = "foam and housing", "sketch of its parts"
BOX = f"solid box {LENGTH:g} {WIDTH:g} {HEIGHT:g} m"
PUBLISHED = {"Benzon 2022": BENZON_2022, "Wu 2018": WU_2018}


@dataclass(frozen=True, kw_only=True)
class HullCase:
    """One description of the hull."""

    hull: str
    """Where the coefficients are from."""


@dataclass(frozen=True, kw_only=True)
class HullRow:
    """Coefficients in SI units, by axis."""

    volume: float = column("volume", "l", digits=1, factor=1e3)
    added_mass: Mapping[str, float] = column("added mass", by="axis")
    quadratic: Mapping[str, float] = column("quadratic drag", by="axis")
    linear: Mapping[str, float] = column("linear drag", by="axis")


@experiment(
    "hull_geometry", vary={"hull": (VISIBLE, PARTS, BOX, *PUBLISHED)}, quick={"hull": (PARTS,)}
)
def hull_geometry(case: HullCase) -> HullRow:
    """Gives the coefficients of a hull."""
    water = PUBLISHED[case.hull] if case.hull in PUBLISHED else _from_geometry(case.hull)
    return HullRow(
        volume=float(water.volume),
        added_mass=_by_axis(water.added_mass),
        quadratic=_by_axis(water.quadratic_damping),
        linear=_by_axis(water.linear_damping),
    )


def _from_geometry(hull: str) -> hydrodynamics.BodyHydrodynamics:
    if hull == PARTS:
        spec, geoms = mujoco.MjSpec.from_string(SKETCH), "auto"
    else:
        # all that is seen, or the box that stands for it in contacts
        spec, geoms = models.load(MODEL), "visual" if hull == VISIBLE else "collision"

    return wet(spec, geoms=geoms, density=DENSITY).bodies["hull"]


def _by_axis(numbers: object) -> dict[str, float]:
    """Numbers (6,), or the diagonal of a matrix (6, 6), by axis."""
    array = np.asarray(numbers, dtype=float)
    return dict(zip(AXES, (array if array.ndim == 1 else np.diag(array)).tolist(), strict=True))


def _of_axes(name: str, axes: tuple[str, ...], label: str = "") -> list[Statistic]:
    """A column for each axis of coefficients."""
    return [
        stat("value", lambda row, axis=axis: row[name][axis], f"{label} {axis}".strip())
        for axis in axes
    ]


hull_geometry.page = (
    Page()
    .table(
        "Added mass of BlueROV2 Heavy [kg, kg m^2]",
        by="hull",
        columns=["volume", *_of_axes("added_mass", AXES)],
    )
    .table(
        "Quadratic drag [N s^2/m^2, N m s^2], and linear [N s/m]",
        by="hull",
        columns=[*_of_axes("quadratic", AXES), *_of_axes("linear", AXES[:3], "linear")],
    )
)

if __name__ == "__main__":
    run_scenario(hull_geometry.main)
