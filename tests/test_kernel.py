"""The effects' own files are what Warp compiles, for a CPU and for a GPU."""

import subprocess
import sys

import pytest

pytest.importorskip("mujoco_warp", reason="pip install 'gms-mujoco[warp]'")

import warp as wp
from axes import DRY, axis
from worlds import EVERY, catalogue

from gms_mujoco import batched, kernel

wp.config.log_level = wp.LOG_WARNING


def test_the_laws_are_those_of_the_files():
    text = kernel.source(batched.lay_out(catalogue()))
    for name in EVERY:
        file = (kernel._PACKAGE / "effects" / f"{name}.cc").read_text()
        assert file.split("namespace {")[1].split("}  // namespace")[0] in text
    assert "Effect gms_effect_" not in text, "the tables of the effects stay out"


@pytest.mark.parametrize("name", ["friction_kernel", "solve_kernel"])
def test_it_compiles_for_a_gpu_without_one(tmp_path, name):
    from gms_mujoco.warp import _kernel, _solver

    explicit, implicit = batched.lay_out(catalogue()), batched.lay_out(axis(DRY)[0])
    module = (_kernel(explicit) if name == "friction_kernel" else _solver(implicit)).module
    try:
        wp.compile_aot_module(module, arch=75, module_dir=tmp_path, use_ptx=True)
    except RuntimeError as error:
        pytest.skip(f"Warp has no CUDA compiler here: {error}")
    text = next(tmp_path.glob("*.ptx")).read_text()
    assert name in text and "f64" in text


def test_says_in_one_line_what_is_missing(tmp_path):
    code = """
import sys
from importlib import import_module
from gms_mujoco.errors import EngineError
for module, missing in (("mjx", "jax"), ("warp", "mujoco_warp"), ("warp", "warp")):
    for name in [n for n in sys.modules if n in ("gms_mujoco.kernel", "gms_mujoco.warp", "gms_mujoco.mjx")]:
        del sys.modules[name]
    sys.modules[missing] = None
    try:
        import_module(f"gms_mujoco.{module}")
    except EngineError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    lines = [line for line in done.stdout.splitlines() if "needs" in line]
    extras = ("mjx", "warp", "warp")
    assert [line.split(": ")[1] for line in lines] == [f"pip install 'gms-mujoco[{x}]'" for x in extras]
