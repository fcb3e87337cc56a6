"""Error model of the camera on the arm: rendered pictures, their motion by direct alignment, and
the fit to its errors.

A case is one key picture and three pictures after it. Object, place, range, texture, turbidity,
silt, motion and the error of the predicted motion are drawn from the case's seed.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy import optimize, stats

from uuv.experiment import Row, Summary, Table
from uuv.models.meshes.ray_casting import RayScene
from uuv.models.naming import TIP_SITE
from uuv.models.objects import targets
from uuv.models.objects.target_model import TargetModel
from uuv.models.vehicles import uuv_puma
from uuv.perception.navigation.surface_alignment import Alignment, align, prepare
from uuv.sensors.rendered_arm_camera import hidden_by, picture_noise
from uuv.sim.interfaces.documents import toml_text
from uuv.sim.interfaces.spatial import Array, exp_so3, pose, rotation_from_z
from uuv.sim.interfaces.streams import Streams
from uuv.sim.sensors.arm_camera import (
    GRID,
    KEY_SHIFT,
    LEAST_SEEN,
    OBSERVED,
    ROTATION,
    WEAKEST,
    ErrorModel,
    Prediction,
    beside_tool,
    predict,
    tool_in_view,
)
from uuv.sim.sensors.textured_view import SmallStereo, Texture, Turbidity, expose
from uuv.sim.sensors.visible_world import Rays, body_id, site_on_body

OBJECTS = ("barrel", "barrel", "pile", "plate", "rock", "anode")
PICTURES = 3  # after each key
GATE = 27.9  # [-] chi-square with 3 degrees of freedom, as navigation's
PLAIN = 0.1  # share of the cases with a surface without texture
CLOUDY = 0.4  # share of the cases with silt
CONDITION = ("constant", "shift over width", "share hidden by silt", "ln gradient over noise")


@dataclass(frozen=True)
class KeyCase:
    """One key picture and those after it."""

    seed: int
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class Tool:
    """The vehicle's own tool in the camera's view."""

    depth: Array  # (height, width) [m], inf where it is not
    hidden: np.ndarray  # (height, width) bool
    hidden_coarse: np.ndarray  # the same on the coarse grid

    @classmethod
    def of(cls, camera: SmallStereo) -> "Tool":
        """The default vehicle's pad."""
        model = uuv_puma.build().compile()
        link, X_LG = site_on_body(model, TIP_SITE, "arm camera")
        X_LC = X_LG @ beside_tool()
        at = body_id(model, link, "arm camera")
        fine, coarse = (
            tool_in_view(model, at, X_LC, Rays.of(camera.rays(step), camera.near))
            for step in (1, GRID)
        )
        return cls(fine, hidden_by(fine), np.isfinite(coarse))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _KeyView:
    """What a key picture shows, and through which water."""

    target: TargetModel
    contrast: float  # [-] of the texture
    texture: Texture
    attenuation: float  # [1/m]
    clouds: Array  # (PICTURES,) [-] of the later pictures
    X_TK: Array  # (4, 4) pose of the camera

    @classmethod
    def drawn(cls, streams: Streams) -> "_KeyView":
        """A view of one of OBJECTS."""
        target = targets.named(OBJECTS[int(streams["object"].integers(len(OBJECTS)))])
        contrast = float(np.exp(streams["contrast"].uniform(*np.log((0.02, 0.4)))))
        contrast = 0.0 if streams["plain"].uniform() < PLAIN else contrast
        clouds = streams["clouds"].uniform(0.0, 0.8, PICTURES)
        gap = float(streams["gap"].uniform(0.0, 0.15))
        gap = 0.0 if streams["touching"].uniform() < 0.6 else gap

        return cls(
            target=target,
            contrast=contrast,
            texture=Texture.of(int(streams["texture"].integers(2**31)), contrast),
            attenuation=float(np.exp(streams["attenuation"].uniform(*np.log((0.15, 2.2))))),
            clouds=clouds * (streams["cloudy"].uniform() < CLOUDY),
            X_TK=_place(target, gap, streams["place"]),
        )


def run(case: KeyCase) -> Row:
    """Renders the pictures of a case and aligns them.

    Returns:
        Its conditions, and for each picture the error of the motion, the tracker's information, and
        the prediction.
    """
    streams = Streams(case.seed, case.number)
    camera = SmallStereo()
    tool = Tool.of(camera)
    drawn = _KeyView.drawn(streams)
    X_TK, texture = drawn.X_TK, drawn.texture
    scene = RayScene(drawn.target.vertices, drawn.target.triangles)

    # The key picture.
    clear = Turbidity(attenuation=drawn.attenuation)
    key_hits = _hits(scene, camera, X_TK, tool)
    range_m = (
        float(np.median(key_hits[0][np.isfinite(key_hits[0]) & ~tool.hidden]))
        if _seen(key_hits, tool)
        else 0.17
    )
    noise = picture_noise(camera, drawn.attenuation, range_m)
    key = expose(camera, key_hits, X_TK, texture, clear, streams["key picture"])
    prepared = prepare(key.intensity, key.depth, tool.hidden, camera.focal, noise)

    # Later ones, aligned with it.
    pictures: list[dict[str, Any]] = []
    for k, cloud in enumerate(drawn.clouds):
        water = Turbidity(attenuation=drawn.attenuation, cloud=float(cloud))
        X_KC = _motion(camera, range_m, streams[f"motion {k}"])
        X_TC = X_TK @ X_KC
        hits = _hits(scene, camera, X_TC, tool)
        now = expose(camera, hits, X_TC, texture, water, streams[f"picture {k}"])
        guess = X_KC @ pose(exp_so3(ROTATION * streams[f"guessed turn {k}"].standard_normal(3)))
        guess[:3, 3] += 2e-3 * streams[f"guessed shift {k}"].standard_normal(3)
        found = align(
            prepared,
            prepare(now.intensity, now.depth, tool.hidden, camera.focal, noise),
            guess,
            ROTATION,
            noise,
        )
        step = slice(GRID // 2, None, GRID)
        depth = np.where(tool.hidden_coarse, np.inf, hits[0][step, step])
        across = float(np.hypot(X_KC[0, 3], X_KC[1, 3]))
        view = predict(camera, depth, tool.hidden_coarse, texture, water, across)
        pictures.append(_picture(found, X_KC, view))
    return {
        "number": case.number,
        "object": drawn.target.name,
        "contrast": drawn.contrast,
        "attenuation": drawn.attenuation,
        "range": range_m,
        **{name: [each[name] for each in pictures] for name in pictures[0]},
    }


def _seen(hits: tuple[Array, Array], tool: Tool) -> bool:
    return bool((np.isfinite(hits[0]) & ~tool.hidden).any())


def _place(target: TargetModel, gap: float, rng: np.random.Generator) -> Array:
    """Pose X_TC (4, 4) of the camera with the tool somewhere on a path of the object, `gap` [m]
    above it.
    """
    path = next(iter(target.paths.values()))
    i = int(rng.integers(len(path.p)))
    z = np.asarray(path.a[i])
    X_TG = pose(rotation_from_z(z, rng.standard_normal(3)), np.asarray(path.p[i]) - gap * z)
    return X_TG @ pose(exp_so3(np.append(0.02 * rng.standard_normal(2), 0.0))) @ beside_tool()


def _motion(camera: SmallStereo, range_m: float, rng: np.random.Generator) -> Array:
    """Pose X_KC (4, 4) of a later picture in the key camera's axes."""
    heading = rng.uniform(-np.pi, np.pi)
    shift = rng.uniform(0.0, KEY_SHIFT) * camera.width / camera.focal * range_m
    p = shift * np.array([np.cos(heading), np.sin(heading), 0.0]) + [
        0.0,
        0.0,
        2e-3 * rng.standard_normal(),
    ]
    return pose(exp_so3(0.02 * rng.standard_normal(3)), p)


def _hits(scene: RayScene, camera: SmallStereo, X_TC: Array, tool: Tool) -> tuple[Array, Array]:
    """Exact depth and cosine of the angle of incidence (height, width); the tool is before the
    object.
    """
    ways = camera.rays().reshape(-1, 3) @ X_TC[:3, :3].T
    hit = scene.cast(np.broadcast_to(X_TC[:3, 3], ways.shape), ways)
    cosine = np.abs(np.sum(hit["normal"] * ways, axis=1)) / np.linalg.norm(ways, axis=1)
    depth = hit["t"].astype(np.float64).reshape(tool.depth.shape)
    nearer = tool.depth < depth
    return np.where(nearer, tool.depth, depth), np.where(nearer, 0.7, cosine.reshape(depth.shape))


def _picture(found: Alignment | None, X_KC: Array, view: Prediction) -> dict[str, Any]:
    """Columns of one picture; all in the axes of the present camera."""
    lost = found is None or not found.settled
    error, stated = np.zeros(3), np.zeros((3, 3))
    if found is not None:
        R = X_KC[:3, :3]
        error, stated = R.T @ (found.p_KC - X_KC[:3, 3]), R.T @ found.information_K @ R
    return {
        "lost": bool(lost),
        "seen": view.seen,
        "error": error.tolist(),
        "stated": stated.ravel().tolist(),
        "texture": view.texture.ravel().tolist(),
        "shape": view.shape.ravel().tolist(),
        "condition": view.condition.tolist(),
    }


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """One rendered pair as the fit needs it."""

    key: int
    lost: bool
    error: Array
    stated: Array
    view: Prediction
    row: Row


def pairs_of(rows: list[Row]) -> list[Pair]:
    """All pairs of the rows whose view has enough surface for a track."""
    pairs = []
    for row in rows:
        for i in range(PICTURES):
            if row["seen"][i] < LEAST_SEEN:
                continue
            view = Prediction(
                texture=np.reshape(row["texture"][i], (6, 6)),
                shape=np.reshape(row["shape"][i], (6, 6)),
                condition=np.array(row["condition"][i]),
                seen=row["seen"][i],
                range=row["range"],
            )
            pairs.append(
                Pair(
                    row["number"],
                    row["lost"][i],
                    np.array(row["error"][i]),
                    np.reshape(row["stated"][i], (3, 3)),
                    view,
                    row,
                )
            )
    return pairs


def fit(pairs: list[Pair]) -> ErrorModel:
    """Maximum-likelihood fit of the error model; pairs beyond the gate count as outliers and not
    for the variance.
    """
    lost = _fit_lost(pairs)
    kept = [pair for pair in pairs if not pair.lost]
    start, used = np.zeros(8), kept
    for _ in range(3):  # outliers are those of the fit without them
        start = np.asarray(optimize.minimize(_deviance, start, args=(used,), method="L-BFGS-B").x)
        used = [pair for pair in kept if squared(pair, start)[0] <= GATE]
    outliers = [pair for pair in kept if squared(pair, start)[0] > GATE]
    factor = (
        np.sqrt(np.median([squared(pair, start)[0] for pair in outliers]) / 3.0)
        if outliers
        else 1.0
    )
    whitened = {id(pair): _whitened(pair, start) for pair in used}
    products, squares = [], []
    for one in used:
        for other in used:
            if one.key == other.key and one is not other:
                products.append(float(whitened[id(one)] @ whitened[id(other)]))
        squares.append(float(whitened[id(one)] @ whitened[id(one)]))
    common = float(np.clip(np.mean(products) / np.mean(squares), 0.0, 1.0)) if products else 0.0
    sound = [pair.error for pair in used if squared(pair, start)[1] == 3]
    return ErrorModel(
        texture=_rounded(start[:4]),
        shape=_rounded(start[4:]),
        lost=_rounded(lost),
        common=round(common, 3),
        outliers=round(len(outliers) / max(len(kept), 1), 4),
        outlier_factor=round(float(factor), 2),
        bias=_rounded(np.mean(sound, axis=0), 7),
        pairs=len(pairs),
    )


def _rounded(values: Array, digits: int = 3) -> Any:
    return tuple(round(float(value), digits) for value in values)


def _information(pair: Pair, parameters: Array) -> Array:
    x = pair.view.condition
    return pair.view.information(
        float(np.exp(parameters[:4] @ x)), float(np.exp(parameters[4:] @ x))
    )


def squared(pair: Pair, parameters: Array) -> tuple[float, int]:
    """Squared error over the fitted covariance, and the number of observed directions."""
    L = _information(pair, parameters)
    return float(pair.error @ L @ pair.error), int((np.linalg.eigvalsh(L) > OBSERVED).sum())


def _whitened(pair: Pair, parameters: Array) -> Array:
    values, axes = np.linalg.eigh(_information(pair, parameters))
    return axes @ (np.sqrt(np.maximum(values, 0.0)) * (axes.T @ pair.error))


def _deviance(parameters: Array, pairs: list[Pair]) -> float:
    """Twice the negative logarithm of the likelihood, over the observed directions, with a weak
    prior.
    """
    total = float(np.sum(parameters**2)) / 4.0
    for pair in pairs:
        values, axes = np.linalg.eigh(_information(pair, parameters))
        seen = values > OBSERVED
        along = axes.T @ pair.error
        total += float(np.sum(along[seen] ** 2 * values[seen] - np.log(values[seen])))
        # of one given up: that at the bound
        total += (1.0 + 2.0 * np.log(WEAKEST)) * int((~seen).sum())
    return total


def _fit_lost(pairs: list[Pair]) -> Array:
    """Logistic regression of lost pictures, with a weak prior."""
    X = np.array([pair.view.condition for pair in pairs])
    y = np.array([pair.lost for pair in pairs], dtype=np.float64)

    def loss(b: Array) -> float:
        a = X @ b
        return float(np.sum(np.logaddexp(0.0, a) - y * a) + 0.02 * b @ b)

    return np.asarray(optimize.minimize(loss, np.array([-3.0, 0.0, 0.0, 0.0])).x)


def summarise(rows: list[Row]) -> Summary:
    """The fitted model, and its check against the pairs by groups."""
    pairs = pairs_of(rows)
    model = fit(pairs)
    parameters = np.concatenate([model.texture, model.shape])
    groups = {
        "all": pairs,
        "textured, no silt": [
            p for p in pairs if p.row["contrast"] >= 0.1 and p.view.condition[2] == 0.0
        ],
        "faint texture": [p for p in pairs if 0.0 < p.row["contrast"] < 0.1],
        "silt over a quarter or more": [p for p in pairs if p.view.condition[2] >= 0.25],
        "attenuation above 1 / m": [p for p in pairs if p.row["attenuation"] > 1.0],
        "farther than 0.2 m": [p for p in pairs if p.row["range"] > 0.2],
        "plain barrel or pile": [
            p for p in pairs if p.row["contrast"] == 0.0 and p.row["object"] in ("barrel", "pile")
        ],
        "plain, other": [
            p
            for p in pairs
            if p.row["contrast"] == 0.0 and p.row["object"] not in ("barrel", "pile")
        ],
    }
    cells = [(name, *_group(group, parameters)) for name, group in groups.items()]
    table = Table(
        title="Errors of rendered pairs, camera axes, against the fitted model",
        columns=(
            "group",
            "pairs",
            "lost",
            "across [mm]",
            "along view [mm]",
            "stated across",
            "observed",
            "NEES / n",
            ">99 %",
        ),
        rows=cells,
        caption="RMS of pairs that were not lost, in observed directions; stated: median of the "
        "model. "
        "NEES / n: squared error over the model's covariance by observed direction, outliers left "
        "out.",
    )
    return Summary(
        metrics={
            "model": {name: getattr(model, name) for name in ErrorModel.__dataclass_fields__},
            "pairs": len(pairs),
        },
        tables=[table],
        lines=[to_toml(model)],
    )


def _group(group: list[Pair], parameters: Array) -> tuple[str, ...]:
    kept = [pair for pair in group if not pair.lost]
    if not kept:
        return (str(len(group)), *("",) * 7)
    across, along, stated, nees, dof, count, beyond = [], [], [], 0.0, 0, 0, 0
    for pair in kept:
        L = _information(pair, parameters)
        values, axes = np.linalg.eigh(L)
        seen = (axes * (values > OBSERVED)) @ axes.T
        error = seen @ pair.error
        n = int((values > OBSERVED).sum())
        count += n
        across.append(error[:2])
        along.append(error[2])
        if n == 3:
            stated.append(np.sqrt(0.5 * np.trace(np.linalg.inv(L)[:2, :2])))
        square = float(pair.error @ L @ pair.error)
        if square <= GATE:
            nees, dof = nees + square, dof + n
        beyond += n > 0 and square > stats.chi2.ppf(0.99, n)
    return (
        str(len(group)),
        f"{(len(group) - len(kept)) / len(group):.1%}",
        f"{1e3 * np.sqrt(np.mean(np.square(across))):.3f}",
        f"{1e3 * np.sqrt(np.mean(np.square(along))):.3f}",
        f"{1e3 * np.median(stated):.3f}" if stated else "-",
        f"{count / len(kept):.2f} of 3",
        f"{nees / dof:.2f}" if dof else "-",
        f"{beyond / len(kept):.1%}",
    )


def to_toml(model: ErrorModel) -> str:
    """Text of the package's table."""
    heading = (
        "Errors of the camera on the arm, fitted to rendered pairs by\n"
        "    ./uvw run scripts/experiments/navigation/fit_arm_camera.py --runs 700 --seed 1 "
        "--write\n"
        f"texture, shape, lost: factors of {', '.join(CONDITION)} (sim/sensors/arm_camera.py)"
    )
    return toml_text(asdict(model), heading)
