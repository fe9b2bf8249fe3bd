"""The optional kernel in C; everything else stands in pyproject.toml.

Without Cython nothing is built, and a failed build is a warning: NumPy computes then.
"""

from pathlib import Path
from subprocess import SubprocessError

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError

try:
    from Cython.Build import cythonize
except ImportError:
    cythonize = None

KERNEL = "src/traverse/kinematics/kernel"


class OptionalBuild(build_ext):
    """Builds the extensions that can be built."""

    def build_extension(self, ext: Extension) -> None:
        """Take a compiler that is not there, or fails, as a build that is left out."""
        try:
            super().build_extension(ext)
        except (OSError, SubprocessError) as error:
            raise CompileError(f"the compiler does not do it: {error}") from error


def extensions() -> list[Extension]:
    if cythonize is None:
        return []
    kernel = Extension(
        "traverse.kinematics.kernel.compiled",
        [f"{KERNEL}/compiled.pyx", f"{KERNEL}/variants.c"],
        include_dirs=[KERNEL],
        depends=[
            str(path)
            for path in sorted(Path(KERNEL).iterdir())
            if path.suffix in {".h", ".inc", ".pxd", ".pxi", ".pyx"}
        ],
        # Strict IEEE: no contraction into fused operations, no -ffast-math; and no
        # instructions beyond the baseline but in the variants chosen at import.
        # Loops begin where the processor fetches: else the same code is a tenth slower
        # or not, as whatever stands before it happens to be long.
        extra_compile_args=[
            "-O3",
            "-ffp-contract=off",
            "-fno-math-errno",
            "-falign-functions=64",
            "-falign-loops=64",
        ],
        libraries=["m"],
        # One wheel for every later Python; a single pose costs 0.1 us more.
        define_macros=[("Py_LIMITED_API", "0x030b0000")],
        py_limited_api=True,
    )
    extension_modules: list[Extension] = cythonize(
        [kernel], build_dir="build/cython", quiet=True
    )
    for extension in extension_modules:  # cythonize forgets it
        extension.optional = True
    return extension_modules


setup(
    ext_modules=extensions(),
    cmdclass={"build_ext": OptionalBuild},
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)
