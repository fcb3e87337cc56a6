"""Models of vehicles, arms, targets and scenes as MjSpec, with hydrodynamic and thruster tables.
Nothing is stepped.

The module of a vehicle is imported when that vehicle is loaded. `from uuv import models` and the
lists of names therefore need no MuJoCo.
"""

if __name__ != "uuv.models":
    raise ImportError(f"{__name__!r} is not a package of the project: import uuv.models")


from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from uuv.models.registry import MadeForm, Registry

if TYPE_CHECKING:
    import mujoco


__all__ = ["Description", "available", "describe", "load"]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Entry:
    build: str  # MODULE:FUNCTION that returns an MjSpec
    source: str


_MODELS = {
    "uuv_puma": _Entry(
        build="uuv.models.vehicles.uuv_puma:build", source="generic, of no real vehicle; estimates"
    ),
    "uuv_puma_side": _Entry(
        build="uuv.models.vehicles.uuv_puma:build_side",
        source="uuv_puma with the arm on the port side, for vertical structures",
    ),
    "bluerov2": _Entry(
        build="uuv.models.vehicles.bluerov2:build",
        source="clydemcqueen/bluerov2_gz, six T200 at 16 V; added mass of Wu 2018",
    ),
    "bluerov2_alpha5": _Entry(
        build="uuv.models.vehicles.bluerov2:with_alpha_5",
        source="bluerov2 with reach_alpha_5 under the bow",
    ),
    "bluerov2_heavy_benzon2022": _Entry(
        build="uuv.models.vehicles.bluerov2_heavy:benzon_2022",
        source="von Benzon et al. 2022, JMSE 10(12):1898, table A1; T200 at 16 V",
    ),
    "bluerov2_heavy_wu2018": _Entry(
        build="uuv.models.vehicles.bluerov2_heavy:wu_2018",
        source="Wu 2018, thesis, Flinders University, tables 5.1 and 5.2 (for fresh water, here "
        "ballasted for 1025 kg/m^3); T200 at 16 V",
    ),
    "bluerov2_heavy_alpha5": _Entry(
        build="uuv.models.vehicles.bluerov2_heavy:with_alpha_5",
        source="von Benzon et al. 2022 with reach_alpha_5 under the bow",
    ),
    "girona500_arm4": _Entry(
        build="uuv.models.vehicles.girona500:with_arm_4",
        source="UWSim (uji-ros-pkg/underwater_simulation), hull for fresh water, here ballasted "
        "for 1025 kg/m^3; joint frames of an ARM 5E, its masses and torques are estimates",
    ),
    "phoenix_smart3s": _Entry(
        build="uuv.models.vehicles.phoenix_smart3s:build",
        source="SIMURV 4.0 (Antonelli 2013); hull: NPS AUV, Healey and Lienard 1993 (for fresh "
        "water, here ballasted for 1025 kg/m^3)",
    ),
    "rexrov_oberon7": _Entry(
        build="uuv.models.vehicles.rexrov:with_oberon_7",
        source="RexROV of UUV Simulator (Manhaes et al. 2016; Berg 2012) with an Oberon 7 as in "
        "DAVE",
    ),
    "rexrov2_arm7": _Entry(
        build="uuv.models.vehicles.rexrov2:with_arm_7",
        source="RexROV 2 of UUV Simulator (Manhaes et al. 2016; Berg 2012) with the kinematics of "
        "a KUKA LBR iiwa 7",
    ),
    "uuv_puma_two_sway": _Entry(
        build="uuv.models.vehicles.uuv_puma:build_two_sway",
        source="uuv_puma with two sway thrusters, at bow and stern",
    ),
    "remus100": _Entry(
        build="uuv.models.vehicles.remus100:build",
        source="PythonVehicleSimulator (Fossen), remus100.py; propeller as a thruster, fins by "
        "remus100.fin_wrench",
    ),
    "reach_alpha_5": _Entry(
        build="uuv.models.vehicles.reach_alpha_5:build",
        source="Kolano et al., arXiv 2209.13577; friction: floating-KinDyn",
    ),
}
VEHICLES: "Registry[mujoco.MjSpec]" = Registry(
    "vehicle",
    {name: entry.build for name, entry in _MODELS.items()},
    {"bluerov2_heavy": "bluerov2_heavy_benzon2022"},  # the later and better attested set
    form=MadeForm("a mujoco.MjSpec", lambda spec: hasattr(spec, "worldbody")),
    copied=lambda spec: spec.copy(),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Description:
    """Summary of a named model."""

    name: str  # a name of its own, never an alias
    source: str
    floating: bool  # True: it has a free hull; False: its base is fixed to the world
    dof: int  # number of degrees of freedom, including those of the hull
    joints: tuple[str, ...]  # driven joints
    thrusters: int
    # how it moves: by "thrusters", by a "wrench" where the source has no thrusters, or "fixed base"
    drive: str
    mass: float  # [kg] dry mass
    volume: float  # [m^3] displaced volume, after ballasting

    def _repr_html_(self) -> str:
        """Card for a notebook."""
        from uuv.sim.interfaces.page import plain_card

        rows = [
            ("dry mass", f"{self.mass:.1f}", "kg"),
            ("displaced", f"{1e3 * self.volume:.1f}", "l"),
            ("degrees of freedom", str(self.dof), ""),
            ("driven joints", ", ".join(self.joints) or "none", ""),
            ("drive", self.drive, ""),
            ("thrusters", str(self.thrusters), ""),
        ]
        return plain_card(self.name, self.source, rows)


def available() -> tuple[str, ...]:
    """Names of all models: built-in ones, their aliases, and those of other packages."""
    return VEHICLES.names()


def load(name: str) -> "mujoco.MjSpec":
    """Model by name as `mujoco.MjSpec`, with hydrodynamic coefficients attached.

    Args:
        name: one of `available`.

    Returns:
        The model, as a new copy that the caller may change.

    Raises:
        ConfigurationError: no model has that name; the message lists those that exist.
    """
    return VEHICLES.load(name)


def describe(name: str) -> Description:
    """Summarise a named model: source, degrees of freedom, drive, mass.

    Args:
        name: one of `available`.

    Returns:
        The summary of the compiled model.

    Raises:
        ConfigurationError: no model has that name.
    """
    import mujoco
    import numpy as np

    from uuv.models import hydrodynamics
    from uuv.models.naming import HULL_BODY
    from uuv.models.water import thrusters

    spec = load(name)
    water = hydrodynamics.attached(spec)
    model = spec.compile()

    # How it moves: by thrusters, and by drives of joints.
    count = len(thrusters.read(model)[0])
    floating = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, HULL_BODY) >= 0
    driven = np.asarray(model.actuator_trntype) == mujoco.mjtTrn.mjTRN_JOINT

    return Description(
        name=VEHICLES.resolve(name),
        source=_source(VEHICLES.resolve(name)),
        floating=floating,
        dof=model.nv,
        joints=tuple(model.joint(int(j)).name for j in np.asarray(model.actuator_trnid)[driven, 0]),
        thrusters=count,
        drive="thrusters" if count else "wrench" if floating else "fixed base",
        mass=float(np.sum(model.body_mass)),
        volume=sum(body.volume for body in water.values()),
    )


def _source(name: str) -> str:
    return _MODELS[name].source if name in _MODELS else "another package"


if not TYPE_CHECKING:  # a type checker sees only the modules that are imported here

    def __getattr__(name: str) -> Any:
        """Import a module of this package, such as `uuv.models.hydrodynamics`, on its first use."""
        if not name.startswith("_"):
            try:
                return import_module(f"{__name__}.{name}")
            except ModuleNotFoundError as error:
                if error.name != f"{__name__}.{name}":
                    raise
        raise AttributeError(f"module 'models' has no attribute {name!r}")
