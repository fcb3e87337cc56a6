"""Collections: the mesh that no one has prepared, and what is refused."""

from pathlib import Path

import pytest

from experiments.contact.collect import BRACKET, LENGTH, OBJECTS, CollectCase, bracket, stl
from uuv.models.meshes.closed_shells import volume
from uuv.models.objects import targets
from uuv.models.objects.grasps import antipodal
from uuv.sim.interfaces.errors import ConfigurationError


def test_the_bracket_is_a_closed_angle_that_has_grasps(tmp_path: Path) -> None:
    vertices, triangles = bracket()
    section = 0.06 * 0.012 + 0.012 * 0.028
    assert volume(vertices, triangles) == pytest.approx(section * LENGTH, rel=1e-9)

    file = tmp_path / "bracket.stl"
    file.write_text(stl(vertices, triangles))
    target = targets.of(file, 1.0)
    widths = [grasp.width for grasp in antipodal(target.vertices, target.triangles, friction=0.6)]
    assert min(widths) == pytest.approx(0.012, abs=1e-3)


def test_an_object_that_is_not_in_the_list_is_refused() -> None:
    CollectCase(what=BRACKET, seed=0)
    with pytest.raises(ConfigurationError, match=f"what: must be one of {next(iter(OBJECTS))}"):
        CollectCase(what="anvil", seed=0)
