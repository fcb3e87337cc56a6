"""Options of the identification of an object in a cloud, and checks of its inputs before
compiling.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from uuv.perception.registration_method import Method
from uuv.sim.interfaces.errors import ConfigurationError


@dataclass(kw_only=True)
class IdentificationOptions:
    """Identify a known object in a point cloud."""

    object: str = "barrel"
    """A name of uuv.models.objects.targets.available(), a mesh file (STL, PLY, OBJ, OFF, glTF), or
    a cloud of the surface (PLY, PCD, text with x y z a line, and perhaps a normal), which is
    meshed.
    """
    among: tuple[str, ...] = ()
    """Names, mesh or cloud files, and folders of them: which of these is it? --object is then only
    what the simulated scene shows.
    """
    cloud: Path | None = None
    """Text (x y z a line), PLY or PCD, in the sensor's frame; default: a simulated scene."""
    scale: float | None = None
    """Unit of the cloud in metres: 0.001 for millimetres."""
    mesh_scale: float | None = None
    """Unit of the mesh or cloud files of models in metres."""
    approach: tuple[float, float, float] | None = None
    """Coarse position of the object's centre in the sensor's frame [m]; default: unknown."""
    rotation: tuple[float, float, float] | None = None
    """Coarse attitude of the object in the sensor's frame as a rotation vector [deg]; default:
    unknown.
    """
    sigma: float | None = None
    """Standard deviation of the sensor's depth [m] at 1 m range; it grows with the square of the
    range.
    """
    sensor: Literal["stereo", "white", "sonar"] = "stereo"
    """Sensor of the simulated scene."""
    method: Method = "planes"
    """Registration method; paper: as published, for comparison."""
    fouled: float = 0.0
    """Growth on the object in the simulated scene, up to this height [m]; its model stays clean."""
    dented: float = 0.0
    """Dents in the object in the simulated scene, up to this depth [m]; its model stays
    undamaged.
    """
    seed: int = 0
    """Seed of the simulated scene and of random samples."""
    out: Path | None = None
    """Folder for identification.json, cloud.ply, model.ply and identification.png. Where the object
    differs from its model, also deformation.ply and deformation.png.
    """

    def __post_init__(self) -> None:
        if self.sigma is None:
            return
        from uuv.perception.clouds.scan import SIGMA_ALLOWED  # this import loads numba

        least, most = SIGMA_ALLOWED
        if not least <= self.sigma <= most:
            raise ConfigurationError(
                f"--sigma: must be {least:g} to {most:g} m (at a range of 1 m), got {self.sigma}"
            )


def check_inputs(options: IdentificationOptions) -> None:
    """Refuse an unknown object, and files that are neither mesh nor cloud.

    Raises:
        ConfigurationError: The message names the option, the allowed values and the given one.
    """
    from uuv.models.meshes.surfel_files import check_surfels
    from uuv.models.objects import targets

    if options.cloud is not None:
        check_surfels(options.cloud)
    names = options.among or (options.object,)
    if options.among and options.cloud is None:
        names = (*names, options.object)
    for name in names:
        if not Path(name).is_dir():  # a folder is read as a whole, once
            targets.of(name, options.mesh_scale if Path(name).suffix else None)
