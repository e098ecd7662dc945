#include "effect.h"

namespace {

int n_state(int) { return 1; }  // friction on the moving side
int n_memory(int) { return 1; }

void recall(const double* p, int, const double* unknown, double* state) { state[0] = unknown[0] * p[1]; }

double torque(const double* p, int, const gms::Motion& m, const gms::Level& level, const double* state,
              double* next) {
  const double direction = gms::sign(m.displacement), limit = p[1] * level.at(direction), exponent = p[2];
  if (direction == 0) {
    next[0] = state[0];
  } else if (limit <= 0) {
    next[0] = 0;
  } else {
    // u = 1 - F / Fc along the motion obeys du/dx = -(k / Fc) sgn(u) |u|^exponent: integrated exactly.
    const double u = 1 - direction * state[0] / limit;
    const double x = p[0] * level.stiffness_at(direction) / limit * std::fabs(m.displacement);
    double size;
    if (exponent == 1) {
      size = std::fabs(u) * std::exp(-x);
    } else {
      const double y = std::pow(std::fabs(u), 1 - exponent) + (exponent - 1) * x;
      size = u == 0 || y <= 0 ? 0 : std::pow(y, 1 / (1 - exponent));
    }
    next[0] = direction * limit * (1 - gms::sign(u) * size);
  }
  return -next[0];
}

}  // namespace

extern const gms::Effect gms_effect_dahl;
const gms::Effect gms_effect_dahl = {
    "dahl",
    "Dahl",
    "friction",
    "Dahl friction, dF/dx = k |1 - F sgn(v) / Fc|^alpha sgn(1 - F sgn(v) / Fc): the stress-strain curve of a ductile\n"
    "material. It depends on displacement alone, not on its rate, and is integrated exactly over each interval.\n"
    "Source: P. Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1 (1968).",
    "The torque error draws rounded loops against position after each reversal, the same at every speed.",
    "Slow reversals at several amplitudes around the break-away distance.",
    {{"stiffness", "N m/rad", gms::kUnset, 0, gms::kInfinity, false, true, "k, slope at zero friction"},
     {"coulomb", "N m", gms::kUnset, 0, gms::kInfinity, false, true, "Fc, level that is approached"},
     {"exponent", "1", 1.0, 0.1, 4, false, false, "alpha, shape: below 1 brittle, above 1 ductile"}},
    n_state,
    n_memory,
    recall,
    nullptr,
    torque,
    nullptr,
    true,
};
