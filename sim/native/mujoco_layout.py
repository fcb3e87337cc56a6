"""Memory layout of `mjModel` and `mjData`, from MuJoCo's introspection, verified live.

A native callback gets two raw pointers. Their layout changes with every MuJoCo release, so no
offset is written here: the structs are rebuilt from `mujoco.introspect.structs`. `verify` compares
every pointer of a compiled model with the array that MuJoCo's own Python binding shows for that
field.
"""

import ctypes
from collections import namedtuple
from collections.abc import Collection
from functools import cache
from typing import Any

import mujoco
import numpy as np
from mujoco.introspect import ast_nodes, structs

from uuv.sim.interfaces.errors import HydrodynamicsError

_SCALARS = {
    "int": ctypes.c_int,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
    "char": ctypes.c_char,
    "size_t": ctypes.c_size_t,
    "uint64_t": ctypes.c_uint64,
    "uintptr_t": ctypes.c_size_t,
    "mjtNum": ctypes.c_double,
    "mjtByte": ctypes.c_ubyte,
    "mjtBool": ctypes.c_bool,
    "mjtSize": ctypes.c_int64,
    "unsigned int": ctypes.c_uint,
    "unsigned char": ctypes.c_ubyte,
}

# Model with most kinds of elements, so that few arrays are empty.
_PROBE = """
<mujoco>
  <size nuserdata="3" nuser_body="2" nuser_jnt="1" nuser_actuator="2"/>
  <worldbody>
    <light/> <camera name="c"/> <geom type="plane" size="1 1 1"/>
    <body name="a" pos="0 0 1"> <freejoint/> <geom size=".1"/> <site name="s"/>
      <body name="b" pos=".3 0 0"> <joint name="j" range="-1 1" frictionloss="1"/>
        <geom size=".1"/> <site name="t"/> </body>
    </body>
    <body name="d" mocap="true" pos="3 3 3"> <geom size=".1"/> </body>
  </worldbody>
  <tendon> <spatial name="n"> <site site="s"/> <site site="t"/> </spatial> </tendon>
  <custom> <numeric name="n" data="1 2"/> </custom>
  <actuator> <motor joint="j"/> <general site="s" dyntype="integrator"/> </actuator>
  <sensor> <jointpos joint="j"/> </sensor>
</mujoco>
"""


@cache
def structure(name: str) -> type[ctypes.Structure]:
    """The C struct `name` of the running MuJoCo, as a ctypes.Structure.

    Raises:
        HydrodynamicsError: The introspection data name a type that is unknown here.
    """
    fields = [(field.name, _ctype(field.type)) for field in _fields(structs.STRUCTS[name])]
    return type(name, (ctypes.Structure,), {"_fields_": fields})


def offset(struct: str, path: str) -> int:
    """Offset [bytes] of a field of `struct`; `path` is dotted within structs (`opt.gravity`)."""
    struct_type: Any = structure(struct)
    total = 0

    for name in path.split("."):
        total += getattr(struct_type, name).offset
        struct_type = next(field[1] for field in struct_type._fields_ if field[0] == name)

    return total


def offsets(struct: str, *paths: str) -> Any:
    """Offsets [bytes] of fields of `struct`, as a named tuple by the last part of each path."""
    names = [path.rpartition(".")[2] for path in paths]
    return namedtuple(f"{struct}_offsets", names)(*(offset(struct, path) for path in paths))


def verify(model_fields: Collection[str], data_fields: Collection[str]) -> None:
    """Compare all comparable fields of the rebuilt structs with live objects, and require the
    fields named.

    Raises:
        HydrodynamicsError: A field differs, or a named one cannot be compared. The message has
            MuJoCo's version.
    """
    model = mujoco.MjModel.from_xml_string(_PROBE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)

    differing = [
        *_differences("mjModel", model, model_fields),
        *_differences("mjData", data, data_fields),
    ]

    gravity = ctypes.c_double.from_address(
        model._address + offset("mjModel", "opt.gravity") + 16
    ).value
    if gravity != model.opt.gravity[2]:
        differing.append("mjModel.opt.gravity")

    if differing:
        raise HydrodynamicsError(
            f"MuJoCo {mujoco.__version__}: fields are not at the offsets of its introspection "
            f"data: {', '.join(differing[:5])}"
        )


def _differences(
    name: str, live: mujoco.MjModel | mujoco.MjData, needed: Collection[str]
) -> list[str]:
    struct = structure(name).from_address(live._address)
    differing = []
    compared = set[str]()

    for field in structs.STRUCTS[name].fields:
        if not isinstance(field, ast_nodes.StructFieldDecl):
            continue

        shown = getattr(live, field.name, None)
        if (
            isinstance(field.type, ast_nodes.PointerType)
            and isinstance(shown, np.ndarray)
            and shown.size
        ):
            address = getattr(struct, field.name)
            if address is None and field.name not in needed:
                continue  # not allocated by MuJoCo; the binding returns its own zeros
            compared.add(field.name)
            if address != shown.ctypes.data:
                differing.append(f"{name}.{field.name}")

        elif isinstance(field.type, ast_nodes.ValueType) and isinstance(shown, int | float):
            compared.add(field.name)
            if getattr(struct, field.name) != shown:
                differing.append(f"{name}.{field.name}")

    return differing + [
        f"{name}.{field} (cannot be compared)" for field in needed if field not in compared
    ]


def _fields(
    declaration: ast_nodes.StructDecl | ast_nodes.AnonymousStructDecl,
) -> list[ast_nodes.StructFieldDecl]:
    fields = [field for field in declaration.fields if isinstance(field, ast_nodes.StructFieldDecl)]

    if len(fields) != len(declaration.fields):
        raise HydrodynamicsError(f"MuJoCo {mujoco.__version__}: a struct holds an anonymous member")
    return fields


def _ctype(node: Any) -> Any:
    if isinstance(node, ast_nodes.PointerType):
        return ctypes.c_void_p

    if isinstance(node, ast_nodes.ArrayType):
        kind = _ctype(node.inner_type)
        for extent in reversed(node.extents):
            kind = kind * extent
        return kind

    if isinstance(node, ast_nodes.AnonymousStructDecl):
        inner = [(field.name, _ctype(field.type)) for field in _fields(node)]
        return type("anonymous", (ctypes.Structure,), {"_fields_": inner})

    if isinstance(node, ast_nodes.ValueType):
        if node.name in _SCALARS:
            return _SCALARS[node.name]
        if node.name in structs.STRUCTS:
            return structure(node.name)
        if node.name.startswith("mjt"):
            return ctypes.c_int  # an enumeration

    raise HydrodynamicsError(
        f"MuJoCo {mujoco.__version__}: its introspection data name an unknown type: {node}"
    )
