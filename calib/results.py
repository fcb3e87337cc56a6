"""Result files of a calibration: arm.yaml, dh.csv, URDF and MJCF, new or corrected.

Every file states its units, the date and the hash of the touches. `uuv.calib.arm_files.read_arm`
reads all of them.
"""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from uuv.calib.arm_files import ArmSource, mjcf_arm
from uuv.calib.identification import Calibration
from uuv.models.arms import dh_geometry
from uuv.models.arms.kinematics import THETA, A, D
from uuv.models.arms.serial_arm import SerialArm, tilt_of
from uuv.models.files.urdf import parse
from uuv.sim.interfaces.documents import yaml_text
from uuv.sim.interfaces.errors import ConfigurationError
from uuv.sim.interfaces.spatial import Array, exp_so3, inverse, pose, quat_wxyz_from_rotation, shown

TOUCH_TIP = "touch_tip"  # link whose origin is the touched point
CONVENTION = (
    "Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta); slides Rz(theta) Tz(d + q) Tx(a) "
    "Rx(alpha) Ry(beta)"
)


def write_results(
    folder: Path | str,
    calibration: Calibration,
    source: ArmSource,
    *,
    sha256: str,
    date: str,
    arm: SerialArm | None = None,
    tcp: Array | None = None,
) -> list[Path]:
    """Write the identified arm into `folder` in every format.

    A URDF or MJCF source is corrected: `arm.urdf` is the source with other origins;
    `arm.mjcf_patch.xml` lists the bodies and sites of the source whose poses change.

    Args:
        folder: existing folder.
        calibration: result to write.
        source: file that the arm came from; its joint names and limits are written.
        sha256: hash of the touches.
        date: ISO 8601.
        arm: replaces the calibration's arm, which is longer if the base moved.
        tcp: (3,) [m] replaces the calibration's tool point.

    Returns:
        The files written.

    Raises:
        ConfigurationError: There is no such folder, or `source` is not what `read_arm` returned.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ConfigurationError(f"folder {shown(str(folder))}: there is no such folder")
    if not hasattr(source, "arm"):
        raise ConfigurationError(
            f"source: must be an ArmSource, as `read_arm` returns it, got {type(source).__name__}"
        )

    tcp = calibration.tcp if tcp is None else tcp
    arm = replace(
        arm or calibration.arm, joint_names=source.arm.joint_names, limits=source.arm.limits
    )

    stamp = f"calibrated {date}; touches sha256 {sha256}"
    written = [_write_yaml(folder / "arm.yaml", calibration, arm, source, sha256, date)]
    written.append(_write_dh(folder / "dh.csv", arm, tcp, stamp))

    # URDF: the corrected source, or a new one.
    text = corrected_urdf(source, arm, tcp) if source.kind == "urdf" else urdf(arm, tcp)
    written.append(_write(folder / "arm.urdf", _commented(text, f"{stamp}; rad, m")))

    # MJCF: changes relative to the source, or a new one.
    if source.kind == "mjcf":
        text = mjcf_patch(source, arm, tcp)
        written.append(
            _write(folder / "arm.mjcf_patch.xml", _commented(text, f"{stamp}; m, quaternions wxyz"))
        )
    else:
        text = mjcf(arm, tcp)
        written.append(_write(folder / "arm.mjcf.xml", _commented(text, f"{stamp}; rad, m")))

    return written


def _write(file: Path, text: str) -> Path:
    file.write_text(text, encoding="utf-8")
    return file


def _commented(text: str, comment: str) -> str:
    return f"<!-- {comment.replace('--', '- -')} -->\n{text}\n"


def _rounded(values: Array, digits: int = 12) -> list:
    return np.round(np.asarray(values), digits).tolist()


def _write_yaml(
    file: Path, calibration: Calibration, arm: SerialArm, source: ArmSource, sha256: str, date: str
) -> Path:
    half = calibration.quantile() * calibration.sigma
    rank = calibration.rank
    status = dict(zip(rank.parameters.names, rank.status, strict=True))

    document = {
        "arm": source.path.name,
        "date": date,
        "touches": {
            "sha256": sha256,
            "points": len(calibration.residuals),
            "count": sum(len(residuals) for residuals in calibration.residuals),
            "left_out": len(calibration.outliers),
            "noise_m": round(float(calibration.noise), 9),
        },
        # Conventions and frames.
        "units": {"angle": "rad", "length": "m"},
        "convention": CONVENTION,
        "base": source.base,
        "tip": source.tip,
        "joint_names": list(arm.joint_names),
        "joint_types": arm.joint_types,
        "X_base_0": _rounded(arm.X_base_0),
        "X_n_flange": _rounded(arm.X_n_flange),
        # Geometry.
        "dh": [
            dict(zip(("theta", "d", "a", "alpha", "beta"), row, strict=True))
            for row in _rounded(arm.table)
        ],
        "tcp": _rounded(calibration.tcp),
        "limits": [
            [None if not np.isfinite(x) else round(float(x), 9) for x in row] for row in arm.limits
        ],
        # Parameters with their intervals.
        "identified": {
            name: {
                "value": float(f"{value:.10g}"),
                "change": float(f"{change:.4g}"),
                "half_width_95": float(f"{width:.3g}"),
                "unit": unit,
                "touching": status.get(name, "known"),
            }
            for name, value, change, width, unit in zip(
                calibration.names,
                calibration.estimate.values,
                calibration.estimate.changes,
                half,
                calibration.estimate.parameters.units,
                strict=True,
            )
        },
    }

    if np.any(calibration.compliance):
        document["compliance"] = _rounded(calibration.compliance, 14)
    return _write(file, yaml_text(document))


def _write_dh(file: Path, arm: SerialArm, tcp: Array, stamp: str) -> Path:
    lines = [
        f"# {stamp}",
        f"# {CONVENTION}",
        f"# tool point in the flange [m]: {' '.join(f'{x:.9f}' for x in tcp)}",
    ]
    lines.append("joint,type,theta [rad],d [m],a [m],alpha [rad],beta [rad]")

    for k, (row, letter) in enumerate(zip(arm.table, arm.joint_types, strict=True), 1):
        lines.append(f"{k},{letter}," + ",".join(f"{value:.12g}" for value in row))

    return _write(file, "\n".join(lines) + "\n")


# Any arm as a new URDF or MJCF


def links(arm: SerialArm) -> list[Array]:
    """Link frames at zero: n + 1 poses (4, 4).

    The pose of each joint's child link is relative to the link before, with z along the joint axis;
    the last pose is that of the flange in link n.
    """
    out = []
    rest = np.array(arm.X_base_0)

    for row in arm.table:
        out.append(rest @ pose(exp_so3([0.0, 0.0, row[THETA]])))
        rest = pose(tilt_of(row), [row[A], 0.0, row[D]])

    return [*out, rest @ arm.X_n_flange]


def urdf(arm: SerialArm, tcp: Array) -> str:
    """The arm as a new URDF of links without shapes, from `base` over `flange` to `touch_tip`.

    Args:
        arm: identified arm.
        tcp: (3,) [m] tool point in the flange.

    Returns:
        XML text.
    """
    root = ET.Element("robot", name="arm")
    limits = arm.limits
    names = ["base", *(f"link{k + 1}" for k in range(arm.n)), "flange", TOUCH_TIP]
    for name in names:
        ET.SubElement(root, "link", name=name)
    steps = [*links(arm), pose(p=tcp)]

    # One joint for every link: first the driven joints, then flange and tool point, which are
    # fixed.
    for k, X in enumerate(steps):
        driven = k < arm.n
        kind = "fixed"
        if driven:
            bounded = bool(np.all(np.isfinite(limits[k])))
            kind = (
                "prismatic"
                if arm.joint_types[k] == "p"
                else "revolute"
                if bounded
                else "continuous"
            )

        joint = ET.SubElement(
            root, "joint", name=arm.joint_names[k] if driven else f"{names[k + 1]}_joint", type=kind
        )
        ET.SubElement(joint, "parent", link=names[k])
        ET.SubElement(joint, "child", link=names[k + 1])
        _set_origin(joint, X)

        if driven:
            ET.SubElement(joint, "axis", xyz="0 0 1")
        if kind in ("revolute", "prismatic"):
            lower, upper = limits[k] if np.all(np.isfinite(limits[k])) else (-1e3, 1e3)
            ET.SubElement(
                joint, "limit", lower=f"{lower:.9g}", upper=f"{upper:.9g}", effort="0", velocity="0"
            )

    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def mjcf(arm: SerialArm, tcp: Array) -> str:
    """The arm as a new MJCF of bodies without shapes, from `arm_base` to the site `tip`, with
    placeholder masses.

    Args:
        arm: identified arm.
        tcp: (3,) [m] tool point in the flange.

    Returns:
        XML text.
    """
    root = ET.Element("mujoco", model="arm")
    ET.SubElement(root, "compiler", angle="radian")
    body = ET.SubElement(ET.SubElement(root, "worldbody"), "body", {"name": "arm_base"})
    *steps, flange = links(arm)
    limits = arm.limits

    for k, X in enumerate(steps):
        body = ET.SubElement(body, "body", {"name": f"link{k + 1}", **_place(X)})
        ET.SubElement(body, "inertial", pos="0 0 0", mass="1", diaginertia=".01 .01 .01")
        joint = ET.SubElement(body, "joint", name=arm.joint_names[k], axis="0 0 1")
        joint.set("type", "slide" if arm.joint_types[k] == "p" else "hinge")
        if np.all(np.isfinite(limits[k])):
            joint.set("range", f"{limits[k, 0]:.9g} {limits[k, 1]:.9g}")
            joint.set("limited", "true")

    ET.SubElement(body, "site", {"name": "flange", **_place(flange)})
    ET.SubElement(body, "site", {"name": "tip", **_place(flange @ pose(p=tcp))})
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def _place(X: Array) -> dict[str, str]:
    quat_wxyz = quat_wxyz_from_rotation(X[:3, :3])
    return {
        "pos": " ".join(f"{x:.12g}" for x in X[:3, 3]),
        "quat": " ".join(f"{x:.12g}" for x in quat_wxyz),
    }


# Correction of the file that the arm came from


def corrected_urdf(source: ArmSource, arm: SerialArm, tcp: Array) -> str:
    """The URDF of `source` with the joint origins of the identified `arm`.

    Every link stays fixed to its joint's axis, so axes, zeros, meshes and inertias remain as
    written. A link `touch_tip`, fixed to the tip link, has its origin in the touched point; that of
    a source which has one, such as a former result, is moved there. If the tip link is fixed to the
    last driven link, its own origin is that point too.

    Args:
        source: URDF that the nominal arm was read from.
        arm: identified arm.
        tcp: (3,) [m] tool point in the flange.

    Returns:
        XML text.

    Raises:
        ConfigurationError: the source has another link `touch_tip` that carries links or moves.
    """
    robot = parse(source.path, "arm")
    root = robot.xml
    chain = robot.chain(source.base, source.tip)
    old, new = _riding(source.arm), _riding(arm)
    driven = {i: k for k, i in enumerate(chain.driven)}

    # displacement of the links so far; parent link before correction
    carried = np.eye(4)
    parent = np.eye(4)

    for i, (joint, step) in enumerate(zip(chain.joints, chain.X_parent_child, strict=True)):
        child = parent @ step
        if i in driven:
            moved = new[driven[i]] @ inverse(old[driven[i]])
            _set_origin(joint, inverse(carried @ parent) @ moved @ child)
            carried = moved
        parent = child

    # The tool point moves the last origin, unless the last joint is driven.
    X_base_tip = arm.axes()[2] @ pose(p=tcp)
    X_tip_touch = inverse(carried @ parent) @ X_base_tip
    if len(chain.joints) - 1 not in driven:
        before = parent @ inverse(chain.X_parent_child[-1])
        _set_origin(chain.joints[-1], inverse(carried @ before) @ X_base_tip)
        X_tip_touch = np.eye(4)

    if source.tip != TOUCH_TIP:
        _fix_touch_tip(root, source, X_tip_touch)
    return ET.tostring(root, encoding="unicode")


def _fix_touch_tip(root: ET.Element, source: ArmSource, X_tip_touch: Array) -> None:
    """Fix the link `touch_tip` to the tip link of `source`, at the pose `X_tip_touch` (4, 4)."""
    carriers = [joint for joint in root.iter("joint") if _end(joint, "child") == TOUCH_TIP]
    carried = [
        joint.get("name") for joint in root.iter("joint") if _end(joint, "parent") == TOUCH_TIP
    ]

    if carried or any(joint.get("type") != "fixed" for joint in carriers):
        raise ConfigurationError(
            f"arm {source.path}: the link {TOUCH_TIP!r}, which marks the touched point in the "
            "result, must be fixed and carry no other link; rename it, or give --tip touch_tip"
        )

    if not carriers:
        ET.SubElement(root, "link", name=TOUCH_TIP)
        carriers = [ET.SubElement(root, "joint", name=f"{TOUCH_TIP}_joint", type="fixed")]
        ET.SubElement(carriers[0], "parent")
        ET.SubElement(carriers[0], "child", link=TOUCH_TIP)

    for end in carriers[0].iter("parent"):
        end.set("link", source.tip)
    _set_origin(carriers[0], X_tip_touch)


def _end(joint: ET.Element, kind: str) -> str | None:
    """Name of the link that a joint has as its parent or child."""
    end = joint.find(kind)
    return None if end is None else end.get("link")


def _riding(arm: SerialArm) -> list[Array]:
    """Frames (4, 4) of the links in the base at zero, with origins on the joint axes, turned by
    theta0.
    """
    X = np.eye(4)
    out = []
    for step in links(arm)[:-1]:
        X = X @ step
        out.append(X)
    return out


def _set_origin(joint: ET.Element, X: Array) -> None:
    origin = joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")

    # Roll, pitch and yaw.
    R = X[:3, :3]
    level = np.hypot(R[0, 0], R[1, 0])
    pitch = np.arctan2(-R[2, 0], level)
    if level > 1e-9:
        roll, yaw = np.arctan2(R[2, 1], R[2, 2]), np.arctan2(R[1, 0], R[0, 0])
    else:  # gimbal lock: roll and yaw turn about one axis
        roll, yaw = 0.0, np.arctan2(-R[0, 1], R[1, 1])

    origin.set("xyz", " ".join(f"{x:.12g}" for x in X[:3, 3]))
    origin.set("rpy", f"{roll:.12g} {pitch:.12g} {yaw:.12g}")


def mjcf_patch(source: ArmSource, arm: SerialArm, tcp: Array) -> str:
    """Bodies and sites of `source`'s MJCF whose pose differs in the identified arm, with new poses.

    Args:
        source: MJCF that the nominal arm was read from.
        arm: identified arm.
        tcp: (3,) [m] tool point in the flange.

    Returns:
        XML text.
    """
    spec, old = mjcf_arm(source.path, source.base, source.tip)
    before = spec.compile()
    dh_geometry.move(spec, old, arm.with_tip(tcp), source.base)
    after = spec.compile()

    root = ET.Element("patch", model=source.path.name)
    for kind, word in ((mujoco.mjtObj.mjOBJ_BODY, "body"), (mujoco.mjtObj.mjOBJ_SITE, "site")):
        count = before.nbody if word == "body" else before.nsite
        places = [(getattr(m, f"{word}_pos"), getattr(m, f"{word}_quat")) for m in (before, after)]
        for i in range(count):
            name = mujoco.mj_id2name(before, kind, i)
            if not name or all(
                np.allclose(a[i], b[i], atol=1e-12) for a, b in zip(*places, strict=True)
            ):
                continue

            pos, quat = (values[i] for values in places[1])
            ET.SubElement(
                root,
                word,
                name=name,
                pos=" ".join(f"{x:.12g}" for x in pos),
                quat=" ".join(f"{x:.12g}" for x in quat),
            )

    ET.indent(root)
    return ET.tostring(root, encoding="unicode")
