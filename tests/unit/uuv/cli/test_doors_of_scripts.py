"""What scripts are given: options out of range, plug-ins that raise, vehicles without parts,
touches that are none.
"""

from importlib import import_module
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest

from uuv import models
from uuv.calib.touch_files import read_touches
from uuv.controllers.tuning import ArmTuning, TouchTuning
from uuv.models.naming import check_parts
from uuv.sim.interfaces.errors import LONGEST, ConfigurationError


@pytest.fixture
def parts() -> ModuleType:
    return import_module("uuv.components.contact_parts")


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("clean_object", ("--least", "nan"), "--least: must be finite, got nan"),
        (
            "clean_object",
            ("--least", "2"),
            "--least (task.least), a share of the path: must be positive",
        ),
        ("clean_barrel", ("--speed", "inf"), "--speed: must be finite, got inf"),
        (
            "clean_barrel",
            ("--speed", "1e9"),
            "--speed (task.speed) [m/s]: must be finite, >= 0.0001, <= 1, got 1e+09",
        ),
        (
            "clean_barrel",
            ("--arm-errors", "-1"),
            "--arm-errors (vehicle.arm_errors): must be a whole number >= 0",
        ),
        ("clean_barrel", ("--forces", "60", "nan"), "--forces: must be finite, got nan"),
        ("clean_barrel", ("--set", "task.sped=0.03"), "--set: "),
        ("clean_barrel", ("--quick", "--speed", "0.08"), "--speed 0.044, or a path of 0.36 m"),
        (
            "clean_barrel",
            ("--speed", "0.001", "--longest", "500"),
            "--longest 500 s: must be longer than the work, which takes at least 602 s",
        ),
        (
            "clean_barrel",
            ("--looks", "0"),
            "--looks (sensing.looks): must be a whole number in 1..40, got 0",
        ),
        ("clean_barrel", ("--vehicle", "n" * 300 + ".xml"), "file name too long"),
    ],
)
def test_an_option_of_a_script_out_of_range_is_one_line(
    script, name: str, options: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    is_one_line(script(name, *options, "--out", tmp_path), said)


@pytest.mark.parametrize(
    ("words", "options", "said"),
    [
        ("calibrate", ("--arm-errors", "-1"), "--arm-errors: must be a whole number >= 0, got -1"),
        (
            "plan-seabed",
            ("--cloud", "a", "--targets", "b", "--width", "1e-9"),
            "--width [m]: must be finite, >= 0.001",
        ),
        ("campaign", ("nothing.toml",), "nothing.toml"),
        (
            "campaign",
            ("nothing.toml", "--only", "1", "--page"),
            "--only, --replay and --page: give only one of them",
        ),
        ("compare-campaigns", ("nowhere", "elsewhere"), "nowhere: no folder of a campaign"),
        ("benchmark", ("--cases", "0"), "--cases: must be at least 1, got 0"),
        ("benchmark", ("--entry", "nobody"), "nobody"),
        ("identify object", ("--cloud", "nothing.ply"), "nothing.ply"),
        ("identify friction", ("--gear-spread", "2"), "--gear-spread"),
        ("identify water", ("--vehicle", "nothing"), "unknown vehicle 'nothing'"),
        ("validate", ("--outt",), "--outt"),
    ],
)
def test_an_option_of_a_verb_out_of_range_is_one_line(
    verb, words: str, options: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    is_one_line(verb(*words.split(), *options, "--out", tmp_path), said)


def is_one_line(run, said: str) -> None:
    assert run.returncode == 2
    assert said in run.stderr
    assert run.stderr.count("\n") == 1
    assert len(run.stderr) <= LONGEST + len("error: \n")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "import nothing_of_the_kind",
            r"cannot be imported; ModuleNotFoundError: No module named "
            r"'nothing.*plug.py:1",
        ),
        ("x = 1\nraise SystemExit(3)", r"cannot be imported; SystemExit: 3 \(.*plug.py:2\)"),
        ("def f(:\n", r"cannot be imported; SyntaxError: .*plug.py:1"),
        ("x = 1", r"cannot be imported; AttributeError: module 'plug' has no attribute 'C'"),
        (
            "class C:\n    period = 0.01\n    def __init__(self, model, **how):\n        "
            "{}['gain']\n",
            r"cannot be made from a model; KeyError: 'gain' \(.*plug.py:4\)",
        ),
        (
            "class C:\n    def __init__(self, model): ...\n",
            "cannot be made from a model; TypeError: .*water_error",
        ),
        (
            "class C:\n    period = 0.0\n    def __init__(self, *a, **k): ...\n",
            "period .s.: must be positive",
        ),
        (
            "class C:\n    period = 0.01\n    def __init__(self, *a, **k): ...\n",
            "it has no init and no step",
        ),
    ],
)
def test_a_plug_in_that_raises_is_named_with_its_line(
    parts: ModuleType, text: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "plug.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(import_module("sys").modules, "plug", raising=False)
    with pytest.raises(
        ConfigurationError, match=f"control.controller 'plug:C': .*{said}"
    ) as refused:
        parts.controller(
            parts.Control(controller="plug:C"), models.load("uuv_puma").compile(), water_error=0.0
        )
    assert len(str(refused.value)) <= LONGEST


def test_missing_parts_of_a_vehicle_are_named_all_at_once_with_their_use() -> None:
    spec = models.load("uuv_puma")
    check_parts(spec.compile())
    for key in list(spec.keys):
        spec.delete(key)
    spec.site("camera").name = "eye"
    message = (
        r"lacks .*: site 'camera' \(sees .*keyframe 'home' \(arm folded.*keyframe 'ready' "
        r"\(arm bent, IK"
    )
    with pytest.raises(ConfigurationError, match=message):
        check_parts(spec.compile())
    bare = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="hull"><freejoint/><geom '
        'size=".1"/></body></worldbody></mujoco>'
    )
    with pytest.raises(ConfigurationError, match=r"thrusters, body 'arm_base'.*'ready'") as refused:
        check_parts(bare.compile())
    assert len(str(refused.value)) <= LONGEST


def test_poses_are_no_touches(tmp_path: Path) -> None:
    """Seven columns for seven joints: x y z and a quaternion, as they lie beside joint angles in
    published folders.
    """
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.5, 1.5, (12, 7))
    quat = rng.normal(size=(12, 4))
    poses = np.column_stack(
        [rng.uniform(-0.5, 0.5, (12, 3)), quat / np.linalg.norm(quat, axis=1, keepdims=True)]
    )
    np.savetxt(tmp_path / "hole_0.csv", q, "%.6f", ",")
    how = {"joint_types": "r" * 7, "limits": np.tile([-2.0, 2.0], (7, 1))}
    assert read_touches(tmp_path, **how).count == 12
    np.savetxt(tmp_path / "hole_0_pose.csv", poses, "%.6f", ",")
    with pytest.raises(
        ConfigurationError,
        match=r"hole_0_pose.csv: must hold joint values, but has poses \(x y z and a "
        r"unit quaternion",
    ):
        read_touches(tmp_path, **how)
    (tmp_path / "hole_0_pose.csv").unlink()
    q[4, 2] = 2.6
    np.savetxt(tmp_path / "hole_1.csv", q, "%.6f", ",")
    with pytest.raises(
        ConfigurationError,
        match=r"'hole_1': touch 5 has joint 3 at 2.6 rad, .* "
        r"limits are -2 to 2",
    ):
        read_touches(tmp_path, **how)


def test_touching_feels_by_the_same_filters_as_work() -> None:
    """Sensors and gears are the same; only the servo of free motion is the touching's own."""
    mine = TouchTuning().drives
    shared = ArmTuning()
    names = ("joint_frequency", "joint_damping", "joint_integral_time")
    differing = [name for name in shared.__slots__ if getattr(mine, name) != getattr(shared, name)]
    assert sorted(differing) == sorted(names)
