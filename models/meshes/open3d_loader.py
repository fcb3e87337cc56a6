"""Lazy import of Open3D, the only one in the project, with clear errors for missing libraries.

No job needs Open3D, except for ray casting on Linux on ARM. It is the reference with which the
methods of this project are compared.
"""

import ctypes
import warnings
from functools import cache
from typing import Any

from uuv.sim.interfaces.errors import MissingLibraryError

DEBIAN_PACKAGES = "libgl1 libegl1 libx11-6 libudev1 libidn2-0"


@cache
def load() -> Any:
    """Import the `open3d` module on the first call (about 1-2 s).

    Raises:
        MissingLibraryError: Open3D or a system library that it needs is missing; the message says
            what to install.
    """
    try:
        import libusb_package  # pyright: ignore[reportMissingImports]

        # Open3D's extension requires libusb-1.0.so.0 even without a camera; minimal systems lack
        # it.
        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            import open3d  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError as error:
        raise MissingLibraryError(
            f"the package {error.name} is not installed; install Open3D and its dependencies by "
            "./uvw run --extra open3d ..., or pip install 'uuv-arm[open3d]'"
        ) from error
    except (ImportError, OSError) as error:
        raise MissingLibraryError(
            f"Open3D cannot be imported ({error}). On Debian or Ubuntu: apt install "
            f"{DEBIAN_PACKAGES}"
        ) from error

    # Open3D writes warnings to stdout; relevant failures reach the callers as errors.
    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d
