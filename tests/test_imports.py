"""Imports point one way, as design.md draws it; optional dependencies live at the edges."""

import ast
import importlib
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "gms_mujoco"

# A module may import those of lower rank, and of its own rank where the drawing lets it.
LAYERS = [
    {"errors", "parameter", "version", "registration", "effort"},
    {"files", "units", "timing", "turns", "progress", "recent", "figure", "tall", "folds", "noise_band",
     "residual_maps", "native", "excitation", "free_motion", "spectra", "threads", "variances"},
    {"harmonics", "frf_units", "place_spectrum", "slow_signal"},
    {"record", "formats", "effect", "score"},
    {"effects", "columns", "frf", "frf_table", "passivity", "repeats", "distortion", "resonance"},
    {"frf_noise"},
    {"servo_run", "plant", "coordinates", "grid", "sampling", "encoder"},
    {"servo_observation", "between_samples"},
    {"readings"},
    {"rest"},
    {"servo_starts", "simulate", "inverse", "sines", "frf_observation", "noise", "scales", "motion", "starts", "engine",
     "tasks", "axis", "dahl_resonance"},
    {"first_state", "candidates", "derivatives", "time_steps"},
    {"batched", "observe", "misfit", "least_squares", "placement", "intervals", "undetermined", "residuals", "robot",
     "plausible", "rough_inertia", "speed_curve", "time_spectrum", "whitened"},
    {"compare_servo", "rough"},
    {"servo_residuals"},
    {"held_out", "fit_result", "history"},
    {"linear_model", "refine", "other_causes", "patience"},
    {"screen", "habits"},
    {"mjcf", "bam", "servo", "fit", "compare", "compare_frf", "bench", "sweep", "hensen"},
    {"measured_axis"},
    {"frf_files", "record_files"},
    {"dataset"},
    {"elements", "remainder", "custom", "goals"},
    {"reading", "judgement"},
    {"beyond", "moments", "plays"},
    {"friction_shape", "joint_fits"},
    {"steps", "openings", "trials"},
    {"findings", "waves"},
    {"pairs"},
    {"search"},
    {"recheck", "friction_law"},
    {"paths"},
    {"given_inertia", "given_load", "given_setup"},
    {"conclusion", "unfitted"},
    {"diagnose"},
    {"bootstrap"},
    {"page", "page_frf", "page_servo"},
    {"demo", "report", "workers"},
    {"fleet"},
    {"env", "vector_env", "control", "drawing", "portrait", "scene", "view", "tour", "tour_servo"},
    {"learn", "kernel"},
    {"warp", "mjx"},
    {"sb3"},
    {"cli"},
    {"__init__", "__main__"},
]
RANK = {name: i for i, layer in enumerate(LAYERS) for name in layer}
EDGES = {
    "registration", "env", "vector_env", "control", "drawing", "portrait", "scene", "view", "tour", "tour_servo",
    "learn", "sb3", "cli", "report", "demo", "workers", "fleet", "kernel", "warp", "mjx",
}  # fmt: skip
OPTIONAL = {
    "rerun", "gymnasium", "matplotlib", "stable_baselines3", "torch", "joblib", "distributed", "warp",
    "mujoco_warp", "jax",
}  # fmt: skip


# Folders that hold modules with places of their own; the other folders have one place each.
GROUPS = {"logs", "responses", "identification", "comparison", "diagnosis", "views"}


def _named(parts: tuple[str, ...]) -> str | None:
    """The name in LAYERS of a path below the package; none for the package or a group by itself."""
    inside = parts[1:] if parts and parts[0] in GROUPS else parts
    return inside[0] if inside else None


def _modules() -> dict[str, list[Path]]:
    found: dict[str, list[Path]] = {}
    for path in PACKAGE.rglob("*.py"):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if not (parts[0] in GROUPS and parts[1] == "__init__"):
            found.setdefault(_named(parts) or "", []).append(path)
    return found


MODULES = _modules()


def _imports(path: Path) -> tuple[set[str], set[str]]:
    """Modules of this package and of others that a file imports when it is loaded or run, annotations aside."""
    own: set[str] = set()
    other: set[str] = set()
    folders = path.relative_to(PACKAGE).parts[:-1]

    def visit(node: ast.AST, at_load: bool) -> None:
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            return
        if isinstance(node, ast.Import):
            other.update(a.name.split(".")[0] for a in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            other.add((node.module or "").split(".")[0])
        elif isinstance(node, ast.ImportFrom) and at_load:
            below = node.module.split(".") if node.module else []
            named = _named((*folders[: len(folders) + 1 - node.level], *below))
            own.update([named] if named else [a.name for a in node.names])
        inside = at_load and not isinstance(node, ast.FunctionDef)
        for child in ast.iter_child_nodes(node):
            visit(child, inside)

    visit(ast.parse(path.read_text(encoding="utf-8")), True)
    return {n for n in own if n in MODULES}, other


@pytest.mark.parametrize("name", sorted(MODULES))
def test_a_module_has_its_place_and_imports_downwards(name: str) -> None:
    assert name in RANK, f"give {name} its place in LAYERS"
    for path in MODULES[name]:
        for used in _imports(path)[0] - {name}:
            assert RANK[used] <= RANK[name], f"{path.relative_to(PACKAGE)} imports {used}, which stands above it"


def test_nothing_imports_the_edges() -> None:
    for name, paths in MODULES.items():
        if name not in EDGES | {"__init__", "__main__"}:
            for path in paths:
                assert not _imports(path)[0] & EDGES, f"{path.relative_to(PACKAGE)} imports an edge"


def test_optional_dependencies_live_at_the_edges() -> None:
    for name, paths in MODULES.items():
        if name not in EDGES:
            for path in paths:
                assert not _imports(path)[1] & OPTIONAL, f"{path.relative_to(PACKAGE)} needs an optional package"


def test_the_package_loads_no_part_of_scipy_before_it_is_used() -> None:
    """Who only simulates, in many processes, does not wait for it."""
    told = "import sys, gms_mujoco; print({'scipy.signal', 'scipy.stats', 'scipy.optimize'} & set(sys.modules))"
    ended = subprocess.run([sys.executable, "-P", "-c", told], capture_output=True, text=True, check=True)
    assert ended.stdout.strip() == "set()"


def test_no_module_imports_itself_through_others() -> None:
    graph = {name: set().union(*(_imports(p)[0] for p in paths)) - {name} for name, paths in MODULES.items()}
    TopologicalSorter(graph).prepare()  # raises a CycleError that names the circle


def test_what_mjx_needs_is_told_where_warp_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    from gms_mujoco.errors import EngineError

    for name in ("warp", "gms_mujoco.kernel", "gms_mujoco.mjx"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "warp", None)
    with pytest.raises(EngineError, match=r"friction under MJX needs it: pip install 'gms-mujoco\[mjx\]'"):
        importlib.import_module("gms_mujoco.mjx")


def test_modules_that_load_slowly_are_loaded_when_they_are_named() -> None:
    told = ("import gms_mujoco as gms, sys; late = ['gms_mujoco.env', 'gms_mujoco.control']; "
            "assert not set(late) & set(sys.modules); print(gms.control.PID.__name__, gms.env.ServoTracking.__name__)")
    ended = subprocess.run([sys.executable, "-P", "-c", told], capture_output=True, text=True, check=True)
    assert ended.stdout.split() == ["PID", "ServoTracking"]


def test_stable_baselines_that_is_not_installed_is_told_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    from gms_mujoco.errors import GmsError

    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    monkeypatch.delitem(sys.modules, "gms_mujoco.sb3", raising=False)
    with pytest.raises(GmsError, match=r"needs stable-baselines3: pip install 'gms-mujoco\[rl\]'"):
        importlib.import_module("gms_mujoco.sb3")
