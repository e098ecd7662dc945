"""The friction of a model in a kernel of NVIDIA Warp: the effects' own C++ files, compiled by Warp for a CPU or a GPU.

No law is written a second time. Warp puts the text of a native snippet into the source of its module as it stands; ours
brings effect.h, the laws in effects/*.cc (each file up to its table), and native/kernel.h, which evaluates one joint
and solves for stiff ones.
"""

import functools
import hashlib
from pathlib import Path
from typing import Any

from .batched import Layout
from .errors import EngineError

try:
    import warp as wp
except ImportError:
    raise EngineError("friction in many worlds needs NVIDIA Warp: pip install 'gms-mujoco[warp]'") from None

_PACKAGE = Path(__file__).parent
_HEADERS = ("native/effect.h", "native/hidden_body.h", "native/backward_euler.h", "native/tree.h")

# Warp's compilers have no headers of the standard library, but declare these functions of C.
# And they have turned the names of types into macros.
_STANDARD = """
#define GMS_MUJOCO_KERNEL
#pragma push_macro("int")
#undef int
namespace gms_standard {
inline double fabs(double x) { return ::fabs(x); }
inline double exp(double x) { return ::exp(x); }
inline double pow(double x, double y) { return ::pow(x, y); }
inline double sin(double x) { return ::sin(x); }
inline double cos(double x) { return ::cos(x); }
inline double sqrt(double x) { return ::sqrt(x); }
inline double floor(double x) { return ::floor(x); }
inline double ceil(double x) { return ::ceil(x); }
inline double fmax(double x, double y) { return x > y || y != y ? x : y; }
inline double fmin(double x, double y) { return x < y || y != y ? x : y; }
inline double copysign(double x, double y) { return (y < 0) == (x < 0) ? x : -x; }
inline bool isnan(double x) { return x != x; }
inline double nan(const char*) { const double zero = 0; return zero / zero; }
inline double expm1(double x) {
  const double e = ::exp(x);
  return e == 1 ? x : (e - 1) * x / ::log(e);
}
}  // namespace gms_standard
#define std gms_standard
"""


def _text(path: str) -> str:
    lines = (_PACKAGE / path).read_text(encoding="utf-8").splitlines()
    return "\n".join(line for line in lines if not (line.startswith("#include") or line.endswith("_H_")))


def _law(effect: str) -> str:
    """The functions of an effect's file, in a namespace of their own."""
    text = _text(f"effects/{effect}.cc").split(f"extern const gms::Effect gms_effect_{effect};")[0]
    return f"namespace gms_law_{effect} {{\n{text}\n}}"


def _switch(declared: str, cases: dict[int, str], fallback: str) -> str:
    """A function of the number of an effect: `declared`, with the expression for each."""
    calls = "".join(f"  if (effect == {i}) return {x};\n" for i, x in cases.items())
    return f"inline {declared} {{\n{calls}  {fallback}\n}}"


def source(layout: Layout) -> str:
    """C++ of the friction of a model: all that the snippet needs at file scope."""
    given = "int effect, const double* p, int n, const Motion& m"
    modulated = {
        i: f"gms_law_{e}::modulate(p, n, m, state, level)" for i, e in enumerate(layout.effects) if layout.modulates(e)
    }
    torques = {
        i: (f"level.{by} * " if (by := layout.multiplier(e)) else "")
        + f"gms_law_{e}::torque(p, n, m, level, state, next)"
        for i, e in enumerate(layout.effects)
        if layout.has_torque(e)
    }
    joints, uses = (", ".join(str(x) for row in table for x in row) for table in (layout.joints, layout.uses))
    return "\n".join(
        [
            "#ifndef GMS_MUJOCO_KERNEL",  # several functions of one kernel bring it
            _STANDARD,
            *map(_text, _HEADERS),
            *map(_law, layout.effects),
            f"#define GMS_MOST_PARAMETERS {max(row[3] for row in layout.joints)}",
            f"#define GMS_MOST_STATES {max(row[5] for row in layout.joints)}",
            f"#define GMS_STATES {layout.n_state}",
            f"#define GMS_IMPLICIT {len(layout.implicit)}" if layout.implicit else "",
            "namespace gms {",
            f"static const int kJoints[] = {{{joints}}};",
            f"static const int kUses[] = {{{uses}}};",
            f"static const int kImplicit[] = {{{', '.join(map(str, layout.implicit or (-1,)))}}};",
            _switch(f"void modulate({given}, const double* state, Level& level)", modulated, ""),
            _switch(
                f"double torque({given}, const Level& level, const double* state, double* next)", torques, "return 0;"
            ),
            "}",
            _text("native/kernel.h"),
            '#undef std\n#pragma pop_macro("int")\n#endif',
        ]
    )


# What a native function has of a world: its parameters, its states, and where the new ones go.
_WORLD = "wp::address(parameters, row, 0), wp::address(before, world, 0), wp::address(after, world, 0)"
_REAL = {wp.float64: "wp::float64", wp.float32: "wp::float32"}


@functools.cache
def _snippet(text: str, stem: str, result: str, parameters: str, values: str, body: str) -> str:
    """Body of a native function. It declares what it calls, and ends; the rest stands after it at file scope.

    Args:
        text: what has to stand before that function.
        stem: of its name, which goes on with a hash of the text.
        result, parameters: of its declaration.
        values: it is called with.
        body: statement of it.
    """
    name = f"gms_{stem}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    back = "" if result == "void" else "return "
    return f"""
    {result} {name}({parameters});
    {back}{name}({values});
}}
{text}
{result} {name}({parameters}) {{
    {back}{body};
"""


def evaluator(layout: Layout, real: Any) -> Any:
    """A Warp function: the torque on joint number `joint` of `layout` in a world, whose state it moves on.

    Args:
        layout: of the model.
        real: type of the numbers in `parameters` and the states, `wp.float64` or `wp.float32`; laws are evaluated in
            double.

    Returns:
        f(joint, parameters, row, before, after, world, time, timestep, position, velocity, pull, given) -> torque
        [N m]; `row` is that of the parameters, `before` and `after` are the states, (nworld, n_state), and may be the
        same array. For the others see native/kernel.h.
    """
    number = _REAL[real]
    snippet = _snippet(
        source(layout), "friction", "double",
        f"int joint, const {number}* parameters, const {number}* before, {number}* after, double time, "
        "double timestep, double position, double velocity, double pull, double given",
        f"joint, {_WORLD}, time, timestep, position, velocity, pull, given",
        "gms::evaluate(joint, parameters, before, after, time, timestep, position, velocity, pull, given)",
    )  # fmt: skip

    @wp.func_native(snippet)
    def friction(
        joint: int,
        parameters: wp.array2d[real],
        row: int,
        before: wp.array2d[real],
        after: wp.array2d[real],
        world: int,
        time: wp.float64,
        timestep: wp.float64,
        position: wp.float64,
        velocity: wp.float64,
        pull: wp.float64,
        given: wp.float64,
    ) -> wp.float64: ...

    return friction


def solver(layout: Layout, real: Any) -> Any:
    """A Warp function: the torques of the implicit joints of a world over the step that begins, by backward Euler.

    Args:
        layout: of the model, with implicit joints.
        real: as for `evaluator`, which has to be called first.

    Returns:
        f(parameters, row, before, after, world, time, timestep, room); `room` is (nworld, room_size(layout)) float64,
        its rows are those of native/kernel.h.
    """
    number = _REAL[real]
    snippet = _snippet(
        source(layout), "settle", "void",
        f"const {number}* parameters, const {number}* before, {number}* after, double time, double timestep, "
        "double* room",
        f"{_WORLD}, time, timestep, wp::address(room, world, 0)",
        "gms::settle(parameters, before, after, time, timestep, room)",
    )  # fmt: skip

    @wp.func_native(snippet)
    def settle(
        parameters: wp.array2d[real],
        row: int,
        before: wp.array2d[real],
        after: wp.array2d[real],
        world: int,
        time: wp.float64,
        timestep: wp.float64,
        room: wp.array2d[wp.float64],
    ): ...

    return settle


def responder(layout: Layout) -> Any:
    """A Warp function that fills the room of `solver` from the inertia that MuJoCo Warp has, see native/kernel.h."""
    snippet = _snippet(
        source(layout), "respond", "void",
        "int size, const int* row_size, const int* row_start, const int* column, const float* inertia, "
        "const float* damping, float damps, const float* velocity, const float* torque, const int* dofs, "
        "double timestep, double* work, double* room",
        "size, wp::address(row_size, 0), wp::address(row_start, 0), wp::address(column, 0), "
        "wp::address(inertia, world, 0), wp::address(damping, row, 0), damps, wp::address(velocity, world, 0), "
        "wp::address(torque, world, 0), wp::address(dofs, 0), timestep, wp::address(work, world, 0), "
        "wp::address(room, world, 0)",
        "gms::respond({size, row_size, row_start, column}, inertia, damping, damps, velocity, torque, dofs, timestep, "
        "work, room)",
    )  # fmt: skip

    @wp.func_native(snippet)
    def respond(
        size: int,
        row_size: wp.array[int],
        row_start: wp.array[int],
        column: wp.array[int],
        inertia: wp.array2d[float],
        damping: wp.array2d[float],
        row: int,
        damps: float,
        velocity: wp.array2d[float],
        torque: wp.array2d[float],
        dofs: wp.array[int],
        timestep: wp.float64,
        world: int,
        work: wp.array2d[wp.float64],
        room: wp.array2d[wp.float64],
    ): ...

    return respond


# Rows of the room of `solver`, as in native/kernel.h.
POSITION, VELOCITY, FREE, GIVEN, PUSH, SOLVED, RESPONSE = range(7)


def room_size(layout: Layout) -> int:
    """Numbers that `solver` needs of each world."""
    n = len(layout.implicit)
    return (RESPONSE + n) * n


def jax_torque(layout: Layout) -> Any:
    """The friction of one world as a JAX function, which maps over more: a kernel behind JAX's foreign functions.

    Returns:
        f(parameters, state, time, timestep, position, velocity, pull, given) -> torque, state; each (1, n) float32.
    """
    evaluate = evaluator(layout, wp.float32)
    n_state, n_joints = layout.n_state, len(layout.joints)

    @wp.kernel(module="unique", enable_backward=False)
    def friction_kernel(
        parameters: wp.array2d[float],
        before: wp.array2d[float],
        time: wp.array2d[float],
        timestep: wp.array2d[float],
        position: wp.array2d[float],
        velocity: wp.array2d[float],
        pull: wp.array2d[float],
        given: wp.array2d[float],
        torque: wp.array2d[float],
        state: wp.array2d[float],
    ):
        world, joint = wp.tid()  # type: ignore[misc, unused-ignore]
        torque[world, joint] = float(
            evaluate(
                joint,
                parameters,
                world,
                before,
                state,
                world,
                wp.float64(time[world, 0]),
                wp.float64(timestep[world, 0]),
                wp.float64(position[world, joint]),
                wp.float64(velocity[world, joint]),
                wp.float64(pull[world, joint]),
                wp.float64(given[world, joint]),
            )
        )

    return wp.jax_kernel(
        friction_kernel,
        num_outputs=2,
        launch_dims=(1, n_joints),
        output_dims={"torque": (1, n_joints), "state": (1, n_state)},
    )


def jax_solver(layout: Layout) -> Any:
    """The torque of the implicit joints of one world as a JAX function, which maps over more.

    Returns:
        f(parameters, state, time, timestep, given) -> torque (1, n_implicit), state; each (1, n) float32. `given` has
        the rows POSITION to GIVEN of the room, and then those from RESPONSE on.
    """
    settle = solver(layout, wp.float32)
    n, size = len(layout.implicit), room_size(layout)

    @wp.kernel(module="unique", enable_backward=False)
    def settle_kernel(
        parameters: wp.array2d[float],
        before: wp.array2d[float],
        time: wp.array2d[float],
        timestep: wp.array2d[float],
        given: wp.array2d[float],
        torque: wp.array2d[float],
        state: wp.array2d[float],
        room: wp.array2d[wp.float64],
    ):
        world = wp.tid()
        for i in range(wp.static(PUSH * n)):
            room[world, i] = wp.float64(given[world, i])
        for i in range(wp.static(n * n)):
            room[world, wp.static(RESPONSE * n) + i] = wp.float64(given[world, wp.static(PUSH * n) + i])
        now, step = wp.float64(time[world, 0]), wp.float64(timestep[world, 0])
        settle(parameters, world, before, state, world, now, step, room)
        for i in range(n):
            torque[world, i] = float(room[world, wp.static(PUSH * n) + i])

    return wp.jax_kernel(
        settle_kernel,
        num_outputs=3,
        launch_dims=(1,),
        output_dims={"torque": (1, n), "state": (1, layout.n_state), "room": (1, size)},
    )
