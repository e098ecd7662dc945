#include "hidden_body.h"

namespace {

int n_state(int) { return gms::kHiddenState; }
int n_memory(int) { return 2; }

// How far the load is from rest, and its velocity relative to the joint, as a deflection [rad].
void recall(const double* p, int, const double* unknown, double* state) {
  state[gms::kDeflection] = unknown[0];
  state[gms::kVelocity] = gms::kTurn * p[1] * unknown[1];
  state[gms::kJointVelocity] = 0;
}

struct Shaft {
  double omega, zeta;

  gms::Relative stretch(gms::Relative r, double a, double t) const { return gms::Swing(omega, zeta, t).from(r, a); }
  double pull(gms::Relative r) const { return omega * omega * r.position + 2 * zeta * omega * r.velocity; }
  double tightens(gms::Relative r, double a) const { return omega * (omega * r.velocity - 2 * zeta * a); }
};

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double* state, double* next) {
  const Shaft shaft{gms::kTurn * p[1], p[2]};
  const double slow = p[3];
  const auto move = [&](gms::Relative r, const gms::Course& course, double& taken) {
    const double a = course.acceleration;
    if (!(slow > 0)) return shaft.stretch(r, a, m.duration);
    const int n = gms::stretches(shaft.omega, m.duration);
    const double t = m.duration / n;
    double* const lost = course.coarse ? &taken : nullptr;
    for (int i = 0; i < n; i++) r = gms::rubbed(shaft, r, course.start + i * t * a, a, t, slow, lost);
    return r;
  };
  const auto pull = [&](gms::Relative r) { return shaft.pull(r); };
  return p[0] * gms::follow(m, shaft.omega, shaft.zeta, state, next, move, pull);
}

}  // namespace

extern const gms::Effect gms_effect_flexible_coupling;
const gms::Effect gms_effect_flexible_coupling = {
    "flexible_coupling",
    "FlexibleCoupling",
    "mechanics",
    "A load of inertia J2 behind a coupling of stiffness k = J2 w^2 and damping c = 2 zeta w J2, w = 2 pi f:\n"
    "tau = k (q2 - q) + c (v2 - v),  J2 dv2/dt = -tau - F2 sign(v2), at rest where F2 holds what pushes: but for that\n"
    "dry friction of the load, J2 times the deceleration of one that coasts, the two lose no momentum.\n"
    "J2 is a part of the axis's inertia J, and J - J2 moves with the joint: well below f, where tau = -J2 a, the drive\n"
    "feels J; well above it the motor alone. f is the resonance with the motor clamped; with the motor free it is\n"
    "f sqrt(J / (J - J2)). The motion of the load over an interval is the closed form for a joint that accelerates\n"
    "evenly. In a simulation the load sets out with the joint; in what way it swings where a record begins a fit finds.\n"
    "Source: the two-mass system, e.g. Vukosavic and Stojic, IEEE Trans. Industrial Electronics 45 (1998).",
    "The torque error follows acceleration and turns sign across a resonance; the FRF has a zero before a pole.",
    "Excitation at high frequency, well beyond the resonance, at several amplitudes.",
    {{"inertia", "kg m^2", 0, 0, gms::kInfinity, false, true, "J2, of the load, part of the axis's"},
     {"frequency", "Hz", gms::kUnset, 1e-3, gms::kInfinity, false, true, "f, resonance of the load with the motor clamped"},
     {"damping", "1", 0.05, 0, 10, false, true, "zeta, relative to critical"},
     {"deceleration", "rad/s^2", 0, 0, gms::kInfinity, false, true, "F2/J2, by dry friction of the load; 0: none"}},
    n_state,
    n_memory,
    recall,
    nullptr,
    torque,
    nullptr,
    true,
    true,
};
