"""What every scenario of contact work can be asked, and what a coarse detection says of an object."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from models.objects import deformed
from models.objects.targets import TargetModel
from scenarios.contact_job import ContactJob
from sim.interfaces.spatial import Array, exp_so3, finite_number, whole_number
from sim.runs.startup import ScenarioOptions

Left = Literal[
    "compensation", "hydrodynamic-term", "dynamic-term", "contact-term", "drift-correction", "force-control", "fusion"
]

SLOWEST, FASTEST = 1e-4, 1.0  # [m/s] of the tool along a path
_MOST_FORCE = 1e3  # [N] beyond what any vehicle here can press with
_MOST_LOOKS = 40  # that come within the time that a scan is waited for
_HIGHEST = 1.0  # [m] of growth, or dents
_PATCHES = 3  # of growth, or dents


@dataclass(kw_only=True)
class ContactOptions(ScenarioOptions):
    """What every scenario of contact work can be asked."""

    forces: tuple[float, ...] = ()
    """Set forces [N] on equal parts of the path; 60 90 60 along and 60 90 around by default."""
    speed: float = 0.02
    """Of the tool along the path [m/s]."""
    contactless: float | None = None
    """Keep the tool at this distance [m] from the surface, without touching, in place of pressing (paper 004)."""
    fouled: float = 0.0
    """Growth on the object, up to this height [m], along the path; the vehicle knows the clean object alone."""
    dented: float = 0.0
    """The same with dents, up to this deep [m]."""
    looks: int = 1
    """Frames, or pings, in a row whose median the tool path is planned on; 16 for what may be fouled or dented."""
    sensor: Literal["camera", "sonar"] = "camera"
    """What the object is seen with."""
    without: tuple[Left, ...] = ()
    """Methods to leave out, for ablation."""
    arm_errors: int | None = None
    """Seed of an arm built 2 mm and 0.3 deg wrong in every joint, which the controller does not know."""
    calibrated: bool = False
    """Calibrate the arm first, touching four points with a hand's noise of 0.1 mm; one distance is known."""
    arm: Path | None = None
    """Arm as the controller shall know it: arm.yaml of calibrate_arm.py."""
    range: float = 1.25
    """From camera to object [m] at which it is scanned."""
    vehicle: str = "uuv_puma"
    """A name of models.available(), or an MJCF file with the named parts (README)."""
    controller: str = "controllers.work_controller:WorkController"
    """MODULE:CLASS of the controller."""

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
        """Work along `path` of `target`, which lies at `X_WT` (4, 4); `forces` [N] where none are asked for.

        What is coarsely known of it, and what the sea has made of it, is drawn from `rng`. Raises ConfigurationError
        for a number of looks, or heights of growth, that cannot be.
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
        """What the sea has made of `target`, mostly along its path `path`; None: nothing. Draws only if asked to.

        Raises ConfigurationError for heights that cannot be.
        """
        return left_by_the_sea(target, self.fouled, self.dented, rng, near=target.path(path).p)


def left_by_the_sea(
    target: TargetModel, fouled: float, dented: float, rng: np.random.Generator, near: Array | None = None
) -> TargetModel | None:
    """`target` with growth up to `fouled` [m] and dents up to `dented` [m], `near` points (N, 3) in T or all over.

    None, and nothing drawn, if both are 0. Raises ConfigurationError for heights that cannot be.
    """
    shown = target
    for name, height in (("fouled", fouled), ("dented", dented)):
        finite_number(height, f"--{name} [m]", least=0.0, most=_HIGHEST)
        if height > 0.0:
            shown = getattr(deformed, name)(shown, rng, _PATCHES, (0.4 * height, height), near=near).target
    return None if shown is target else shown


def coarse_detection(X_WT: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """What a coarse detection says of an object at `X_WT`: place (3,) [m], 10 to 30 cm off, and axes, up to 30 deg."""
    way, axis = rng.standard_normal((2, 3))
    approach = X_WT[:3, 3] + rng.uniform(0.1, 0.3) * way / np.linalg.norm(way)
    turn = exp_so3(rng.uniform(0.0, np.radians(30.0)) * axis / np.linalg.norm(axis))
    return approach, turn @ X_WT[:3, :3]
