"""Water of one's own in a run, by each of its doors: scenario file, command line, Python, and
`on_water`.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from untyped import untyped
from uuv.assembly import Assembly, assemble
from uuv.check.conditions import Conditions
from uuv.check.jobs import ArmJobs
from uuv.check.preflight import preflight
from uuv.inputs import check_inputs
from uuv.jobs import clean_barrel, identify_friction, sample_seabed
from uuv.jobs.command_line import parsed
from uuv.perturbations.perturbation import Loop, Perturbation
from uuv.runner import run_through
from uuv.scenario import Scenario
from uuv.scenario_file import read_scenario, with_values, write_scenario
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.messages import Command
from uuv.sim.interfaces.spatial import pose
from uuv.sim.loop.snapshot import Snapshot
from uuv.sim.plant.plant import Plant
from uuv.sim.water.current import Current
from uuv.sim.water.cylinder_wake import CylinderWake
from uuv.sim.water.flow_field import FlowField
from uuv.site import Site, flow_of
from uuv.ticks.compiled_ticks import reason

SECONDS = 0.2  # simulated
PUSH = Command(time=0.0, joint_torque=np.zeros(6), thrusters=0.1 * np.ones(6), scan=False)
MODULE = """
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Sheared:
    rate: float = 0.02
    slow: float = 0.5

    def velocity(self, p_W, time):
        return [0.1 + self.rate * p_W[0], 0.01 * time, -self.slow * self.rate]


@dataclass(frozen=True, kw_only=True)
class Needy:
    rate: float

    def velocity(self, p_W, time):
        return [self.rate, 0.0, 0.0]


class Bare:
    def velocity(self, p_W, time):
        return [0.0, 0.0, 0.0]


@dataclass(frozen=True, kw_only=True)
class Late:
    def velocity(self, p_W, time):
        return [float("nan") if time > 0.1 else 0.0, 0.0, 0.0]
"""


@dataclass(frozen=True, kw_only=True)
class TurningJet(FlowField):
    """Jet along y, widest in the plane x = 0, that sets in within 20 s."""

    speed: float = 0.3  # [m/s]

    def velocity(self, p_W: np.ndarray, time: float) -> np.ndarray:
        across = np.exp(-(p_W[0] ** 2)) * (1.0 + 0.1 * p_W[1])
        return np.array([0.0, self.speed * across * (1.0 - np.exp(-time / 20.0)), 0.0])


@pytest.fixture(autouse=True)
def my_water(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A user's module."""
    (tmp_path / "my_water.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)


def at_start(scenario: Scenario) -> tuple[Assembly, np.ndarray]:
    """The scenario assembled without gusts, and the field's part of the water at its start (3,)
    [m/s].
    """
    still = replace(scenario, site=replace(scenario.site, gust=0.0))
    built = assemble(still)
    return built, built.plant.truth.current_W - still.site.current


def sheared(x: float, rate: float = 0.02, slow: float = 0.5) -> list[float]:
    """Velocity [m/s] of the module's field at the start."""
    return [0.1 + rate * x, 0.0, -slow * rate]


def test_by_the_command_line():
    typed = ["--quick", "--flow", "my_water:Sheared", "--current", "0", "0.2", "0"]
    scenario = clean_barrel(**parsed(clean_barrel, typed)[0])
    check_inputs(scenario)
    built, field = at_start(with_values(scenario, ["site.flow.rate=0.03"]))
    np.testing.assert_allclose(field, sheared(built.X_WB[0, 3], rate=0.03), atol=1e-15)
    assert reason(built.loop.plant, built.parts) == ""


@pytest.mark.parametrize("job", [sample_seabed, identify_friction])
def test_every_job_has_the_option(job):
    scenario = job(quick=True, flow="my_water:Sheared")
    built, field = at_start(scenario)
    np.testing.assert_allclose(field, sheared(built.X_WB[0, 3]), atol=1e-15)


def test_by_a_file_with_leave(tmp_path: Path):
    file = tmp_path / "scenario.toml"
    write_scenario(clean_barrel(quick=True, flow="my_water:Sheared"), file)
    text = file.read_text().replace("rate = 0.02", "rate = 0.04")
    assert '[site.flow]\nkind = "my_water:Sheared"\nrate = 0.04\nslow = 0.5\n' in text
    file.write_text(text)
    with pytest.raises(
        ConfigurationError, match="names code, 'my_water:Sheared', which is only run with --t"
    ):
        read_scenario(file)
    scenario = read_scenario(file, trust=True)
    built, field = at_start(scenario)
    np.testing.assert_allclose(field, sheared(built.X_WB[0, 3], rate=0.04), atol=1e-15)
    write_scenario(scenario, file)
    assert read_scenario(file, trust=True) == scenario


def test_by_python_and_by_name():
    where = "place = [-9.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0], diameter = 0.5, length = 9.0"
    text = f'site.flow={{kind = "CylinderWake", {where}, stream = [1.0, 0.0, 0.0]}}'
    scenario = with_values(clean_barrel(quick=True), [text])
    built, field = at_start(scenario)
    flow = scenario.site.flow
    assert flow is not None
    assert clean_barrel(quick=True, flow=flow) == scenario
    np.testing.assert_allclose(field, flow.velocity(built.X_WB[:3, 3], 0.0), atol=1e-15)
    assert field[0] < -0.05
    assert (
        replace(clean_barrel(quick=True), site=replace(clean_barrel(quick=True).site, flow=flow))
        == scenario
    )


def test_without_a_field_files_are_as_they_were(tmp_path: Path):
    write_scenario(clean_barrel(quick=True), tmp_path / "scenario.toml")
    assert "flow" not in (tmp_path / "scenario.toml").read_text()


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("my_water:Missing", "flow 'my_water:Missing': cannot be imported"),
        (
            "my_water:Needy",
            r"site.flow: my_water:Needy has keys without a default, rate; "
            r"set the kind and these keys one by one: site",
        ),
        (
            "my_water:Bare",
            r"\[site.flow\]: flow 'my_water:Bare' must be a dataclass that has a "
            r"method velocity",
        ),
        ("CylinderWak", "unknown flow 'CylinderWak'; there are CylinderWake"),
    ],
)
def test_a_name_that_is_no_field_is_refused(name: str, said: str):
    with pytest.raises(ConfigurationError, match=said):
        clean_barrel(quick=True, flow=name)


def test_an_object_that_is_no_field_is_refused():
    from my_water import Bare, Sheared  # pyright: ignore[reportMissingImports]

    with pytest.raises(
        ConfigurationError,
        match=r"site.flow: must be a dataclass, whose fields "
        r"are keys",
    ):
        Site(flow=Bare())
    with pytest.raises(
        ConfigurationError,
        match=r"site.flow: must be an instance, got the class "
        r"Sheared",
    ):
        Site(flow=Sheared)
    with pytest.raises(
        ConfigurationError,
        match=r"site.flow: needs a method velocity\(p_W, "
        r"time\), got 0.3",
    ):
        Site(flow=untyped(0.3))


def test_a_field_that_fails_on_the_way_ends_the_run_with_one_line():
    built = assemble(clean_barrel(quick=True, flow="my_water:Late"))
    with pytest.raises(
        ConfigurationError,
        match=r"flow Late: velocity must be \(3,\) finite .* "
        r"0.10\d s",
    ):
        run_through(built, longest=SECONDS)


def test_a_plant_that_is_saved_goes_on_in_its_field():
    """Two plants of the same scenario: one goes through, the other on from where the first was
    saved.
    """
    scenario = clean_barrel(quick=True, flow="my_water:Sheared")
    through, later = assemble(scenario).plant, assemble(scenario).plant
    for _ in range(40):
        through.observe()
        through.step(PUSH)
    saved = Snapshot(through.save(), "plant").copy()
    later.resume(saved)

    for plant in (through, later):
        for _ in range(40):
            plant.observe()
            plant.step(PUSH)
    np.testing.assert_array_equal(later.data.qpos, through.data.qpos)
    np.testing.assert_array_equal(later.truth.current_W, through.truth.current_W)


class Swell(Current):
    """Water of one's own, uniform in space: 0.2 m/s along y, and a sine along x."""

    def __init__(self) -> None:
        super().__init__([0.0, 0.2, 0.0])
        self.steps = 0

    def step(self) -> tuple[np.ndarray, np.ndarray]:
        self.steps += 1
        phase = 0.01 * self.steps
        return np.array([0.1 * np.sin(phase), 0.2, 0.0]), np.array([0.5 * np.cos(phase), 0.0, 0.0])


@dataclass(frozen=True, kw_only=True)
class ByWater(Perturbation):
    def on_water(self, current: Current) -> Current:
        np.testing.assert_allclose(current.mean_W, (0.15, 0.0, 0.0))
        return Swell()


@dataclass(frozen=True, kw_only=True)
class ByLoop(Perturbation):
    def on_loop(self, loop: Loop) -> Loop:
        untyped(loop.plant).reset(current=Swell())
        return loop


@pytest.mark.parametrize("perturbation", [ByWater(), ByLoop()], ids=["on_water", "on_loop"])
def test_a_current_of_ones_own_is_that_of_the_run(perturbation: Perturbation):
    built = assemble(replace(clean_barrel(quick=True), perturbations=(perturbation,)))
    ran = run_through(built, longest=SECONDS)
    assert ran.part_by_part == ""
    np.testing.assert_allclose(built.plant.truth.current_W, [0.1 * np.sin(0.01 * 101), 0.2, 0.0])
    series = ran.recording.series
    np.testing.assert_allclose(series["p_WB"].value[0], built.X_WB[:3, 3])  # from its start


def test_a_current_that_is_set_on_the_plant_is_that_of_the_run():
    built = assemble(clean_barrel(quick=True))
    built.plant.reset(current=Swell())
    assert run_through(built, longest=SECONDS).part_by_part == ""
    np.testing.assert_allclose(built.plant.truth.current_W, [0.1 * np.sin(0.01 * 101), 0.2, 0.0])


@dataclass(frozen=True, kw_only=True)
class Doubled(Perturbation):
    """The current doubles smoothly from the start on."""

    def on_water(self, current: Current) -> Current:
        return current.with_profile(lambda time: (2.0 - np.exp(-time), np.exp(-time)))


def test_perturbations_of_the_water_add_up():
    """A field of the site, a profile on all of it, and a field on top of that."""
    from my_water import Sheared  # pyright: ignore[reportMissingImports]

    @dataclass(frozen=True, kw_only=True)
    class More(Perturbation):
        def on_water(self, current: Current) -> Current:
            return current.with_flow(Sheared(rate=0.1))

    plain = clean_barrel(quick=True, flow="my_water:Sheared", gust=0.0)
    built = assemble(replace(plain, perturbations=(Doubled(), More())))
    x = built.X_WB[0, 3]
    expected = np.array(plain.site.current) + sheared(x) + sheared(x, rate=0.1)
    np.testing.assert_allclose(built.plant.truth.current_W, expected, atol=1e-15)
    run_through(built, longest=SECONDS)
    ratio = built.plant.truth.current_W[2] / expected[2]
    assert ratio == pytest.approx(2.0 - np.exp(-SECONDS), abs=2e-3)


class GustyPlant:
    """Wrapper that writes its own water into the model."""

    def __init__(self, plant: Any) -> None:
        self.plant = plant
        self.timestep = plant.timestep

    def observe(self) -> Any:
        return self.plant.observe()

    def step(self, command: Any) -> None:
        self.plant.model.opt.wind[:] = [0.4, 0.0, 0.0]
        self.plant.step(command)


def test_a_wrapper_that_writes_the_water_is_refused_with_the_right_hook():
    class Gusty(Perturbation):
        def on_loop(self, loop: Loop) -> Loop:
            return replace(loop, plant=GustyPlant(loop.plant))

    built = assemble(replace(clean_barrel(quick=True), perturbations=(Gusty(),)))
    with pytest.raises(
        ConfigurationError,
        match=r"opt.wind is \[0.4, 0.0, 0.0\] m/s, "
        r".*`on_water` of a perturbation",
    ):
        run_through(built, longest=SECONDS)


def test_water_in_the_spec_is_refused():
    class Windy(Perturbation):
        def on_scene(self, scene: Any) -> None:
            scene.option.wind = [0.0, 0.3, 0.0]

    with pytest.raises(
        ConfigurationError,
        match=r"opt.wind of vehicle or scene: must be 0, .* got \[0.0, 0.3, 0.0\] m/s",
    ):
        assemble(replace(clean_barrel(quick=True), perturbations=(Windy(),)))


def test_what_is_no_current_is_refused():
    class Nothing(Perturbation):
        def on_water(self, current: Current) -> Current:
            return untyped(None)

    with pytest.raises(
        ConfigurationError,
        match=r"Nothing.on_water: must return a uuv.*Current, "
        r"got None",
    ):
        assemble(replace(clean_barrel(quick=True), perturbations=(Nothing(),)))


def test_a_plant_of_ones_own_takes_the_place_of_the_assembled_one():
    """And not its ticks: those of the run are of the plant that is stepped."""
    plants: list[Plant] = []

    class Another(Perturbation):
        def on_loop(self, loop: Loop) -> Loop:
            assert isinstance(loop.plant, Plant)
            X_WB = pose(None, loop.plant.data.qpos[:3])
            plants.append(Plant(loop.plant.model, current=Current([0.0, 0.3, 0.0]), X_WB=X_WB))
            return replace(loop, plant=plants[-1])

    built = assemble(replace(clean_barrel(quick=True), perturbations=(Another(),)))
    assert built.plant is plants[0]
    ran = run_through(built, longest=SECONDS)
    assert ran.part_by_part == ""
    assert plants[0].truth.time == pytest.approx(SECONDS, abs=3e-3)


def test_the_current_of_an_assembly_is_always_from_its_beginning():
    built = assemble(clean_barrel(quick=True))
    rows = [[built.current().step()[0] for _ in range(3)] for _ in range(2)]
    np.testing.assert_array_equal(rows[0], rows[1])
    np.testing.assert_array_equal(rows[0][0], built.plant.truth.current_W)
    assert np.abs(np.array(rows[0]) - [0.15, 0.0, 0.0]).max() > 1e-3


def test_a_flow_field_is_not_lost_in_silence():
    @dataclass(frozen=True, kw_only=True)
    class Fresh(Perturbation):
        def on_water(self, current):
            return Current([0.0, 0.1, 0.0], timestep=0.002)

    scenario = replace(clean_barrel(quick=True, flow="my_water:Sheared"), perturbations=(Fresh(),))
    with pytest.raises(
        ConfigurationError,
        match=r"^Fresh\.on_water: .*flow field "
        r"Sheared.*use `with_flow`",
    ):
        assemble(scenario)
    assert (
        assemble(replace(clean_barrel(quick=True), perturbations=(Fresh(),))).plant.truth.current_W
        is not None
    )


def test_the_steady_part_cannot_be_changed_in_place():
    with pytest.raises(ValueError, match="read-only"):
        Current([0.2, 0.0, 0.0]).mean_W[1] = 0.3


def test_the_water_at_a_place_is_asked_of_the_plant() -> None:
    site = Site(current=(0.1, -0.2, 0.05), gust=0.02, flow=TurningJet())
    plant = assemble(replace(clean_barrel(seed=3), site=site)).plant
    p_W = np.array([2.0, -0.5, -1.0])
    plant.observe()
    for _ in range(3):
        plant.step(PUSH)
        plant.observe()

    # At the hull it is the run's own; elsewhere the field differs.
    at = plant.vehicle.hull_qpos
    p_WB = np.array(plant.data.qpos[at : at + 3])
    time = 3 * plant.timestep
    np.testing.assert_allclose(plant.water_at(p_WB), plant.truth.current_W, atol=1e-15)
    gap = TurningJet().velocity(p_W, time) - TurningJet().velocity(p_WB, time)
    np.testing.assert_allclose(plant.water_at(p_W), plant.truth.current_W + gap, atol=1e-15)
    np.testing.assert_array_equal(plant.water_at(p_W), plant.water_at(p_W))  # it draws no gust
    with pytest.raises(ConfigurationError, match=r"p_W \[m\]: expected shape \(3,\)"):
        plant.water_at([1.0, 2.0])


def test_a_factor_of_time_is_on_the_field_elsewhere_too() -> None:
    scenario = replace(
        clean_barrel(seed=3), site=Site(current=(0.1, 0.0, 0.0), gust=0.0, flow=TurningJet())
    )
    built = assemble(scenario)
    built.plant.reset(current=built.current(lambda time: (0.5 + 0.1 * time, 0.1)), X_WB=built.X_WB)
    p_W = np.array([1.0, 0.3, -0.4])
    expected = 0.5 * (np.array([0.1, 0.0, 0.0]) + TurningJet().velocity(p_W, 0.0))
    np.testing.assert_allclose(built.plant.water_at(p_W), expected, atol=1e-15)


def test_the_current_of_a_plant_is_read_and_never_replaced_in_silence() -> None:
    plant = assemble(
        replace(clean_barrel(seed=3), site=Site(current=(0.1, 0.2, 0.0), gust=0.0))
    ).plant
    np.testing.assert_array_equal(plant.current.mean_W, [0.1, 0.2, 0.0])
    with pytest.raises(
        ConfigurationError,
        match=r"plant\.current: cannot be "
        r"set.*on_water\(current\)",
    ):
        plant.current = Current(np.zeros(3))


def test_a_kind_with_keys_that_have_no_default_says_how_they_are_given() -> None:
    needs = (
        "stream, place, axis, diameter, length; set the kind and these keys one by one: "
        "site.flow.kind=CylinderWake"
    )
    with pytest.raises(
        ConfigurationError, match=f"site.flow: CylinderWake has keys without a default, {needs}"
    ):
        flow_of("CylinderWake")
    typed = [
        "site.flow.kind=CylinderWake",
        "site.flow.stream=[0.3, 0.0, 0.0]",
        "site.flow.place=[-2.0, 0.0, 0.0]",
        "site.flow.axis=[0.0, 0.0, 1.0]",
        "site.flow.diameter=0.6",
        "site.flow.length=4",
    ]
    assert with_values(clean_barrel(), typed).site.flow == CylinderWake(
        stream=(0.3, 0.0, 0.0),
        place=(-2.0, 0.0, 0.0),
        axis=(0.0, 0.0, 1.0),
        diameter=0.6,
        length=4.0,
    )


def test_the_check_and_the_start_of_a_run_know_the_flow() -> None:
    site = Site(current=(0.1, 0.0, 0.0), flow=TurningJet(speed=1.9))
    scenario = replace(clean_barrel(), site=site)
    strongest = site.strongest_water(np.zeros(3))
    np.testing.assert_allclose(strongest, [0.1, 1.9 * (1.0 - np.exp(-100.0 / 20.0)), 0.0])
    lines = preflight(scenario, assemble(replace(scenario, site=Site())).own).lines
    assert any(
        "the water at the hull moves at 1.89 m/s along sway, the thrusters can hold" in line
        for line in lines
    )
    still = replace(scenario, site=Site())
    assert not any("the water" in line for line in preflight(still, assemble(still).own).lines)

    jobs = ArmJobs("uuv_puma", conditions=Conditions(flow=TurningJet(speed=1.9)))
    verdict = jobs.verdict("barrel-longitudinal", 0.0)
    assert not verdict.promised
    assert "no station keeping in 1.89 m/s" in verdict.said
