"""The code in the documents runs as it stands there."""

import pkgutil
import re
import sys
from dataclasses import fields, replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from untyped import untyped
from uuv import assemble, jobs, models
from uuv.cli.skeletons import SENSOR
from uuv.controllers.arm.inverse_dynamics import ArmDynamics
from uuv.models.vehicle import Vehicle
from uuv.scenario_file import with_values
from uuv.sim.interfaces.messages import Command, Reference, StateEstimate
from uuv.sim.interfaces.protocols import Controller
from uuv.sim.interfaces.spatial import pose


def names_of(
    root: Path, word: str, page: str = "docs/own_controller.md", **given: Any
) -> dict[str, Any]:
    """What the one block of Python with `word` in it defines, where the names in `given` are there
    already.
    """
    blocks = re.findall(r"```python\n(.*?)```", (root / page).read_text(), flags=re.DOTALL)
    (block,) = [block for block in blocks if word in block]
    names: dict[str, Any] = {"__name__": "of_the_documents", **given}
    exec(compile(block, page, "exec"), names)
    return names


def fields_of(root: Path, message: type) -> set[str]:
    """Names in the first column of the table of a message's fields in own_controller.md."""
    page = (root / "docs" / "own_controller.md").read_text()
    table = page.split(f"| field of `{message.__name__}` | |\n|---|---|\n")[1].split("\n\n")[0]
    return {
        name for row in table.splitlines() for name in re.findall(r"`(\w+)`", row.split("|")[1])
    }


@pytest.mark.parametrize("message", [StateEstimate, Reference, Command])
def test_every_field_of_a_message_is_in_the_documents(root, message):
    assert fields_of(root, message) == {field.name for field in fields(message)}


def test_the_call_of_inverse_dynamics_in_the_documents_is_as_it_says(root):
    """The wrench on the tip acts by -J^T on the joints, and by itself on the hull."""
    model = models.load("uuv_puma").compile()
    arm = ArmDynamics(model)
    vehicle = Vehicle.of(model)
    rest = np.zeros(arm.n)
    still = np.zeros(3)
    estimate = SimpleNamespace(
        q=vehicle.q_ready, qd=rest, X_WB=np.eye(4), v_WB_B=still, w_WB_B=still, a_WB_B=still
    )
    names = names_of(
        root, "arm.inverse(", "docs/benchmark.md", arm=arm, estimate=estimate, qdd=rest
    )
    none = {
        "nu_B": np.zeros(6),
        "a_B": np.zeros(6),
        "v_current_W": still,
        "wrench_tip_G": np.zeros(6),
    }
    tau, wrench_B = arm.inverse(vehicle.q_ready, rest, rest, R_WB=np.eye(3), **none)
    X_BG, J_B = arm.tip(vehicle.q_ready)
    force_B = X_BG[:3, :3] @ [0.0, 0.0, -60.0]
    np.testing.assert_allclose(names["tau"] - tau, -J_B[:3].T @ force_B, atol=1e-9)
    np.testing.assert_allclose((names["wrench_B"] - wrench_B)[:3], force_B, atol=1e-9)
    assert np.abs(force_B).max() > 10.0


def test_the_force_law_of_the_documents_is_the_controllers(root):
    """And it takes 15 lines at most."""
    names = names_of(root, "class Integrator")
    model = models.load("uuv_puma").compile()
    controller = names["integrating"](model, water_error=0.1)
    law = names["Integrator"]()
    assert law in controller.tunings
    assert law.step(law.init(), 10.0, 4.0, 0.0, 0.5) == pytest.approx(12e-4)


def test_the_compiled_force_law_of_the_documents_is_the_same(root):
    names = names_of(root, "law=integrate")
    assert names["integrate"](np.zeros(1), 10.0, 4.0, 0.0, 0.5) == pytest.approx(12e-4)
    model = models.load("uuv_puma").compile()
    assert isinstance(names["integrating"](model, water_error=0.1), Controller)


def test_the_controller_of_the_documents_bears_the_arm(root):
    names = names_of(root, "class BearWeight")
    model = models.load("uuv_puma").compile()
    vehicle = Vehicle.of(model)
    controller = names["BearWeight"](model)
    assert isinstance(controller, Controller)
    n = vehicle.joints.size
    estimate = StateEstimate(
        time=0.0,
        X_WB=np.eye(4),
        v_WB_B=np.zeros(3),
        w_WB_B=np.zeros(3),
        a_WB_B=np.zeros(3),
        q=vehicle.q_home,
        qd=np.zeros(n),
        tau=np.zeros(n),
    )
    _, command = controller.step(
        controller.init(estimate), estimate, untyped(SimpleNamespace(scan=False))
    )
    assert np.all(np.isfinite(command.joint_torque))
    assert 1.0 < np.abs(command.joint_torque).max() < 200.0
    assert not command.thrusters.any()


def test_the_fault_of_the_documents_reaches_the_thruster(root, monkeypatch):
    """The commands pass, but for the one thruster, whose own is multiplied."""
    # dataclasses look there
    monkeypatch.setitem(sys.modules, "of_the_documents", ModuleType("of_the_documents"))
    names = names_of(root, "class SwingingPlant", "docs/own_task.md")
    fault = names["Swinging"](thruster="heave_front")
    plant = assemble(replace(jobs.clean_barrel(quick=True), perturbations=(fault,))).loop.plant
    command = np.linspace(0.1, 0.6, 6)
    sent = []
    monkeypatch.setattr(
        type(untyped(plant).plant), "step", lambda _, command: sent.append(command.thrusters)
    )
    for time in (0.0, 0.125):
        plant.step(Command(time=time, joint_torque=np.zeros(6), thrusters=command, scan=False))
    factor = np.where(
        np.array(untyped(plant).plant.vehicle.thruster_names) == "heave_front", 1.3, 1.0
    )
    np.testing.assert_allclose(sent, [command, factor * command], rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "page"),
    [
        ("my_flow", "own_current"),
        ("my_wake", "own_current"),
        ("my_water", "change_water"),
        ("square", "own_job"),
    ],
)
def test_an_example_is_the_block_of_its_page(root, name, page):
    """A file in docs/examples is the block of the page with a line about it before."""
    page = (root / "docs" / f"{page}.md").read_text(encoding="utf-8")
    example = (root / "docs" / "examples" / f"{name}.py").read_text(encoding="utf-8")
    assert example.partition("\n\n")[2] in re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)


def test_the_currents_of_the_documents_are_those_of_a_run(root, monkeypatch):
    """A jet by the command line's name, and shelter behind the object by `on_water`, at the start
    of a run.
    """
    monkeypatch.syspath_prepend(root / "docs" / "examples")
    plain = with_values(
        jobs.clean_barrel(quick=True), ["site.gust=0.0", "site.current=[0.0, 0.2, 0.0]"]
    )
    in_jet = assemble(
        with_values(plain, ["site.flow.kind=my_flow:Jet", "site.flow.width=3.0"])
    ).plant
    np.testing.assert_array_equal(in_jet.truth.current_W, [0.0, 0.2, 0.0])  # it sets in slowly
    for _ in range(50):
        in_jet.observe()
        in_jet.step(Command(time=0.0, joint_torque=np.zeros(6), thrusters=np.zeros(6), scan=False))
    rise = 1.0 - np.exp(-0.1 / 10.0)
    across = np.exp(-((in_jet.data.qpos[0] / 3.0) ** 2))
    np.testing.assert_allclose(
        in_jet.truth.current_W, [0.0, 0.2 + 0.2 * across * rise, 0.0], atol=1e-12
    )

    sheltered = assemble(with_values(plain, ["perturbations.my_wake:Sheltered.share=0.4"]))
    middle = np.array(sheltered.plant.model.body("target").pos)
    sheltered.plant.reset(
        current=sheltered.current(), X_WB=pose(None, middle + np.array([0.0, 2.0, 0.0]))
    )
    expected = 0.2 * (1.0 - 0.4 * 0.5 * (1.0 + np.tanh(4.0)))
    np.testing.assert_allclose(sheltered.plant.truth.current_W, [0.0, expected, 0.0], atol=1e-12)


def test_the_sensor_of_the_documents_is_the_skeletons(root):
    page = (root / "docs" / "own_sensor.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", page, flags=re.DOTALL)
    assert SENSOR.part.replace("NAME", "noisy").endswith(block)


def test_code_that_the_methods_name_is_there(root):
    page = (root / "docs" / "methods.md").read_text(encoding="utf-8")
    files = re.findall(r"`((?:\w+/)+\w+\.py)`", page)
    assert len(files) > 10
    for file in files:
        assert (root / file).is_file(), file
    names = re.findall(r"\]\[([\w.]+)\]", page)
    assert len(names) > 10
    for name in names:
        assert pkgutil.resolve_name(name) is not None


def anchors_of(page: Path) -> set[str]:
    """Anchors that a browser finds on a page: its headings, lower case, blanks as hyphens."""
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    headings = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return {
        re.sub(r"[^\w\- ]", "", heading.lower()).strip().replace(" ", "-") for heading in headings
    }


def test_links_of_the_first_page_and_of_the_documents_open(root):
    """Files and headings; the addresses of other sites are not asked for."""
    broken = []
    for page in (root / "README.md", *sorted((root / "docs").glob("*.md"))):
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            if target.startswith("http"):
                continue
            file, _, anchor = target.partition("#")
            linked = page.parent / file if file else page
            if not linked.exists() or (anchor and anchor not in anchors_of(linked)):
                broken.append(f"{page.name}: {target}")
    assert broken == []
