"""Options that all contact scenarios share, and the model of a coarse detection."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from models.objects import deformed
from models.objects.targets import TargetModel
from scenarios.contact_job import ContactJob
from sim.interfaces.spatial import Array, exp_so3, finite_number, whole_number
from sim.runs.command_line import ScenarioOptions

AblatedMethod = Literal[
    "compensation", "hydrodynamic-term", "dynamic-term", "contact-term", "drift-correction", "force-control", "fusion"
]

SLOWEST, FASTEST = 1e-4, 1.0  # [m/s] of the tool along a path
_MOST_FORCE = 1e3  # [N] beyond the capability of any vehicle here
_MOST_LOOKS = 40  # frames that arrive before the wait for a scan times out
_HIGHEST = 1.0  # [m] largest growth or dents
_PATCHES = 3  # patches of growth or dents on an object


@dataclass(kw_only=True)
class ContactOptions(ScenarioOptions):
    """Options that all contact scenarios share."""

    forces: tuple[float, ...] = ()
    """Set forces [N] on equal parts of the path; default: 60 90 60 along an object, 60 90 around it."""
    speed: float = 0.02
    """Speed of the tool along the path [m/s]."""
    contactless: float | None = None
    """Keep the tool at this distance [m] from the surface instead of pressing [Konoplin 2019]."""
    fouled: float = 0.0
    """Growth on the object along the path, up to this height [m]; the vehicle knows the clean object only."""
    dented: float = 0.0
    """Dents in the object along the path, up to this depth [m]; the vehicle knows the undamaged object only."""
    looks: int = 1
    """Successive depth frames, or pings, whose median the tool path is planned on; 16 where growth or dents are
    possible."""
    sensor: str = "camera"
    """Sensor for identification: camera, sonar, or one that an installed package registers."""
    without: tuple[AblatedMethod, ...] = ()
    """Controller methods to leave out (ablation)."""
    arm_errors: int | None = None
    """Seed of an arm built 2 mm and 0.3 deg wrong in every joint, unknown to the controller."""
    calibrated: bool = False
    """Calibrate the arm first: four points touched with a hand's noise of 0.1 mm, one known distance."""
    arm: Path | None = None
    """File of the controller's arm model: arm.yaml of calibrate_arm.py."""
    range: float = 1.25
    """Range from camera to object at the scan [m]."""
    vehicle: str = "uuv_puma"
    """A name of models.available(), or an MJCF file with the named parts (docs/concepts.md)."""
    controller: str = "work"
    """Controller: work, a registered name, or MODULE:CLASS."""

    def job(
        self,
        scenario: str,
        target: TargetModel,
        path: str,
        X_WT: Array,
        rng: np.random.Generator,
        *,
        forces: tuple[float, ...],
        least_share: float,
    ) -> ContactJob:
        """Specification of contact work along a path of an object.

        The coarse detection, and growth and dents, are drawn from `rng`.

        Args:
            scenario: Name of the scenario.
            target: Model of the object.
            path: Name of one of its paths.
            X_WT: (4, 4) true pose of the object.
            rng: Source of the random draws.
            forces: [N] set forces where --forces gives none.
            least_share: Share of the path that must be within reach.

        Raises:
            ConfigurationError: An option is out of range.
        """
        whole_number(self.looks, "--looks", least=1, most=_MOST_LOOKS)
        if self.arm_errors is not None:
            whole_number(self.arm_errors, "--arm-errors")
        finite_number(self.speed, "--speed [m/s]", least=SLOWEST, most=FASTEST)
        least_share = finite_number(least_share, "--least, a share of the path", above=0.0, most=1.0)
        for force in self.forces:
            finite_number(force, "--forces [N]", above=0.0, most=_MOST_FORCE)
        approach, orientation = coarse_detection(X_WT, rng)
        return ContactJob(
            scenario=scenario,
            title=f"Cleaning the {target.name}, {path} path, seed {self.seed}",
            target=target,
            path=path,
            forces=self.forces or forces,
            speed=self.speed,
            least_share=least_share,
            X_WT=X_WT,
            approach_W=approach,
            orientation_W=orientation,
            scan_range=self.range,
            vehicle=self.vehicle,
            controller=self.controller,
            without=frozenset(self.without),
            arm_errors=self.arm_errors,
            calibrated=self.calibrated,
            arm=self.arm,
            contactless=self.contactless,
            looks=self.looks,
            sees_with=self.sensor,
            there=self._there(target, path, rng),
        )

    def _there(self, target: TargetModel, path: str, rng: np.random.Generator) -> TargetModel | None:
        """The true object: `target` with growth and dents near `path`; None: equal to `target`, nothing drawn.

        Raises:
            ConfigurationError: A height is out of range.
        """
        return with_growth_and_dents(target, self.fouled, self.dented, rng, near=target.path(path).p)


def with_growth_and_dents(
    target: TargetModel, fouled: float, dented: float, rng: np.random.Generator, near: Array | None = None
) -> TargetModel | None:
    """`target` with random growth and dents.

    Args:
        target: Model of the clean object.
        fouled: [m] largest height of the growth.
        dented: [m] largest depth of the dents.
        rng: Draws the patches.
        near: (N, 3) [m] points in T around which the patches lie; None: all over the object.

    Returns:
        The deformed object; None, and nothing drawn, if both heights are 0.

    Raises:
        ConfigurationError: A height is out of range.
    """
    shown = target
    for name, height in (("fouled", fouled), ("dented", dented)):
        finite_number(height, f"--{name} [m]", least=0.0, most=_HIGHEST)
        if height > 0.0:
            shown = getattr(deformed, name)(shown, rng, _PATCHES, (0.4 * height, height), near=near).target
    return None if shown is target else shown


def coarse_detection(X_WT: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Coarse pose of an object at `X_WT` (4, 4), with a random error.

    Returns:
        Position (3,) [m], 10 to 30 cm off; rotation (3, 3), up to 30 deg off.
    """
    way, axis = rng.standard_normal((2, 3))
    approach = X_WT[:3, 3] + rng.uniform(0.1, 0.3) * way / np.linalg.norm(way)
    turn = exp_so3(rng.uniform(0.0, np.radians(30.0)) * axis / np.linalg.norm(axis))
    return approach, turn @ X_WT[:3, :3]
