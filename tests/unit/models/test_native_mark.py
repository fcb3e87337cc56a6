"""MJCF of what needs native code: refused by MuJoCo alone, at home where the code is imported."""

import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.models import hydrodynamics as water
from uuv.models.arms import gear_friction
from uuv.models.arms.gear_friction import GearFriction
from uuv.models.files.sidecar import xml_with_elements, xml_without_water
from uuv.models.water.native_mark import PLUGIN, mark, without_mark
from uuv.sim import hydrodynamics

BALL = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody> <body name="ball"> <freejoint/> <geom size=".1" mass="4"/> </body> </worldbody>
</mujoco>
"""
HINGE = '<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody></mujoco>'


def ball() -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(BALL)
    water.attach(spec, {"ball": water.sphere(0.1)})
    return spec


def gear() -> mujoco.MjSpec:
    spec = mujoco.MjSpec.from_string(HINGE)
    friction = GearFriction(coulomb=1.0, stiction=2.0, stribeck_speed=0.1)
    gear_friction.attach(spec, {"j": friction})
    return spec


def scene() -> mujoco.MjSpec:
    spec = mujoco.MjSpec()
    spec.attach(ball(), prefix="own_", frame=spec.worldbody.add_frame(pos=[1, 2, 3]))
    spec.attach(ball(), prefix="other_", frame=spec.worldbody.add_frame(pos=[1, 4, 3]))
    return spec


def test_mujoco_alone_refuses_what_would_move_dry(tmp_path: Path):
    """By the name of the missing module; a vehicle in air, beside its water file, it reads."""
    elements = xml_with_elements(models.load("bluerov2_heavy"))
    again = mujoco.MjSpec.from_string(ball().to_xml()).to_xml()
    refused = [ball().to_xml(), ball().copy().to_xml(), again, gear().to_xml(), elements]
    spec = scene()
    spec.compile()
    refused.append(spec.to_xml())
    for k, xml in enumerate(refused):
        (tmp_path / f"{k}.xml").write_text(xml)
    (tmp_path / "air.xml").write_text(xml_without_water(models.load("bluerov2_heavy")))
    code = f"""
import mujoco, sys
for k in range({len(refused)}):
    for read in (mujoco.MjModel.from_xml_path, mujoco.MjSpec.from_file):
        try:
            read(f"{{k}}.xml")
            print("read", k)
        except ValueError as error:
            print(str(error).partition(chr(10))[0])
mujoco.MjModel.from_xml_path("air.xml")
assert not any(name.startswith("uuv") for name in sys.modules)
"""
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert set(run.stdout.splitlines()) == {f"XML Error: plugin {PLUGIN} not found"}
    assert len(run.stdout.splitlines()) == 2 * len(refused)


@pytest.mark.parametrize("reader", ["from_xml_path", "from_xml_string"])
def test_a_process_with_the_module_loads_it_wet(reader: str, tmp_path: Path):
    xml = ball().to_xml()
    (tmp_path / "ball.xml").write_text(xml)
    hydrodynamics.uninstall()
    mujoco.MjModel.from_xml_string(BALL)
    assert not hydrodynamics.is_installed()
    source = xml if reader == "from_xml_string" else str(tmp_path / "ball.xml")
    model = getattr(mujoco.MjModel, reader)(source)
    assert hydrodynamics.is_installed()
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 100)
    assert data.qvel[2] > -0.1  # in air it would have fallen at 2 m/s
    hydrodynamics.uninstall()


def test_the_mark_leaves_no_trace_in_a_compiled_model():
    spec = ball()
    for _ in range(3):
        mark(spec)
    assert spec.to_xml().count(PLUGIN) == 1
    assert hydrodynamics.compile(spec).nplugin == 0
    assert scene().compile().nplugin == 0


def test_a_file_without_the_mark_is_otherwise_the_same():
    spec = ball()
    xml = without_mark(spec.to_xml())
    assert PLUGIN not in xml
    assert "extension" not in xml
    plain = mujoco.MjModel.from_xml_string(xml)
    marked = spec.compile()
    np.testing.assert_allclose(plain.body_user[1], marked.body_user[1], rtol=1e-5)
    assert without_mark(BALL) == BALL


def test_an_instance_of_it_is_refused():
    declared = f'<extension><plugin plugin="{PLUGIN}"><instance name="i"/></plugin></extension>'
    with pytest.raises(ValueError, match="plugin->init failed"):
        mujoco.MjModel.from_xml_string(BALL.replace("<worldbody>", declared + "<worldbody>"))
