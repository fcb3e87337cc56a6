"""View conditions of a camera on the arm: texture, water, silt and scale error, without the
camera's kernels.
"""

from dataclasses import dataclass

from uuv.sim.interfaces.spatial import finite_number


@dataclass(frozen=True, kw_only=True)
class ViewConditions:
    """View conditions of the camera: texture of the surface, water, silt, and error of the
    scale.
    """

    # standard deviation of the surface's reflectance, as a share of its mean; 0: uniform
    texture: float = 0.2
    attenuation: float = 0.4  # [1/m] attenuation of a beam of light
    # [1/s] rate of clouds of silt, each of which hides a share drawn between 0 and 1
    cloud_rate: float = 0.05
    cloud_time: float = 1.0  # [s] mean duration of a cloud
    # standard deviation of the error of the stereo calibration's scale, constant over a run
    scale: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("texture", "attenuation", "cloud_rate", "cloud_time", "scale"):
            finite_number(getattr(self, name), f"arm camera {name}", least=0.0)
        finite_number(self.cloud_time, "arm camera cloud_time [s]", above=0.0)
