"""Random scenes of objects: what is seen is the object at the pose that is called true, and a seed
gives one scene.
"""

import numpy as np
import pytest

from uuv.perception.registration.identification import identify
from uuv.perception.registration.model_surface import ModelSurface
from uuv.sim.interfaces.errors import ConfigurationError


@pytest.mark.parametrize("name", ["barrel", "manifold"])
def test_the_object_stands_where_it_is_said_to(name: str, within):
    from uuv.clouds.object_scenes import object_scene

    scene = object_scene(name, 3, "white")
    frame_seen, _ = ModelSurface.of(scene.target).seen(scene.X_CT, scene.scan)
    off = (scene.scan.depth - frame_seen.depth)[np.isfinite(frame_seen.depth)]
    within("median [m]", np.nanmedian(off), 1.5e-3)  # 0.16 mm: how a cylinder is cut into triangles
    within("spread [m]", 1.4826 * np.nanmedian(np.abs(off)) - 0.003, 1.5e-3)  # 0.18 mm off the 3 mm
    assert np.isfinite(off).mean() > 0.99


def test_a_seed_gives_one_scene_and_a_start_within_its_limits():
    from uuv.clouds.object_scenes import object_scene

    first, again, other = (
        object_scene("barrel", seed, sensor)
        for seed, sensor in ((1, "stereo"), (1, "white"), (2, "stereo"))
    )
    assert np.array_equal(first.X_CT, again.X_CT)
    assert np.array_equal(first.approach, again.approach)
    assert not np.array_equal(first.scan.depth, again.scan.depth)
    assert not np.array_equal(first.X_CT, other.X_CT)
    assert np.array_equal(first.scan.depth, object_scene("barrel", 1).scan.depth, equal_nan=True)
    assert 1.0 <= first.range_m <= 2.0
    for scene in (first, other):
        assert np.linalg.norm(scene.approach - scene.X_CT[:3, 3]) <= 0.3
        assert (
            np.trace(scene.orientation.T @ scene.X_CT[:3, :3])
            >= 1.0 + 2.0 * np.cos(np.deg2rad(45.0)) - 1e-9
        )
    assert scene.error(scene.X_CT) == pytest.approx((0.0, 0.0), abs=1e-7)


def test_other_objects_and_none():
    from uuv.clouds.object_scenes import object_scene, target_of

    first, none = (
        object_scene("barrel", 1, there=target_of("manifold"), absent=absent)
        for absent in (False, True)
    )
    covered = np.isfinite(
        ModelSurface.of(target_of("manifold")).seen(first.X_CT, first.scan)[0].depth
    )
    assert np.nanmedian((none.scan.depth - first.scan.depth)[covered]) > 0.1


def test_unknown_names_are_refused():
    from uuv.clouds.object_scenes import object_scene

    with pytest.raises(ConfigurationError, match="manifold"):
        object_scene("teapot", 0)
    with pytest.raises(ConfigurationError, match="stereo"):
        object_scene("barrel", 0, "eye")


def test_a_sliver_of_the_bed_does_not_draw_the_search():
    """With nothing known beforehand; some part of a valve explains a sliver better than the valve
    its own patch.
    """
    from uuv.clouds.object_scenes import object_scene

    scene = object_scene("valve", 908)
    identification = identify(scene.scan, scene.target, sensor=scene.sensor.model)
    assert identification.accepted, identification.reason
    assert scene.error(identification.X_sensor_target)[0] < 0.01
