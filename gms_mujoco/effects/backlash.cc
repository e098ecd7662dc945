#include "hidden_body.h"

namespace {

int n_state(int) { return gms::kHiddenState; }
int n_memory(int) { return 1; }

void recall(const double* p, int, const double* unknown, double* state) {
  state[gms::kDeflection] = unknown[0] * 0.5 * p[1];
  state[gms::kVelocity] = state[gms::kJointVelocity] = 0;
}

struct Coupling {
  double half, omega, zeta, lambda;  // half the gap; of the contact; drag in the gap over inertia
  double slow;                       // deceleration by dry friction

  // Torque of a contact on `side` over the inertia of the load.
  double press(int side, gms::Relative r) const {
    return omega * omega * (r.position - side * half) + 2 * zeta * omega * r.velocity;
  }

  // 1 or -1: in contact on that side; 0: between. A contact pushes and does not pull.
  int side_of(gms::Relative r) const {
    for (int s = 1; s >= -1; s -= 2) {
      const double x = s * r.position - half;
      if ((x > 0 && s * press(s, r) > 0) || (x == 0 && s * r.velocity > 0)) return s;
    }
    return 0;
  }

  bool beyond(int side, gms::Relative r) const {
    if (side != 0) return side * press(side, r) < 0;
    return std::fabs(r.position) > half && side_of(r) != 0;
  }

  // A coarse step: backward Euler, continuous in the joint's velocity v for the implicit step around it to solve. It
  // damps a contact so much that the damper is left out. `taken`: the velocity that dry friction takes of the load.
  gms::Relative leap(gms::Relative r, double v, double t, double& taken) const {
    double moves = pushed(r, r.velocity, t);
    if (slow > 0) {
      const double ahead = pushed(r, r.velocity - slow * t, t), back = pushed(r, r.velocity + slow * t, t);
      moves = ahead + v > 0 ? ahead : back + v < 0 ? back : -v;
      const double rest = r.position - t * v, x = rest - std::fmin(std::fmax(rest, -half), half);
      taken = moves != -v ? std::copysign(slow * t, moves + v) : r.velocity + v - t * omega * omega * x;
    }
    return {r.position + t * moves, moves};
  }

  // The velocity after it, by a contact, of a load that has the velocity v without.
  double pushed(gms::Relative r, double v, double t) const {
    for (int s = 1; s >= -1; s -= 2) {
      const double beyond = s * (r.position + t * v) - half;
      if (beyond > 0) v -= s * t * omega * omega * beyond / (1 + omega * omega * t * t);
    }
    return v;
  }

  // Torque on the joint over the inertia of the load.
  double pull(gms::Relative r) const {
    const int side = side_of(r);
    return side == 0 ? lambda * r.velocity : press(side, r);
  }

  double tightens(gms::Relative r, double a) const {
    return side_of(r) == 0 ? -lambda * a : omega * (omega * r.velocity - 2 * zeta * a);
  }
};

// Its motion, without friction.
struct Moving : Coupling {
  double whole;  // the time most often asked for, and what that does to a load that is free and to one in contact
  gms::Coast coast;
  gms::Swing swing;

  gms::Relative after(int side, gms::Relative r, double a, double t) const {
    if (side == 0) return (t == whole ? coast : gms::Coast(lambda, t)).from(r, a);
    const double seat = side * half;
    r = (t == whole ? swing : gms::Swing(omega, zeta, t)).from({r.position - seat, r.velocity}, a);
    r.position += seat;
    return r;
  }

  // Of a contact, or of the gap.
  gms::Left left(int side, gms::Relative r, double a) const {
    const double p = press(side, r), v = r.velocity;
    if (side == 0) return {half - std::fabs(r.position), -std::copysign(1, r.position) * v, beyond(side, r)};
    return {side * p, side * omega * (omega * v - 2 * zeta * (a + p)), beyond(side, r)};
  }

  // Over time t, exact between contacts.
  gms::Relative stretch(gms::Relative r, double a, double t) const {
    for (int contact = 0; contact < gms::kMostTurns && t > 0; contact++) {
      const int side = side_of(r);
      const gms::Relative end = after(side, r, a, t);
      if (!beyond(side, end)) return end;
      const bool crossing = side == 0 && std::fabs(r.position) <= half;
      const double passed =
          gms::until(t, left(side, end, a), [&](double now) { return left(side, after(side, r, a, now), a); });
      r = after(side, r, a, passed);
      if (crossing) r.position = std::copysign(half, r.position);
      t -= passed;
    }
    return r;
  }
};

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double* state, double* next) {
  const double omega = gms::kTurn * p[2], zeta = p[3];
  const Coupling coupling{0.5 * p[1], omega, zeta, 2 * zeta * omega * p[4], p[5]};
  const auto move = [&](gms::Relative r, const gms::Course& course, double& taken) {
    if (course.coarse) return coupling.leap(r, course.start, m.duration, taken);
    const int n = gms::stretches(omega, m.duration);
    const double t = m.duration / n, a = course.acceleration, slow = coupling.slow;
    const Moving moving{coupling, t, gms::Coast(coupling.lambda, t), gms::Swing(omega, zeta, t)};
    for (int i = 0; i < n; i++) {
      r = slow > 0 ? gms::rubbed(moving, r, course.start + i * t * a, a, t, slow, nullptr) : moving.stretch(r, a, t);
    }
    return r;
  };
  return p[0] * gms::follow(m, omega, zeta, state, next, move, [&](gms::Relative r) { return coupling.pull(r); });
}

}  // namespace

extern const gms::Effect gms_effect_backlash;
const gms::Effect gms_effect_backlash = {
    "backlash",
    "Backlash",
    "mechanics",
    "A load of inertia J2 behind a coupling with play, free within a gap b: with r = q2 - q and x the part of r\n"
    "beyond -b/2 ... b/2, tau = k x + c dr/dt where that pushes the two apart, d c dr/dt elsewhere, and\n"
    "J2 dv2/dt = -tau - F2 sign(v2), at rest where F2 holds what pushes. k = J2 w^2, c = 2 zeta w J2, w = 2 pi f as in\n"
    "`flexible_coupling`; F2, the dry friction of the load, is J2 times the deceleration of one that coasts. J2 is a\n"
    "part of the axis's inertia J, and J - J2 moves with the joint. The motion of the load is exact between contacts. At\n"
    "the first sample it moves with the joint, anywhere in the gap. A load that rattles freely remembers each knock:\n"
    "only where the motion, or friction, presses it from side to side do measured positions say when it knocks.\n"
    "Source: Nordin and Gutman, Controlling mechanical systems with backlash - a survey, Automatica 38 (2002).",
    "The torque error follows acceleration, vanishes for a moment after each change of its sign, then knocks; where the\n"
    "load has friction of its own, that is missing after each reversal until the gap is crossed.",
    "Reversals at high acceleration, at several amplitudes around the gap.",
    {{"inertia", "kg m^2", 0, 0, gms::kInfinity, false, true, "J2, of the load, part of the axis's"},
     {"gap", "rad", gms::kUnset, 0, gms::kInfinity, false, true, "b, whole width of the play"},
     {"frequency", "Hz", gms::kUnset, 1e-3, gms::kInfinity, false, true, "f, resonance in contact, motor clamped"},
     {"damping", "1", 1, 0, 10, false, true, "zeta, relative to critical, in contact; 1: hardly a rebound"},
     {"drag", "1", 0, 0, 1, false, false, "d, drag in the gap over the damping in contact"},
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
