#include "hidden_body.h"

namespace {

constexpr double kFraction = 0.25;  // of 1/w, the longest stretch in which a contact is looked for once
constexpr int kMostStretches = 64;
constexpr int kMostContacts = 8;  // in one stretch; more is chatter within rounding
constexpr double kInstant = 1e-12;  // of a stretch, within which the instant of a contact is found
constexpr int kMostLooks = 200;     // for it: every fourth halves what is left

int n_state(int) { return gms::kHiddenState; }
int n_memory(int) { return 1; }

void recall(const double* p, int, const double* unknown, double* state) {
  state[gms::kDeflection] = unknown[0] * 0.5 * p[1];
  state[gms::kVelocity] = state[gms::kJointVelocity] = 0;
}

struct Coupling {
  double half, omega, zeta, lambda;  // half the gap; of the contact; drag in the gap over inertia

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

  gms::Relative after(int side, gms::Relative r, double a, double t) const {
    return side == 0 ? gms::Coast(lambda, t).from(r, a) : pressed(side, r, a, gms::Swing(omega, zeta, t));
  }

  gms::Relative pressed(int side, gms::Relative r, double a, const gms::Swing& swing) const {
    const double seat = side * half;
    r = swing.from({r.position - seat, r.velocity}, a);
    r.position += seat;
    return r;
  }

  bool beyond(int side, gms::Relative r) const {
    if (side != 0) return side * press(side, r) < 0;
    return std::fabs(r.position) > half && side_of(r) != 0;
  }

  // When a load at `r` comes to be beyond, where it is at `end` after t: just after, by Newton's steps to either side of
  // that instant, and by halves where they lead elsewhere.
  double until_beyond(int side, gms::Relative r, double a, double t, gms::Relative end) const {
    const double least = kInstant * t;
    double inside = 0, outside = t, now = t;
    for (int i = 1; i <= kMostLooks && outside - inside > least; i++) {
      const double p = press(side, end), v = end.velocity;
      const double within = side == 0 ? half - std::fabs(end.position) : side * p;
      const double rate = side == 0 ? -std::copysign(1, end.position) * v
                                    : side * omega * (omega * v - 2 * zeta * (a + p));
      now += (now == inside ? 0.25 : -0.25) * least - within / rate;
      if (i % 4 == 0 || !(now > inside && now < outside)) now = 0.5 * (inside + outside);
      end = after(side, r, a, now);
      (beyond(side, end) ? outside : inside) = now;
    }
    return outside;
  }

  // Over time t, exact between contacts, given what such a stretch does to a load that is free and to one in contact.
  gms::Relative stretch(gms::Relative r, double a, double t, const gms::Coast& coast, const gms::Swing& swing) const {
    for (int contact = 0; contact < kMostContacts && t > 0; contact++) {
      const int side = side_of(r);
      const gms::Relative end = contact > 0 ? after(side, r, a, t)
                                : side == 0 ? coast.from(r, a) : pressed(side, r, a, swing);
      if (!beyond(side, end)) return end;
      const bool crossing = side == 0 && std::fabs(r.position) <= half;
      const double passed = until_beyond(side, r, a, t, end);
      r = after(side, r, a, passed);
      if (crossing) r.position = std::copysign(half, r.position);
      t -= passed;
    }
    return r;
  }

  // A coarse step: backward Euler, continuous in the joint's velocity for the implicit step around it to solve. It
  // damps a contact so much that the damper is left out.
  gms::Relative leap(gms::Relative r, double t) const {
    for (int s = 1; s >= -1; s -= 2) {
      const double beyond = s * (r.position + t * r.velocity) - half;
      if (beyond > 0) r.velocity -= s * t * omega * omega * beyond / (1 + omega * omega * t * t);
    }
    return {r.position + t * r.velocity, r.velocity};
  }

  // Torque on the joint over the inertia of the load.
  double pull(gms::Relative r) const {
    const int side = side_of(r);
    return side == 0 ? lambda * r.velocity : press(side, r);
  }
};

double torque(const double* p, int, const gms::Motion& m, const gms::Level&, const double* state, double* next) {
  const double omega = gms::kTurn * p[2], zeta = p[3];
  const Coupling coupling{0.5 * p[1], omega, zeta, 2 * zeta * omega * p[4]};
  const auto move = [&](gms::Relative r, const gms::Course& course) {
    if (course.coarse) return coupling.leap(r, m.duration);
    const double wanted = std::ceil(omega * m.duration / kFraction);
    const int n = wanted < kMostStretches ? static_cast<int>(std::fmax(wanted, 1)) : kMostStretches;
    const double t = m.duration / n;
    const gms::Coast coast(coupling.lambda, t);
    const gms::Swing swing(omega, zeta, t);
    for (int i = 0; i < n; i++) r = coupling.stretch(r, course.acceleration, t, coast, swing);
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
    "beyond -b/2 ... b/2, tau = k x + c dr/dt where that pushes the two apart, d c dr/dt elsewhere, J2 dv2/dt = -tau.\n"
    "k = J2 w^2, c = 2 zeta w J2, w = 2 pi f as in `flexible_coupling`. J2 is a part of the axis's inertia J, and J - J2\n"
    "moves with the joint. The motion of the load is exact between contacts. At the first sample it moves with the\n"
    "joint, anywhere in the gap. A load that rattles freely remembers each knock: only where the motion presses it\n"
    "from side to side do measured positions say when it knocks.\n"
    "Source: Nordin and Gutman, Controlling mechanical systems with backlash - a survey, Automatica 38 (2002).",
    "The torque error follows acceleration, vanishes for a moment after each change of its sign, then knocks.",
    "Reversals at high acceleration, at several amplitudes around the gap.",
    {{"inertia", "kg m^2", 0, 0, gms::kInfinity, false, true, "J2, of the load, part of the axis's"},
     {"gap", "rad", gms::kUnset, 0, gms::kInfinity, false, true, "b, whole width of the play"},
     {"frequency", "Hz", gms::kUnset, 1e-3, gms::kInfinity, false, true, "f, resonance in contact, motor clamped"},
     {"damping", "1", 1, 0, 10, false, true, "zeta, relative to critical, in contact; 1: hardly a rebound"},
     {"drag", "1", 0, 0, 1, false, false, "d, drag in the gap over the damping in contact"}},
    n_state,
    n_memory,
    recall,
    nullptr,
    torque,
    nullptr,
    true,
    true,
};
