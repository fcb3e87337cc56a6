"""Files of models for tests of water from geometry."""

import struct
from pathlib import Path

import numpy as np

from uuv.sim.interfaces.spatial import Array

INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" '
    'iyz="0"/></inertial>'
)


def write_stl(file: Path, vertices: Array, triangles: np.ndarray) -> Path:
    """Binary STL of triangles."""
    rows = b"".join(struct.pack("<12fH", 0, 0, 0, *vertices[face].ravel(), 0) for face in triangles)
    file.write_bytes(bytes(80) + struct.pack("<I", len(triangles)) + rows)
    return file


def urdf(shape: str, inertial: str = INERTIAL, more: str = "", tip: str = INERTIAL) -> str:
    """URDF of a base, an arm that turns on it, and a flange fixed to the arm; the arm has the
    `shape`.
    """
    return f"""<robot name="r"><link name="base">{INERTIAL}</link>
      <link name="arm">{inertial}{shape}</link><link name="flange">{tip}{more}</link>
      <joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
      <joint name="f" type="fixed"><parent link="arm"/><child link="flange"/><origin xyz="0.3 0 0"/>
        </joint></robot>"""
