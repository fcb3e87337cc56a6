"""What a camera on the arm sees beside the object's shape, read without the camera's kernels."""

from dataclasses import dataclass

from uuv.sim.interfaces.spatial import finite_number


@dataclass(frozen=True, kw_only=True)
class ViewConditions:
    """What the camera sees beside the object's shape."""

    # standard deviation of the surface's reflectance, share of its mean; 0: plain
    texture: float = 0.2
    attenuation: float = 0.4  # [1/m] of a beam of light
    cloud_rate: float = 0.05  # [1/s] of clouds of silt; each hides a share drawn between 0 and 1
    cloud_time: float = 1.0  # [s] mean time that one lasts
    # standard deviation of the error of the stereo calibration's scale, constant over a run
    scale: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("texture", "attenuation", "cloud_rate", "cloud_time", "scale"):
            finite_number(getattr(self, name), f"arm camera {name}", least=0.0)
        finite_number(self.cloud_time, "arm camera cloud_time [s]", above=0.0)
