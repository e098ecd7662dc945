#include "effect.h"

namespace {

double torque(const double* p, int n, const gms::Motion& m, const gms::Level&, const double*, double*) {
  const double *harmonics = p, *amplitude = p + n, *phase = p + 2 * n;
  double total = 0;
  for (int i = 0; i < n; i++) total += amplitude[i] * std::sin(harmonics[i] * m.position + phase[i]);
  return total;
}

}  // namespace

extern const gms::Effect gms_effect_cogging;
const gms::Effect gms_effect_cogging = {
    "cogging",
    "Cogging",
    "drive",
    "Cogging torque, tau = sum_i A_i sin(n_i q + phi_i), n_i whole numbers per revolution: the magnets' preferred\n"
    "positions (multiples of the number of poles), or ripple of a gear or bearing. On a slide joint the force of a linear\n"
    "motor's magnets or of a screw: n_i is a wave number, 2 pi over the pitch, which a fit finds.\n"
    "Source: Hanselman, Brushless Permanent Magnet Motor Design (2003), chapter on cogging torque.",
    "The torque error is a sine of position with a whole number of periods per revolution (on a slide "
    "joint one per pitch), the same in both directions and at every speed.",
    "Slow constant-velocity runs over a whole revolution (on a slide joint, several pitches) in both directions.",
    {{"harmonics", "1/rev", gms::kUnset, 1, gms::kInfinity, true, false, "n_i, periods per revolution; on a slide waves"},
     {"amplitude", "N m", 0, 0, gms::kInfinity, true, true, "A_i"},
     {"phase", "rad", 0, -gms::kInfinity, gms::kInfinity, true, true, "phi_i, at position zero"}},
    nullptr,
    nullptr,
    nullptr,
    nullptr,
    torque,
};
