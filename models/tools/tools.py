"""Tools by name, for the tip of any arm: `--tool NAME`.

    attachment.attach(spec, TOOLS.load("brush"))

`TOOLS` has those of other packages too.
"""

from uuv.models.registry import MadeForm, Registry
from uuv.models.tools.gripper import Gripper
from uuv.models.tools.handle_socket import HandleSocket
from uuv.models.tools.heads import Head, Jaws
from uuv.models.tools.sampler import BOX, CORER, SAMPLER, Box, Tube

Tool = Tube | Box | Head | Jaws | Gripper | HandleSocket


def pad() -> Tool:
    """Round pad, a dome of 60 mm radius, for an arm that bears some 100 N."""
    return Head(radius=0.06, length=0.06, mass=0.3)


def small_pad() -> Tool:
    """Round pad, a dome of 20 mm radius, for a small arm."""
    return Head(radius=0.02, length=0.03, mass=0.05, stiffness=5e3, damping=20.0)


def brush() -> Tool:
    """Round brush: soft along its bristles, with the friction of wire on steel."""
    return Head(
        radius=0.05,
        length=0.08,
        mass=0.35,
        stiffness=6e3,
        damping=60.0,
        friction=0.5,
        shape="bristles",
    )


def jaws() -> Tool:
    """Parallel jaws at a fixed opening; their rounded end may touch."""
    return Jaws()


def gripper() -> Tool:
    """Parallel jaws with a motor, 0 to 100 mm, for an arm that bears some 100 N."""
    return Gripper()


def small_gripper() -> Tool:
    """Parallel jaws with a motor, 0 to 60 mm, for a small arm."""
    # A softer mount than that of the others: its palm weighs little (`grip_contact`).
    return Gripper(
        opening=0.06,
        force=50.0,
        loss=2.0,
        breadth=0.02,
        length=0.1,
        mass=0.2,
        stiffness=5e3,
        mount_damping=20.0,
    )


def handle_socket() -> Tool:
    """Slot of 25 mm that takes a T-bar or a paddle, to be turned about the tool's axis."""
    return HandleSocket()


def sampler() -> Tool:
    """Round steel tube with a domed nose, to be put into a hole."""
    return SAMPLER


def corer() -> Tool:
    """Round steel tube, open below, to be pushed into the seabed."""
    return CORER


def box() -> Tool:
    """Steel box, open below, to be dragged through the seabed."""
    return BOX


_FORM = MadeForm(
    "a Head, Jaws, Gripper, HandleSocket, Tube or Box of uuv.models.tools",
    lambda t: isinstance(t, Tool),
)
TOOLS: Registry[Tool] = Registry(
    "tool",
    {
        "pad": pad,
        "small_pad": small_pad,
        "brush": brush,
        "jaws": jaws,
        "gripper": gripper,
        "small_gripper": small_gripper,
        "handle_socket": handle_socket,
        "sampler": sampler,
        "corer": corer,
        "box": box,
    },
    form=_FORM,
)
