"""The operator's window."""

import mujoco

from uuv.driving.keyboard import ViewerLook


def test_what_a_drawingers_own_keys_change_is_undone():
    option = mujoco.MjvOption()
    scene = mujoco.MjvScene(mujoco.MjModel.from_xml_string("<mujoco/>"), maxgeom=1)
    option.geomgroup[3] = 1
    arrays = (option.geomgroup, option.sitegroup, option.flags, scene.flags)
    before = [array.tolist() for array in arrays]
    drawing = ViewerLook(option, scene)

    for array in arrays:
        array[:4] = 1 - array[:4]
    drawing.restore()
    assert [array.tolist() for array in arrays] == before
