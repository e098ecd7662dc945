#include "hidden_body.h"

namespace {

int n_state(int) { return gms::kHiddenState; }

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double* state, double* next) {
  const double omega = gms::kTurn * p[1], zeta = p[2];
  if (m.duration > 0) {
    const gms::Course course(m);
    const gms::Relative r = gms::swing({state[gms::kDeflection], state[gms::kVelocity] - course.start},
                                       course.acceleration, omega, zeta, m.duration);
    next[gms::kDeflection] = r.position;
    next[gms::kVelocity] = r.velocity + m.velocity;
    next[gms::kJointVelocity] = m.velocity;
  } else {
    gms::carry(m, state, next);
  }
  const double relative = next[gms::kVelocity] - m.velocity;
  return p[0] * (omega * omega * next[gms::kDeflection] + 2 * zeta * omega * relative);
}

}  // namespace

extern const gms::Effect gms_effect_flexible_coupling;
const gms::Effect gms_effect_flexible_coupling = {
    "flexible_coupling",
    "FlexibleCoupling",
    "mechanics",
    "A load of inertia J2 behind a coupling of stiffness k = J2 w^2 and damping c = 2 zeta w J2, w = 2 pi f:\n"
    "tau = k (q2 - q) + c (v2 - v),  J2 dv2/dt = -tau, so that joint and load exchange momentum and lose none. The load\n"
    "comes on top of the axis's inertia: well below f the joint feels J + J2 (tau = -J2 a), well above it J alone.\n"
    "f is the resonance with the motor clamped; with the motor free it is f sqrt(1 + J2/J).\n"
    "The motion of the load over an interval is the closed form for a joint that accelerates evenly. At the first\n"
    "sample the load moves with the joint: what it does otherwise dies out within a few 1/(zeta w).\n"
    "Source: the two-mass system, e.g. Vukosavic and Stojic, IEEE Trans. Industrial Electronics 45 (1998).",
    "The torque error follows acceleration and turns sign across a resonance; the FRF has a zero before a pole.",
    "Excitation at high frequency, well beyond the resonance, at several amplitudes.",
    {{"inertia", "kg m^2", 0, 0, gms::kInfinity, false, true, "J2, of the load"},
     {"frequency", "Hz", gms::kUnset, 1e-3, gms::kInfinity, false, true, "f, resonance of the load with the motor clamped"},
     {"damping", "1", 0.05, 0, 10, false, true, "zeta, relative to critical"}},
    n_state,
    nullptr,
    nullptr,
    nullptr,
    torque,
};
