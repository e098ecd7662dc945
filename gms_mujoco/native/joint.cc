#include "joint.h"

#include <algorithm>

namespace gms {

const Effect* find_effect(const std::string& name) {
  for (int i = 0; i < kCatalogueSize; i++) {
    if (name == kCatalogue[i]->name) return kCatalogue[i];
  }
  return nullptr;
}

void Joint::add(const Effect* effect, int n, const double* p) {
  int size = 0;
  for (const Parameter& q : effect->parameters) {
    if (q.name) size += q.per_element ? n : 1;
  }
  uses_.push_back({effect, n, std::vector<double>(p, p + size), n_state_});
  if (effect->n_state) n_state_ += effect->n_state(n);
  if (effect->n_memory) n_memory_ += effect->n_memory(n);
}

void Joint::reset(double* state) const {
  state[0] = state[1] = std::nan("");
  std::fill(state + kAnchor, state + n_state_, 0.0);
}

void Joint::recall(const double* unknown, double* state) const {
  reset(state);
  for (const Use& use : uses_) {
    if (!use.effect->n_memory) continue;
    use.effect->recall(use.p.data(), use.n, unknown, state + use.state);
    unknown += use.effect->n_memory(use.n);
  }
}

double Joint::torque(const Sample& now, const double* state, double* next, double* parts) const {
  Motion motion{now.position, 0, now.velocity, 0, now.time, now.load, now.temperature};
  if (!std::isnan(state[0])) {
    motion.displacement = now.position - state[0];
    motion.duration = std::max(now.time - state[1], 0.0);
  }
  return torque(motion, state, next, parts);
}

double Joint::torque(const Motion& motion, const double* state, double* next, double* parts) const {
  double scratch[kMaxState];
  if (!next) next = scratch;
  next[0] = motion.position;
  next[1] = motion.time;

  Level level;
  for (const Use& use : uses_) {
    if (use.effect->modulate) use.effect->modulate(use.p.data(), use.n, motion, level);
  }
  double total = 0;
  for (size_t i = 0; i < uses_.size(); i++) {
    const Use& use = uses_[i];
    double part = 0;
    if (use.effect->torque) {
      part = use.effect->torque(use.p.data(), use.n, motion, level, state + use.state, next + use.state);
    }
    if (parts) parts[i] = part;
    total += part;
  }
  return total;
}

double Joint::implicit_torque(const Sample& now, const double* state, double h, double free_velocity,
                              double gain) const {
  constexpr double kTiny = 1e-150;  // displacement that has a direction and nothing else
  const bool fresh = std::isnan(state[0]);
  const double moved = fresh ? 0 : now.position - state[0];
  const double duration = (fresh ? 0 : std::max(now.time - state[1], 0.0)) + h;
  const auto force = [&](double v, double displacement) {
    const Motion motion{now.position + h * v, displacement, v, duration, now.time + h, now.load, now.temperature};
    return torque(motion, state, nullptr, nullptr);
  };

  // Friction can jump only where the displacement changes sign: look there first, from either side.
  const double still = -moved / h;
  double a = still, f_a = force(still, kTiny), g_a = a - free_velocity - gain * f_a;
  if (g_a > 0) {
    f_a = force(still, -kTiny);
    g_a = a - free_velocity - gain * f_a;
    if (g_a <= 0) return (still - free_velocity) / gain;  // holds
  }
  if (g_a == 0) return f_a;

  // Friction falls with velocity, so the root lies between `still` and b; where a Stribeck curve makes friction
  // rise, b has to move further out.
  double b = free_velocity + gain * f_a;
  double f_b = force(b, moved + h * b), g_b = b - free_velocity - gain * f_b;
  for (int i = 0; i < 60 && (g_b > 0) == (g_a > 0) && g_b != 0; i++) {
    a = b, f_a = f_b, g_a = g_b;
    b = still + 2 * (b - still);
    f_b = force(b, moved + h * b), g_b = b - free_velocity - gain * f_b;
  }

  // False position, Anderson and Bjorck's variant (BIT 13, 1973): keeps the bracket, converges superlinearly.
  const double tolerance = 1e-13 * (std::fabs(free_velocity - still) + std::fabs(b - still));
  for (int i = 0; i < 60 && std::fabs(g_b) > tolerance && std::fabs(b - a) > tolerance; i++) {
    const double c = b - g_b * (b - a) / (g_b - g_a);
    const double f_c = force(c, moved + h * c), g_c = c - free_velocity - gain * f_c;
    if ((g_c > 0) != (g_b > 0)) {
      a = b, f_a = f_b, g_a = g_b;
    } else {
      const double m = 1 - g_c / g_b;
      g_a *= m > 0 ? m : 0.5;
    }
    b = c, f_b = f_c, g_b = g_c;
  }
  return f_b;
}

double Joint::slope(double h) const {
  constexpr double kSmall = 1e-9;  // [rad or m], far below any break-away distance
  double state[kMaxState];
  reset(state);
  const double rest = torque(Motion{0, 0, 0, h, h, 0, 0}, state, nullptr, nullptr);
  double largest = 0;
  for (const double x : {kSmall, -kSmall}) {
    const double moving = torque(Motion{x, x, x / h, h, h, 0, 0}, state, nullptr, nullptr);
    largest = std::max(largest, std::fabs(moving - rest) * h / kSmall);
  }
  return largest;
}

}  // namespace gms
