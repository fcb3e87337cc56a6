"""A vehicle in other water: docs/change_water.md."""

from dataclasses import replace

from uuv import models
from uuv.models.hydrodynamics import attach, attached


def draggy():
    """The default vehicle with half as much drag again on its hull."""
    spec = models.load("uuv_puma")
    hull = attached(spec)["hull"]
    attach(spec, {"hull": replace(hull, quadratic_damping=1.5 * hull.quadratic_damping)})
    return spec
