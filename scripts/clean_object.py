"""Contact cleaning of any known object: one of the library by name, or a mesh file with a path laid on it.

The task is that of clean_barrel.py with another object. A named object is worked along one of its own paths. On a mesh
file [m] the path is a line over its top, along x, projected onto the mesh from above.
"""

from scenarios.start import parse, run_scenario  # isort: skip

import time
from dataclasses import dataclass

import numpy as np

from models.objects import targets
from models.objects.targets import TargetModel
from perception.toolpath.path_shapes import laid_on, line
from scenarios.contact_job import ContactJob, run_contact_job
from scenarios.contact_options import ContactOptions
from sim.interfaces.spatial import exp_so3, pose


@dataclass(kw_only=True)
class Options(ContactOptions):
    """Clean a known object with a set force."""

    object: str = "rock"
    """A name of models.objects.targets.available(), or a mesh file."""
    path: str | None = None
    """Name of one of the object's paths; default: the first."""
    length: float = 0.3
    """Length of the line over a mesh [m]."""
    least: float = 0.6
    """Least share of the path that must be within reach; the rest is dropped at both ends, and reported."""
    range: float = 1.2


def model_of(options: Options) -> TargetModel:
    """The target model that `options` select, with a straight path laid on a mesh that has none.

    Raises:
        ConfigurationError: There is no such object, or the line misses the mesh.
    """
    target = targets.of(options.object)
    if target.paths:
        return target
    top = target.center + np.array([0.0, 0.0, target.radius])
    half = np.array([0.5 * options.length, 0.0, 0.0])
    over = laid_on(target, line(top - half, top + half), [0.0, 0.0, -1.0])
    return target.with_path("over", over)


def object_job(options: Options, rng: np.random.Generator) -> ContactJob:
    """The contact job for `options`; the object's pose and its coarse detection are drawn from `rng`.

    Raises:
        ConfigurationError: The object or its path is unknown, or an option is out of range.
    """
    target = model_of(options)
    path = options.path or next(iter(target.paths), "none")
    target.path(path)  # raises for an unknown name, and lists the known ones
    X_WT = pose(exp_so3([0.0, 0.0, rng.uniform(-0.6, 0.6)]), rng.uniform(-0.2, 0.2, 3) - [0.0, 0.0, 1.5])
    forces = (60.0,) if options.quick else (60.0, 90.0, 60.0)
    return options.job("clean_object", target, path, X_WT, rng, forces=forces, least_share=options.least)


def main() -> int:
    """Runs the scenario and returns the exit code."""
    options = parse(Options)
    rng = np.random.default_rng(options.seed)
    return run_contact_job(object_job(options, rng), options, rng, started=time.perf_counter())


if __name__ == "__main__":
    run_scenario(main)
