#include "effect.h"

namespace {

void modulate(const double* p, int n, const gms::Motion& m, const double*, gms::Level& level) {
  const double *harmonics = p, *amplitude = p + n, *phase = p + 2 * n;
  double factor = 1;
  for (int i = 0; i < n; i++) factor += amplitude[i] * std::sin(harmonics[i] * m.position + phase[i]);
  if (factor < 0) factor = 0;
  level.scale(factor, p[3 * n] != 0, p[3 * n + 1] != 0, p[3 * n + 2] != 0);
}

}  // namespace

extern const gms::Effect gms_effect_position_dependent_friction;
const gms::Effect gms_effect_position_dependent_friction = {
    "position_dependent_friction",
    "PositionDependentFriction",
    "friction",
    "Friction that varies along the revolution: the level of every friction law of the joint is multiplied by\n"
    "1 + sum_i a_i sin(n_i q + phi_i), n_i whole numbers per revolution: a bent shaft, an eccentric gear, a seal; on\n"
    "a slide joint a wave number, 2 pi over the pitch of a screw or rail, which a fit finds.\n"
    "The stiffness of `gms`, `lugre` and `dahl` follows their level, or with s = 0 stays. What a contact holds at rest is\n"
    "not changed by either; with w = 1 the whole torque of friction is multiplied, that and with d = 1 the drag too, as\n"
    "many a simulation has it.\n"
    "Source: position-dependent friction terms, Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994).",
    "The torque error is a sine of position that changes sign with the direction of motion.",
    "Slow constant-velocity runs over a whole revolution (on a slide joint, several pitches) in both directions.",
    {{"harmonics", "1/rev", gms::kUnset, 1, gms::kInfinity, true, false, "n_i, periods per revolution; on a slide waves"},
     {"amplitude", "1", 0, 0, 1, true, true, "a_i, relative to the level"},
     {"phase", "rad", 0, -gms::kInfinity, gms::kInfinity, true, true, "phi_i, at position zero"},
     {"stiffening", "1", 1, 0, 1, false, false, "s, 1: the stiffness varies with the level; 0: the level alone"},
     gms::kWholeTorque,
     gms::kWithDrag},
    nullptr,
    nullptr,
    nullptr,
    modulate,
    nullptr,
};
