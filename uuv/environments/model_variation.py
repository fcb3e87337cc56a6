"""Perturbations of a vehicle, drawn in each episode and written into the compiled scene."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from uuv.models.naming import TOOL_GEOM
from uuv.perturbations.perturbation import Perturbation, perturb
from uuv.sim import hydrodynamics
from uuv.sim.interfaces.errors import ConfigurationError

# Arrays of a model that perturbations of a vehicle change, by kind of element.
_OF_BODY = ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_user")
_OF_DOF = ("dof_damping", "dof_frictionloss", "dof_armature")
_OF_JOINT = ("jnt_stiffness", "jnt_user", "jnt_range")
_OF_GEOM = ("geom_friction", "geom_solref", "geom_solimp", "geom_size")
_OF_ACTUATOR = ("actuator_user", "actuator_gear", "actuator_ctrlrange", "actuator_gainprm")
Finder = Callable[[str, str], str]  # full name in the scene, by kind and name in the vehicle


class ModelVariation:
    """The perturbations of one vehicle in one scene.

    Raises:
        ConfigurationError: A perturbation changes the scene, the loop or the timestep, which cannot
            change between episodes.
    """

    def __init__(self, spec: mujoco.MjSpec, perturbations: Sequence[Perturbation]) -> None:
        """Take the nominal vehicle and its perturbations."""
        for perturbation in perturbations:
            if type(perturbation).on_vehicle is Perturbation.on_vehicle:
                raise ConfigurationError(
                    f"perturbation {type(perturbation).__name__}: must act on the vehicle only, "
                    "since an episode cannot vary scene or loop"
                )

        self._spec = spec
        self._perturbations = tuple(perturbations)
        self._nominal = spec.copy().compile()
        self._scene: mujoco.MjModel | None = None
        self._rows: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._pairs = np.zeros(0, dtype=np.int64)
        self.drawn: dict[str, float] = {}  # mean values of the factors of the present episode

    def bind(self, scene: mujoco.MjModel, find: Finder) -> None:
        """Look up the vehicle's named parts in the compiled model of a scene.

        Args:
            scene: The model to vary.
            find: Function that returns the full name of a part.
        """
        nominal = self._nominal
        self._scene = scene

        # Rows of the same part in the models of vehicle and scene, by kind.
        for kind, word, total in (
            (mujoco.mjtObj.mjOBJ_BODY, "body", nominal.nbody),
            (mujoco.mjtObj.mjOBJ_JOINT, "joint", nominal.njnt),
            (mujoco.mjtObj.mjOBJ_GEOM, "geom", nominal.ngeom),
            (mujoco.mjtObj.mjOBJ_ACTUATOR, "actuator", nominal.nu),
        ):
            in_nominal, in_scene = [], []
            for i in range(1 if word == "body" else 0, total):
                name = mujoco.mj_id2name(nominal, kind, i)
                at = mujoco.mj_name2id(scene, kind, find(word, name)) if name else -1
                if at >= 0:
                    in_nominal.append(i)
                    in_scene.append(at)
            self._rows[word] = (
                np.array(in_nominal, dtype=np.int64),
                np.array(in_scene, dtype=np.int64),
            )

        dofs = [
            (int(nominal.jnt_dofadr[a]), int(scene.jnt_dofadr[b]))
            for a, b in zip(*self._rows["joint"], strict=True)
        ]
        own_dofs, scene_dofs = np.array(dofs, dtype=np.int64).reshape(-1, 2).T
        self._rows["dof"] = own_dofs, scene_dofs

        # Contact pairs of the tool, whose friction varies with it.
        tool = mujoco.mj_name2id(scene, mujoco.mjtObj.mjOBJ_GEOM, find("geom", TOOL_GEOM))
        ends = np.column_stack([scene.pair_geom1, scene.pair_geom2])
        self._pairs = (
            np.flatnonzero((ends == tool).any(axis=1)) if tool >= 0 else np.zeros(0, dtype=np.int64)
        )

    def draw(self, random_state: np.random.RandomState) -> None:
        """Draw the factors of an episode, and write the vehicle's numbers into the scene.

        Raises:
            ConfigurationError: A perturbation changes the timestep, or changes a part that the
                vehicle lacks.
        """
        assert self._scene is not None
        spec = self._spec.copy()
        self.drawn = perturb(spec, self._perturbations, int(random_state.randint(2**31)))
        varied = spec.compile()
        scene = self._scene

        if varied.opt.timestep != self._nominal.opt.timestep:
            raise ConfigurationError(
                "perturbation: must not need another timestep, since an episode cannot change it"
            )

        for word, fields in (
            ("body", _OF_BODY),
            ("dof", _OF_DOF),
            ("joint", _OF_JOINT),
            ("geom", _OF_GEOM),
            ("actuator", _OF_ACTUATOR),
        ):
            in_nominal, in_scene = self._rows[word]
            for field in fields:
                getattr(scene, field)[in_scene, ...] = getattr(varied, field)[in_nominal, ...]

        if len(self._pairs):
            sliding, spinning, rolling = varied.geom(TOOL_GEOM).friction
            scene.pair_friction[self._pairs] = [sliding, sliding, spinning, rolling, rolling]

        # Masses of subtrees, which MuJoCo computes only at compilation.
        scene.body_subtreemass[:] = scene.body_mass
        for body in range(scene.nbody - 1, 0, -1):
            scene.body_subtreemass[scene.body_parentid[body]] += scene.body_subtreemass[body]

        hydrodynamics.set_constants(scene)
