"""Scenario: everything a run needs and nothing else, as a value and (`scenario_file`) as a TOML file."""

from dataclasses import dataclass, field
from typing import TypeVar

from controllers.ik.method import Method as IkMethod
from scenarios.arm_camera import ArmCameraSetup
from scenarios.methods import AblatedMethod, PublishedMethod
from scenarios.perturbations.perturbation import Perturbation
from scenarios.site import Site
from scenarios.tasks.task import Task
from sim.interfaces.errors import ConfigurationError
from sim.interfaces.files import folder_name
from sim.interfaces.protocols import Sensor
from sim.interfaces.spatial import finite_number, whole_number

P = TypeVar("P", bound=Perturbation)
_MOST_LOOKS = 40  # frames that arrive before the wait for a scan times out


@dataclass(frozen=True, kw_only=True)
class VehicleSetup:
    """The vehicle as it is."""

    vehicle: str = "uuv_puma"  # a name of models.available(), or a file, MJCF or URDF, with the named parts
    arm_errors: int | None = None  # seed of the errors with which the arm was built; None: no errors
    tool: str | None = None  # of models.tools.tools.TOOLS, on its tip; None: its own, or the one that the task needs
    parts: str | None = None  # file that maps its names to those of the contract; None: the one beside its file

    def __post_init__(self) -> None:
        if self.arm_errors is not None:
            whole_number(self.arm_errors, "--arm-errors")


@dataclass(frozen=True, kw_only=True)
class Belief:
    """What the vehicle believes of itself beside its nominal model."""

    water_error: float = 0.15  # share by which all its added masses and drags are wrong, alike
    calibrated: bool = False  # its arm model is identified from touches on deck
    arm: str | None = None  # file of its arm model; excludes `calibrated`

    def __post_init__(self) -> None:
        finite_number(self.water_error, "water_error")
        if self.calibrated and self.arm is not None:
            raise ConfigurationError("--calibrated and --arm: one of the two")


@dataclass(frozen=True, kw_only=True)
class Sensing:
    """Sensors, and noise of those that a study varies."""

    sensor: str = "camera"  # for identification: camera, sonar, survey, or one that an installed package registers
    looks: int = 1  # depth frames, or pings, whose median the path is planned on
    follow: bool = False  # follow the object by further depth frames while the vehicle scans it
    dead_beams: tuple[int, ...] = ()  # of the Doppler log, 1 to 4
    vision_period: float = 0.1  # [s]
    vision_delay: float = 0.1  # [s]
    vision_noise: float = 2e-3  # [m]
    torque_noise: float = 0.01  # share of the reading
    torque_bias: float = 0.5  # [N m] uniform in +-
    arm_camera: ArmCameraSetup | None = None  # camera beside the tool; None: there is none

    def __post_init__(self) -> None:
        whole_number(self.looks, "--looks", least=1, most=_MOST_LOOKS)
        for name in ("vision_period", "vision_delay", "vision_noise", "torque_noise", "torque_bias"):
            finite_number(getattr(self, name), name, least=0.0)

    def proprioception(self) -> list[Sensor]:
        """Encoders, torque sensors, IMU, DVL and vision of a drifting hull."""
        from sim.sensors import proprioception

        return [
            proprioception.Encoders(),
            proprioception.JointTorqueSensors(noise=self.torque_noise, bias=self.torque_bias),
            proprioception.Imu(),
            proprioception.Dvl(),
            proprioception.VisionDrift(period=self.vision_period, delay=self.vision_delay, noise=self.vision_noise),
        ]


@dataclass(frozen=True, kw_only=True)
class Control:
    """The controller, and methods that it does without."""

    controller: str = "work"  # registered name, or MODULE:CLASS
    without: tuple[AblatedMethod, ...] = ()
    ik: IkMethod = "hybrid"  # inverse kinematics that tracks the tool pose
    published: tuple[PublishedMethod, ...] = ()  # methods as in [Konoplin 2022], in place of the default ones
    elastic_gears: bool = False  # the softer joint servo for gears that twist under load

    def __post_init__(self) -> None:
        laws = {"force-law", "normal-force-law"} & {*self.published}
        if len(laws) + ("force-control" in self.without) > 1:
            raise ConfigurationError("--without force-control, --published force-law and normal-force-law: one of them")


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Everything a run needs."""

    name: str  # of the folder of results
    task: Task
    seed: int = 0  # of everything random but the perturbations
    site: Site = field(default_factory=Site)
    vehicle: VehicleSetup = field(default_factory=VehicleSetup)
    belief: Belief = field(default_factory=Belief)
    sensing: Sensing = field(default_factory=Sensing)
    control: Control = field(default_factory=Control)
    perturbations: tuple[Perturbation, ...] = ()  # applied in this order
    perturbation_seed: int = 0

    def __post_init__(self) -> None:
        folder_name(self.name, "name")
        whole_number(self.seed, "--seed")
        whole_number(self.perturbation_seed, "perturbation_seed")

    def perturbation(self, kind: type[P]) -> P:
        """The first perturbation of that kind.

        Raises:
            ConfigurationError: There is none.
        """
        for each in self.perturbations:
            if isinstance(each, kind):
                return each
        raise ConfigurationError(f"scenario {self.name!r} has no perturbation {kind.__name__}")
