#include "hidden_body.h"

namespace {

constexpr double kFraction = 0.25;  // of 1/w, the longest stretch in which a contact is looked for once
constexpr int kMostStretches = 64;
constexpr int kMostContacts = 8;  // in one stretch; more is chatter within rounding

int n_state(int) { return gms::kHiddenState; }

// 1 or -1: in contact on that side; 0: between.
int side_of(gms::Relative r, double half) {
  if (r.position > half || (r.position == half && r.velocity > 0)) return 1;
  if (r.position < -half || (r.position == -half && r.velocity < 0)) return -1;
  return 0;
}

gms::Relative drift(int side, gms::Relative r, double half, double a, double omega, double zeta, double t) {
  if (side == 0) return gms::swing(r, a, 0, 0, t);
  const double seat = side * half;
  r = gms::swing({r.position - seat, r.velocity}, a, omega, zeta, t);
  r.position += seat;
  return r;
}

bool beyond(int side, gms::Relative r, double half) {
  return side == 0 ? std::fabs(r.position) > half : side * r.position < half;
}

// Exact between contacts; the instant of a contact is found by bisection.
gms::Relative stretch(gms::Relative r, double half, double a, double omega, double zeta, double t) {
  for (int contact = 0; contact < kMostContacts; contact++) {
    const int side = side_of(r, half);
    const gms::Relative end = drift(side, r, half, a, omega, zeta, t);
    if (!beyond(side, end, half)) return end;
    double inside = 0, outside = t;
    for (int i = 0; i < 40; i++) {
      const double middle = 0.5 * (inside + outside);
      (beyond(side, drift(side, r, half, a, omega, zeta, middle), half) ? outside : inside) = middle;
    }
    r = drift(side, r, half, a, omega, zeta, outside);
    r.position = side == 0 ? std::copysign(half, r.position) : side * half;
    t -= outside;
    if (!(t > 0)) break;
  }
  return r;
}

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double* state, double* next) {
  const double half = 0.5 * p[1], omega = gms::kTurn * p[2], zeta = p[3];
  if (m.duration > 0) {
    const gms::Course course(m);
    gms::Relative r{state[gms::kDeflection], state[gms::kVelocity] - course.start};
    const double wanted = std::ceil(omega * m.duration / kFraction);
    const int n = wanted < kMostStretches ? static_cast<int>(std::fmax(wanted, 1)) : kMostStretches;
    for (int i = 0; i < n; i++) r = stretch(r, half, course.acceleration, omega, zeta, m.duration / n);
    next[gms::kDeflection] = r.position;
    next[gms::kVelocity] = r.velocity + m.velocity;
    next[gms::kJointVelocity] = m.velocity;
  } else {
    gms::carry(m, state, next);
  }
  const gms::Relative r{next[gms::kDeflection], next[gms::kVelocity] - m.velocity};
  const int side = side_of(r, half);
  return side == 0 ? 0 : p[0] * (omega * omega * (r.position - side * half) + 2 * zeta * omega * r.velocity);
}

}  // namespace

extern const gms::Effect gms_effect_backlash;
const gms::Effect gms_effect_backlash = {
    "backlash",
    "Backlash",
    "mechanics",
    "A load of inertia J2 behind a coupling with play, free within a gap b: with r = q2 - q and x the part of r\n"
    "beyond -b/2 ... b/2, tau = k x + c dr/dt in contact and 0 between, J2 dv2/dt = -tau.\n"
    "k = J2 w^2, c = 2 zeta w J2, w = 2 pi f as in `flexible_coupling`, which this is at b = 0. The load comes on top of\n"
    "the axis's inertia. Its motion is exact between contacts. At the first sample it moves with the joint, in the\n"
    "middle of the gap.\n"
    "Source: Nordin and Gutman, Controlling mechanical systems with backlash - a survey, Automatica 38 (2002).",
    "The torque error follows acceleration, vanishes for a moment after each change of its sign, then knocks.",
    "Reversals at high acceleration, at several amplitudes around the gap.",
    {{"inertia", "kg m^2", 0, 0, gms::kInfinity, false, true, "J2, of the load"},
     {"gap", "rad", gms::kUnset, 0, gms::kInfinity, false, true, "b, whole width of the play"},
     {"frequency", "Hz", gms::kUnset, 1e-3, gms::kInfinity, false, true, "f, resonance of the load in contact, motor clamped"},
     {"damping", "1", 0.05, 0, 10, false, true, "zeta, relative to critical, in contact"}},
    n_state,
    nullptr,
    nullptr,
    nullptr,
    torque,
};
